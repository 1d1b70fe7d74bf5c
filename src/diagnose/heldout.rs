//! What a model is worth on data that its fit has not seen.
//!
//! The recording is cut into alternating blocks. Each half is predicted by a fit on the other half, so that all data
//! serve as test once. A simulation sees only the current, so it may run through both; only the loss is masked.

use rand::{RngExt, SeedableRng};

use super::base::Base;
use super::evidence::rms;
use super::fit::{Fit, Fitter};
use super::simulator::Simulator;

/// Longest block [s].
pub const BLOCK_S: f64 = 5.0;
/// Fewest blocks.
const FEWEST_BLOCKS: usize = 24;
/// Part of the recording at its begin and at its end that is predicted from the rest,
const BEYOND: f64 = 0.3;
/// and the steps of the fit from which it is.
const BEYOND_STEPS: usize = 8;
/// Sign flips of the test.
const FLIPS: usize = 1999;

/// The held-out residual of a model, and the block of each sample.
pub struct HeldOut {
    /// Measured minus predicted [bar]; NaN where not measured.
    pub residual: Vec<f64>,
    /// Block number of each sample.
    pub block: Vec<usize>,
    /// The same residual, each reading as much as it weighs [bar].
    weighed: Vec<f64>,
}

impl HeldOut {
    /// Of a residual whose readings all weigh the same.
    pub fn plain(residual: Vec<f64>, block: Vec<usize>) -> Self {
        Self { weighed: residual.clone(), residual, block }
    }

    /// Of a residual whose readings weigh as the fitter has it.
    pub fn weighing(fitter: &Fitter<'_>, residual: Vec<f64>, block: Vec<usize>) -> Self {
        let mut weighed = residual.clone();
        fitter.weigh(&mut weighed);
        Self { residual, block, weighed }
    }

    /// RMSE over all held-out stretches [bar].
    pub fn rmse_bar(&self) -> f64 {
        rms(&self.residual)
    }

    /// The same, each reading as much as it weighs [bar].
    pub fn weighed_bar(&self) -> f64 {
        rms(&self.weighed)
    }

    /// Squared error of each block, and its number of samples.
    fn blocks(&self) -> Vec<(f64, usize)> {
        let mut sums = vec![(0.0, 0usize); self.block.last().map_or(0, |b| b + 1)];
        for (e, b) in self.weighed.iter().zip(&self.block) {
            if e.is_finite() {
                sums[*b].0 += e * e;
                sums[*b].1 += 1;
            }
        }
        sums
    }

    /// How much worse `without` is than this: difference of the RMSE, its 95 % interval over blocks, and the chance
    /// of such a difference by flips of sign.
    pub fn gain_over(&self, without: &Self) -> (f64, Option<(f64, f64)>, f64) {
        let gain = without.weighed_bar() - self.weighed_bar();
        let pairs: Vec<(f64, f64, usize)> =
            self.blocks().iter().zip(without.blocks()).map(|(a, b)| (a.0, b.0, a.1)).filter(|p| p.2 > 0).collect();
        if pairs.len() < 4 {
            return (gain, None, 1.0);
        }
        let mut random = rand_pcg::Pcg64::seed_from_u64(0x686f_6c64);
        // Differences of the root of each block's mean square: a block with one large event counts as one block.
        let differences: Vec<f64> = pairs.iter().map(|(a, b, n)| (b / *n as f64).sqrt() - (a / *n as f64).sqrt()).collect();
        let observed: f64 = differences.iter().sum();
        let at_least = (0..FLIPS)
            .filter(|_| differences.iter().map(|d| if random.random::<bool>() { *d } else { -d }).sum::<f64>() >= observed)
            .count();
        let p_value = (at_least + 1) as f64 / (FLIPS + 1) as f64;
        let mut gains: Vec<f64> = (0..400)
            .map(|_| {
                let (mut a, mut b, mut n) = (0.0, 0.0, 0);
                for _ in 0..pairs.len() {
                    let p = pairs[random.random_range(0..pairs.len())];
                    (a, b, n) = (a + p.0, b + p.1, n + p.2);
                }
                (b / n as f64).sqrt() - (a / n as f64).sqrt()
            })
            .collect();
        gains.sort_by(f64::total_cmp);
        (gain, Some((gains[10], gains[389])), p_value)
    }
}

