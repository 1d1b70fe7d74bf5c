//! Where a simulation and a recording differ, what physics is missing, and how sure that is.
//!
//! A candidate effect is a block of the same pipeline that `--sim` uses. Each is fitted by simulation error, jointly
//! with the base model; "recalibrate only" gets the same effort. The choice is by BIC on effective samples and by
//! what held-out stretches show. This room knows no effect by name.

mod conclude;
mod descent;
mod diagnosis;
mod evidence;
mod experiment;
mod fit;
mod heldout;
mod locate;
mod loss;
mod model;
mod remainder;
mod rival;
mod screen;
mod search;
mod signature;
mod start;
mod stimuli;
mod story;
mod words;

pub use diagnosis::{
    Candidate, Change, Curves, Diagnosed, Diagnosis, Errors, Estimate, Finding, NextExperiment, Place, Region, Remainder, Rival, SCHEMA,
    Verdict, Window,
};
pub use signature::{Axis, Signature};
pub use story::{Cell, RunStory, Slice, Story, Strip, story};
pub use words::{figure, paragraph, title, uncertainty};

use conclude::{Findings, Scattered};
use evidence::Evidence;
use fit::Fitter;
use model::{Model, Simulator};

use crate::course::{Course, CourseError, Preparation};
use crate::physics::{EFFECTS, Effect, Kind, Scatter};
use crate::recording::Recording;
use crate::valve::Valve;

/// Why a recording cannot be diagnosed.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// The recording cannot carry a diagnosis.
    #[error("{source_name}: {problem}")]
    Recording {
        /// The recording.
        source_name: String,
        /// What is missing, and what is wanted.
        problem: String,
    },
    /// It cannot be compared with any model.
    #[error(transparent)]
    Course(#[from] CourseError),
    /// The model cannot be simulated.
    #[error("{model}: {source}")]
    Model {
        /// The model's name.
        model: String,
        /// What is wrong.
        source: Box<crate::physics::PhysicsError>,
    },
}

/// Diagnoses a recording against a model.
///
/// # Errors
/// [`DiagnoseError`] where the recording is too short, has no excitation or no pressure, or the model cannot be simulated.
pub fn diagnose(recording: &Recording, valve: &Valve) -> Result<Diagnosed, DiagnoseError> {
    let mut evidence = Evidence::of(Course::of(recording, &Preparation::default())?)?;
    let mut base = Model::base(valve).map_err(|source| DiagnoseError::Model { model: valve.name.clone(), source: Box::new(source) })?;
    if evidence.is_slow() {
        base = base.of_process(evidence.step_s());
        evidence.notes.push(format!(
            "a sample every {} s shows a process rather than the valve in it: its lag counts as part of the model, and only friction and play of the valve are looked for",
            evidence.step_s()
        ));
    }
    if let Some(problem) = evidence.mismatch(valve) {
        return Err(DiagnoseError::Recording { source_name: recording.source.clone(), problem });
    }
    evidence.notes.extend(valve.warnings());
    let mut fitter = Fitter::new(&evidence);
    for k in start::unsettled(&evidence, &base) {
        fitter.measured[k] = f64::NAN;
    }
    // Readings that measure nothing go first, so that they hide nothing else.
    let mut null = fitter.recalibrate(&base, &[]);
    if !base.confirms_lag(null.theta[model::BASE - 1]) {
        base = base.distrusting_lag();
        null = fitter.recalibrate(&base, &[]);
    }
    let mut scattered = scatter(&fitter, &null, |_| true);
    scattered.retain(|s| !s.finding.masked.is_empty());
    for s in &scattered {
        for k in &s.finding.masked {
            fitter.measured[*k] = f64::NAN;
        }
        fitter.found.push(s.effect.id());
    }
    let search = search::search(&mut fitter, &base);
    // What only the scatter shows is looked for about the best course.
    let late = scatter(&fitter, &search.chosen, |e| e.kind() == Kind::Scatter && !fitter.found.contains(&e.id()));
    scattered.extend(late);
    let mut found = Findings { recording, base: &base, fitter: &fitter, search: &search, scattered }.conclude();
    found.diagnosis.next_experiment = experiment::next_experiment(&found);
    Ok(found)
}

/// Those of the effects asked for whose signature shows in the scatter about this fit, or in stretches of their own.
fn scatter(fitter: &Fitter<'_>, fit: &fit::Fit<'_>, asked: impl Fn(&dyn Effect) -> bool) -> Vec<Scattered> {
    let mut simulated = Vec::new();
    Simulator::new(fitter.evidence).pressure(&fit.model, &fit.theta, &mut simulated);
    let look = Scatter {
        dt_s: fitter.evidence.step_s(),
        noise_bar: fitter.evidence.noise_bar,
        measured_bar: &fitter.measured,
        simulated_bar: &simulated,
    };
    EFFECTS
        .iter()
        .copied()
        .filter(|e| asked(*e))
        .filter_map(|effect| effect.scatter(&look).map(|finding| Scattered { effect, finding }))
        .collect()
}

#[cfg(test)]
mod tests;
