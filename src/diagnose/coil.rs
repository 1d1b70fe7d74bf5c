//! Before or behind the coil current: where that current was measured, it parts the valve from what drives it.
//!
//! The model without further effects is calibrated anew with the measured current in place of the command. What it then still
//! misses arises behind the coil current, in magnet, spool, oil or sensor; what is gone with it came from before: a message, a
//! driver, a coil.

use serde::{Deserialize, Serialize};

use super::evidence::Evidence;
use super::fit::{Fit, Fitter};
use super::model::Model;
use super::search::recalibrated;
use super::settled;
use crate::course::{Course, Input, Noise, Preparation};
use crate::recording::Recording;

/// Share of the samples at which the current has to be measured.
const MEASURED: f64 = 0.9;
/// Reach of the play that noise of one standard deviation cannot cross.
const PLAY: f64 = 3.0;
/// A measured current that never differs by more than this from the command is the command [A].
const SAME_A: f64 = 1e-6;

/// On which side of the coil current lies what is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// With the measured current nearly nothing is missing.
    Before,
    /// With the measured current as much is missing.
    Behind,
    /// With the measured current less is missing.
    Both,
}

/// What the measured coil current says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CoilCurrent {
    /// Where what is missing lies.
    pub missing: Side,
    /// RMSE of the calibrated model, without further effects, driven by the command [bar].
    pub rmse_command_bar: f64,
    /// The same driven by the measured current [bar].
    pub rmse_measured_bar: f64,
}

impl CoilCurrent {
    /// What it means, for a reader.
    pub fn text(&self) -> String {
        let place = match self.missing {
            Side::Before => "what is missing lies before it, between command and current (message, driver, coil)",
            Side::Behind => "what is missing lies behind it (magnet, spool, oil, sensor)",
            Side::Both => {
                "a part of what is missing lies before it (message, driver, coil), the rest behind it (magnet, spool, oil, sensor)"
            }
        };
        format!(
            "By the measured coil current {place}: the calibrated model is off by {:.3} bar RMSE with the command and by {:.3} bar with the measured current.",
            self.rmse_command_bar, self.rmse_measured_bar
        )
    }
}

/// Compares the calibrated model `null`, driven by the command, with the same driven by the measured current. `None` where that
/// was not recorded, is no current of this coil, or the base misses no more than the floor.
pub fn coil_current(recording: &Recording, fitter: &Fitter<'_>, null: &Fit<'_>) -> Option<CoilCurrent> {
    let missing = |rmse_bar: f64| rmse_bar.powi(2) - fitter.floor_bar.powi(2);
    let before = missing(null.rmse_bar);
    if before <= fitter.floor_bar.powi(2) || fitter.evidence.base.is_some() {
        return None;
    }
    let driven = by_measured(recording)?;
    let valve = null.model.valve;
    let mut evidence =
        Evidence::of(Course::take(driven, &Preparation { input: Some(Input::Ramp), ..Preparation::default() }).ok()?).ok()?;
    let base = Model::base(valve).ok()?.on(&evidence);
    let base = if evidence.is_slow() { base.of_process(evidence.step_s()) } else { base };
    let unsettled = settled::unsettled(&mut evidence, &base);
    let by_measured = Fitter::without(&evidence, &unsettled).trusting(fitter.trust.clone());
    let (fit, _) = recalibrated(&by_measured, base);
    // A channel with which the model fits worse is not the current of this coil, or not in this unit.
    if fit.rmse_bar > fitter.criteria.recalibrates * null.rmse_bar {
        return None;
    }
    let gone = 1.0 - missing(fit.rmse_bar).max(0.0) / before;
    let (explains, structure) = (fitter.criteria.explains, fitter.criteria.structure);
    let missing = if gone >= explains && fit.rmse_bar <= structure * fitter.floor_bar {
        Side::Before
    } else if gone <= 1.0 - explains {
        Side::Behind
    } else {
        Side::Both
    };
    let (rmse_command_bar, rmse_measured_bar) = (fitter.plain_rmse_bar(null), by_measured.plain_rmse_bar(&fit));
    Some(CoilCurrent { missing, rmse_command_bar, rmse_measured_bar })
}

/// The recording with the measured current in place of the command, its noise followed by a play: to the hysteresis of a valve
/// each reversal of it would be one of the spool.
fn by_measured(recording: &Recording) -> Option<Recording> {
    if recording.runs.iter().any(|run| run.current_meas_a.is_none()) {
        return None;
    }
    let mut driven = recording.clone();
    let (mut all, mut known, mut apart_a) = (0usize, 0usize, 0.0f64);
    for run in &mut driven.runs {
        let mut measured = run.current_meas_a.take()?;
        let reach_a = PLAY * Noise::deviation(&measured);
        follow(&mut measured, reach_a);
        for (command, current) in run.current_a.iter_mut().zip(measured).filter(|(command, _)| command.is_finite()) {
            all += 1;
            if current.is_finite() {
                known += 1;
                apart_a = apart_a.max((current - *command).abs());
                *command = current;
            }
        }
    }
    (known as f64 >= MEASURED * all as f64 && apart_a > SAME_A).then_some(driven)
}

/// Lets the signal move only where it has left its last value by more than `reach_a`.
fn follow(signal_a: &mut [f64], reach_a: f64) {
    let mut last = f64::NAN;
    for value in signal_a.iter_mut().filter(|v| v.is_finite()) {
        last = if last.is_nan() { *value } else { last.clamp(*value - reach_a, *value + reach_a) };
        *value = last;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Run;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    #[test]
    fn a_measured_current_in_coarse_steps_does_not_turn_where_it_flickers() {
        let random = &mut rand_pcg::Pcg64::seed_from_u64(5);
        let noise = Normal::new(0.0, 1.5e-4).unwrap();
        let command: Vec<f64> = (0..4000).map(|k| 0.4 + 5e-5 * f64::from(k)).collect();
        let measured: Vec<f64> = command.iter().map(|i| ((i + noise.sample(random)) * 1e3).round() / 1e3).collect();
        let falls = |current: &[f64]| current.windows(2).filter(|w| w[1] < w[0]).count();
        assert!(falls(&measured) > 100);
        let time_s = (0..command.len()).map(|k| k as f64 * 0.01).collect();
        let run = Run { time_s, current_a: command, current_meas_a: Some(measured), ..Run::default() };
        let recording = Recording { source: "steps.csv".into(), runs: vec![run], notes: Vec::new(), input: None };
        assert_eq!(falls(&by_measured(&recording).unwrap().runs[0].current_a), 0);
    }
}
