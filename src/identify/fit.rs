//! The fit of the free-run simulation error, with Huber's loss and curves kept monotone by a penalty.
//!
//! The error is that of the simulation, never of a one-step prediction: a prediction from the last measured
//! pressure would hide every slow or static error. Source: P. J. Huber, Ann. Math. Statist. 35
//! (1964) 73.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::model::{MIN_SLOPE, Shape};
use super::segment::{Segment, shortest_step_s};
use crate::least_squares::{Descended, Equations, Landscape, Pace, descend, dot};
use crate::valve::{Input, ReferenceCurves};

/// Points of the range at which the curves are kept rising and apart.
const GUARDS: usize = 24;
/// How much worse a violated guard is than the same error in all samples.
const GUARD_WEIGHT: f64 = 100.0;
/// Bound of a start between the curves: 0.1 % of the width away from a curve.
const START_LIMIT: f64 = 0.998;

/// How the descent of a fit goes.
const PACE: Pace = Pace { steps: 0, damping: 1e-3, least: 1e-9, raised: 5.0, tries: 8 };

/// The data and the bounds of a fit.
pub(super) struct Problem<'a> {
    /// The segments, simulated each from its own start.
    pub segments: &'a [Segment],
    /// Longest delay [s].
    pub delay_max_s: f64,
    /// Longest lag [s].
    pub lag_max_s: f64,
    /// Range of the pressure [bar], which scales steps and guards.
    pub span_bar: f64,
    /// Sensor noise [bar], the scale of the prior of the starts.
    pub noise_bar: f64,
    offsets: Vec<usize>,
}

/// How far a descent goes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Most steps.
    pub iterations: usize,
    /// Only the first parameters move; the others stay as they are.
    pub free: usize,
    /// Stops where a step lowers the loss by less than this share.
    pub tolerance: f64,
}

