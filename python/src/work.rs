//! What the library does for a call, free of Python.

use hil::identify::{HysteresisChoice, Options};
use hil::physics::{Pipeline, Signals};
use hil::recording::Recording;
use hil::report;
use hil::valve::{Input, Valve};

/// An answer in all its forms.
pub struct Answer {
    /// The model that was found.
    pub valve: Valve,
    /// The document of the contract.
    pub json: String,
    /// What the terminal shows.
    pub text: String,
    /// The page.
    pub page: String,
}

/// What a user may fix of an identification.
pub fn options(hysteresis: Option<&str>, order: Option<usize>, name: Option<String>) -> Result<Options, String> {
    let hysteresis = match hysteresis {
        None => HysteresisChoice::Auto,
        Some("hyperbolic") => HysteresisChoice::Hyperbolic,
        Some("free") => HysteresisChoice::Free,
        Some("none") => HysteresisChoice::None,
        Some(other) => return Err(format!("hysteresis `{other}`: \"hyperbolic\", \"free\" and \"none\" are allowed")),
    };
    Ok(Options { name, order, hysteresis, ..Options::default() })
}

/// What the command does between its samples.
pub fn input(name: &str) -> Result<Input, String> {
    match name {
        "held" => Ok(Input::Held),
        "ramp" => Ok(Input::Ramp),
        other => Err(format!("input `{other}`: \"held\" and \"ramp\" are allowed")),
    }
}

/// Identifies.
pub fn identify(recording: &Recording, options: &Options) -> Result<Answer, String> {
    let found = hil::identify::identify(recording, options).map_err(|e| e.to_string())?;
    let (json, text, page) = (report::identify::json(&found), report::identify::text(&found), report::identify::html(&found));
    Ok(Answer { valve: found.valve, json, text, page })
}

/// Diagnoses.
pub fn diagnose(recording: &Recording, valve: &Valve) -> Result<Answer, String> {
    let found = hil::diagnose::diagnose(recording, valve).map_err(|e| e.to_string())?;
    let json = report::diagnosis::json(&found.diagnosis);
    let text = report::diagnosis::text(&found.diagnosis);
    let page = report::diagnosis::page(&found, &hil::diagnose::story(&found));
    Ok(Answer { valve: found.augmented, json, text, page })
}

/// Simulates an even grid without a column of times.
pub fn simulate_even(valve: &Valve, input: Input, dt_s: f64, current_a: &[f64]) -> Result<Vec<f64>, String> {
    if !(dt_s.is_finite() && dt_s > 0.0) {
        return Err(format!("step {dt_s} s: a positive time is allowed"));
    }
    if let Some(at) = current_a.iter().position(|i| !i.is_finite()) {
        return Err(format!("current[{at}] is {}: finite values are allowed; give `time` where samples are missing", current_a[at]));
    }
    let (mut work, mut pressure) = (Vec::new(), Vec::new());
    let pipeline = Pipeline { input, ..Pipeline::of(valve).map_err(|e| e.to_string())? };
    if !current_a.is_empty() {
        pipeline.run(0.0, dt_s, &Signals::current(current_a), &mut work, &mut pressure);
    }
    match pressure.iter().position(|p| !p.is_finite()) {
        Some(at) => Err(format!("the pressure at sample {at} is not finite")),
        None => Ok(pressure),
    }
}
