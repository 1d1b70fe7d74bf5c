//! Held-out error: what a model predicts that was fitted without these samples, and which of two models that speaks for.
//!
//! Runs are held out where there are enough of them, blocks elsewhere. Samples beside a held-out block, up to the memory of
//! the model and of its residual, are left out of the fit as well, so that nothing of the block is known to it.

use super::fit::{Effort, Fit, Problem, loss};
use super::model::Shape;
use super::select::correlation_time;

/// Orders of the curves that are tried.
const ORDERS: std::ops::RangeInclusive<usize> = 1..=8;
/// A richer model must lower the held-out loss by this many standard errors of the difference between the blocks: the
/// rule of one standard error (L. Breiman et al., *Classification and Regression Trees* (1984), section 3.4.3).
const STANDARD_ERRORS: f64 = 1.0;
/// Blocks into which a recording is cut.
const BLOCKS: usize = 80;
/// Folds where whole runs are held out.
const RUN_FOLDS: usize = 6;
/// Runs from which on whole runs are held out; of step tests, which hold one level each, fewer are enough.
const FEWEST_RUNS: (usize, usize) = (6, 3);
/// Time constants after which a lag has forgotten.
const FORGOTTEN: f64 = 5.0;

/// Held-out error of one order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrderError {
    /// Order of both curves.
    pub order: usize,
    /// Held-out error, robust against single samples [bar].
    pub heldout_bar: f64,
}

/// Which samples are held out together.
pub(super) struct Folds {
    /// Block of every sample.
    block: Vec<usize>,
    /// Fold of every block.
    fold: Vec<usize>,
    /// Number of folds.
    count: usize,
    /// Samples left out beside a held-out one.
    gap: usize,
    /// Where each segment begins and ends.
    ranges: Vec<std::ops::Range<usize>>,
}

impl Folds {
    /// The folds for a model like `fit`.
    pub fn of(problem: &Problem<'_>, fit: &Fit, weights: &[f64], limit: f64) -> Self {
        let runs = problem.segments.len();
        let by_run = runs >= if fit.shape.has_loop() { FEWEST_RUNS.0 } else { FEWEST_RUNS.1 };
        let ranges: Vec<_> = (0..runs).map(|k| problem.range(k)).collect();
        let length = (problem.len() / BLOCKS).max(20);
        let mut block = Vec::with_capacity(problem.len());
        for (k, range) in ranges.iter().enumerate() {
            block.extend(range.clone().map(|at| if by_run { k } else { at / length }));
        }
        let blocks = block.last().map_or(0, |b| b + 1);
        let (fold, count): (Vec<usize>, usize) = if by_run {
            ((0..blocks).map(|b| b % RUN_FOLDS).collect(), blocks.min(RUN_FOLDS))
        } else {
            ((0..blocks).map(|b| usize::from(scattered(b))).collect(), 2)
        };
        let step_s = problem.step_s();
        let memory = (fit.theta[fit.shape.delay()] + FORGOTTEN * fit.shape.lag_s(&fit.theta)) / step_s;
        let correlated = correlation_time(problem, &fit.residual_bar, weights, limit);
        let gap = ((memory + correlated) as usize).min(length / 3);
        Self { block, fold, count, gap: if by_run { 0 } else { gap }, ranges }
    }

    /// The weights of a fit that does not see fold `held`.
    fn train(&self, weights: &[f64], held: usize) -> Vec<f64> {
        let hidden = |at: usize| self.fold[self.block[at]] == held;
        let mut out = weights.to_vec();
        for range in &self.ranges {
            for at in range.clone() {
                // Within the gap of the nearest sample of another block on either side.
                let near = at.saturating_sub(self.gap).max(range.start)..=(at + self.gap).min(range.end - 1);
                if hidden(at) || hidden(*near.start()) || hidden(*near.end()) {
                    out[at] = 0.0;
                }
            }
        }
        out
    }
}

/// Half of all numbers, without a period: every second block would show a periodic sweep always the same currents.
fn scattered(block: usize) -> bool {
    (block as u32).wrapping_mul(2_654_435_761) >> 31 == 1
}

