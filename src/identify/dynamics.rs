//! Delay and lag: a search over a grid before the fit, and the decision whether there is a lag at all.
//!
//! The loss over the delay has a local minimum in every sampling interval, because a step falls between two samples
//! in a way of its own; a gradient alone stays in the one where it starts.

use rayon::prelude::*;

use super::fit::{Fit, Problem, loss, robust_sigma};
use super::model::Shape;
use super::select::{self, correlation_time, fit_robust};
use super::survey::Survey;
use crate::valve::Input;

/// Step of the grid over the delay, in samples.
const GRID_STEP: f64 = 0.25;
/// Lags of the grid, in samples.
const LAGS: [f64; 7] = [0.3, 0.6, 1.0, 2.0, 4.0, 8.0, 16.0];
/// Starts that are followed from the grid.
const FOLLOWED: usize = 3;
/// A step is a jump by this share of the recorded range.
const STEP_SHARE: f64 = 0.05;
/// A lag below this many samples is none.
const LEAST_LAG: f64 = 0.05;
/// A lag behind a held command below this many samples has settled before the next sample, wherever in the interval the
/// command arrived: then only the interval is seen.
const LEAST_LAG_HELD: f64 = 0.25;
/// Gain in the Bayesian information criterion that a lag must bring: "strong" (Kass and Raftery 1995).
const LAG_GAIN: f64 = 6.0;

/// Delays that are tried about a fit [s].
fn delays_s(problem: &Problem<'_>, fit: &Fit) -> Vec<f64> {
    let step_s = problem.step_s();
    let late = (fit.theta[fit.shape.delay()] + fit.shape.lag_s(&fit.theta)) / step_s;
    let spacing = GRID_STEP.max(late / 24.0);
    let count = ((late + 2.0) / spacing) as usize;
    (0..=count).map(|k| k as f64 * spacing * step_s).collect()
}

/// The fit with a lag, from the best points of a grid of delays and lags; nothing where no lag can be tried.
pub(super) fn with_lag(problem: &Problem<'_>, fit: &Fit, survey: &Survey, weights: &[f64], limit: f64) -> Option<Fit> {
    let with = Shape { lag: true, ..fit.shape.clone() };
    let lags: Vec<f64> = LAGS.iter().map(|l| l * problem.step_s()).filter(|l| *l <= problem.lag_max_s).collect();
    let theta = fit.shape.convert(&fit.theta, &with, 0.0);
    let starts = grid(problem, &with, &theta, survey.rate_a_per_s, (&delays_s(problem, fit), &lags), weights, limit);
    follow(problem, &with, starts, weights, limit)
}

/// Refits delay, lag and all else from the best points of a grid; a lag stays only where the data show it.
pub(super) fn refine(problem: &Problem<'_>, fit: &Fit, survey: &Survey, weights: &[f64], limit: f64) -> Fit {
    let step_s = problem.step_s();
    let without = Shape { lag: false, ..fit.shape.clone() };
    let mut theta_without = fit.shape.convert(&fit.theta, &without, 0.0);
    theta_without[without.delay()] += fit.shape.lag_s(&fit.theta);
    let plain = follow(
        problem,
        &without,
        grid(problem, &without, &theta_without, survey.rate_a_per_s, (&delays_s(problem, fit), &[0.0]), weights, limit),
        weights,
        limit,
    );
    let (Some(plain), Some(lagged)) = (plain, with_lag(problem, fit, survey, weights, limit)) else { return fit.clone() };
    let with = &lagged.shape;
    let least = if with.input == Input::Held { LEAST_LAG_HELD } else { LEAST_LAG };
    let shown = with.lag_s(&lagged.theta) > least * step_s;
    let wanted = if survey.steps == 0 && with.input == Input::Held {
        // Without a lag a held command shows its delay by whole steps only, which would bend curves and loop: only strong
        // evidence speaks for that.
        select::gain(problem, &lagged, &plain, weights, survey.noise_bar) < 0.5 * LAG_GAIN
    } else {
        lag_gain(problem, survey, &plain, &lagged, weights, limit) > LAG_GAIN
    };
    let chosen = if shown && wanted { lagged } else { plain };
    fit_robust(problem, &chosen.shape, &chosen.theta, weights, survey.noise_bar, &[6]).0
}

