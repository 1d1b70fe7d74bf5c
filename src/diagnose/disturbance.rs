//! The rival that has no name: an unknown disturbance of the state, which wanders.
//!
//! Of a random walk nothing is known between two times but what stands at both: in the mean it goes straight from one to the other. So
//! a stretch that was held out is corrected by what a model leaves before and behind it. Physics that is there predicts the stretch
//! better than that; a name that only follows a wander does not.

use super::fit::Fitter;
use super::heldout::HeldOut;

/// What a model leaves next to a held-out stretch is read over so much time [s],
const BESIDE_S: f64 = 0.5;
/// and over no more than this part of a stretch.
const BESIDE: f64 = 0.25;

impl HeldOut {
    /// The same with an unknown disturbance in the state.
    pub fn disturbed(&self, fitter: &Fitter<'_>) -> Self {
        let mut residual = self.residual.clone();
        let stretches: Vec<&[usize]> = self.block.chunk_by(|a, b| a == b).collect();
        let mut begin = 0;
        for (k, stretch) in stretches.iter().enumerate() {
            let end = begin + stretch.len();
            let beside = |of: &[usize]| ((BESIDE_S / fitter.evidence.step_s()).min(BESIDE * of.len() as f64) as usize).max(1);
            let before = k.checked_sub(1).and_then(|b| mean(&self.residual[begin - beside(stretches[b])..begin]));
            let behind = stretches.get(k + 1).and_then(|b| mean(&self.residual[end..end + beside(b)]));
            let (from, to) = (before.or(behind).unwrap_or(0.0), behind.or(before).unwrap_or(0.0));
            for (j, e) in residual[begin..end].iter_mut().enumerate() {
                *e -= from + (to - from) * (j as f64 + 0.5) / stretch.len() as f64;
            }
            begin = end;
        }
        Self::weighing(fitter, residual, self.block.clone())
    }

    /// Whether a disturbance of the state in a model that leaves `without` goes on better than this. A disturbance follows the error of
    /// the form as well, which a name is not asked to explain: how large that is, data of the good valve says.
    pub fn loses_to_disturbance(&self, fitter: &Fitter<'_>, without: &Self) -> bool {
        let of_form = (fitter.floor_bar.powi(2) - fitter.evidence.noise_bar.powi(2)).max(0.0);
        without.disturbed(fitter).weighed_bar().powi(2) < self.weighed_bar().powi(2) - of_form
    }
}

/// Mean of the values that are there.
fn mean(values: &[f64]) -> Option<f64> {
    let (sum, count) = values.iter().filter(|v| v.is_finite()).fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::evidence::rms;
    use crate::diagnose::evidence::tests::{held, straight_run, waves};
    use crate::diagnose::heldout::blocks;
    use rand::{RngExt, SeedableRng};

    const SAMPLES: usize = 12_000;

    /// White noise of 9 mbar about a wander of `size_bar`, held out.
    fn with_wander(fitter: &Fitter<'_>, size_bar: f64, seed: u64) -> HeldOut {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let off = |k: usize| size_bar * (0.0021 * k as f64).sin() + 0.03 * (random.random::<f64>() - 0.5);
        HeldOut::weighing(fitter, (0..SAMPLES).map(off).collect(), blocks(fitter))
    }

    fn about(look: impl Fn(&Fitter<'_>)) {
        let evidence = held(vec![straight_run(waves(SAMPLES), |_, _| 0.0)]);
        look(&Fitter::new(&evidence));
    }

    #[test]
    fn a_wander_goes_on_as_it_stands_before_and_behind_and_noise_does_not() {
        about(|fitter| {
            let left = |size_bar: f64| rms(&with_wander(fitter, size_bar, 1).disturbed(fitter).residual);
            assert!(left(0.3) < 0.06, "{}", left(0.3));
            assert!((0.0086..0.0092).contains(&left(0.0)), "{}", left(0.0));
        });
    }

    #[test]
    fn a_name_that_takes_half_of_a_wander_loses_and_one_that_takes_all_of_it_does_not() {
        about(|fitter| {
            let without = with_wander(fitter, 0.3, 1);
            assert!(with_wander(fitter, 0.15, 1).loses_to_disturbance(fitter, &without));
            assert!(!with_wander(fitter, 0.0, 1).loses_to_disturbance(fitter, &without));
        });
    }

    #[test]
    fn what_the_good_valve_wanders_likewise_is_no_reason_against_a_name() {
        let evidence = held(vec![straight_run(waves(SAMPLES), |_, _| 0.0)]);
        let mut fitter = Fitter::new(&evidence);
        let (without, with) = (with_wander(&fitter, 0.3, 1), with_wander(&fitter, 0.1, 1));
        assert!(with.loses_to_disturbance(&fitter, &without));
        fitter.floor_bar = 0.08;
        assert!(!with.loses_to_disturbance(&fitter, &without));
        assert!(with_wander(&fitter, 0.25, 1).loses_to_disturbance(&fitter, &without));
    }

    #[test]
    fn where_nothing_wanders_the_disturbance_wins_by_no_chance() {
        about(|fitter| {
            for seed in 0..40 {
                let noise = with_wander(fitter, 0.0, seed);
                assert!(!noise.loses_to_disturbance(fitter, &noise), "{seed}");
            }
        });
    }
}
