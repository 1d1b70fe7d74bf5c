//! The way to the minimum: a first fit for each convention of the command, the covered range, the order, the form of the loop.

use super::dynamics;
use super::fit::{Fit, Problem};
use super::heldout::{self, Folds, OrderError};
use super::model::{Form, Shape};
use super::select;
use super::start;
use super::survey::{self, Survey};
use super::{HysteresisChoice, Options};
use crate::valve::Input;

/// Up to this many segments the start of each is fitted.
const MAX_STARTS: usize = 4;
/// Share of the direction bins that both directions must cover for a hysteresis to be fitted.
const MIN_BOTH: usize = survey::DIRECTION_BINS * 3 / 20;
/// A fit whose root mean square is this many times the noise may stand in a wrong minimum: others are looked for.
const FAR: f64 = 1.1;
/// Gain in log-likelihood that decides for a command against the convention: "very strong" (Kass and Raftery 1995).
const INPUT_GAIN: f64 = 5.0;
/// Shares of the squared half-width of the loop from which `a` starts once more.
const A_AGAIN: [f64; 6] = [1e-3, 1e-2, 0.1, 0.5, 2.0, 8.0];
/// A minimum is another one where it is lower by this share.
const LOWER: f64 = 1e-3;

/// Steps of a fit to all readings, in each of two rounds: it begins next to its end.
const LAST_STEPS: usize = 5;

/// Another form of the loop must lower the held-out error by this share: below, it repairs what nobody would notice.
const FORM_GAIN: f64 = 0.03;

/// What the search has found.
pub(super) struct Found {
    /// The fit.
    pub fit: Fit,
    /// Huber's threshold [bar].
    pub limit_bar: f64,
    /// Held-out error of every order that was tried.
    pub orders: Vec<OrderError>,
    /// Held-out error of the model [bar].
    pub heldout_bar: Option<f64>,
}

/// Searches the minimum; the survey learns the covered range.
///
/// Where the model does not reach the noise with what the first fit took the command for, the other is followed to the end
/// too: a first fit may stand in a wrong minimum, and a wrong input looks like missing physics. So is a floor at zero of which
/// too few readings stand there to be seen. What is left there is no noise, so that no likelihood decides: as with order and
/// form, the model that predicts the samples held out better is taken.
pub(super) fn search(problem: &Problem<'_>, survey: &mut Survey, options: &Options, weights: &[f64]) -> Found {
    let at_first = survey.clone();
    let mut found = along(problem, survey, options, weights);
    let short = |found: &Found| select::rms(&found.fit.residual_bar, weights) > FAR * at_first.noise_bar;
    // What is found another way, with its survey, where that predicts better by more than a share.
    let mut or_better = |found: Found, mut other_survey: Survey, options: &Options, share: f64| {
        let other = along(problem, &mut other_survey, options, weights);
        let better = match (found.heldout_bar, other.heldout_bar) {
            (Some(found), Some(other)) => other < (1.0 - share) * found,
            _ => select::gain(problem, &found.fit, &other.fit, weights, at_first.noise_bar) > INPUT_GAIN,
        };
        if !better {
            return found;
        }
        *survey = other_survey;
        other
    };
    if options.input.is_none() && short(&found) {
        let input = match found.fit.shape.input {
            Input::Held => Input::Ramp,
            Input::Ramp => Input::Held,
        };
        found = or_better(found, at_first.clone(), &Options { input: Some(input), ..options.clone() }, 0.0);
    }
    if short(&found)
        && let Some(with_floor) = at_first.with_floor_at_zero(problem.segments)
    {
        let same = Options { input: Some(found.fit.shape.input), ..options.clone() };
        found = or_better(found, with_floor, &same, FORM_GAIN);
    }
    found
}

/// What was found in one reading of several, by `thinned` weights, fitted to all of them, with what the command does between them.
///
/// Where they are followed less closely, the loop may be another one: a hyperbola starts anew at each turn of a current that trembles,
/// and of these one reading of several shows a few only.
pub(super) fn to_the_end(
    problem: &Problem<'_>,
    (found, thinned): (Found, &[f64]),
    survey: &Survey,
    options: &Options,
    weights: &[f64],
) -> Found {
    let at_first_bar = select::rms(&found.fit.residual_bar, thinned);
    let with = |input| {
        let shape = Shape { input, ..found.fit.shape.clone() };
        select::fit_robust(problem, &shape, &found.fit.theta, weights, survey.noise_bar, &[LAST_STEPS, LAST_STEPS])
    };
    let (fit, limit_bar) = match options.input {
        Some(input) => with(input),
        None => {
            let (held, ramp) = rayon::join(|| with(Input::Held), || with(Input::Ramp));
            if is_ramp(problem, [&held.0, &ramp.0], weights, survey.noise_bar) { ramp } else { held }
        }
    };
    let hides = select::rms(&fit.residual_bar, weights) > FAR * at_first_bar.max(survey.noise_bar);
    let found = Found { fit, limit_bar, ..found };
    if hides && options.hysteresis == HysteresisChoice::Auto && found.fit.shape.form == Form::Hyperbolic {
        return with_free_loop(problem, survey, options, found, weights);
    }
    found
}

