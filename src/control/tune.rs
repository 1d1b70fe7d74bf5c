//! Gains for a largest sensitivity that holds over the whole delay range.
//!
//! Of all gains whose worst sensitivity, with the exact delay and sampled, stays within the wanted one, those that leave the
//! least of a disturbance that grows while the target moves, as a wrong curve makes it, together with what the controller
//! withholds because it may be noise. (M-constrained optimisation:
//! Astrom, Panagopoulos and Hagglund, Automatica 34 (1998), 585-601, who take the largest K_I; for a disturbance of the
//! pressure with most of it in the dead time some K_I is worth giving for K_P.)

use super::Gains;
use super::significance::ENDS;
use super::stability::margins::delays;
use super::stability::sampled::SampledLoop;
use super::stability::{LoopPlant, exact};

/// What is tuned, and for what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TuningTask {
    /// Gain, lag and nominal delay.
    pub plant: LoopPlant,
    /// Range of the delay over which the sensitivity must hold [s].
    pub delay_range_s: (f64, f64),
    /// Largest allowed sensitivity; above 1.
    pub max_sensitivity: f64,
    /// Loop rate [Hz].
    pub rate_hz: f64,
    /// Standard deviation of the sensor's noise, as a share of the disturbances that are worth removing.
    pub noise_share: f64,
}

/// A disturbance of the pressure that is worth removing: what the paper's model is off on its valve, Fig. 7 [bar].
pub const DISTURBANCE_BAR: f64 = 0.2;

/// How the feedback is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// A PI on the measured pressure.
    Pi,
    /// A PI with Smith's predictor, which believes in the nominal delay.
    Smith,
}

impl Form {
    fn closed(self, task: &TuningTask, delay_s: f64, gains: Gains) -> SampledLoop {
        let plant = LoopPlant { delay_s, ..task.plant };
        match self {
            Self::Pi => SampledLoop::new(&plant, gains, task.rate_hz),
            Self::Smith => SampledLoop::with_predictor(&plant, &task.plant, gains, task.rate_hz),
        }
    }

    /// Whether the continuous loop of this delay keeps the sensitivity, too; a predictor exists sampled only.
    fn holds_exactly(self, task: &TuningTask, delay_s: f64, gains: Gains) -> bool {
        match self {
            Self::Pi => {
                let exact = exact::margins(&LoopPlant { delay_s, ..task.plant }, gains);
                exact.stable && exact.max_sensitivity.is_some_and(|m| m <= task.max_sensitivity)
            }
            Self::Smith => true,
        }
    }
}

/// Duration of the disturbance that gains are judged by [s]: what a curve that is off does while the target moves in a shift.
const DISTURBANCE_S: f64 = 0.3;
/// Time over which its response is judged [s].
const JUDGED_S: f64 = 3.0;

/// Gains that keep the task's sensitivity and leave the least of a disturbance, in the mean over the delay range; `None` where
/// no K_I > 0 keeps it.
pub fn tune(task: &TuningTask) -> Option<Gains> {
    tune_as(task, Form::Pi)
}

/// As [`tune`], for feedback of another form.
pub fn tune_as(task: &TuningTask, form: Form) -> Option<Gains> {
    // K_P on a coarse grid up to the exact limit, then finer around the best.
    let limit = exact::boundary(&task.plant, 2).last().map_or(2.0 / task.plant.gain_bar_per_ma, |p| p.0);
    let (mut low, mut high) = (0.0, limit);
    let mut best: Option<(f64, Gains)> = None;
    for steps in [16, 8, 8] {
        let step = (high - low) / f64::from(steps);
        for i in 0..=steps {
            let kp_ma_per_bar = low + step * f64::from(i);
            let Some(ki_ma_per_bar_s) = largest_ki(task, form, kp_ma_per_bar, 1e-3 * limit) else { continue };
            let gains = Gains { kp_ma_per_bar, ki_ma_per_bar_s };
            let left = left_as(task, form, gains);
            if best.is_none_or(|b| left < b.0) {
                best = Some((left, gains));
            }
        }
        let center = best?.1.kp_ma_per_bar;
        (low, high) = ((center - step).max(0.0), center + step);
    }
    best.map(|b| b.1)
}

/// Mean square of what is left of a disturbance of the pressure that rises in a straight line and stays, over both ends and the
/// middle of the delay range, with the square of the correction that may be noise and is withheld.
pub fn left(task: &TuningTask, gains: Gains) -> f64 {
    left_as(task, Form::Pi, gains)
}

