//! Textbook rules for the gains of a PI controller on a lag with dead time, each at the sensitivity that is asked for.
//!
//! A rule says how proportional and integral gain belong together for a plant; how bold they are is its one free number,
//! which is set so that the worst sensitivity over the delay range is that of the task. So rules can be compared.

use super::Gains;
use super::tune::{TuningTask, holds};

/// A rule of a textbook.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TextbookRule {
    /// S. Skogestad, "Simple analytic rules for model reduction and PID controller tuning", J. Process Control 13 (2003) 291-309.
    Simc,
    /// K. J. Astrom, T. Hagglund, "Revisiting the Ziegler-Nichols step response method for PID control", J. Process Control 14 (2004)
    /// 635-650: approximate M-constrained integral gain optimisation.
    Amigo,
    /// Lambda tuning: the zero of the controller on the pole of the plant, closed loop lambda (E. B. Dahlin, Instruments and Control
    /// Systems 41 (1968) 77-83).
    Lambda,
}

/// All rules.
pub const RULES: [TextbookRule; 3] = [TextbookRule::Simc, TextbookRule::Amigo, TextbookRule::Lambda];

impl TextbookRule {
    /// Its name as reports print it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Simc => "SIMC",
            Self::Amigo => "AMIGO",
            Self::Lambda => "lambda",
        }
    }

    /// Gains for the plant of `task`; `caution` is the rule's free number, 1 as published: the closed-loop time constant over the dead
    /// time (SIMC) or over three lags and dead times (lambda), the reciprocal of a factor on both gains (AMIGO).
    pub fn gains(self, task: &TuningTask, caution: f64) -> Gains {
        let (k, tau) = (task.plant.gain_bar_per_ma, task.plant.lag_s);
        // The loop holds one period of computation, and a held command is half a period late in the mean.
        let theta = task.plant.delay_s + 1.5 / task.rate_hz;
        let (kp, ki) = match self {
            Self::Simc => {
                let closed = caution * theta;
                // K_I = K_P / min(tau, 4 (closed + theta)), which also holds without a lag.
                let (kp, ki) = (tau / (k * (closed + theta)), 1.0 / (k * (closed + theta)));
                (kp, if tau > 4.0 * (closed + theta) { kp / (4.0 * (closed + theta)) } else { ki })
            }
            Self::Amigo => {
                let kp = 0.15 / k + (0.35 - theta * tau / (theta + tau).powi(2)) * tau / (k * theta);
                let ti = 0.35 * theta + 13.0 * theta * tau * tau / (tau * tau + 12.0 * theta * tau + 7.0 * theta * theta);
                (kp / caution, kp / ti / caution)
            }
            Self::Lambda => {
                let closed = 3.0 * caution * (tau + theta);
                (tau / (k * (closed + theta)), 1.0 / (k * (closed + theta)))
            }
        };
        Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: ki }
    }

    /// The boldest gains of this rule that keep the task's sensitivity; `None` where none does.
    pub fn tuned(self, task: &TuningTask) -> Option<Gains> {
        let at = |caution: f64| holds(task, self.gains(task, caution));
        let (mut bold, mut cautious) = (0.02, 50.0);
        if !at(cautious) {
            return None;
        }
        for _ in 0..30 {
            let middle = (bold * cautious).sqrt();
            if at(middle) { cautious = middle } else { bold = middle }
        }
        Some(self.gains(task, cautious))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::stability::{LoopPlant, margins};

    const TASK: TuningTask = TuningTask {
        plant: LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.03, delay_s: 0.02 },
        delay_range_s: (0.01, 0.03),
        max_sensitivity: 1.4,
        rate_hz: 100.0,
        noise_share: 0.0,
    };

    /// Skogestad's example: k = 1, tau = 1, theta = 1 gives K_P = 0.5 and tau_I = 1; Astrom and Hagglund's formula by hand.
    #[test]
    fn the_published_settings() {
        // At a rate so high that sampling adds nothing.
        let task = TuningTask { plant: LoopPlant { gain_bar_per_ma: 1.0, lag_s: 1.0, delay_s: 1.0 }, rate_hz: 1e9, ..TASK };
        let close = |found: Gains, kp: f64, ki: f64| {
            assert!((found.kp_ma_per_bar - kp).abs() < 1e-6 && (found.ki_ma_per_bar_s - ki).abs() < 1e-6, "{found:?}");
        };
        close(TextbookRule::Simc.gains(&task, 1.0), 0.5, 0.5);
        // 0.15 + (0.35 - 1/4) = 0.25; T_i = 0.35 + 13/20 = 1.
        close(TextbookRule::Amigo.gains(&task, 1.0), 0.25, 0.25);
        close(TextbookRule::Lambda.gains(&task, 1.0), 1.0 / 7.0, 1.0 / 7.0);
        let slow = TuningTask { plant: LoopPlant { lag_s: 100.0, ..task.plant }, ..task };
        close(TextbookRule::Simc.gains(&slow, 1.0), 50.0, 50.0 / 8.0);
    }

    #[test]
    fn each_rule_uses_the_sensitivity_up() {
        for rule in RULES {
            let gains = rule.tuned(&TASK).unwrap();
            let worst = margins(&TASK.plant, TASK.delay_range_s, gains, TASK.rate_hz).unwrap().worst_over_delay_range;
            let largest = worst.max_sensitivity.unwrap().max(worst.sampled.max_sensitivity.unwrap());
            assert!(largest <= 1.4 && largest > 1.39, "{rule:?} {gains:?}: {largest}");
        }
    }

    #[test]
    fn nothing_keeps_a_sensitivity_of_one() {
        assert_eq!(TextbookRule::Simc.tuned(&TuningTask { max_sensitivity: 1.0, ..TASK }), None);
    }
}
