//! From a recording to a valve model.
//!
//! The base model is that of the paper: a delayed current, two reference curves joined by a hyperbola, a floor at
//! tank pressure, and where the data show it a first-order lag. All parameters are fitted together to the free-run
//! simulation error, so that delay and loop width are told apart by whatever the recording holds: turning points,
//! changing amplitudes, steps, different rates. The method, its sources and its limits: `docs/identify.md`.

mod dynamics;
mod error;
mod fit;
mod model;
mod outcome;
mod profile;
mod segment;
mod select;
mod start;
mod survey;
mod uncertainty;
mod warnings;
mod windows;

pub use error::IdentifyError;
pub use outcome::{DrawnCurves, Identified, Parameter, Trace};
pub use select::OrderError;

use crate::course::{Course, CourseError, Preparation};
use crate::recording::Recording;
use fit::Problem;
use model::Shape;
use segment::Segment;

/// Whether the model has a hysteresis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum HysteresisChoice {
    /// As the data show it.
    #[default]
    Auto,
    /// The hyperbola of Eqs. (5)-(8).
    Hyperbolic,
    /// None: the average of the curves.
    None,
}

/// What a user may fix.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Name of the valve; the recording's name where `None`.
    pub name: Option<String>,
    /// Order of the curves; by held-out error where `None`.
    pub order: Option<usize>,
    /// Whether there is a hysteresis.
    pub hysteresis: HysteresisChoice,
    /// SHA-256 of the recording's bytes, hex.
    pub sha256: Option<String>,
}

/// Fewest samples with current and pressure.
const MIN_SAMPLES: usize = 50;
/// Up to this many segments the start of each is fitted.
const MAX_STARTS: usize = 4;
/// Highest order of the curves.
pub const MAX_ORDER: usize = 9;
/// Share of the direction bins that both directions must cover for a hysteresis to be fitted.
const MIN_BOTH: usize = survey::DIRECTION_BINS * 3 / 20;

/// Identifies a valve model from a recording.
///
/// # Errors
/// [`IdentifyError`] where a channel is missing, or the data hold nothing to identify.
pub fn identify(recording: &Recording, options: &Options) -> Result<Identified, IdentifyError> {
    identify_course(&Course::of(recording, &Preparation::default())?, options)
}

/// Identifies a valve model from a recording that is made ready.
///
/// # Errors
/// As [`identify`].
pub fn identify_course(course: &Course, options: &Options) -> Result<Identified, IdentifyError> {
    if let Some(order) = options.order.filter(|o| !(1..=MAX_ORDER).contains(o)) {
        return Err(IdentifyError::Option { option: "--order", problem: format!("{order} is not allowed; 1 to {MAX_ORDER} are") });
    }
    let (mut segments, whole) = windows::segments(course);
    let mut survey = checked_survey(course, &mut segments)?;
    survey.recorded_a = course.current_range_a();
    let duration_s = segments.iter().map(|s| s.time_s[s.len() - 1] - s.time_s[0]).fold(0.0, f64::max);
    let step_s = segments[0].step_s;
    let longest_s = (50.0 * step_s).max(0.5).min(0.25 * duration_s);
    let problem = Problem::new(&segments, longest_s, (4.0 * longest_s).min(0.25 * duration_s), survey.span_bar, survey.noise_bar);
    let weights = problem.weights();
    let noise_bar = survey.noise_bar;
    let mut fit = first_fit(&problem, &survey, options, &weights);
    let before = survey.covered_a;
    survey.cover(&segments, fit.theta[fit.shape.delay()], 4.0 * fit.shape.lag_s(&fit.theta));
    let range_a = to_the_floor(&fit, &survey);
    let change = (range_a.0 - before.0).abs().max((range_a.1 - before.1).abs());
    if change > 0.1 * (before.1 - before.0) {
        // A slow valve: what looked covered was still on its way.
        fit = first_fit(&problem, &survey, options, &weights);
    } else {
        (fit.shape, fit.theta) = fit.shape.moved(&fit.theta, range_a);
        survey.covered_a = range_a;
    }
    let mut orders = Vec::new();
    if options.order.is_none() {
        let limit = select::threshold(&fit.residual_bar, &weights, noise_bar);
        let largest = survey::levels(&segments, &survey).saturating_sub(1).max(1);
        let (order, tried) = select::choose_order(&problem, &fit, &weights, limit, largest);
        orders = tried;
        let shape = Shape { order, ..fit.shape.clone() };
        fit.theta = fit.shape.convert(&fit.theta, &shape, 0.0);
        fit.shape = shape;
        fit = dynamics::refine(&problem, &fit, &survey, &weights, limit);
    }
    fit = below_the_floor(&problem, fit, &survey, &weights);
    let (fit, limit) = select::fit_robust(&problem, &fit.shape, &fit.theta, &weights, noise_bar, &[10, 10]);
    if !fit.theta.iter().all(|t| t.is_finite()) || !fit.cost.is_finite() {
        return Err(IdentifyError::NotFinite { source_name: course.source.clone() });
    }
    let (fit, nodes) = profile::lowest(&problem, fit, &weights, limit, |fit| uncertainty::variance(&problem, fit, &weights, limit).0);
    let data = outcome::Data { course, whole, problem: &problem, survey: &survey };
    Ok(outcome::outcome(&data, options, &fit, (&nodes, limit), orders))
}

/// The covered range, down to where the higher curve reaches the floor: there it ends, and nothing is extrapolated.
fn to_the_floor(fit: &fit::Fit, survey: &survey::Survey) -> (f64, f64) {
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
fn below_the_floor(problem: &Problem<'_>, mut fit: fit::Fit, survey: &survey::Survey, weights: &[f64]) -> fit::Fit {
    const ROUNDS: usize = 3;
    let (low, high) = survey.covered_a;
    if survey.floor_bar.is_none() || !fit.shape.hysteresis || survey.recorded_a.0 >= low {
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

/// A fit with curves of the order given, or of order 3 as in the paper, with delay and lag found.
fn first_fit(problem: &Problem<'_>, survey: &survey::Survey, options: &Options, weights: &[f64]) -> fit::Fit {
    let hysteresis = match options.hysteresis {
        HysteresisChoice::Hyperbolic => true,
        HysteresisChoice::None => false,
        HysteresisChoice::Auto => survey.both_directions >= MIN_BOTH,
    };
    let levels = survey::levels(problem.segments, survey);
    let order = options.order.unwrap_or_else(|| 3.min(levels.saturating_sub(1)).max(1));
    let starts = if hysteresis && problem.segments.len() <= MAX_STARTS { problem.segments.len() } else { 0 };
    let shape = Shape { order, hysteresis, lag: false, range_a: survey.covered_a, floor_bar: survey.floor_bar, starts };
    let start = start::start(problem, &shape, survey, weights);
    let (plain, limit) = select::fit_robust(problem, &shape, &start, weights, survey.noise_bar, &[8, 8]);
    dynamics::refine(problem, &plain, survey, weights, limit)
}

/// The survey, after everything is refused from which nothing can be identified.
fn checked_survey(course: &Course, segments: &mut [Segment]) -> Result<survey::Survey, IdentifyError> {
    course.carries(MIN_SAMPLES)?;
    let found = survey::survey(segments, course.noise.bar);
    if found.samples < MIN_SAMPLES {
        return Err(CourseError::TooShort { source_name: course.source.clone(), readings: found.samples, wanted: MIN_SAMPLES }.into());
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
