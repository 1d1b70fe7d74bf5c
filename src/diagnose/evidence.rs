//! The recording made ready for fits: even grids, gaps marked, the sensor noise measured.

use super::DiagnoseError;
use crate::recording::{Recording, Run};

/// Fewest usable samples in all.
const FEWEST_SAMPLES: usize = 200;

/// A recording with this step or a longer one shows a process [s].
const SLOW_STEP_S: f64 = 0.25;
/// A current that moves in fewer samples than this share is one of steps.
const STEPS: f64 = 0.05;

/// One run on an even grid.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Name of the run.
    pub name: Option<String>,
    /// Time of the first sample [s].
    pub start_s: f64,
    /// Time step [s].
    pub dt_s: f64,
    /// Command [A], gaps held.
    pub current_a: Vec<f64>,
    /// Measured pressure [bar]; NaN where it was not recorded or is masked.
    pub pressure_bar: Vec<f64>,
}

impl Grid {
    /// Time of sample `k` [s].
    pub fn time_s(&self, k: usize) -> f64 {
        self.start_s + k as f64 * self.dt_s
    }
}

/// All that a fit looks at.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The runs, each simulated from its own start.
    pub grids: Vec<Grid>,
    /// Standard deviation of the sensor noise, from the second differences of the pressure [bar].
    pub noise_bar: f64,
    /// What was noticed.
    pub notes: Vec<String>,
}

impl Evidence {
    /// Prepares a recording.
    ///
    /// # Errors
    /// [`DiagnoseError`] where the recording cannot carry a diagnosis: no pressure, a constant current, too short.
    pub fn of(recording: &Recording) -> Result<Self, DiagnoseError> {
        let refuse = |problem: String| DiagnoseError::Recording { source_name: recording.source.clone(), problem };
        let mut notes = recording.notes.clone();
        let mut grids = Vec::new();
        for run in &recording.runs {
            let Some(pressure) = &run.pressure_bar else {
                return Err(refuse("has no channel `pressure_bar`; name the measured one with --map pressure_bar=..".into()));
            };
            if run.len() < 20 {
                notes.push(format!("run {} has {} samples only and is left out", run.name.as_deref().unwrap_or("(nameless)"), run.len()));
                continue;
            }
            grids.push(even(run, pressure, &mut notes));
        }
        let used: usize = grids.iter().map(|g| g.pressure_bar.iter().filter(|p| p.is_finite()).count()).sum();
        if used < FEWEST_SAMPLES {
            return Err(refuse(format!("holds {used} usable samples; a diagnosis wants at least {FEWEST_SAMPLES}")));
        }
        let spread = |values: &dyn Fn(&Grid) -> Vec<f64>| {
            let all: Vec<f64> = grids.iter().flat_map(values).filter(|v| v.is_finite()).collect();
            all.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b)) - all.iter().fold(f64::INFINITY, |a, b| a.min(*b))
        };
        let current_span = spread(&|g| g.current_a.clone());
        if current_span <= 0.0 {
            return Err(refuse("holds a constant current: without excitation nothing can be told apart".into()));
        }
        let noise_bar = noise(&grids);
        Ok(Self { grids, noise_bar, notes })
    }

    /// Why this cannot be a recording of this valve: current or pressure of another order of magnitude.
    pub fn mismatch(&self, valve: &crate::valve::Valve) -> Option<String> {
        let most = |values: &dyn Fn(&Grid) -> &[f64]| {
            self.grids.iter().flat_map(|g| values(g).iter()).filter(|v| v.is_finite()).fold(0.0, |a: f64, b| a.max(b.abs()))
        };
        let (current, pressure) = (most(&|g| &g.current_a), most(&|g| &g.pressure_bar));
        let limit = valve.current_limits_a.1.abs().max(valve.current_limits_a.0.abs());
        if current > 20.0 * limit {
            return Some(format!(
                "the current reaches {current} A, but the valve takes at most {limit} A; is the channel in mA? (--map current_a=\"NAME [mA]\")"
            ));
        }
        if current < 0.01 * limit {
            return Some(format!(
                "the current stays below {current} A, a hundredth of the valve's {limit} A: wrong unit, or no excitation"
            ));
        }
        let (low, high) = valve.curves.pressure_range_bar();
        let reach = low.abs().max(high.abs());
        if pressure > 30.0 * reach {
            return Some(format!(
                "the pressure reaches {pressure} bar, the model {reach:.1} bar; is the channel in another unit? (--map pressure_bar=\"NAME [kPa]\")"
            ));
        }
        None
    }

    /// Whether the current rests but for steps.
    pub fn is_of_steps(&self) -> bool {
        let all = || self.grids.iter().flat_map(|g| g.current_a.iter());
        let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), i| (l.min(*i), h.max(*i)));
        let moves = self.grids.iter().flat_map(|g| g.current_a.windows(2)).filter(|w| (w[1] - w[0]).abs() > 1e-3 * (high - low)).count();
        (moves as f64) < STEPS * self.samples() as f64
    }

    /// Whether the samples are too far apart for a valve's dynamics, so that a process behind the valve is what they show.
    pub fn is_slow(&self) -> bool {
        self.grids[0].dt_s >= SLOW_STEP_S
    }

    /// Samples in all, used or not.
    pub fn samples(&self) -> usize {
        self.grids.iter().map(|g| g.current_a.len()).sum()
    }

    /// The measured pressures of all runs, one after the other.
    pub fn pressure_bar(&self) -> Vec<f64> {
        self.grids.iter().flat_map(|g| g.pressure_bar.iter().copied()).collect()
    }
}

