//! Robust rounds of the fit, and the order of the curves by held-out error.

use super::fit::{Effort, Fit, Problem, loss, robust_sigma};
use super::model::Shape;

/// Huber's threshold in robust deviations of the residual: a step that the model misses stays in, with less weight.
const THRESHOLD_SIGMAS: f64 = 25.0;
/// And at least this many root mean squares: in a step test the steps are the information.
const THRESHOLD_RMS: f64 = 2.0;
/// Orders of the curves that are tried.
const ORDERS: std::ops::RangeInclusive<usize> = 1..=8;
/// A higher order must lower the held-out loss by this share.
const ORDER_GAIN: f64 = 0.004;
/// Blocks into which a recording is cut for the held-out error.
const BLOCKS: usize = 80;
/// Folds where whole runs are held out.
const RUN_FOLDS: usize = 6;

/// Huber's threshold for a residual [bar].
pub(super) fn threshold(residual: &[f64], weights: &[f64], noise_bar: f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (r, _) in residual.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
        sum += r * r;
        count += 1.0;
    }
    let rms = f64::sqrt(sum / f64::max(count, 1.0));
    (THRESHOLD_SIGMAS * robust_sigma(residual, weights).max(noise_bar)).max(THRESHOLD_RMS * rms).max(1e-9)
}

/// Rounds of fit and new threshold.
pub(super) fn fit_robust(
    problem: &Problem<'_>,
    shape: &Shape,
    start: &[f64],
    weights: &[f64],
    noise_bar: f64,
    iterations: &[usize],
) -> (Fit, f64) {
    let mut theta = start.to_vec();
    let mut limit = f64::INFINITY;
    let mut fit = problem.minimise(shape, &theta, weights, limit, 0);
    for n in iterations {
        limit = threshold(&fit.residual_bar, weights, noise_bar);
        fit = problem.minimise(shape, &theta, weights, limit, *n);
        theta.clone_from(&fit.theta);
    }
    (fit, limit)
}

/// Correlation time of the residual in samples: 1 + 2 times the sum of its autocorrelation up to the first value
/// below 0.05.
pub(super) fn correlation_time(problem: &Problem<'_>, residual: &[f64], weights: &[f64], threshold_bar: f64) -> f64 {
    let clean: Vec<f64> =
        residual.iter().zip(weights).map(|(r, w)| if *w > 0.0 { r.clamp(-threshold_bar, threshold_bar) } else { 0.0 }).collect();
    let variance: f64 = clean.iter().map(|r| r * r).sum();
    if variance <= 0.0 {
        return 1.0;
    }
    let mut time = 1.0;
    let longest = (clean.len() / 4).min(2000);
    let mut lag = 1;
    let mut width = 1;
    while lag < longest {
        let mut sum = 0.0;
        for k in 0..problem.segments.len() {
            let part = &clean[problem.range(k)];
            if part.len() > lag {
                sum += part[lag..].iter().zip(part).map(|(a, b)| a * b).sum::<f64>();
            }
        }
        let rho = sum / variance;
        if rho < 0.05 {
            break;
        }
        time += 2.0 * rho * width as f64;
        // Far from zero the correlation changes slowly: every few lags are enough.
        width = (lag / 16).max(1);
        lag += width;
    }
    time
}

/// Held-out error of one order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrderError {
    /// Order of both curves.
    pub order: usize,
    /// Held-out error, robust against single samples [bar].
    pub heldout_bar: f64,
}

/// Finds the order of the curves by held-out error over scattered blocks, or over runs.
pub(super) fn choose_order(problem: &Problem<'_>, fit: &Fit, weights: &[f64], limit: f64, largest: usize) -> (usize, Vec<OrderError>) {
    let (folds, count_of_folds) = folds(problem, &fit.shape);
    let mut tried: Vec<OrderError> = Vec::new();
    let count = weights.iter().filter(|w| **w > 0.0).count().max(1) as f64;
    for order in ORDERS.filter(|o| *o <= largest) {
        let shape = Shape { order, ..fit.shape.clone() };
        let start = fit.shape.convert(&fit.theta, &shape, 0.0);
        let mut sum = 0.0;
        for held in 0..count_of_folds {
            let train: Vec<f64> = weights.iter().zip(&folds).map(|(w, f)| if *f == held { 0.0 } else { *w }).collect();
            // Delay, lag and starts are the same for all orders.
            let effort = Effort { iterations: 5, free: shape.delay(), tolerance: 1e-4 };
            let trained = problem.descend(&shape, &start, &train, limit, effort);
            sum += trained
                .residual_bar
                .iter()
                .zip(weights)
                .zip(&folds)
                .filter(|((_, w), f)| **w > 0.0 && **f == held)
                .map(|((r, w), _)| w * loss(*r, limit))
                .sum::<f64>();
        }
        tried.push(OrderError { order, heldout_bar: (sum / count).sqrt() });
    }
    let best = tried.iter().map(|t| t.heldout_bar).fold(f64::INFINITY, f64::min);
    let order = tried.iter().find(|t| t.heldout_bar <= best * (1.0 + ORDER_GAIN)).map_or(fit.shape.order, |t| t.order);
    (order, tried)
}

/// The fold of every sample, and the number of folds. Step tests hold one level per run, so whole runs are held out.
fn folds(problem: &Problem<'_>, shape: &Shape) -> (Vec<usize>, usize) {
    let runs = problem.segments.len();
    let by_run = !shape.hysteresis && runs >= 3;
    let block = (problem.len() / BLOCKS).max(20);
    let mut out = Vec::with_capacity(problem.len());
    for (k, s) in problem.segments.iter().enumerate() {
        let begin = problem.range(k).start;
        out.extend((0..s.len()).map(|j| if by_run { k % RUN_FOLDS } else { usize::from(scattered((begin + j) / block)) }));
    }
    (out, if by_run { runs.min(RUN_FOLDS) } else { 2 })
}

/// Half of all numbers, without a period: every second block would show a periodic sweep always the same currents.
fn scattered(block: usize) -> bool {
    (block as u32).wrapping_mul(2_654_435_761) >> 31 == 1
}