impl Fitter<'_> {
    /// Measured minus simulated, all readings alike; NaN where masked [bar].
    pub fn plain_residual(&self, fit: &Fit<'_>) -> Vec<f64> {
        let mut residual = Vec::new();
        Simulator::new(self.evidence).residual(&fit.model, &fit.theta, &self.measured, &mut residual);
        residual
    }

    /// Root of the mean square of what a fit leaves, all readings alike [bar].
    pub fn plain_rmse_bar(&self, fit: &Fit<'_>) -> f64 {
        rms(&self.plain_residual(fit))
    }

    /// How far the model may be off over all readings alike where nothing is wrong [bar].
    pub fn plain_floor_bar(&self) -> f64 {
        if self.weights.is_empty() {
            return self.floor_bar;
        }
        self.floor_bar * rms(&self.weights.iter().map(|weight| weight.recip()).collect::<Vec<_>>())
    }
}

/// The number of the block that each sample lies in.
pub fn blocks(fitter: &Fitter<'_>) -> Vec<usize> {
    let total_s: f64 = fitter.evidence.grids.iter().map(|g| g.current_a.len() as f64 * g.dt_s).sum();
    let length_s = BLOCK_S.min(total_s / FEWEST_BLOCKS as f64);
    let mut out = Vec::with_capacity(fitter.measured.len());
    let mut first = 0;
    for grid in &fitter.evidence.grids {
        let per_block = ((length_s / grid.dt_s) as usize).max(5);
        out.extend((0..grid.current_a.len()).map(|k| first + k / per_block));
        first = out.last().map_or(0, |b| b + 1);
    }
    out
}

/// How long the base of a model remembers [samples], so that what a fit sees at the edge of a block tells nothing of the next; at most
/// a quarter of a block.
fn gap_samples(fitter: &Fitter<'_>, fit: &Fit<'_>) -> usize {
    let dt_s = fitter.evidence.step_s();
    let longest = 0.25 * BLOCK_S.min(fitter.measured.len() as f64 * dt_s / FEWEST_BLOCKS as f64);
    (Base::of(&fit.theta).memory_s().min(longest) / dt_s).ceil() as usize
}

/// The samples that lie within `gap` samples of another block.
fn guards(block: &[usize], gap: usize) -> Vec<bool> {
    let other = |k: usize, at: usize| block.get(at).is_some_and(|b| *b != block[k]);
    (0..block.len()).map(|k| other(k, k.saturating_sub(gap)) || other(k, k + gap)).collect()
}

/// How much of what `with` gains over `without` on all data it gains on data that lie beyond those of its fit: the begin is
/// predicted from the rest, and the end. What only follows a slow wander does not go on as it says; 1 where there is nothing to
/// gain.
pub fn carried_forward(fitter: &Fitter<'_>, with: &Fit<'_>, without: &Fit<'_>) -> f64 {
    let n = fitter.measured.len();
    let cut = (BEYOND * n as f64) as usize;
    let ends = [0..cut, n - cut..n];
    let squares = |fit: &Fit<'_>, theta: &[f64], end: &std::ops::Range<usize>| {
        let mut residual = Vec::new();
        fitter.residual(&mut Simulator::new(fitter.evidence), &fit.model, theta, &mut residual);
        residual[end.clone()].iter().filter(|e| e.is_finite()).map(|e| e * e).sum::<f64>()
    };
    let (mut claimed, mut gained) = (0.0, 0.0);
    for end in ends {
        let mut measured = fitter.measured.clone();
        measured[end.clone()].fill(f64::NAN);
        let seen = fitter.seeing(measured);
        let beyond = |fit: &Fit<'_>| squares(fit, &seen.polish(&fit.model, &fit.theta, BEYOND_STEPS).theta, &end);
        let (less, more) = rayon::join(|| beyond(without), || beyond(with));
        claimed += less - squares(with, &with.theta, &end);
        gained += less - more;
    }
    if claimed > 0.0 { gained / claimed } else { 1.0 }
}