/// As [`left`], for feedback of another form.
pub fn left_as(task: &TuningTask, form: Form, gains: Gains) -> f64 {
    let (low, high) = task.delay_range_s;
    let samples = (JUDGED_S * task.rate_hz) as usize;
    let disturbance: Vec<f64> = (0..samples).map(|k| (k as f64 / task.rate_hz / DISTURBANCE_S).min(1.0)).collect();
    let at = |delay_s: f64| {
        let closed = form.closed(task, delay_s, gains);
        let withheld = match form {
            Form::Pi if task.noise_share > 0.0 => ENDS * task.noise_share * task.plant.gain_bar_per_ma * closed.noise_gain(gains),
            Form::Pi | Form::Smith => 0.0,
        };
        closed.left_of(&disturbance).iter().map(|e| e * e).sum::<f64>() / samples as f64 + withheld * withheld
    };
    [low, 0.5 * (low + high), high].into_iter().map(at).sum::<f64>() / 3.0
}

/// Whether the worst sensitivity over the delay range stays within the task's.
pub fn holds(task: &TuningTask, gains: Gains) -> bool {
    holds_as(task, Form::Pi, gains)
}

fn holds_as(task: &TuningTask, form: Form, gains: Gains) -> bool {
    // The long end of the range decides nearly always: look there first.
    delays(task.delay_range_s).into_iter().rev().all(|delay_s| {
        let sampled = form.closed(task, delay_s, gains);
        sampled.stable() && sampled.max_sensitivity().is_some_and(|m| m <= task.max_sensitivity) && form.holds_exactly(task, delay_s, gains)
    })
}

/// The largest K_I at this K_P, from `from` on.
fn largest_ki(task: &TuningTask, form: Form, kp: f64, from: f64) -> Option<f64> {
    let at = |ki: f64| holds_as(task, form, Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: ki });
    if !at(from) {
        return None;
    }
    let (mut low, mut high) = (from, from * 8.0);
    while at(high) && high < from * 1e9 {
        (low, high) = (high, high * 8.0);
    }
    for _ in 0..16 {
        let middle = (low * high).sqrt();
        if at(middle) { low = middle } else { high = middle }
    }
    Some(low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::stability::margins;

    const TASK: TuningTask = TuningTask {
        plant: LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.02 },
        delay_range_s: (0.01, 0.03),
        max_sensitivity: 1.4,
        rate_hz: 100.0,
        noise_share: 0.0,
    };

    #[test]
    fn the_sensitivity_is_used_up_at_the_worst_delay() {
        let gains = tune(&TASK).unwrap();
        let found = margins(&TASK.plant, TASK.delay_range_s, gains, TASK.rate_hz).unwrap().worst_over_delay_range;
        let worst = found.max_sensitivity.unwrap().max(found.sampled.max_sensitivity.unwrap());
        assert!(worst <= 1.4 && worst > 1.39, "{worst} with {gains:?}");
        // The paper's gains use far less.
        assert!(gains.ki_ma_per_bar_s > 10.0 * Gains::PAPER.ki_ma_per_bar_s);
    }

    #[test]
    fn no_gains_of_the_same_sensitivity_leave_less() {
        use crate::control::rules::RULES;
        for (lag_s, noise_share) in [(0.0, 0.0), (0.01, 0.0), (0.045, 0.0), (0.01, 0.1), (0.045, 0.25)] {
            let task = TuningTask { plant: LoopPlant { lag_s, ..TASK.plant }, noise_share, ..TASK };
            let ours = left(&task, tune(&task).unwrap());
            for rule in RULES {
                let theirs = left(&task, rule.tuned(&task).unwrap());
                assert!(ours <= 1.002 * theirs, "lag {lag_s}, {rule:?}: {ours} against {theirs}");
            }
        }
    }

    /// The predictor believes in the middle of the range; what it gains is small, known delay or not (docs/control.md).
    #[test]
    fn a_predictor_gains_some_percent() {
        for half_width_s in [0.0, 0.01] {
            let task = TuningTask { delay_range_s: (0.02 - half_width_s, 0.02 + half_width_s), ..TASK };
            let of = |form| left_as(&task, form, tune_as(&task, form).unwrap()).sqrt();
            let ratio = of(Form::Smith) / of(Form::Pi);
            assert!((0.85..0.99).contains(&ratio), "{half_width_s}: {ratio}");
        }
    }

    #[test]
    fn noise_makes_the_proportional_gain_smaller() {
        let (quiet, noisy) = (tune(&TASK).unwrap(), tune(&TuningTask { noise_share: 0.2, ..TASK }).unwrap());
        assert!(noisy.kp_ma_per_bar < 0.8 * quiet.kp_ma_per_bar, "{quiet:?} {noisy:?}");
    }

    #[test]
    fn more_sensitivity_gives_more_integral_gain_and_more_delay_less() {
        let ki = |task: &TuningTask| tune(task).unwrap().ki_ma_per_bar_s;
        let base = ki(&TASK);
        assert!(ki(&TuningTask { max_sensitivity: 1.7, ..TASK }) > base);
        assert!(ki(&TuningTask { delay_range_s: (0.01, 0.06), ..TASK }) < base);
    }

    #[test]
    fn no_gains_for_a_sensitivity_of_one() {
        assert_eq!(tune(&TuningTask { max_sensitivity: 1.0, ..TASK }), None);
    }
}
