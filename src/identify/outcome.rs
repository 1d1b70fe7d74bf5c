//! What identification hands over: the valve, how well it fits, how sure its parameters are.

use super::fit::{Fit, Problem};
use super::heldout::OrderError;
use super::parameters::{CurvePoint, Parameter, curve_points, parameters};
use super::profile::Node;
use super::quality::{Quality, quality};
use super::survey::{Survey, play};
use super::uncertainty::{covariance, staircase, variance};
use super::{Options, evidence, late, warnings, windows};
use crate::course::Course;
use crate::units::{Current, Pressure};
use crate::valve::{Identification, Input, ParameterEstimate, ReferenceCurves, Valve};

/// Measured and simulated pressure of one run, for a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Name of the run.
    pub run: Option<String>,
    /// Time [s].
    pub time_s: Vec<f64>,
    /// Current, delayed as in the model [A].
    pub delayed_current_a: Vec<f64>,
    /// Measured pressure [bar].
    pub measured_bar: Vec<f64>,
    /// Simulated pressure [bar].
    pub simulated_bar: Vec<f64>,
    /// Simulated minus measured pressure [bar].
    pub residual_bar: Vec<f64>,
}

/// The fitted curves, drawn over their range.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnCurves {
    /// Current [A].
    pub current_a: Vec<f64>,
    /// Ascending curve [bar].
    pub ascending_bar: Vec<f64>,
    /// Descending curve [bar].
    pub descending_bar: Vec<f64>,
}

/// An identified model.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// The model, ready to be written.
    pub valve: Valve,
    /// Share of the variance of the pressure that the model explains while the current rises.
    pub r2_ascending: Option<f64>,
    /// The same while the current falls.
    pub r2_descending: Option<f64>,
    /// RMSE of the simulation over all recorded samples [bar].
    pub rmse_bar: f64,
    /// RMSE over the samples that were fitted, without outliers and flat top [bar].
    pub rmse_fitted_bar: f64,
    /// RMSE of the average model, Eq. (10), over all recorded samples [bar].
    pub rmse_average_model_bar: f64,
    /// The parameters with their standard errors.
    pub parameters: Vec<Parameter>,
    /// The curves with their standard errors.
    pub curve_points: Vec<CurvePoint>,
    /// What the command does between its samples, as stated or as the data show it.
    pub input: Input,
    /// How good the model is.
    pub quality: Quality,
    /// Correlation time of the residual [samples]; standard errors are inflated by its root.
    pub correlation_time_samples: f64,
    /// Held-out error of every order that was tried; empty where the order was given.
    pub orders: Vec<OrderError>,
    /// Error on samples that the model had not seen [bar]; `None` where nothing was held out.
    pub heldout_bar: Option<f64>,
    /// What was found and handled.
    pub notes: Vec<String>,
    /// What the data cannot carry.
    pub warnings: Vec<String>,
    /// The curves for a report.
    pub curves: DrawnCurves,
    /// Measured and simulated pressure for a report.
    pub traces: Vec<Trace>,
}

impl Identified {
    /// Range of current in which the curves were seen [A].
    pub fn seen_a(&self) -> (f64, f64) {
        let drawn = &self.curves.current_a;
        (drawn.first().copied().unwrap_or(f64::NAN), drawn.last().copied().unwrap_or(f64::NAN))
    }
}

/// What was fitted to.
pub(super) struct Data<'a> {
    /// The recordings, made ready.
    pub courses: &'a [Course],
    /// What the problem holds of them.
    pub taken: windows::Taken,
    /// The fitted segments.
    pub problem: &'a Problem<'a>,
    /// What was found in them.
    pub survey: &'a Survey,
    /// Whether a controller is at work in a slow recording.
    pub controlled: bool,
}