/// How much better the model with a lag is, as a gain in the Bayesian information criterion.
///
/// A lag shows where the pressure moves fast, and that may be a handful of samples after a few steps. There the
/// residual is compared with its own deviation, sample by sample; a gain elsewhere counts only by the number of
/// independent samples, for a lag that mends the shape of the loop is none.
fn lag_gain(problem: &Problem<'_>, survey: &Survey, plain: &Fit, lagged: &Fit, weights: &[f64], limit: f64) -> f64 {
    let n = weights.iter().filter(|w| **w > 0.0).count() as f64;
    let gain = if survey.steps > 0 {
        let sigma = robust_sigma(&lagged.residual_bar, weights).max(survey.noise_bar).max(f64::MIN_POSITIVE);
        let jump = STEP_SHARE * (survey.recorded_a.1 - survey.recorded_a.0);
        let mut gain = 0.0;
        for (k, s) in problem.segments.iter().enumerate() {
            let range = problem.range(k);
            let last = (0..s.len()).scan(None, |last: &mut Option<usize>, j| {
                if j > 0 && (s.current_a[j] - s.current_a[j - 1]).abs() > jump {
                    *last = Some(j);
                }
                Some(*last)
            });
            for ((at, j), last) in range.zip(0..).zip(last) {
                if weights[at] > 0.0 && last.is_some_and(|l| s.time_s[j] - s.time_s[l] < problem.delay_max_s) {
                    gain += weights[at] * (loss(plain.residual_bar[at], limit) - loss(lagged.residual_bar[at], limit));
                }
            }
        }
        gain / (sigma * sigma)
    } else {
        n / correlation_time(problem, &lagged.residual_bar, weights, limit) * (plain.cost / lagged.cost).ln()
    };
    gain - n.max(2.0).ln()
}

/// The best point of the grid for each lag, best first, as starts.
///
/// Each point is tried with the loop as it is and with the loop narrowed by what the later answer explains.
fn grid(
    problem: &Problem<'_>,
    shape: &Shape,
    theta: &[f64],
    rate_a_per_s: f64,
    (delays, lags): (&[f64], &[f64]),
    weights: &[f64],
    limit: f64,
) -> Vec<Vec<f64>> {
    let late = |theta: &[f64]| theta[shape.delay()] + shape.lag_s(theta);
    let now = late(theta);
    let cells: Vec<(f64, f64)> = lags.iter().flat_map(|l| delays.iter().map(|d| (*l, *d))).collect();
    let costs: Vec<(f64, Vec<f64>)> = cells
        .par_iter()
        .map(|(lag, delay)| {
            let mut point = theta.to_vec();
            point[shape.delay()] = *delay;
            if let Some(k) = shape.lag_at() {
                point[k] = *lag;
            }
            let narrowed = shape.narrowed(&point, rate_a_per_s, late(&point) - now);
            let delayed = problem.delayed(*delay, shape.input);
            let of = |point: Vec<f64>| {
                let simulated = problem.simulate(shape, &point, &delayed, false);
                (problem.loss_of(&simulated, weights, limit), point)
            };
            let (kept, other) = (of(point), of(narrowed));
            if other.0 < kept.0 { other } else { kept }
        })
        .collect();
    let mut best: Vec<&(f64, Vec<f64>)> =
        costs.chunks(delays.len().max(1)).filter_map(|c| c.iter().min_by(|a, b| a.0.total_cmp(&b.0))).collect();
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    best.into_iter().map(|p| p.1.clone()).take(FOLLOWED).collect()
}

/// The best fit that a few iterations from each start lead to.
fn follow(problem: &Problem<'_>, shape: &Shape, starts: Vec<Vec<f64>>, weights: &[f64], limit: f64) -> Option<Fit> {
    let fits = starts.iter().map(|start| problem.minimise(shape, start, weights, limit, 3));
    fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|best| problem.minimise(shape, &best.theta, weights, limit, 6))
}
