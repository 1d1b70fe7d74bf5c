//! Robust rounds of the fit, and what is counted of its residual.

use super::fit::{Fit, Problem, robust_sigma};
use super::model::Shape;
use crate::least_squares::correlation_samples;

/// Huber's threshold in robust deviations of the residual: a step that the model misses stays in, with less weight.
const THRESHOLD_SIGMAS: f64 = 25.0;
/// And at least this many root mean squares: in a step test the steps are the information.
const THRESHOLD_RMS: f64 = 2.0;

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

/// Root mean square of the residual where `weights` is positive [bar].
pub(super) fn rms(residual: &[f64], weights: &[f64]) -> f64 {
    let used = residual.iter().zip(weights).filter(|(_, w)| **w > 0.0);
    let (sum, count) = used.fold((0.0, 0.0), |(sum, count), (r, _)| (sum + r * r, count + 1.0));
    f64::sqrt(sum / f64::max(count, 1.0))
}

/// Gain in log-likelihood of the second fit over the first, by the number of independent samples [nats].
pub(super) fn gain(problem: &Problem<'_>, first: &Fit, second: &Fit, weights: &[f64], noise_bar: f64) -> f64 {
    let limit = threshold(&first.residual_bar, weights, noise_bar).max(threshold(&second.residual_bar, weights, noise_bar));
    let cost = |fit: &Fit| problem.cost(&fit.shape, &fit.theta, &fit.residual_bar, weights, limit);
    let n = weights.iter().filter(|w| **w > 0.0).count() as f64;
    0.5 * n / correlation_time(problem, &second.residual_bar, weights, limit) * (cost(first) / cost(second)).ln()
}

/// Correlation time of the residual in samples, beyond a threshold cut off.
pub(super) fn correlation_time(problem: &Problem<'_>, residual: &[f64], weights: &[f64], threshold_bar: f64) -> f64 {
    let clean: Vec<f64> = residual.iter().map(|r| r.clamp(-threshold_bar, threshold_bar)).collect();
    correlation_of((0..problem.segments.len()).map(|k| (&clean[problem.range(k)], &weights[problem.range(k)])))
}

/// Correlation time in samples of stretches of values with their weights: what has none does not count.
pub(super) fn correlation_of<'a>(stretches: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> f64 {
    let used = |(values, weights): (&[f64], &[f64])| values.iter().zip(weights).map(|(v, w)| if *w > 0.0 { *v } else { 0.0 }).collect();
    correlation_samples(&stretches.into_iter().map(used).collect::<Vec<Vec<f64>>>())
}