/// The held-out residual of a model fitted before on everything: refitted on each half, `steps` steps from there.
pub fn held_out(fitter: &Fitter<'_>, fit: &Fit<'_>, steps: usize) -> HeldOut {
    let block = blocks(fitter);
    let near = guards(&block, gap_samples(fitter, fit));
    let predicted = |half: usize| {
        let seen = |((y, b), near): ((&f64, &usize), &bool)| if b % 2 == half || *near { f64::NAN } else { *y };
        let measured = fitter.measured.iter().zip(&block).zip(&near).map(seen).collect();
        let other = fitter.seeing(measured);
        let theta = if steps == 0 { fit.theta.clone() } else { other.polish(&fit.model, &fit.theta, steps).theta };
        let mut predicted = Vec::new();
        Simulator::new(fitter.evidence).pressure(&fit.model, &theta, &mut predicted);
        predicted
    };
    let halves = rayon::join(|| predicted(0), || predicted(1));
    let of = |k: usize, b: usize| if b.is_multiple_of(2) { halves.0[k] } else { halves.1[k] };
    let residual = block.iter().enumerate().map(|(k, b)| fitter.measured[k] - of(k, *b)).collect();
    HeldOut::weighing(fitter, residual, block)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(residual: impl Fn(usize) -> f64) -> HeldOut {
        HeldOut::plain((0..2400).map(residual).collect(), (0..2400).map(|k| k / 100).collect())
    }

    /// Noise that repeats nowhere.
    fn chance(seed: usize) -> impl Fn(usize) -> f64 {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed as u64);
        let values: Vec<f64> = (0..2400).map(|_| random.random::<f64>() - 0.5).collect();
        move |k| values[k]
    }

    #[test]
    fn a_model_that_predicts_worse_gains_nothing_and_the_better_one_does() {
        let (good, bad) = (held(chance(1)), {
            let same = chance(1);
            held(move |k| 1.5 * same(k))
        });
        let (gain, interval, p_value) = good.gain_over(&bad);
        assert!(gain > 0.0 && interval.unwrap().0 > 0.0 && p_value < 0.01, "{gain} {interval:?} {p_value}");
        let (loss, interval, p_value) = bad.gain_over(&good);
        assert!(loss < 0.0 && interval.unwrap().1 < 0.0 && p_value > 0.99, "{loss} {interval:?} {p_value}");
    }

    #[test]
    fn under_the_null_p_is_uniform_and_the_interval_covers() {
        let n = 200;
        let (mut below, mut covered) = ([0usize; 3], 0usize);
        for k in 0..n {
            let (_, interval, p_value) = held(chance(2 * k + 10)).gain_over(&held(chance(2 * k + 11)));
            for (count, level) in below.iter_mut().zip([0.05, 0.25, 0.5]) {
                *count += usize::from(p_value <= level);
            }
            covered += usize::from(interval.is_some_and(|(low, high)| low <= 0.0 && high >= 0.0));
        }
        // Three standard deviations of a binomial count about its mean.
        for (count, level) in below.iter().zip([0.05, 0.25, 0.5]) {
            let spread = 3.0 * (n as f64 * level * (1.0 - level)).sqrt();
            assert!((*count as f64 - n as f64 * level).abs() < spread, "{count} of {n} at {level}");
        }
        assert!((170..=199).contains(&covered), "{covered} of {n}");
    }

    #[test]
    fn a_guard_lies_on_both_sides_of_every_edge() {
        let block: Vec<usize> = (0..30).map(|k| k / 10).collect();
        let near = guards(&block, 2);
        let kept: Vec<usize> = (0..30).filter(|k| !near[*k]).collect();
        assert_eq!(kept, [0, 1, 2, 3, 4, 5, 6, 7, 12, 13, 14, 15, 16, 17, 22, 23, 24, 25, 26, 27, 28, 29]);
        assert!(guards(&block, 0).iter().all(|g| !g));
    }
}
