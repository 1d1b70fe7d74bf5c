//! Gains for a largest sensitivity that holds over the whole delay range.
//!
//! Of all gains whose worst sensitivity, with the exact delay and sampled, stays within the wanted one, those that leave the
//! least of a disturbance that grows while the target moves, as a wrong curve makes it. (M-constrained optimisation:
//! Astrom, Panagopoulos and Hagglund, Automatica 34 (1998), 585-601, who take the largest K_I; for a disturbance of the
//! pressure with most of it in the dead time some K_I is worth giving for K_P.)

use super::Gains;
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
}

/// Duration of the disturbance that gains are judged by [s]: what a curve that is off does while the target moves in a shift.
const DISTURBANCE_S: f64 = 0.3;
/// Time over which its response is judged [s].
const JUDGED_S: f64 = 3.0;

/// Gains that keep the task's sensitivity and leave the least of a disturbance, in the mean over the delay range; `None` where
/// no K_I > 0 keeps it.
pub fn tune(task: &TuningTask) -> Option<Gains> {
    // K_P on a coarse grid up to the exact limit, then finer around the best.
    let limit = exact::boundary(&task.plant, 2).last().map_or(2.0 / task.plant.gain_bar_per_ma, |p| p.0);
    let (mut low, mut high) = (0.0, limit);
    let mut best: Option<(f64, Gains)> = None;
    for steps in [16, 8, 8] {
        let step = (high - low) / f64::from(steps);
        for i in 0..=steps {
            let kp_ma_per_bar = low + step * f64::from(i);
            let Some(ki_ma_per_bar_s) = largest_ki(task, kp_ma_per_bar, 1e-3 * limit) else { continue };
            let gains = Gains { kp_ma_per_bar, ki_ma_per_bar_s };
            let left = left(task, gains);
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
/// middle of the delay range.
pub fn left(task: &TuningTask, gains: Gains) -> f64 {
    let (low, high) = task.delay_range_s;
    let samples = (JUDGED_S * task.rate_hz) as usize;
    let disturbance: Vec<f64> = (0..samples).map(|k| (k as f64 / task.rate_hz / DISTURBANCE_S).min(1.0)).collect();
    let at = |delay_s: f64| {
        let response = SampledLoop::new(&LoopPlant { delay_s, ..task.plant }, gains, task.rate_hz).left_of(&disturbance);
        response.iter().map(|e| e * e).sum::<f64>() / samples as f64
    };
    [low, 0.5 * (low + high), high].into_iter().map(at).sum::<f64>() / 3.0
}

/// Whether the worst sensitivity over the delay range stays within the task's.
pub fn holds(task: &TuningTask, gains: Gains) -> bool {
    // The long end of the range decides nearly always: look there first.
    delays(task.delay_range_s).into_iter().rev().all(|delay_s| {
        let plant = LoopPlant { delay_s, ..task.plant };
        let sampled = SampledLoop::new(&plant, gains, task.rate_hz);
        let within = |m: Option<f64>| m.is_some_and(|m| m <= task.max_sensitivity);
        sampled.stable() && within(sampled.max_sensitivity()) && {
            let exact = exact::margins(&plant, gains);
            exact.stable && within(exact.max_sensitivity)
        }
    })
}

/// The largest K_I at this K_P, from `from` on.
fn largest_ki(task: &TuningTask, kp: f64, from: f64) -> Option<f64> {
    let at = |ki: f64| holds(task, Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: ki });
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
        for lag_s in [0.0, 0.01, 0.045] {
            let task = TuningTask { plant: LoopPlant { lag_s, ..TASK.plant }, ..TASK };
            let ours = left(&task, tune(&task).unwrap());
            for rule in RULES {
                let theirs = left(&task, rule.tuned(&task).unwrap());
                assert!(ours <= 1.002 * theirs, "lag {lag_s}, {rule:?}: {ours} against {theirs}");
            }
        }
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
