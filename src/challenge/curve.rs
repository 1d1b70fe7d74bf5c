//! The static curve: force of a saturating solenoid against a spring, as pressure over current.
//!
//! The force of a proportional solenoid grows with the square of the current and bends over as the iron saturates;
//! pressure on the spool's face balances it after the spring's preload. That is no cubic in the current.

use rand_pcg::Pcg64;

use super::specimen::uniform;

/// `P(i) = soft(k i^2 / (1 + (|i|/i_s)^n)^(1/n) - p_0)`, floored at tank pressure with the soft knee of the notches.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    gain_bar_a2: f64,
    saturation_a: f64,
    sharpness: f64,
    preload_bar: f64,
    knee_bar: f64,
}

impl Curve {
    pub(super) fn draw(rng: &mut Pcg64) -> Self {
        let mut curve = Self {
            gain_bar_a2: 1.0,
            saturation_a: uniform(rng, 0.62, 0.78),
            sharpness: uniform(rng, 1.7, 2.3),
            preload_bar: 0.0,
            knee_bar: uniform(rng, 0.08, 0.25),
        };
        // tank pressure up to about 0.2 A, 34 to 37 bar at 0.93 A: what valves of this size are built for
        let (low, high) = (uniform(rng, 0.2, 0.235), uniform(rng, 33.5, 36.5));
        curve.gain_bar_a2 = high / (curve.force(0.93) - curve.force(low));
        curve.preload_bar = curve.force(low);
        curve
    }

    fn force(&self, current_a: f64) -> f64 {
        let i = current_a.max(0.0);
        self.gain_bar_a2 * i * i / (1.0 + (i / self.saturation_a).powf(self.sharpness)).powf(1.0 / self.sharpness)
    }

    /// Pressure [bar] in equilibrium at a current [A], without friction.
    pub(super) fn pressure(&self, current_a: f64) -> f64 {
        let p = self.force(current_a) - self.preload_bar;
        0.5 * (p + (p * p + self.knee_bar * self.knee_bar).sqrt())
    }

    /// Greatest slope in the working range [bar/A].
    pub(super) fn steepest(&self) -> f64 {
        (20..100).map(|k| f64::from(k) * 0.01).map(|i| (self.pressure(i + 0.005) - self.pressure(i - 0.005)) / 0.01).fold(0.0, f64::max)
    }

    /// The current [A] that a pressure [bar] takes; bisection on the monotone curve.
    pub(super) fn current(&self, pressure_bar: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.3);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.pressure(middle) < pressure_bar { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

#[cfg(test)]
mod tests {
    use super::super::specimen::stream;
    use super::*;

    #[test]
    fn curves_rise_from_tank_to_about_35_bar_and_invert() {
        for seed in 0..50 {
            let curve = Curve::draw(&mut stream(seed, 9));
            assert!(curve.pressure(0.1) < 0.05);
            assert!((33.0..37.0).contains(&curve.pressure(0.93)), "{curve:?}");
            for k in 20..100 {
                let i = f64::from(k) * 0.01;
                assert!(curve.pressure(i + 0.01) > curve.pressure(i));
            }
            for p in [1.0, 10.0, 25.0] {
                assert!((curve.pressure(curve.current(p)) - p).abs() < 1e-6);
            }
        }
    }
}
