//! The loss along the delay, with all else fitted again: what the curvature at the minimum alone cannot say.
//!
//! A step of a held current falls between two samples in a way of its own, and goes to and fro once per sampling interval with the
//! delay. The loss over the delay may therefore have a kink and a minimum in each; on a triangle of constant rate the neighbouring minima
//! are about as deep as the best, and the curvature differs from one interval to the next. Profile likelihood: Bates and
//! Watts, *Nonlinear Regression Analysis and Its Applications* (1988), chapter 6.

use nalgebra::{DMatrix, DVector};

use super::fit::{Fit, Problem, effective_weights};
use super::inverse::inverse;
use crate::least_squares::dot;

/// The profile ends where the loss stands this many variances above the lowest (e^-8 of its density).
const END: f64 = 16.0;
/// And not before this many sampling intervals on either side, for beyond a kink it may fall again.
const LEAST_STEPS: f64 = 1.25;
/// Most nodes on each side.
const NODES: usize = 60;
/// Each distance between nodes is at most this much longer than the one before.
const GROWTH: f64 = 1.3;
/// A node this many variances below the fit shows a better minimum.
const BETTER: f64 = 0.05;
/// Times that the fit follows a better node.
const ROUNDS: usize = 3;

/// A delay and all parameters fitted to it.
#[derive(Debug, Clone)]
pub(super) struct Node {
    /// The parameters.
    pub theta: Vec<f64>,
    /// The loss [bar^2].
    pub cost: f64,
}

/// The fit after it has followed the profile to the lowest minimum, and the profile around it in the order of the
/// delay. `variance` gives the variance by which the loss of a fit is scaled [bar^2].
pub(super) fn lowest(problem: &Problem<'_>, mut fit: Fit, weights: &[f64], limit: f64, variance: impl Fn(&Fit) -> f64) -> (Fit, Vec<Node>) {
    let mut unit = variance(&fit);
    let mut nodes = along(problem, &fit, weights, limit, unit);
    for _ in 0..ROUNDS {
        let Some(best) = nodes.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)) else { break };
        if fit.cost - best.cost <= BETTER * unit {
            break;
        }
        let found = problem.minimise(&fit.shape, &best.theta, weights, limit, 8);
        if found.cost >= fit.cost {
            break;
        }
        fit = found;
        unit = variance(&fit);
        nodes = along(problem, &fit, weights, limit, unit);
    }
    (fit, nodes)
}

/// The profile around a fit; only its own node where nothing depends on the delay.
fn along(problem: &Problem<'_>, fit: &Fit, weights: &[f64], limit: f64, unit: f64) -> Vec<Node> {
    let shape = &fit.shape;
    let own = Node { theta: fit.theta.clone(), cost: fit.cost };
    let delay = shape.delay();
    let step_s = problem.step_s();
    let error_s = (unit * inverse(&fit.normal)[(delay, delay)]).sqrt();
    if !(error_s.is_finite() && error_s > 0.0 && unit > 0.0 && step_s > 0.0) {
        return vec![own];
    }
    let delayed = problem.delayed(fit.theta[delay], shape.input);
    let simulated = problem.simulate(shape, &fit.theta, &delayed, false);
    let columns = problem.jacobian(shape, &fit.theta, &delayed, &simulated, shape.len());
    let effective = effective_weights(&fit.residual_bar, weights, limit);
    let others = inverse(&without(&fit.normal, delay));
    let node = |delay_s: f64| {
        let mut theta = fit.theta.clone();
        theta[delay] = delay_s;
        let mut moved = problem.simulate(shape, &theta, &problem.delayed(delay_s, shape.input), false);
        let change: Vec<f64> = moved.iter().zip(&simulated).zip(&effective).map(|((m, s), w)| w * (m - s)).collect();
        let gradient =
            DVector::from_iterator(shape.len(), columns.iter().enumerate().map(|(k, c)| if k == delay { 0.0 } else { dot(c, &change) }));
        let answer = &others * gradient;
        for (k, column) in columns.iter().enumerate().filter(|(k, _)| *k != delay) {
            theta[k] -= answer[k];
            moved.iter_mut().zip(column).for_each(|(m, c)| *m -= answer[k] * c);
        }
        problem.residual(&mut moved);
        Node { cost: problem.cost(shape, &theta, &moved, weights, limit), theta }
    };
    let side = |sign: f64| {
        let mut out = Vec::new();
        let longest = (0.25 * step_s).max(error_s / 3.0);
        let (mut distance, mut offset) = ((0.25 * step_s).min(error_s / 3.0), 0.0);
        while out.len() < NODES {
            offset += distance;
            let at = (fit.theta[delay] + sign * offset).clamp(0.0, problem.delay_max_s);
            let next = node(at);
            let done = at == 0.0 || at == problem.delay_max_s;
            let far = next.cost - fit.cost > END * unit && offset > LEAST_STEPS * step_s;
            out.push(next);
            if done || far {
                break;
            }
            distance = (distance * GROWTH).min(longest);
        }
        out
    };
    let (mut nodes, later) = rayon::join(|| side(-1.0), || side(1.0));
    nodes.reverse();
    nodes.push(own);
    nodes.extend(later);
    nodes
}

/// A matrix with row and column `k` empty.
pub(super) fn without(matrix: &DMatrix<f64>, k: usize) -> DMatrix<f64> {
    let mut out = matrix.clone();
    out.row_mut(k).fill(0.0);
    out.column_mut(k).fill(0.0);
    out
}