/// The run on a grid of its mean step; a time step that varies is interpolated.
fn even(run: &Run, pressure: &[f64], notes: &mut Vec<String>) -> Grid {
    let n = run.len();
    let median = run.step_s();
    let uneven = run.time_s.windows(2).filter(|w| ((w[1] - w[0]) / median - 1.0).abs() > 0.05).count();
    let mut last = run.current_a.iter().copied().find(|i| i.is_finite()).unwrap_or(0.0);
    let held: Vec<f64> = run
        .current_a
        .iter()
        .map(|i| {
            if i.is_finite() {
                last = *i;
            }
            last
        })
        .collect();
    let span = run.time_s[n - 1] - run.time_s[0];
    if uneven == 0 {
        let dt_s = span / (n - 1) as f64;
        return Grid { name: run.name.clone(), start_s: run.time_s[0], dt_s, current_a: held, pressure_bar: pressure.to_vec() };
    }
    notes.push(format!("{uneven} time steps differ from the median of {median:.4} s; the run is interpolated to an even grid"));
    // A gap longer than three steps stays a gap in the pressure.
    let count = ((span / median).floor() as usize + 1).min(4 * n + 1000);
    let mut k = 0;
    let mut current_a = Vec::with_capacity(count);
    let mut pressure_bar = Vec::with_capacity(count);
    for j in 0..count {
        let t = run.time_s[0] + j as f64 * median;
        while k + 2 < n && run.time_s[k + 1] <= t {
            k += 1;
        }
        let width = run.time_s[k + 1] - run.time_s[k];
        let share = ((t - run.time_s[k]) / width).clamp(0.0, 1.0);
        current_a.push(held[k] + share * (held[k + 1] - held[k]));
        pressure_bar.push(if width > 3.5 * median { f64::NAN } else { pressure[k] + share * (pressure[k + 1] - pressure[k]) });
    }
    Grid { name: run.name.clone(), start_s: run.time_s[0], dt_s: median, current_a, pressure_bar }
}

/// Median absolute second difference over the runs, scaled to a standard deviation: blind to slow courses and to
/// rare events. A reading in coarse steps has at least the noise of its steps.
fn noise(grids: &[Grid]) -> f64 {
    let mut differences: Vec<f64> =
        grids.iter().flat_map(|g| g.pressure_bar.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs())).filter(|d| d.is_finite()).collect();
    if differences.is_empty() {
        return 0.0;
    }
    let middle = differences.len() / 2;
    let median = *differences.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Variance of the second difference of white noise is 6 sigma^2; median of |normal| is 0.6745 sigma.
    let sigma = median / 0.6745 / 6f64.sqrt();
    let mut values: Vec<f64> = grids.iter().flat_map(|g| g.pressure_bar.iter().copied()).filter(|p| p.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let step = values.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-9).fold(f64::INFINITY, f64::min);
    sigma.max(if step.is_finite() { step / 12f64.sqrt() } else { 0.0 }).max(1e-6)
}
