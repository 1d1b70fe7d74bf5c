//! Covariance of the parameters: over the profile of the delay, inflated by the correlation time of the residual.
//!
//! Neighbouring residuals are alike wherever the model's form is not quite that of the valve; counting every sample
//! as independent would make the errors too small by the square root of the correlation time. And the loss is no
//! parabola over the delay (see `profile`): how far the delay may lie is taken from the profile, not from the curvature.

use nalgebra::{DMatrix, DVector};

use super::fit::{Effort, Fit, Problem};
use super::inverse::inverse;
use super::profile::{Node, without};
use super::select::correlation_time;
use crate::least_squares::SIGMAS_95;

/// The variance by which the loss is scaled [bar^2], and the correlation time in samples.
pub(super) fn variance(problem: &Problem<'_>, fit: &Fit, weights: &[f64], limit: f64) -> (f64, f64) {
    let n: f64 = weights.iter().filter(|w| **w > 0.0).count() as f64;
    let p = fit.shape.len() as f64;
    let time = correlation_time(problem, &fit.residual_bar, weights, limit);
    (fit.cost / (n - p).max(1.0) * time, time)
}

/// Covariance of the parameters about the fit.
///
/// With the delay given, the model is as good as linear in all else, and the covariance is that of linear least
/// squares; to it comes how all parameters move along the profile, each node weighed by its likelihood. The variance
/// of the delay is that of an interval of 95 % by the likelihood ratio. For a loss that is a parabola all this is the
/// usual `variance` times (J'WJ)^-1.
pub(super) fn covariance(fit: &Fit, nodes: &[Node], variance: f64) -> DMatrix<f64> {
    let delay = fit.shape.delay();
    let mut given = inverse(&without(&fit.normal, delay)) * variance;
    given.row_mut(delay).fill(0.0);
    given.column_mut(delay).fill(0.0);
    let (nodes, farther_end_s) = interval(fit, nodes, variance);
    let lowest = nodes.iter().map(|n| n.cost).fold(f64::INFINITY, f64::min);
    let at = |k: usize| nodes[k].theta[delay];
    let mut spread = DMatrix::zeros(fit.shape.len(), fit.shape.len());
    for (k, node) in nodes.iter().enumerate() {
        let share = at((k + 1).min(nodes.len() - 1)) - at(k.saturating_sub(1));
        let weight = share * (-0.5 * (node.cost - lowest) / variance).exp();
        let away = DVector::from_iterator(fit.theta.len(), node.theta.iter().zip(&fit.theta).map(|(n, f)| n - f));
        spread += weight * &away * away.transpose();
    }
    let scale = (farther_end_s / SIGMAS_95).powi(2) / spread[(delay, delay)];
    if nodes.len() < 3 || !(scale.is_finite() && scale > 0.0) {
        return inverse(&fit.normal) * variance;
    }
    given + spread * scale
}

/// Covariance about the fit of a model whose delay shows by whole steps only: a held command and no lag.
///
/// Within a sampling interval the loss is flat, and the delay is as likely here as there; the neighbouring intervals count by
/// their likelihood.
pub(super) fn staircase(problem: &Problem<'_>, fit: &Fit, (weights, limit): (&[f64], f64), variance: f64) -> DMatrix<f64> {
    const NEIGHBOURS: i32 = 3;
    let delay = fit.shape.delay();
    let step_s = problem.step_s();
    let mut out = inverse(&without(&fit.normal, delay)) * variance;
    out.row_mut(delay).fill(0.0);
    out.column_mut(delay).fill(0.0);
    let (mut sum, mut spread) = (1.0, DMatrix::zeros(fit.theta.len(), fit.theta.len()));
    for steps in (-NEIGHBOURS..=NEIGHBOURS).filter(|s| *s != 0) {
        let mut theta = fit.theta.clone();
        theta[delay] += f64::from(steps) * step_s;
        if !(0.0..=problem.delay_max_s).contains(&theta[delay]) {
            continue;
        }
        let there = problem.descend(&fit.shape, &theta, weights, limit, Effort { iterations: 4, free: delay, tolerance: 1e-6 });
        let likelihood = (-0.5 * (there.cost - fit.cost).max(0.0) / variance).exp();
        let away = DVector::from_iterator(fit.theta.len(), there.theta.iter().zip(&fit.theta).map(|(n, f)| n - f));
        spread += likelihood * &away * away.transpose();
        sum += likelihood;
    }
    out += spread / sum;
    // An even distribution over the interval.
    out[(delay, delay)] += step_s * step_s / 12.0;
    out
}

/// The nodes around the fit up to the first on each side whose loss is more than 3.84 variances above the lowest, and
/// the distance from the fit to the farther of the two places where it gets there [s].
///
/// Of the two the farther, since the error that is reported goes to both sides alike. A minimum beyond, after the loss
/// has been higher, is another answer and no uncertainty of this one: the fit has already gone to the lowest.
fn interval<'a>(fit: &Fit, nodes: &'a [Node], variance: f64) -> (&'a [Node], f64) {
    let delay = fit.shape.delay();
    let lowest = nodes.iter().map(|n| n.cost).fold(f64::INFINITY, f64::min);
    // The root of the loss, which is a straight line where the loss is a parabola.
    let height = |k: usize| ((nodes[k].cost - lowest) / variance).max(0.0).sqrt();
    let away = |k: usize| (nodes[k].theta[delay] - fit.theta[delay]).abs();
    let own = nodes.iter().position(|n| n.theta[delay] >= fit.theta[delay]).unwrap_or(0);
    let end = |outwards: &mut dyn Iterator<Item = usize>| {
        let mut inside = own;
        for k in outwards {
            if height(k) > SIGMAS_95 {
                let share = ((SIGMAS_95 - height(inside)) / (height(k) - height(inside))).clamp(0.0, 1.0);
                return (k, away(inside) + share * (away(k) - away(inside)));
            }
            inside = k;
        }
        (inside, away(inside))
    };
    let (first, last) = (end(&mut (0..own).rev()), end(&mut (own + 1..nodes.len())));
    (&nodes[first.0..=last.0], first.1.max(last.1))
}

/// Standard error of a linear combination of parameters.
pub(super) fn error_of(covariance: &DMatrix<f64>, direction: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (a, x) in direction.iter().enumerate() {
        for (b, y) in direction.iter().enumerate() {
            if *x != 0.0 && *y != 0.0 {
                sum += x * y * covariance[(a, b)];
            }
        }
    }
    sum.max(0.0).sqrt()
}
