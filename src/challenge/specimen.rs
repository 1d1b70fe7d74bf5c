//! One healthy valve, drawn from a seed: no two specimens are alike.

use rand::RngExt;

use super::anatomy::Anatomy;
use super::chance::{stream, uniform};
use super::curve::Curve;
use super::forms::LoopForm;
use super::formulation::{Formulations, LOOPS};

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
}
