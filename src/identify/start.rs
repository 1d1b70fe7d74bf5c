//! Where the fit starts: a linear least-squares fit of both curves for each of a row of delays.
//!
//! With the direction as a play operator the model is linear in the curves: P = mean(i) - s half(i), s from -1 to 1.

use nalgebra::{DMatrix, DVector};

use super::fit::Problem;
use super::model::{Shape, chebyshev};
use super::survey::{Survey, play};

/// Radius of the play operator as a share of the covered range.
const PLAY_SHARE: f64 = 0.02;
/// Shares of the squared half-width that `a` starts from.
const A_STARTS: [f64; 5] = [0.003, 0.03, 0.15, 0.6, 3.0];

/// Delays to try, in steps: each, then every third more.
fn delays(limit_steps: f64) -> Vec<f64> {
    let mut out = vec![0.0];
    let mut d = 1.0f64;
    while d <= limit_steps {
        out.push(d);
        d = (d + 1.0).max((d * 1.34).round());
    }
    out
}

/// A start for the `shape` (without lag): the best of the row of delays, then the best `a`.
pub(super) fn start(problem: &Problem<'_>, shape: &Shape, survey: &Survey, weights: &[f64]) -> Vec<f64> {
    let step_s = problem.step_s();
    let above = survey.above_bar();
    let mut best: Option<(f64, f64, Vec<f64>)> = None;
    for d in delays(problem.delay_max_s / step_s) {
        if let Some((cost, curve)) = linear(problem, shape, d * step_s, weights, above)
            && best.as_ref().is_none_or(|b| cost < b.0)
        {
            best = Some((cost, d * step_s, curve));
        }
    }
    let (_, delay_s, curve) = best.unwrap_or_else(|| {
        let mut flat = vec![0.0; shape.delay()];
        flat[0] = 0.5 * survey.span_bar;
        (0.0, 0.0, flat)
    });
    if !shape.has_loop() {
        let mut theta = curve;
        theta.push(delay_s);
        return theta;
    }
    let half = curve[shape.order + 1].abs().max(1e-3 * survey.span_bar);
    let threshold = 4.0 * survey.noise_bar.max(0.002 * survey.span_bar);
    let mut chosen: Option<(f64, Vec<f64>)> = None;
    for share in A_STARTS {
        let mut theta = curve.clone();
        theta.push((share * half * half).ln());
        theta.push(delay_s);
        let curves = shape.curves(&[theta.clone(), vec![0.0; shape.starts]].concat());
        for s in problem.segments.iter().take(shape.starts) {
            theta.push(shape.measured_start(&curves, s, s.current_a[0]));
        }
        let simulated = problem.simulate(shape, &theta, &problem.delayed(delay_s, shape.input), false);
        let cost = problem.loss_of(&simulated, weights, threshold);
        if chosen.as_ref().is_none_or(|c| cost < c.0) {
            chosen = Some((cost, theta));
        }
    }
    chosen.map(|c| c.1).unwrap_or_default()
}

/// The curves by linear least squares at one delay, and the sum of squares.
fn linear(problem: &Problem<'_>, shape: &Shape, delay_s: f64, weights: &[f64], above_bar: f64) -> Option<(f64, Vec<f64>)> {
    let curve = shape.order + 1;
    let p = if shape.has_loop() { 2 * curve } else { curve };
    let delayed = problem.delayed(delay_s, shape.input);
    let (low, high) = shape.range_a;
    let mut normal = DMatrix::<f64>::zeros(p, p);
    let mut right = DVector::<f64>::zeros(p);
    let (mut squares, mut count) = (0.0, 0.0);
    let mut row = vec![0.0; p];
    for (k, s) in problem.segments.iter().enumerate() {
        let range = problem.range(k);
        let state = play(&delayed[range.clone()], PLAY_SHARE * (high - low));
        for (j, at) in range.enumerate() {
            let (y, w) = (s.pressure_bar[j], weights[at]);
            if w <= 0.0 || y <= above_bar {
                continue;
            }
            let x = ((2.0 * delayed[at] - low - high) / (high - low)).clamp(-1.2, 1.2);
            chebyshev(x, &mut row[..curve]);
            if shape.has_loop() {
                for c in 0..curve {
                    row[curve + c] = -state[j] * row[c];
                }
            }
            for a in 0..p {
                for b in 0..=a {
                    normal[(a, b)] += w * row[a] * row[b];
                }
                right[a] += w * row[a] * y;
            }
            squares += w * y * y;
            count += w;
        }
    }
    for a in 0..p {
        normal[(a, a)] += 1e-9 * count;
        for b in 0..a {
            normal[(b, a)] = normal[(a, b)];
        }
    }
    let solution = normal.cholesky()?.solve(&right);
    // Different delays leave different samples below the floor: compare the mean square.
    Some(((squares - solution.dot(&right)) / f64::max(count, 1.0), solution.iter().copied().collect()))
}
