//! Gains for a largest sensitivity that holds over the whole delay range.
//!
//! Of all gains whose worst sensitivity, with the exact delay and sampled, stays within the wanted one, those with the
//! largest K_I: for a load step the integral of the error is 1/K_I (M-constrained integral gain optimisation;
//! Astrom, Panagopoulos and Hagglund, Automatica 34 (1998), 585-601).

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

/// Gains with the largest K_I that keep the task's sensitivity; `None` where no K_I > 0 does.
pub fn tune(task: &TuningTask) -> Option<Gains> {
    // K_P on a coarse grid up to the exact limit, then twice finer around the best.
    let limit = exact::boundary(&task.plant, 2).last().map_or(2.0 / task.plant.gain_bar_per_ma, |p| p.0);
    let (mut low, mut high) = (0.0, limit);
    let mut best: Option<Gains> = None;
    for _ in 0..3 {
        const STEPS: usize = 16;
        let step = (high - low) / STEPS as f64;
        for i in 0..=STEPS {
            let kp = low + step * i as f64;
            let better = best.map_or(0.0, |b| b.ki_ma_per_bar_s);
            // One look tells whether this K_P can beat the best so far.
            let candidate = Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: (better * 1.0005).max(1e-3 * limit) };
            if holds(task, candidate) {
                best = Some(Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: largest_ki(task, kp, candidate.ki_ma_per_bar_s) });
            }
        }
        let center = best?.kp_ma_per_bar;
        (low, high) = ((center - step).max(0.0), center + step);
    }
    best
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

fn largest_ki(task: &TuningTask, kp: f64, from: f64) -> f64 {
    let at = |ki: f64| holds(task, Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: ki });
    let (mut low, mut high) = (from, from * 2.0);
    while at(high) && high < from * 1e9 {
        (low, high) = (high, high * 2.0);
    }
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        if at(middle) { low = middle } else { high = middle }
    }
    low
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
