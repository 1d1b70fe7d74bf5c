//! Whether what the feedback wants is more than noise.
//!
//! A valve with hysteresis remembers every reversal. Noise that reaches the current makes reversals at every sample, and
//! these move the valve inside its loop. So the feedback acts only while it wants more than the noise of the sensor makes it
//! want; until then it is computed on, as if it acted.

use super::stability::LoopPlant;
use super::stability::sampled::SampledLoop;
use super::{Gains, linear_loop};
use crate::valve::Valve;

/// Standard deviations of its noise beyond which a wish counts: by chance one in 1.7 million samples, five hours at 100 Hz.
const BEGINS: f64 = 5.0;
/// Standard deviations within which a wish no longer counts.
pub(super) const ENDS: f64 = 2.5;

/// The state of the decision.
pub struct Significance {
    noise_bar: f64,
    period_s: f64,
    plant: LoopPlant,
    /// Gains, and the deviation of the correction that the noise makes with them [bar].
    known: Option<(Gains, f64)>,
    acts: bool,
    /// What was withheld, as the valve would have shown it: a line for the dead time, a lag behind it [bar].
    line: Vec<f64>,
    next: usize,
    kept: f64,
    shown_bar: f64,
}

impl Significance {
    /// For the noise, the delay and the lag of `valve`.
    pub fn new(valve: &Valve, period_s: f64) -> Self {
        // A command is seen by the next sample but one at the earliest.
        let periods = (valve.delay_s / period_s).round() as usize + 1;
        let kept = if valve.lag_s > 0.0 { (-period_s / valve.lag_s).exp() } else { 0.0 };
        let plant = linear_loop(valve).plant;
        Self {
            noise_bar: valve.noise_bar,
            period_s,
            plant,
            known: None,
            acts: false,
            line: vec![0.0; periods],
            next: 0,
            kept,
            shown_bar: 0.0,
        }
    }

    /// Standard deviation of the correction that the sensor's noise makes through the closed loop, at the steepest point of the curve
    /// [bar].
    fn deviation_bar(&mut self, gains: Gains) -> f64 {
        if let Some((_, deviation)) = self.known.filter(|k| k.0 == gains) {
            return deviation;
        }
        let gain = SampledLoop::new(&self.plant, gains, 1.0 / self.period_s).noise_gain(gains);
        // The integral begins where the noise of its first sample puts it.
        let deviation = self.noise_bar * self.plant.gain_bar_per_ma * gain.hypot(gains.kp_ma_per_bar);
        self.known = Some((gains, deviation));
        deviation
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.acts = false;
        self.line.fill(0.0);
        self.shown_bar = 0.0;
    }

    /// By how much the measured pressure lacks what was withheld [bar].
    pub fn withheld_bar(&self) -> f64 {
        self.shown_bar
    }

    /// The correction that is made of the wanted one.
    pub fn step(&mut self, wanted_bar: f64, gains: Gains) -> f64 {
        let deviation = self.deviation_bar(gains);
        self.acts = wanted_bar.abs() > deviation * if self.acts { ENDS } else { BEGINS };
        let given = if self.acts { wanted_bar } else { 0.0 };
        let late = std::mem::replace(&mut self.line[self.next], wanted_bar - given);
        self.next = (self.next + 1) % self.line.len();
        self.shown_bar = self.kept * self.shown_bar + (1.0 - self.kept) * late;
        given
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::test_valve;

    #[test]
    fn noise_is_withheld_and_a_wish_is_not() {
        let valve = Valve { noise_bar: 0.02, ..test_valve() };
        let mut significance = Significance::new(&valve, 0.01);
        let deviation = significance.deviation_bar(Gains::PAPER);
        // At least what K_P makes of it, at most three times that for gains so small.
        let proportional = 0.02 * 0.0585;
        assert!(deviation > proportional && deviation < 3.0 * proportional, "{deviation}");
        let mut step = |sigmas: f64| significance.step(sigmas * deviation, Gains::PAPER);
        assert_eq!(step(4.9), 0.0);
        assert!(step(5.1) > 0.0 && step(2.6) > 0.0, "it goes on below where it began");
        assert_eq!((step(2.4), step(4.9)), (0.0, 0.0));
    }

    #[test]
    fn what_is_withheld_is_missed_after_the_dead_time() {
        let valve = Valve { noise_bar: 0.02, delay_s: 0.02, ..test_valve() };
        let mut significance = Significance::new(&valve, 0.01);
        let missed: Vec<f64> = (0..5)
            .map(|_| {
                significance.step(1e-4, Gains::PAPER);
                significance.withheld_bar()
            })
            .collect();
        assert_eq!(missed, [0.0, 0.0, 0.0, 1e-4, 1e-4]);
    }
}