/// A fitted parameter vector.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// The model's shape.
    pub shape: Shape,
    /// The parameters.
    pub theta: Vec<f64>,
    /// Weighted sum of Huber's loss [bar^2].
    pub cost: f64,
    /// J' W J at the solution.
    pub normal: DMatrix<f64>,
    /// Simulated minus measured pressure, NaN where nothing was measured [bar].
    pub residual_bar: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// A problem over `segments`.
    pub fn new(segments: &'a [Segment], delay_max_s: f64, lag_max_s: f64, span_bar: f64, noise_bar: f64) -> Self {
        let mut offsets = vec![0];
        for s in segments {
            offsets.push(offsets[offsets.len() - 1] + s.len());
        }
        Self { segments, delay_max_s, lag_max_s, span_bar, noise_bar, offsets }
    }

    /// The shortest time step of its segments [s].
    pub fn step_s(&self) -> f64 {
        shortest_step_s(self.segments)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.offsets[self.segments.len()]
    }

    /// The samples of segment `k` in a concatenated vector.
    pub fn range(&self, k: usize) -> std::ops::Range<usize> {
        self.offsets[k]..self.offsets[k + 1]
    }

    /// The weights of the segments, concatenated.
    pub fn weights(&self) -> Vec<f64> {
        self.segments.iter().flat_map(|s| s.weight.iter().copied()).collect()
    }

    /// The current of all segments, delayed.
    pub fn delayed(&self, delay_s: f64, input: Input) -> Vec<f64> {
        let mut out = vec![0.0; self.len()];
        for (k, s) in self.segments.iter().enumerate() {
            s.delayed(delay_s, input, &mut out[self.range(k)]);
        }
        out
    }

    /// The simulated pressure of all segments.
    pub fn simulate(&self, shape: &Shape, theta: &[f64], delayed_a: &[f64], average: bool) -> Vec<f64> {
        self.simulate_with(shape, theta, &shape.curves(theta), delayed_a, average)
    }

    /// As [`Problem::simulate`] with the curves at hand.
    pub fn simulate_with(&self, shape: &Shape, theta: &[f64], curves: &ReferenceCurves, delayed_a: &[f64], average: bool) -> Vec<f64> {
        let mut out = vec![0.0; self.len()];
        for (k, s) in self.segments.iter().enumerate() {
            let range = self.range(k);
            shape.simulate(theta, curves, (k, s), &delayed_a[range.clone()], &mut out[range], average);
        }
        out
    }

    /// Simulated minus measured pressure.
    pub fn residual(&self, simulated: &mut [f64]) {
        for (k, s) in self.segments.iter().enumerate() {
            for (o, p) in simulated[self.range(k)].iter_mut().zip(&s.pressure_bar) {
                *o -= p;
            }
        }
    }

    /// Huber's loss of a simulated pressure [bar^2].
    pub fn loss_of(&self, simulated: &[f64], weights: &[f64], threshold_bar: f64) -> f64 {
        let measured = self.segments.iter().flat_map(|s| &s.pressure_bar);
        simulated.iter().zip(measured).zip(weights).filter(|(_, w)| **w > 0.0).map(|((s, p), w)| w * loss(s - p, threshold_bar)).sum()
    }

    /// Huber's loss of the residual and of the guards [bar^2].
    pub fn cost(&self, shape: &Shape, theta: &[f64], residual: &[f64], weights: &[f64], threshold_bar: f64) -> f64 {
        let data: f64 = residual.iter().zip(weights).filter(|(_, w)| **w > 0.0).map(|(r, w)| w * loss(*r, threshold_bar)).sum();
        data + self.guards(shape, theta, weights).iter().map(|g| g * g).sum::<f64>() + self.prior(shape, theta)
    }

    /// Parameters that the data may not show, with the mean and the curvature of their priors: a start stays in the
    /// middle with a prior as wide as the loop, a lag begins settled with one as wide as the range of the pressure, and the
    /// weights of the plays, of which only the ratios count, keep their sum.
    fn priors(&self, shape: &Shape, theta: &[f64]) -> Vec<(usize, f64, f64)> {
        let variance = self.noise_bar * self.noise_bar;
        let starts = (0..shape.starts).filter_map(|k| Some((shape.start_at(k)?, theta[shape.start_at(k)?], variance)));
        let span = variance / (self.span_bar * self.span_bar);
        let before = (0..shape.starts).filter_map(|k| Some((shape.before_at(k)?, theta[shape.before_at(k)?], span)));
        let sum = theta[shape.weights()].iter().sum::<f64>() - 1.0;
        let step_s = self.step_s();
        // Of a held command a lag of about half a step is expected, where the data do not show another.
        let usual = 0.5 * step_s;
        let lag = shape.lag_at().filter(|_| shape.input == Input::Held);
        let lag = lag.map(|k| (k, theta[k] - usual, variance / (usual * usual)));
        starts.chain(before).chain(lag).chain(shape.weights().map(|k| (k, sum, variance))).collect()
    }

    fn prior(&self, shape: &Shape, theta: &[f64]) -> f64 {
        let plays = shape.weights().len().max(1) as f64;
        let share = |k: usize| if shape.weights().contains(&k) { 1.0 / plays } else { 1.0 };
        self.priors(shape, theta).iter().map(|(k, away, curvature)| share(*k) * curvature * away * away).sum()
    }

    /// Weighted violations of "both curves rise" and "the descending one is above".
    fn guards(&self, shape: &Shape, theta: &[f64], weights: &[f64]) -> Vec<f64> {
        let scale = (GUARD_WEIGHT * weights.len() as f64 / GUARDS as f64).sqrt();
        let (ascending, descending) = shape.polynomials(theta);
        let (low, high) = shape.range_a;
        let tenth = 0.1 * (high - low);
        let least = 0.1 * MIN_SLOPE * self.span_bar;
        let mut out = Vec::with_capacity(3 * (GUARDS + 1));
        for k in 0..=GUARDS {
            let i = low + (high - low) * k as f64 / GUARDS as f64;
            out.push(scale * (ascending.slope(i) * tenth - least).min(0.0));
            if shape.has_loop() {
                out.push(scale * (descending.slope(i) * tenth - least).min(0.0));
                out.push(scale * (descending.eval(i) - ascending.eval(i)).min(0.0));
            }
        }
        out
    }

    /// Bounds of parameter `k`.
    fn bounds(&self, shape: &Shape, k: usize) -> (f64, f64) {
        let square = 2.0 * self.span_bar.ln();
        match k {
            k if k == shape.delay() => (0.0, self.delay_max_s),
            k if Some(k) == shape.lag_at() => (0.0, self.lag_max_s),
            k if Some(k) == shape.ln_a() => (square - 20.0, square),
            k if shape.weights().contains(&k) => (0.0, 2.0),
            k if (0..shape.starts).any(|s| shape.before_at(s) == Some(k)) => (-self.span_bar, self.span_bar),
            k if k > shape.delay() => (-START_LIMIT, START_LIMIT),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    fn clamp(&self, shape: &Shape, theta: &mut [f64]) {
        for (k, t) in theta.iter_mut().enumerate() {
            let (low, high) = self.bounds(shape, k);
            *t = t.clamp(low, high);
        }
    }

    /// Step of the finite difference of parameter `k`.
    fn step(&self, shape: &Shape, theta: &[f64], k: usize) -> f64 {
        let step_s = self.step_s();
        match k {
            // Within the sampling interval in which a held command arrives.
            k if k == shape.delay() => {
                let part = (theta[k] / step_s).fract();
                if shape.input == Input::Held && part > 0.5 { -0.02 * step_s } else { 0.02 * step_s }
            }
            k if Some(k) == shape.lag_at() => 0.01 * theta[k].max(step_s),
            k if Some(k) == shape.ln_a() || shape.weights().contains(&k) => 1e-3,
            k if (0..shape.starts).any(|s| shape.start_at(s) == Some(k)) => 1e-3,
            _ => 1e-5 * self.span_bar,
        }
    }

    /// Derivative of the simulated pressure after each parameter, one column each.
    pub fn jacobian(&self, shape: &Shape, theta: &[f64], delayed_a: &[f64], base: &[f64], free: usize) -> Vec<Vec<f64>> {
        (0..free)
            .into_par_iter()
            .map(|k| {
                let mut moved = theta.to_vec();
                let step = self.step(shape, theta, k);
                moved[k] += step;
                let mut column = if k == shape.delay() {
                    self.simulate(shape, &moved, &self.delayed(moved[k], shape.input), false)
                } else {
                    self.simulate(shape, &moved, delayed_a, false)
                };
                for (c, b) in column.iter_mut().zip(base) {
                    *c = (*c - b) / step;
                }
                column
            })
            .collect()
    }

    /// Minimises the loss from `start` in at most `iterations` steps.
    pub fn minimise(&self, shape: &Shape, start: &[f64], weights: &[f64], threshold_bar: f64, iterations: usize) -> Fit {
        self.descend(shape, start, weights, threshold_bar, Effort { iterations, free: shape.len(), tolerance: 1e-7 })
    }

    /// As [`Problem::minimise`] with the effort given.
    pub fn descend(&self, shape: &Shape, start: &[f64], weights: &[f64], threshold_bar: f64, effort: Effort) -> Fit {
        let mut theta = start.to_vec();
        self.clamp(shape, &mut theta);
        let pace = Pace { steps: effort.iterations, ..PACE };
        let mut slope = Slope { problem: self, shape, weights, threshold_bar, effort };
        let at = slope.at(theta);
        let Descended { at, equations, ended } = descend(&mut slope, at, &pace);
        // Where the steps ran out, those of the last one belong to the point before.
        let normal = equations.filter(|_| ended).map_or_else(|| slope.normal_at(&at), |e| e.normal);
        Fit { shape: shape.clone(), theta: at.theta, cost: at.cost, normal, residual_bar: at.residual }
    }

    fn normal_equations(
        &self,
        shape: &Shape,
        theta: &[f64],
        columns: &[Vec<f64>],
        residual: &[f64],
        weights: &[f64],
        threshold_bar: f64,
    ) -> Equations {
        let p = columns.len();
        let effective = effective_weights(residual, weights, threshold_bar);
        let clean: Vec<f64> = residual.iter().zip(&effective).map(|(r, w)| if *w > 0.0 { *r } else { 0.0 }).collect();
        let rows: Vec<Vec<f64>> = (0..p)
            .into_par_iter()
            .map(|a| {
                let weighted: Vec<f64> = columns[a].iter().zip(&effective).map(|(c, w)| c * w).collect();
                let mut row: Vec<f64> = (0..=a).map(|b| dot(&weighted, &columns[b])).collect();
                row.push(dot(&weighted, &clean));
                row
            })
            .collect();
        let all = shape.len();
        let mut matrix = DMatrix::from_fn(all, all, |a, b| if a.max(b) < p { rows[a.max(b)][a.min(b)] } else { 0.0 });
        let mut gradient = DVector::from_fn(all, |a, _| if a < p { rows[a][a + 1] } else { 0.0 });
        let weights_at = shape.weights();
        for (k, away, curvature) in self.priors(shape, theta) {
            gradient[k] += curvature * away;
            // The sum of the weights couples them all.
            if weights_at.contains(&k) {
                weights_at.clone().for_each(|l| matrix[(k, l)] += curvature);
            } else {
                matrix[(k, k)] += curvature;
            }
        }
        let base = self.guards(shape, theta, weights);
        if base.iter().any(|g| *g != 0.0) {
            let step = 1e-5 * self.span_bar;
            let curve = shape.curve_parameters();
            let slopes: Vec<Vec<f64>> = (0..curve)
                .map(|k| {
                    let mut moved = theta.to_vec();
                    moved[k] += step;
                    self.guards(shape, &moved, weights).iter().zip(&base).map(|(m, b)| (m - b) / step).collect()
                })
                .collect();
            for a in 0..curve {
                gradient[a] += dot(&slopes[a], &base);
                for b in 0..curve {
                    matrix[(a, b)] += dot(&slopes[a], &slopes[b]);
                }
            }
        }
        Equations { normal: matrix, gradient }
    }
}

/// Where the descent of a fit stands.
struct Place {
    theta: Vec<f64>,
    delayed_a: Vec<f64>,
    simulated: Vec<f64>,
    residual: Vec<f64>,
    cost: f64,
}

/// The loss over the parameters of one shape.
struct Slope<'p> {
    problem: &'p Problem<'p>,
    shape: &'p Shape,
    weights: &'p [f64],
    threshold_bar: f64,
    effort: Effort,
}