pub(super) fn outcome(
    data: &Data<'_>,
    options: &Options,
    fit: &Fit,
    (nodes, limit): (&[Node], f64),
    (orders, heldout_bar): (Vec<OrderError>, Option<f64>),
) -> Identified {
    let Data { courses, taken, problem, survey, controlled } = *data;
    let shape = &fit.shape;
    let weights = problem.weights();
    let (variance, time) = variance(problem, fit, &weights, limit);
    let covariance =
        if shape.is_staircase() { staircase(problem, fit, (&weights, limit), variance) } else { covariance(fit, nodes, variance) };
    let late_error_s = late::late_error_s(problem, survey, fit, (&weights, limit), &covariance);
    let parameters = parameters(fit, &covariance, late_error_s);
    let curve_points = curve_points(fit, &covariance, survey.covered_a);
    let delay_s = fit.theta[shape.delay()];
    let delayed = problem.delayed(delay_s, shape.input);
    let simulated = problem.simulate(shape, &fit.theta, &delayed, false);
    let average = problem.simulate(shape, &fit.theta, &delayed, true);
    let error_of_delay = parameters.iter().find(|p| p.name == "delay").map_or(0.0, |p| p.std_error);
    let margin_s = (2.0 * error_of_delay).clamp(0.005, problem.delay_max_s.max(0.005));
    let stem = std::path::Path::new(&courses[0].source).file_stem().map(|s| s.to_string_lossy().into_owned());
    let name = options.name.clone().or(stem).unwrap_or_else(|| "identified".into());
    let hysteresis = shape.hysteresis(&fit.theta);
    let mut valve = Valve {
        name,
        source: format!("identified from {}", source_names(courses)),
        curves: shape.curves(&fit.theta),
        hysteresis,
        delay_s,
        delay_range_s: ((delay_s - margin_s).max(0.0), delay_s + margin_s),
        lag_s: shape.lag_s(&fit.theta),
        current_limits_a: survey.recorded_a,
        floor_bar: survey.floor_bar,
        noise_bar: survey.noise_bar,
        effects: Vec::new(),
        identification: None,
    };
    let ones: Vec<f64> =
        problem.segments.iter().flat_map(|s| s.pressure_bar.iter().map(|p| if p.is_finite() { 1.0 } else { 0.0 })).collect();
    let (rmse_bar, rmse_average_model_bar) = if taken == windows::Taken::All {
        (rmse(problem, &simulated, &ones), rmse(problem, &average, &ones))
    } else {
        rmse_of_all(courses, fit)
    };
    let (r2_ascending, r2_descending) = branches(problem, survey, &delayed, &simulated);
    let quality = quality(problem, survey, fit, &weights, limit, &delayed);
    let mut notes = warnings::notes(courses, survey, fit, &valve);
    notes.extend(warnings::taken_note(courses, problem, taken));
    let mut warnings = warnings::warnings(problem, survey, fit, &parameters, options, &valve);
    if controlled {
        warnings.push(warnings::CONTROLLED.into());
    }
    valve.identification = Some(Identification {
        recording: source_names(courses),
        sha256: (courses.len() == 1).then(|| options.sha256.first().cloned()).flatten(),
        heldout: heldout_bar.map(Pressure::new),
        input: Some(shape.input),
        fit_percent: Some((1e4 * quality.fit_percent).round() / 1e4),
        adequate: Some(quality.adequate),
        recordings: evidence::recordings(courses, &options.sha256, problem.segments, &fit.residual_bar, survey.noise_bar),
        rmse: Some(Pressure::new(rmse_bar)),
        rmse_average_model: Some(Pressure::new(rmse_average_model_bar)),
        covered: Some((Current::new(survey.covered_a.0), Current::new(survey.covered_a.1))),
        parameters: parameters
            .iter()
            .map(|p| (p.name.clone(), ParameterEstimate { value: quantity(p.value, &p.unit), std_error: quantity(p.std_error, &p.unit) }))
            .collect(),
        warnings: warnings.clone(),
    });
    let curves = valve.curves.clone();
    let traces = problem
        .segments
        .iter()
        .enumerate()
        .map(|(k, s)| Trace {
            run: s.run.clone(),
            time_s: s.time_s.clone(),
            delayed_current_a: delayed[problem.range(k)].to_vec(),
            measured_bar: s.pressure_bar.clone(),
            simulated_bar: simulated[problem.range(k)].to_vec(),
            residual_bar: fit.residual_bar[problem.range(k)].to_vec(),
        })
        .collect();
    Identified {
        valve,
        r2_ascending,
        r2_descending,
        rmse_bar,
        rmse_fitted_bar: rmse(problem, &simulated, &weights),
        rmse_average_model_bar,
        parameters,
        curve_points,
        input: shape.input,
        quality,
        correlation_time_samples: time,
        orders,
        heldout_bar,
        notes,
        warnings,
        curves: drawn(&curves, survey.covered_a),
        traces,
    }
}

