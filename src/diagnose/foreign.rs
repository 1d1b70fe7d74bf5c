//! A base that is not ours: a user's own simulation, which the diagnosis can run again or has once for all.
//!
//! Nothing inside it can be fitted. It is recalibrated by gain, zero and delay only; effects are attached behind it, and
//! ahead of it where it can be run again with another command.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::base::AT;
use super::error::DiagnoseError;
use crate::course::Run;
use crate::physics::{Effect, Pipeline, Stage, signals};
use crate::valve::{EffectSpec, Hysteresis, Input, Polynomial, ReferenceCurves, Valve};

/// A base that takes longer than this for one run is not run again: the effects ahead of it take some thousand runs.
const RERUN: Duration = Duration::from_millis(300);
/// Most samples that are kept of runs with other commands: 256 MB.
const KEPT: usize = 32 << 20;

/// A model that is not ours.
pub trait Plant: Debug + Send + Sync {
    /// The pressure [bar] at each sample of the run, for this current [A] in place of the recorded one.
    ///
    /// # Errors
    /// What the model refused, in words.
    fn pressure(&self, run: &Run, current_a: &[f64]) -> Result<Vec<f64>, String>;
    /// Whether it can be run with another command than the recorded one.
    fn runs_again(&self) -> bool;
}

/// How the pressure of a foreign model is read: gain times its pressure, delayed, plus the zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recalibration {
    /// Gain.
    pub gain: f64,
    /// Zero [bar].
    pub zero_bar: f64,
    /// Delay [s]; negative where the model is later than the valve.
    pub delay_s: f64,
}

impl Default for Recalibration {
    fn default() -> Self {
        Self { gain: 1.0, zero_bar: 0.0, delay_s: 0.0 }
    }
}

/// A foreign model with what is known to be missing in it.
#[derive(Debug, Clone)]
pub struct Foreign {
    /// Name, for the words.
    pub name: String,
    /// The model.
    pub plant: Arc<dyn Plant>,
    /// How it is read.
    pub recalibration: Recalibration,
    /// Effects that stand about it already.
    pub effects: Vec<EffectSpec>,
}

/// A foreign model on the runs of some evidence.
#[derive(Debug, Clone)]
pub struct Base {
    plant: Arc<dyn Plant>,
    given: Recalibration,
    /// How it is read now: as given, or as the good valve shows it.
    read: Recalibration,
    /// Its own pressure for the recorded current, run by run [bar].
    recorded_bar: Vec<Arc<Vec<f64>>>,
    runs_again: bool,
    again: Arc<Mutex<Again>>,
}

/// Runs with other commands, the latest last, and the first refusal.
#[derive(Debug, Default)]
struct Again {
    kept: VecDeque<(Vec<u64>, Arc<Vec<f64>>)>,
    samples: usize,
    refused: Option<String>,
}

impl Base {
    /// Runs the model on these runs; also the valve that stands for it where the diagnosis asks for ranges, and what is to be noted.
    ///
    /// # Errors
    /// [`DiagnoseError::Foreign`] where the model refuses.
    pub fn on(runs: &[Run], foreign: &Foreign) -> Result<(Self, Valve, Vec<String>), DiagnoseError> {
        let begun = Instant::now();
        let run = |run: &Run| foreign.plant.pressure(run, &run.current_a).map(Arc::new);
        let recorded_bar: Vec<_> = runs.iter().map(run).collect::<Result<_, _>>().map_err(|problem| foreign.refused(problem))?;
        let took = begun.elapsed();
        let runs_again = foreign.plant.runs_again() && took <= RERUN;
        let mut notes =
            vec!["the base is a foreign model: it is recalibrated by gain, zero and delay only, and nothing inside it is fitted".into()];
        if !runs_again {
            let why = if foreign.plant.runs_again() {
                format!("one run of it takes {:.1} s", took.as_secs_f64())
            } else {
                "it is known for the recorded current only".into()
            };
            notes.push(format!("effects ahead of the base (coil, friction and play of the spool) are not looked for: {why}"));
        }
        let (given, read) = (foreign.recalibration, foreign.recalibration);
        let base = Self { plant: foreign.plant.clone(), given, read, recorded_bar, runs_again, again: Arc::default() };
        let valve = foreign.stand_in(runs, &base);
        Ok((base, valve, notes))
    }

    /// Whether an effect can be tried about this base.
    pub fn carries(&self, effect: &dyn Effect) -> bool {
        self.runs_again || matches!(effect.stage(), Stage::Delay) || effect.stage() >= Stage::Static
    }

    /// The base's pressure as it is read on run number `k` [bar].
    pub fn as_read(&self, k: usize, dt_s: f64) -> Vec<f64> {
        let p = delayed(&self.recorded_bar[k], self.read.delay_s / dt_s);
        p.into_iter().map(|p| self.read.gain * p + self.read.zero_bar).collect()
    }

    /// What `theta` makes of the recalibration.
    pub fn recalibration(&self, theta: &[f64]) -> Recalibration {
        let gain = 1.0 + theta[AT.gain];
        Recalibration {
            gain: gain * self.read.gain,
            zero_bar: gain * self.read.zero_bar + theta[AT.offset],
            delay_s: self.read.delay_s + theta[AT.late],
        }
    }

    /// From now on the base is read in another way.
    pub fn read_as(&mut self, read: Recalibration) {
        self.read = read;
    }

    /// How it is read now.
    pub fn read(&self) -> Recalibration {
        self.read
    }

    /// Moves `theta` to where the base is read as it was given.
    pub fn undo(&self, theta: &mut [f64]) {
        let gain = self.given.gain / self.read.gain;
        theta[AT.gain] = gain - 1.0;
        theta[AT.offset] = self.given.zero_bar - gain * self.read.zero_bar;
        theta[AT.late] = self.given.delay_s - self.read.delay_s;
    }