impl Slope<'_> {
    fn at(&self, theta: Vec<f64>) -> Place {
        let (problem, shape) = (self.problem, self.shape);
        let delayed_a = problem.delayed(theta[shape.delay()], shape.input);
        let simulated = problem.simulate(shape, &theta, &delayed_a, false);
        let mut residual = simulated.clone();
        problem.residual(&mut residual);
        let cost = problem.cost(shape, &theta, &residual, self.weights, self.threshold_bar);
        Place { theta, delayed_a, simulated, residual, cost }
    }

    fn normal_at(&mut self, at: &Place) -> DMatrix<f64> {
        let slopes = self.slopes(at);
        self.problem.normal_equations(self.shape, &at.theta, &slopes, &at.residual, self.weights, self.threshold_bar).normal
    }
}

impl Landscape for Slope<'_> {
    type Point = Place;
    type Slopes = Vec<Vec<f64>>;

    fn slopes(&mut self, at: &Place) -> Vec<Vec<f64>> {
        self.problem.jacobian(self.shape, &at.theta, &at.delayed_a, &at.simulated, self.effort.free)
    }

    fn equations(&self, slopes: &Vec<Vec<f64>>, at: &Place) -> Option<Equations> {
        Some(self.problem.normal_equations(self.shape, &at.theta, slopes, &at.residual, self.weights, self.threshold_bar))
    }

    fn moved(&mut self, at: &Place, step: &DVector<f64>) -> Place {
        let mut theta: Vec<f64> = at.theta.iter().zip(step.iter()).map(|(t, s)| t - s).collect();
        self.problem.clamp(self.shape, &mut theta);
        self.at(theta)
    }

    fn objective(&self, at: &Place) -> f64 {
        at.cost
    }

    fn is_worth_more(&self, before: f64, gain: f64) -> bool {
        gain >= self.effort.tolerance * before
    }

    fn is_held(&self, k: usize) -> bool {
        k >= self.effort.free
    }

    fn is_blocked(&self, at: &Place, k: usize, step: f64) -> bool {
        let (low, high) = self.problem.bounds(self.shape, k);
        (at.theta[k] <= low && step > 0.0) || (at.theta[k] >= high && step < 0.0)
    }
}

/// Huber's loss: quadratic up to the threshold, linear beyond [bar^2].
#[inline]
pub(super) fn loss(residual_bar: f64, threshold_bar: f64) -> f64 {
    let size = residual_bar.abs();
    if size <= threshold_bar { size * size } else { threshold_bar * (2.0 * size - threshold_bar) }
}

/// Weights for the normal equations, iteratively reweighted: a residual beyond the threshold counts linearly.
pub(super) fn effective_weights(residual: &[f64], weights: &[f64], threshold_bar: f64) -> Vec<f64> {
    residual.iter().zip(weights).map(|(r, w)| if *w > 0.0 { w * (threshold_bar / r.abs()).min(1.0) } else { 0.0 }).collect()
}

/// Robust standard deviation of the residual where `weights` is positive: 1.4826 times the median of its size [bar].
pub(super) fn robust_sigma(residual: &[f64], weights: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residual.iter().zip(weights).filter(|(r, w)| **w > 0.0 && r.is_finite()).map(|(r, _)| r.abs()).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
}