/// The curves at equal distances of the current, where they were seen.
fn drawn(curves: &ReferenceCurves, (low, high): (f64, f64)) -> DrawnCurves {
    const POINTS: u32 = 200;
    let current_a: Vec<f64> = (0..=POINTS).map(|k| low + (high - low) * f64::from(k) / f64::from(POINTS)).collect();
    DrawnCurves {
        ascending_bar: current_a.iter().map(|i| curves.ascending_at(*i)).collect(),
        descending_bar: current_a.iter().map(|i| curves.descending_at(*i)).collect(),
        current_a,
    }
}

/// A value with its unit, in five significant digits.
fn quantity(value: f64, unit: &str) -> String {
    let digits = if value == 0.0 || !value.is_finite() { 0 } else { (4 - value.abs().log10().floor() as i32).clamp(0, 12) as usize };
    format!("{value:.digits$} {unit}")
}

fn rmse(problem: &Problem<'_>, simulated: &[f64], weights: &[f64]) -> f64 {
    let measured = problem.segments.iter().flat_map(|s| &s.pressure_bar);
    let (mut sum, mut count) = (0.0, 0.0);
    for ((s, p), w) in simulated.iter().zip(measured).zip(weights) {
        if *w > 0.0 {
            sum += (s - p) * (s - p);
            count += 1.0;
        }
    }
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}

/// RMSE of the model and of the average model over every sample of a long recording [bar].
fn rmse_of_all(courses: &[Course], fit: &Fit) -> (f64, f64) {
    let curves = fit.shape.curves(&fit.theta);
    let delay_s = fit.theta[fit.shape.delay()];
    let mut sums = [0.0; 3];
    let (mut delayed, mut out) = (Vec::new(), Vec::new());
    windows::pieces(courses, |segment, skip| {
        delayed.resize(segment.len(), 0.0);
        out.resize(segment.len(), 0.0);
        segment.delayed(delay_s, fit.shape.input, &mut delayed);
        for (n, average) in [false, true].into_iter().enumerate() {
            fit.shape.simulate(&fit.theta, &curves, (usize::MAX, segment), &delayed, &mut out, average);
            for (s, p) in out.iter().zip(&segment.pressure_bar).skip(skip).filter(|(_, p)| p.is_finite()) {
                sums[n] += (s - p) * (s - p);
                sums[2] += 0.5;
            }
        }
    });
    let root = |sum: f64| if sums[2] > 0.0 { (sum / sums[2]).sqrt() } else { 0.0 };
    (root(sums[0]), root(sums[1]))
}

/// R^2 of the simulation above the floor, for rising and for falling current.
fn branches(problem: &Problem<'_>, survey: &Survey, delayed: &[f64], simulated: &[f64]) -> (Option<f64>, Option<f64>) {
    let above = survey.above_bar();
    let mut sums = [[0.0f64; 4]; 2];
    for (k, s) in problem.segments.iter().enumerate() {
        let range = problem.range(k);
        let state = play(&delayed[range.clone()], 0.02 * (survey.covered_a.1 - survey.covered_a.0));
        for (j, at) in range.enumerate() {
            let p = s.pressure_bar[j];
            if s.weight[j] <= 0.0 || p <= above || state[j].abs() < 0.999 {
                continue;
            }
            let sum = &mut sums[usize::from(state[j] < 0.0)];
            sum[0] += 1.0;
            sum[1] += p;
            sum[2] += p * p;
            sum[3] += (simulated[at] - p) * (simulated[at] - p);
        }
    }
    let r2 = |s: [f64; 4]| {
        let total = s[2] - s[1] * s[1] / s[0];
        (s[0] > 10.0 && total > 0.0).then(|| 1.0 - s[3] / total)
    };
    (r2(sums[0]), r2(sums[1]))
}

/// The names of the recordings, for messages.
pub(super) fn source_names(courses: &[Course]) -> String {
    courses.iter().map(|c| c.source.as_str()).collect::<Vec<_>>().join(", ")
}