/// Held-out loss of each block, fitted in the first `free` parameters from `start` [bar^2].
pub(super) fn heldout(
    problem: &Problem<'_>,
    shape: &Shape,
    start: &[f64],
    free: usize,
    (weights, limit): (&[f64], f64),
    folds: &Folds,
) -> Vec<f64> {
    let mut out = vec![0.0; folds.fold.len()];
    for held in 0..folds.count {
        let effort = Effort { iterations: 6, free, tolerance: 1e-4 };
        let trained = problem.descend(shape, start, &folds.train(weights, held), limit, effort);
        for (at, (r, w)) in trained.residual_bar.iter().zip(weights).enumerate() {
            let block = folds.block[at];
            if *w > 0.0 && folds.fold[block] == held {
                out[block] += w * loss(*r, limit);
            }
        }
    }
    out
}

/// Whether the second of two models of rising richness predicts better, beyond what chance does from block to block.
pub(super) fn better(first: &[f64], second: &[f64]) -> bool {
    let gains: Vec<f64> = first.iter().zip(second).map(|(a, b)| a - b).collect();
    let n = gains.len().max(2) as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let variance = gains.iter().map(|g| (g - mean) * (g - mean)).sum::<f64>() / (n - 1.0);
    mean > STANDARD_ERRORS * (variance / n).sqrt()
}

/// Root of the mean loss [bar].
pub(super) fn error_bar(blocks: &[f64], weights: &[f64]) -> f64 {
    let count = weights.iter().filter(|w| **w > 0.0).count().max(1) as f64;
    (blocks.iter().sum::<f64>() / count).sqrt()
}

/// The order of the curves: the lowest that the best one does not beat beyond chance; and the error of each.
pub(super) fn choose_order(problem: &Problem<'_>, fit: &Fit, weights: &[f64], limit: f64, largest: usize) -> (usize, Vec<OrderError>) {
    let folds = Folds::of(problem, fit, weights, limit);
    let tried: Vec<(usize, Vec<f64>)> = ORDERS
        .filter(|o| *o <= largest)
        .map(|order| {
            let shape = Shape { order, ..fit.shape.clone() };
            let start = fit.shape.convert(&fit.theta, &shape, 0.0);
            // Delay, lag and starts are the same for all orders.
            (order, heldout(problem, &shape, &start, shape.delay(), (weights, limit), &folds))
        })
        .collect();
    let sum = |blocks: &[f64]| blocks.iter().sum::<f64>();
    let best = tried.iter().min_by(|a, b| sum(&a.1).total_cmp(&sum(&b.1)));
    let order = best.and_then(|best| tried.iter().find(|t| !better(&t.1, &best.1))).map_or(fit.shape.order, |t| t.0);
    (order, tried.iter().map(|(order, blocks)| OrderError { order: *order, heldout_bar: error_bar(blocks, weights) }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_must_stand_out_of_the_scatter_of_the_blocks() {
        let first: Vec<f64> = (0..40).map(|k| 1.0 + 0.3 * f64::from(k % 5)).collect();
        let less: Vec<f64> = first.iter().map(|f| f - 0.1).collect();
        let scattered: Vec<f64> = first.iter().enumerate().map(|(k, f)| f + if k % 2 == 0 { 1.0 } else { -1.02 }).collect();
        assert!(better(&first, &less) && !better(&less, &first));
        assert!(!better(&first, &scattered));
    }

    #[test]
    fn a_fit_sees_nothing_of_a_held_out_block_nor_of_its_neighbourhood() {
        let folds = Folds { block: (0..60).map(|k| k / 20).collect(), fold: vec![0, 1, 0], count: 2, gap: 5, ranges: vec![0..20, 20..60] };
        let train = folds.train(&[1.0; 60], 1);
        // The first segment ends before the block: its samples are of another run.
        assert_eq!(train.iter().position(|w| *w == 0.0), Some(20));
        assert_eq!(train.iter().rposition(|w| *w == 0.0), Some(44));
        assert_eq!(train.iter().filter(|w| **w == 0.0).count(), 25);
    }
}
