//! One healthy valve, drawn from a seed: no two specimens are alike.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::curve::Curve;
use super::formulation::{Formulations, LOOPS};
use super::memory::LoopForm;

/// Fine time step of the plant [s]: an order of magnitude below the fastest lag that it holds.
pub(super) const STEP_S: f64 = 0.0005;
/// Which plant a valve is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anatomy {
    /// A static curve with hysteresis, then blocks one behind the other.
    Blocks,
    /// Differential equations: coil with eddy currents, magnet, spool with friction, chamber, line, piston.
    Equations,
}

impl Anatomy {
    /// The word of the truth file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blocks => "blocks",
            Self::Equations => "equations",
        }
    }
}

/// The healthy properties of one valve and of its sensor.
#[derive(Debug, Clone)]
pub(super) struct Specimen {
    pub(super) anatomy: Anatomy,
    /// Form of the static hysteresis; of the equations, of the magnet's part in it.
    pub(super) hysteresis: LoopForm,
    pub(super) curve: Curve,
    /// Half the width of the major loop, as current [A].
    pub(super) half_width_a: f64,
    /// How slowly a branch is reached after a reversal, relative to the loop (1: as drawn on average).
    pub(super) reach: f64,
    /// Message and computing delay [s].
    pub(super) delay_s: f64,
    /// Closed-loop lag of the coil current [s].
    pub(super) coil_lag_s: f64,
    /// Lag of the small chamber behind the spool [s].
    pub(super) chamber_lag_s: f64,
    /// Standard deviation of the sensor noise [bar].
    pub(super) noise_bar: f64,
    /// Share of the noise variance that is coloured.
    pub(super) coloured: f64,
    /// Correlation time of that share [s].
    pub(super) colour_s: f64,
}

/// A stream of random numbers of its own for each purpose, so that a healthy twin meets the same drive and noise.
pub(super) fn stream(seed: u64, purpose: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(purpose.wrapping_mul(0xD1B5_4A32_D192_ED03)))
}

/// Uniform in `[low, high)`.
pub(super) fn uniform(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// A standard normal number (Box-Muller: one line, and no table of another crate in the proof).
pub(super) fn normal(rng: &mut Pcg64) -> f64 {
    let u = 1.0 - rng.random::<f64>();
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

impl Specimen {
    pub(super) fn draw(seed: u64, anatomy: Anatomy, formulations: Formulations) -> Self {
        let rng = &mut stream(seed, 1);
        let hysteresis = match anatomy {
            Anatomy::Blocks => formulations.choose(&LOOPS, rng),
            Anatomy::Equations => LoopForm::Play,
        };
        Self {
            anatomy,
            hysteresis,
            curve: Curve::draw(rng, formulations),
            half_width_a: uniform(rng, 0.009, 0.013),
            reach: uniform(rng, 0.7, 1.4),
            delay_s: uniform(rng, 0.015, 0.028),
            coil_lag_s: uniform(rng, 0.002, 0.004),
            chamber_lag_s: uniform(rng, 0.002, 0.005),
            noise_bar: uniform(rng, 0.025, 0.05),
            coloured: if rng.random::<bool>() { uniform(rng, 0.0, 0.1) } else { uniform(rng, 0.1, 0.5) },
            colour_s: uniform(rng, 0.03, 0.4),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_always_draws_the_same_valve_and_another_seed_another() {
        let text = |seed| format!("{:?}", Specimen::draw(seed, Anatomy::Blocks, Formulations::All));
        assert_eq!(text(5), text(5));
        assert_ne!(text(5), text(6));
    }

    #[test]
    fn normal_numbers_have_mean_0_and_variance_1() {
        let rng = &mut stream(1, 2);
        let x: Vec<f64> = (0..20_000).map(|_| normal(rng)).collect();
        let mean = x.iter().sum::<f64>() / 20_000.0;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04, "{mean} {variance}");
    }
}