/// Whether the command is on straight lines between its samples: the convention stands where the data do not speak against it.
fn is_ramp(problem: &Problem<'_>, [held, ramp]: [&Fit; 2], weights: &[f64], noise_bar: f64) -> bool {
    let against = if Input::default() == Input::Held { INPUT_GAIN } else { -INPUT_GAIN };
    select::gain(problem, held, ramp, weights, noise_bar) > against
}

/// The way to the minimum.
fn along(problem: &Problem<'_>, survey: &mut Survey, options: &Options, weights: &[f64]) -> Found {
    let noise_bar = survey.noise_bar;
    let mut fit = first_fit(problem, survey, options, options.input, weights);
    let input = Some(fit.shape.input);
    let before = survey.covered_a;
    survey.cover(problem.segments, fit.theta[fit.shape.delay()], 4.0 * fit.shape.lag_s(&fit.theta));
    let range_a = to_the_floor(&fit, survey);
    let change = (range_a.0 - before.0).abs().max((range_a.1 - before.1).abs());
    if change > 0.1 * (before.1 - before.0) {
        // A slow valve: what looked covered was still on its way.
        fit = first_fit(problem, survey, options, input, weights);
    } else {
        (fit.shape, fit.theta) = fit.shape.moved(&fit.theta, range_a);
        survey.covered_a = range_a;
    }
    let mut orders = Vec::new();
    if options.order.is_none() {
        let limit = select::threshold(&fit.residual_bar, weights, noise_bar);
        let largest = survey::levels(problem.segments, survey).saturating_sub(1).max(1);
        let (order, tried) = heldout::choose_order(problem, &fit, weights, limit, largest);
        orders = tried;
        let shape = Shape { order, ..fit.shape.clone() };
        fit.theta = fit.shape.convert(&fit.theta, &shape, 0.0);
        fit.shape = shape;
        fit = dynamics::refine(problem, &fit, survey, weights, limit);
    }
    fit = below_the_floor(problem, fit, survey, weights);
    let (fit, limit_bar) = select::fit_robust(problem, &fit.shape, &fit.theta, weights, noise_bar, &[10, 10]);
    let fit = in_the_middle(problem, fit, weights, limit_bar);
    let heldout_bar = orders.iter().find(|o| o.order == fit.shape.order).map(|o| o.heldout_bar);
    if options.hysteresis == HysteresisChoice::Hyperbolic || !fit.shape.has_loop() {
        return Found { fit, limit_bar, orders, heldout_bar };
    }
    if options.hysteresis == HysteresisChoice::Auto && select::rms(&fit.residual_bar, weights) <= FAR * noise_bar {
        return Found { fit, limit_bar, orders, heldout_bar };
    }
    with_free_loop(problem, survey, options, Found { fit, limit_bar, orders, heldout_bar }, weights)
}

/// A delay that shows by whole steps only goes to the middle of its interval.
fn in_the_middle(problem: &Problem<'_>, mut fit: Fit, weights: &[f64], limit: f64) -> Fit {
    let step_s = problem.step_s();
    let delay = fit.shape.delay();
    let steps = (fit.theta[delay] / step_s - 1e-9).ceil();
    if !fit.shape.is_staircase() || steps < 1.0 {
        return fit;
    }
    fit.theta[delay] = (steps - 0.5) * step_s;
    problem.minimise(&fit.shape, &fit.theta, weights, limit, 2)
}

/// The model with a loop of free form, where it was asked for or predicts held-out samples better than the hyperbola.
fn with_free_loop(problem: &Problem<'_>, survey: &Survey, options: &Options, found: Found, weights: &[f64]) -> Found {
    let hyperbola = &found.fit;
    let shape = Shape { form: Form::Free, ..hyperbola.shape.clone() };
    let start = hyperbola.shape.convert(&hyperbola.theta, &shape, 0.0);
    let (fit, limit_bar) = select::fit_robust(problem, &shape, &start, weights, survey.noise_bar, &[10, 10, 10]);
    let folds = Folds::of(problem, hyperbola, weights, found.limit_bar);
    let heldout = |fit: &Fit| heldout::heldout(problem, &fit.shape, &fit.theta, fit.shape.delay(), (weights, found.limit_bar), &folds);
    let (of_hyperbola, of_free) = (heldout(hyperbola), heldout(&fit));
    let errors = [&of_hyperbola, &of_free].map(|blocks| heldout::error_bar(blocks, weights));
    let better = heldout::better(&of_hyperbola, &of_free) && errors[1] < (1.0 - FORM_GAIN) * errors[0];
    if options.hysteresis == HysteresisChoice::Free || better {
        Found { fit, limit_bar, orders: found.orders, heldout_bar: Some(errors[1]) }
    } else {
        Found { heldout_bar: Some(errors[0]), ..found }
    }
}

