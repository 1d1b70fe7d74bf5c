//! PI controller with anti-windup and bumpless switching, in A.

use super::Gains;

/// State of the PI controller, Eq. (12): K_P e + K_I integral of e.
#[derive(Debug, Clone, Default)]
pub struct Pi {
    integral_a: f64,
    output_a: f64,
    active: bool,
}

/// Time constant with which the output dies away after switching off [s].
const FADE_S: f64 = 0.1;

impl Pi {
    /// One step with the error `error_bar` over `period_s`; the sum with `base_a` is kept within `range_a`.
    ///
    /// The integral grows only while the sum is within the range, or on its way back into it.
    pub fn step(&mut self, gains: Gains, error_bar: f64, period_s: f64, base_a: f64, range_a: (f64, f64)) -> f64 {
        let proportional = gains.kp_ma_per_bar * 1e-3 * error_bar;
        if !self.active {
            // Bumpless: the output goes on from where it is.
            self.integral_a = self.output_a - proportional;
            self.active = true;
        }
        let growth = gains.ki_ma_per_bar_s * 1e-3 * error_bar * period_s;
        let sum = base_a + proportional + self.integral_a + growth;
        let winds_up = (sum > range_a.1 && growth > 0.0) || (sum < range_a.0 && growth < 0.0);
        if !winds_up {
            self.integral_a += growth;
        }
        self.output_a = proportional + self.integral_a;
        self.output_a
    }

    /// One step without a usable measurement: the output stays.
    pub fn hold(&self) -> f64 {
        self.output_a
    }

    /// One step while switched off: the output dies away.
    pub fn fade(&mut self, period_s: f64) -> f64 {
        self.active = false;
        self.output_a *= (-period_s / FADE_S).exp();
        if self.output_a.abs() < 1e-7 {
            self.output_a = 0.0;
        }
        self.output_a
    }

    /// Restarts the integral at the next step without a jump of the output, for instance after new gains.
    pub fn rebase(&mut self) {
        self.active = false;
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDE: (f64, f64) = (-10.0, 10.0);

    #[test]
    fn a_constant_error_gives_a_ramp() {
        let mut pi = Pi::default();
        let outputs: Vec<f64> = (0..100).map(|_| pi.step(Gains::PAPER, 2.0, 0.01, 0.0, WIDE)).collect();
        // The switch-on is bumpless, so the proportional part comes through the integral: 5 mA/(bar s) * 2 bar.
        assert!((outputs[99] - 0.010).abs() < 1e-12, "{}", outputs[99]);
        assert!((outputs[1] - outputs[0] - 1e-4).abs() < 1e-12);
    }

    #[test]
    fn a_change_of_the_error_is_answered_by_kp() {
        let mut pi = Pi::default();
        pi.step(Gains::PAPER, 0.0, 0.01, 0.0, WIDE);
        let output = pi.step(Gains::PAPER, 1.0, 0.01, 0.0, WIDE);
        assert!((output - (1e-3 + 5e-5)).abs() < 1e-15);
    }

    #[test]
    fn the_integral_does_not_wind_up() {
        let mut pi = Pi::default();
        for _ in 0..10_000 {
            pi.step(Gains::PAPER, 10.0, 0.01, 0.5, (0.0, 0.6));
        }
        assert!(0.5 + pi.hold() <= 0.6 + 1e-3);
        // One step of the opposite sign leaves saturation at once.
        assert!(0.5 + pi.step(Gains::PAPER, -1.0, 0.01, 0.5, (0.0, 0.6)) < 0.6);
    }

    #[test]
    fn switching_off_fades_and_on_again_goes_on_from_there() {
        let mut pi = Pi::default();
        for _ in 0..200 {
            pi.step(Gains::PAPER, 2.0, 0.01, 0.0, WIDE);
        }
        let before = pi.hold();
        let faded = pi.fade(0.01);
        assert!(faded < before && faded > 0.9 * before);
        let again = pi.step(Gains::PAPER, 2.0, 0.01, 0.0, WIDE);
        assert!((again - faded).abs() <= 1.001e-4, "{again} after {faded}");
        for _ in 0..1000 {
            pi.fade(0.01);
        }
        assert_eq!(pi.hold(), 0.0);
    }
}