    /// The first refusal of a run with another command.
    pub fn refused(&self) -> Option<String> {
        self.again.lock().map_or(None, |again| again.refused.clone())
    }

    /// Pressure with the effects about the base on all runs, one after the other [bar].
    pub fn pressure(&self, runs: &[Run], pipeline: Pipeline<'_>, theta: &[f64], out: &mut Vec<f64>) {
        let read = self.recalibration(theta);
        let late_s = read.delay_s + pipeline.effects.iter().map(|(e, values)| e.dead_time_s(values)).sum::<f64>();
        let input = pipeline.input;
        // Between its samples nothing is known of a foreign pressure but that it goes from one to the next.
        let behind = Pipeline { input: Input::Ramp, ..pipeline };
        out.clear();
        for (k, grid) in runs.iter().enumerate() {
            let signals = signals(grid);
            let (at_curve, pressure) = if behind.acts_ahead(grid.elapsed_s, grid.dt_s) {
                let ahead = Pipeline { input, effects: behind.effects.clone(), ..behind }.ahead(grid.elapsed_s, grid.dt_s, &signals);
                let pressure = self.again(k, grid, &ahead);
                (Some(ahead), pressure)
            } else {
                (None, self.recorded_bar[k].clone())
            };
            let late = late_s / grid.dt_s;
            let current_a = delayed(at_curve.as_ref().unwrap_or(&grid.current_a), late);
            let mut p: Vec<f64> = delayed(&pressure, late).into_iter().map(|p| read.gain * p + read.zero_bar).collect();
            behind.behind(grid.elapsed_s, grid.dt_s, &signals.with_current(&current_a), &mut p);
            grid.at_readings(&mut p);
            out.extend(p);
        }
    }

    /// The model's pressure for another command: kept from before, or run again. After a refusal that of the recorded
    /// command; the diagnosis then ends with the refusal.
    fn again(&self, k: usize, grid: &Run, current_a: &[f64]) -> Arc<Vec<f64>> {
        let key: Vec<u64> = std::iter::once(k as u64).chain(current_a.iter().map(|i| i.to_bits())).collect();
        let Ok(again) = self.again.lock() else { return self.recorded_bar[k].clone() };
        if again.refused.is_some() {
            return self.recorded_bar[k].clone();
        }
        if let Some(at) = again.kept.iter().rposition(|(have, _)| *have == key) {
            return again.kept[at].1.clone();
        }
        drop(again);
        let found = self.plant.pressure(grid, current_a);
        let Ok(mut again) = self.again.lock() else { return self.recorded_bar[k].clone() };
        match found {
            Ok(pressure) => {
                let pressure = Arc::new(pressure);
                again.samples += pressure.len();
                again.kept.push_back((key, pressure.clone()));
                while again.samples > KEPT / 2 {
                    let Some((_, oldest)) = again.kept.pop_front() else { break };
                    again.samples -= oldest.len();
                }
                pressure
            }
            Err(problem) => {
                again.refused.get_or_insert(problem);
                self.recorded_bar[k].clone()
            }
        }
    }
}

impl Foreign {
    pub(super) fn refused(&self, problem: String) -> DiagnoseError {
        DiagnoseError::Foreign { model: self.name.clone(), problem }
    }

    /// A valve with the ranges of the base: the straight line nearest to its pressure over the current.
    fn stand_in(&self, grids: &[Run], base: &Base) -> Valve {
        let points = || grids.iter().enumerate().flat_map(|(k, g)| g.current_a.iter().copied().zip(base.as_read(k, g.dt_s)));
        let (n, i, p) = points().fold((0.0, 0.0, 0.0), |(n, si, sp), (i, p)| (n + 1.0, si + i, sp + p));
        let (mean_a, mean_bar) = (i / f64::max(n, 1.0), p / f64::max(n, 1.0));
        let (square, product) = points().fold((0.0, 0.0), |(a, b), (i, p)| (a + (i - mean_a).powi(2), b + (i - mean_a) * (p - mean_bar)));
        let slope = product / f64::max(square, 1e-300);
        let range_a = points().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (i, _)| (l.min(i), h.max(i)));
        let line = || Polynomial::new(vec![slope, mean_bar - slope * mean_a]);
        Valve {
            name: self.name.clone(),
            source: String::new(),
            curves: ReferenceCurves::on_range(line(), line(), range_a),
            hysteresis: Hysteresis::None,
            delay_s: 0.0,
            delay_range_s: (0.0, 0.0),
            lag_s: 0.0,
            current_limits_a: range_a,
            floor_bar: None,
            noise_bar: 0.0,
            effects: self.effects.clone(),
            identification: None,
        }
    }
}

/// A signal so many samples later, on straight lines; at its ends it stands.
fn delayed(values: &[f64], samples: f64) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    if samples == 0.0 || values.is_empty() {
        return values.to_vec();
    }
    let at = |k: usize| {
        let x = (k as f64 - samples).clamp(0.0, last as f64);
        let (whole, part) = (x as usize, x.fract());
        values[whole] + part * (values[(whole + 1).min(last)] - values[whole])
    };
    (0..values.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::delayed;

    #[test]
    fn a_delay_reads_between_the_samples_on_both_sides() {
        let ramp = [0.0, 1.0, 2.0, 3.0];
        assert_eq!(delayed(&ramp, 1.5), [0.0, 0.0, 0.5, 1.5]);
        assert_eq!(delayed(&ramp, -1.5), [1.5, 2.5, 3.0, 3.0]);
        assert_eq!(delayed(&ramp, 0.0), ramp);
        assert!(delayed(&[], 3.0).is_empty());
    }
}
