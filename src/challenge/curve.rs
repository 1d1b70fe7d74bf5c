//! The static curve: what the solenoid's force, the springs and the spool's faces make of the current, as pressure.
//!
//! None of the forms is a cubic in the current. Each is drawn so that tank pressure reaches to about 0.2 A and 33 to
//! 37 bar stand at 0.93 A, what valves of this size are built for.

use rand_pcg::Pcg64;

use super::chance::uniform;
use super::forms::CurveForm;
use super::formulation::{CURVES, Formulations};

/// `P(i) = soft(k (f(i) - f(low)))`, floored at tank pressure with the soft knee of the notches.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    form: CurveForm,
    gain_bar: f64,
    /// Where it bends [A].
    bend_a: f64,
    /// How sharply.
    sharpness: f64,
    onset_a: f64,
    preload_bar: f64,
    knee_bar: f64,
}

impl Curve {
    pub(super) fn draw(rng: &mut Pcg64, formulations: Formulations) -> Self {
        let form = formulations.choose(&CURVES, rng);
        let (bend_a, sharpness) = match form {
            CurveForm::Solenoid => (uniform(rng, 0.62, 0.78), uniform(rng, 1.7, 2.3)),
            CurveForm::Logistic => (uniform(rng, 0.5, 0.62), uniform(rng, 0.12, 0.18)),
            CurveForm::Power => (1.0, uniform(rng, 1.1, 1.6)),
            CurveForm::TwoSprings => (uniform(rng, 0.45, 0.65), uniform(rng, 0.55, 0.75)),
            CurveForm::Saturating => (uniform(rng, 0.6, 1.0), 1.0),
            CurveForm::Notched => (uniform(rng, 0.3, 0.42), uniform(rng, 0.15, 0.3)),
        };
        let knee_bar = uniform(rng, 0.08, 0.25);
        let (low, high) = (uniform(rng, 0.2, 0.235), uniform(rng, 33.5, 36.5));
        let mut curve = Self { form, gain_bar: 1.0, bend_a, sharpness, onset_a: low, preload_bar: 0.0, knee_bar };
        curve.gain_bar = high / (curve.force(0.93) - curve.force(low));
        curve.preload_bar = curve.force(low);
        curve
    }

    fn force(&self, current_a: f64) -> f64 {
        let i = current_a.max(0.0);
        let shape = match self.form {
            CurveForm::Solenoid => i * i / (1.0 + (i / self.bend_a).powf(self.sharpness)).powf(1.0 / self.sharpness),
            CurveForm::Logistic => 1.0 / (1.0 + (-(i - self.bend_a) / self.sharpness).exp()),
            CurveForm::Power => {
                let d = i - self.onset_a;
                d.signum() * d.abs().powf(self.sharpness)
            }
            CurveForm::TwoSprings => {
                let d = i - self.bend_a;
                i - (1.0 - self.sharpness) * 0.5 * (d + (d * d + 0.0016).sqrt())
            }
            CurveForm::Saturating => 1.0 - (-i / self.bend_a).exp(),
            CurveForm::Notched => {
                i + self.sharpness * self.bend_a / std::f64::consts::TAU * (std::f64::consts::TAU * i / self.bend_a).sin()
            }
        };
        self.gain_bar * shape
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
    use super::super::chance::stream;
    use super::*;

    #[test]
    fn curves_rise_from_tank_to_about_35_bar_and_invert() {
        for seed in 0..50 {
            let curve = Curve::draw(&mut stream(seed, 9), Formulations::All);
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
