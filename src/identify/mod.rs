//! From a recording to a valve model.
//!
//! The base model is that of the paper: a delayed current, two reference curves joined by a hyperbola, a floor at
//! tank pressure, and where the data show it a first-order lag. All parameters are fitted together to the free-run
//! simulation error, so that delay and loop width are told apart by whatever the recording holds: turning points,
//! changing amplitudes, steps, different rates. The method, its sources and its limits: `docs/identify.md`.

mod arrival;
mod direction;
mod dynamics;
mod error;
mod evidence;
mod fit;
mod heldout;
mod inverse;
mod late;
mod model;
mod options;
mod outcome;
mod parameters;
mod profile;
mod quality;
mod search;
mod segment;
mod select;
mod settled;
mod start;
mod survey;
mod uncertainty;
mod warnings;
mod windows;

pub use error::IdentifyError;
pub use heldout::OrderError;
pub use options::{HysteresisChoice, MAX_ORDER, Options};
pub use outcome::{DrawnCurves, Identified, Trace};
pub use parameters::{CurvePoint, Parameter};
pub use quality::Quality;

use crate::course::{Course, CourseError, Preparation};
use crate::process_loop::{self, SLOW_STEP_S};
use crate::recording::Recording;
use crate::valve::{Input, MAX_TIME_S};
use fit::Problem;
use outcome::source_names;
use segment::Segment;
use windows::Taken;

/// Fewest samples with current and pressure.
const MIN_SAMPLES: usize = 50;
/// Identifies a valve model from a recording.
///
/// # Errors
/// See [`identify_courses`].
pub fn identify(recording: &Recording, options: &Options) -> Result<Identified, IdentifyError> {
    identify_all(std::slice::from_ref(recording), options)
}

/// Identifies a valve model from recordings of the same valve, together: a sweep and a commissioning drive, say.
///
/// # Errors
/// See [`identify_courses`].
pub fn identify_all(recordings: &[Recording], options: &Options) -> Result<Identified, IdentifyError> {
    let preparation = Preparation { input: options.input, ..Preparation::default() };
    let courses = recordings.iter().map(|r| Course::of(r, &preparation)).collect::<Result<Vec<_>, _>>()?;
    identify_courses(&courses, options)
}

/// Identifies a valve model from a recording that is made ready.
///
/// # Errors
/// See [`identify_courses`].
pub fn identify_course(course: &Course, options: &Options) -> Result<Identified, IdentifyError> {
    identify_courses(std::slice::from_ref(course), options)
}

/// Identifies a valve model from recordings of the same valve that are made ready, together.
///
/// # Errors
/// [`IdentifyError`] where there is no recording, a channel is missing, or the data hold nothing to identify.
pub fn identify_courses(courses: &[Course], options: &Options) -> Result<Identified, IdentifyError> {
    if let Some(order) = options.order.filter(|o| !(1..=MAX_ORDER).contains(o)) {
        return Err(IdentifyError::Option { option: "--order", problem: format!("{order} is not allowed; 1 to {MAX_ORDER} are") });
    }
    if options.falling {
        let rising = Options { falling: false, ..options.clone() };
        let mut found = identify_courses(&direction::turned(courses), &rising)?;
        found.notes.push(FALLING.into());
        return Ok(found);
    }
    let stated = courses.iter().find(|c| c.input_stated).map(|c| c.input);
    let options = &Options { input: options.input.or(stated), ..options.clone() };
    let (mut segments, taken) = windows::segments(courses, options.input.unwrap_or(Input::Ramp));
    let mut survey = checked_survey(courses, &mut segments)?;
    // In a closed loop the controller turns the two against each other, whichever way the process moves.
    let controlled = courses.iter().any(is_control_loop);
    if !controlled && direction::falls(&segments) {
        return Err(IdentifyError::Falls { source_name: source_names(courses) });
    }
    survey.recorded_a = windows::range(courses);
    let duration_s = segments.iter().map(|s| s.time_s[s.len() - 1] - s.time_s[0]).fold(0.0, f64::max);
    let longest_step_s = segments.iter().map(|s| s.step_s).fold(0.0, f64::max);
    let longest_s = (50.0 * longest_step_s).max(0.5).min(0.25 * duration_s);
    let longest_lag_s = (4.0 * longest_s).min(0.25 * duration_s).min(MAX_TIME_S);
    let (span_bar, noise_bar) = (survey.span_bar, survey.noise_bar);
    let of = |segments| Problem::new(segments, longest_s, longest_lag_s, span_bar, noise_bar);
    let mut problem = of(&segments);
    let mut weights = problem.weights();
    // Of readings that are left out nobody knows whether the command stood meanwhile, and a straight line is right for the rest.
    let between = Options { input: options.input.or(taken.is_thinned().then_some(Input::Ramp)), ..options.clone() };
    let mut found = search::search(&problem, &mut survey, &between, &weights);
    let mut all: Vec<Segment>;
    if let Taken::Every(_) = taken {
        all = windows::all(courses);
        checked_survey(courses, &mut all)?;
        problem = of(&all);
        let of_all = problem.weights();
        found = search::to_the_end(&problem, (found, &weights), &survey, options, &of_all);
        weights = of_all;
    }
    let heldout_bar = found.heldout_bar;
    if !found.fit.theta.iter().all(|t| t.is_finite()) || !found.fit.cost.is_finite() {
        return Err(IdentifyError::NotFinite { source_name: source_names(courses) });
    }
    let limit = found.limit_bar;
    let (fit, nodes) = profile::lowest(&problem, found.fit, &weights, limit, |fit| uncertainty::variance(&problem, fit, &weights, limit).0);
    let data = outcome::Data { courses, taken, problem: &problem, survey: &survey, controlled };
    Ok(outcome::outcome(&data, options, &fit, (&nodes, limit), (found.orders, heldout_bar)))
}

/// Whether a recording is slow and shows a controller at work.
fn is_control_loop(course: &Course) -> bool {
    let longest = course.runs.iter().max_by_key(|run| run.current_a.len());
    longest.is_some_and(|run| run.dt_s >= SLOW_STEP_S && process_loop::is_closed(&run.pressure_bar, &run.current_a))
}

/// What is said of a model that was asked to fall.
const FALLING: &str = "a falling characteristic was asked for: the model holds over the negative current; other commands take recordings of this valve with --map current_a=\"-1 * current_a\"";

/// The survey, after everything is refused from which nothing can be identified.
fn checked_survey(courses: &[Course], segments: &mut [Segment]) -> Result<survey::Survey, IdentifyError> {
    for course in courses {
        course.carries(MIN_SAMPLES)?;
    }
    // The noise of all readings, whichever recording they stand in.
    let (squares, readings) = courses
        .iter()
        .map(|c| (c.noise.bar, c.readings() as f64))
        .fold((0.0, 0.0), |(s, n), (bar, count)| (s + count * bar * bar, n + count));
    let found = survey::survey(segments, f64::sqrt(squares / f64::max(readings, 1.0)));
    if found.samples < MIN_SAMPLES {
        return Err(CourseError::TooShort { source_name: source_names(courses), readings: found.samples, wanted: MIN_SAMPLES }.into());
    }
    Ok(found)
}

#[cfg(test)]
mod law;
#[cfg(test)]
mod tests;