/// The covered range, down to where the higher curve reaches the floor: there it ends, and nothing is extrapolated.
fn to_the_floor(fit: &Fit, survey: &Survey) -> (f64, f64) {
    let (low, high) = survey.covered_a;
    let Some(floor) = survey.floor_bar else { return (low, high) };
    let curves = fit.shape.curves(&fit.theta);
    let slope = curves.descending.slope(low).max(1e-9);
    let missing = ((curves.descending_at(low) - floor) / slope).clamp(0.0, 0.05 * (high - low));
    let hidden = curves.descending_at(low) - floor < 2.0 * (survey.above_bar() - floor);
    (if hidden { (low - missing).max(survey.recorded_a.0) } else { low }, high)
}

/// The fit with its range carried on below the covered one, over the currents at which the floor hides the pressure.
///
/// The loop goes on down there and turns: how wide it is shows in the path of the pressure back above the floor, and
/// from there in the ascending curve, in `a` and in the delay. Straight lines, which take the width at the floor for
/// that at the turn, would bend all three; the polynomials, as far as they rise and stay apart, carry it on as the
/// paper's valve does.
fn below_the_floor(problem: &Problem<'_>, mut fit: Fit, survey: &Survey, weights: &[f64]) -> Fit {
    const ROUNDS: usize = 3;
    let (low, high) = survey.covered_a;
    if survey.floor_bar.is_none() || !fit.shape.has_loop() || survey.recorded_a.0 >= low {
        return fit;
    }
    for _ in 0..ROUNDS {
        let before = fit.shape.range_a.0;
        let range_a = (fit.shape.valid_down_to(&fit.theta, (low, high), survey.recorded_a.0), high);
        if (range_a.0 - before).abs() <= 0.002 * (high - low) {
            break;
        }
        let (shape, theta) = fit.shape.moved(&fit.theta, range_a);
        fit = select::fit_robust(problem, &shape, &theta, weights, survey.noise_bar, &[8]).0;
    }
    fit
}

/// A fit with curves of the order given, or of order 3 as in the paper, with delay and lag found; the command by its
/// convention, or otherwise where the data say so.
fn first_fit(problem: &Problem<'_>, survey: &Survey, options: &Options, input: Option<Input>, weights: &[f64]) -> Fit {
    let with = |input| fit_of(problem, survey, options, input, weights);
    if let Some(input) = input {
        return with(input);
    }
    let (held, ramp) = rayon::join(|| with(Input::Held), || with(Input::Ramp));
    if is_ramp(problem, [&held, &ramp], weights, survey.noise_bar) { ramp } else { held }
}

fn fit_of(problem: &Problem<'_>, survey: &Survey, options: &Options, input: Input, weights: &[f64]) -> Fit {
    let form = match options.hysteresis {
        HysteresisChoice::Hyperbolic | HysteresisChoice::Free => Form::Hyperbolic,
        HysteresisChoice::None => Form::None,
        HysteresisChoice::Auto if survey.both_directions >= MIN_BOTH => Form::Hyperbolic,
        HysteresisChoice::Auto => Form::None,
    };
    let levels = survey::levels(problem.segments, survey);
    let order = options.order.unwrap_or_else(|| 3.min(levels.saturating_sub(1)).max(1));
    let starts = if form != Form::None && problem.segments.len() <= MAX_STARTS { problem.segments.len() } else { 0 };
    let shape = Shape { order, form, input, lag: false, range_a: survey.covered_a, floor_bar: survey.floor_bar, starts };
    let start = start::start(problem, &shape, survey, weights);
    let (plain, limit) = select::fit_robust(problem, &shape, &start, weights, survey.noise_bar, &[8, 8]);
    let fit = dynamics::refine(problem, &plain, survey, weights, limit);
    elsewhere(problem, survey, fit, weights)
}

/// Where the fit does not reach the noise, the best of several other hyperbolas; the fit itself where none is better.
fn elsewhere(problem: &Problem<'_>, survey: &Survey, fit: Fit, weights: &[f64]) -> Fit {
    let Some(ln_a) = fit.shape.ln_a().filter(|_| select::rms(&fit.residual_bar, weights) > FAR * survey.noise_bar) else { return fit };
    let limit = select::threshold(&fit.residual_bar, weights, survey.noise_bar);
    let half = fit.theta[fit.shape.order + 1].abs().max(0.01 * survey.span_bar);
    let tried = A_AGAIN.map(|share| {
        let mut theta = fit.theta.clone();
        theta[ln_a] = (share * half * half).ln();
        problem.minimise(&fit.shape, &theta, weights, limit, 8)
    });
    let Some(best) = tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)) else { return fit };
    if best.cost > (1.0 - LOWER) * fit.cost {
        return fit;
    }
    let again = dynamics::refine(problem, &best, survey, weights, limit);
    if again.cost < fit.cost { again } else { fit }
}
