//! Where a simulation and a recording differ, what physics is missing, and how sure that is.
//!
//! A candidate effect is a block of the same pipeline that `--sim` uses. Each is fitted by simulation error, jointly
//! with the base model; "recalibrate only" gets the same effort. The choice is by BIC on effective samples and by
//! what held-out stretches show. This room knows no effect by name.

mod against;
mod answered;
mod apart;
mod base;
mod before_form;
mod claims;
mod coil;
mod comparable;
mod conclude;
mod confirm;
mod criteria;
mod descent;
mod diagnosis;
mod discover;
mod disturbance;
mod error;
mod errors;
mod evidence;
mod excerpt;
mod experiment;
mod findings;
mod fit;
mod foreign;
mod foreseen;
mod good;
mod guess;
mod heldout;
mod hollow;
mod incomparable;
mod keeps_place;
mod locate;
mod loss;
mod mistake;
mod model;
mod outcome;
mod posterior;
mod prior;
mod process;
mod profile;
mod proposals;
mod recall;
mod remainder;
mod remembered;
mod residuals;
mod rival;
mod round;
mod scatter;
mod screen;
mod search;
mod seen;
mod settled;
mod signature;
mod simulated;
mod simulator;
mod slower;
mod spread;
mod start;
mod stimuli;
mod story;
mod trust;
mod watch;
mod weigh;
mod witness;
mod words;

pub use coil::{CoilCurrent, Side};
pub use criteria::Criteria;
pub use diagnosis::{
    Candidate, Change, Claim, Curves, Diagnosed, Diagnosis, Discovery, Errors, Estimate, Finding, Followed, NextExperiment, OnUnseen,
    Place, Region, Remainder, Rival, SCHEMA, Verdict, Window,
};
pub use error::DiagnoseError;
pub use foreign::{Foreign, Plant, Recalibration};
pub use mistake::Mistake;
pub(crate) use model::CALIBRATION;
pub use remembered::Remembered;
pub use signature::{Axis, Signature};
pub use simulated::Simulated;
pub use story::{Cell, RunStory, Slice, Story, Strip, story};
pub use watch::{Tried, tell_of_candidates};
pub use words::{figure, paragraph, title, uncertainty};

use conclude::Beside;
use evidence::Evidence;
use fit::Fitter;
use good::Good;
use model::Model;
use scatter::{mask, restored, scatter};
use witness::Witness;

use crate::course::{Course, Preparation};
use crate::physics::{Effect, Kind};
use crate::recording::Recording;
use crate::valve::Valve;

/// Diagnoses a recording against a model.
///
/// # Errors
/// [`DiagnoseError`] where the recording is too short or has no pressure, or the model cannot be simulated.
pub fn diagnose(recording: &Recording, valve: &Valve) -> Result<Diagnosed, DiagnoseError> {
    diagnose_against(recording, valve, &[])
}

/// Diagnoses a recording against a model and data of the good valve, which decides what has changed. Of `good`, those
/// recordings count that move about as fast as this one.
///
/// # Errors
/// As [`diagnose`]; also where data of the good valve does not belong to the model.
pub fn diagnose_against(recording: &Recording, valve: &Valve, good: &[Recording]) -> Result<Diagnosed, DiagnoseError> {
    diagnose_by(&Criteria::default(), None, recording, valve, good)
}

/// The same by other thresholds than the usual ones, and with the fits of other diagnoses by other thresholds, where they are
/// remembered: the answer is the same with them and without.
///
/// # Errors
/// As [`diagnose_against`].
pub fn diagnose_by(
    criteria: &Criteria,
    remembered: Option<&Remembered>,
    recording: &Recording,
    valve: &Valve,
    good: &[Recording],
) -> Result<Diagnosed, DiagnoseError> {
    let mut evidence = Evidence::read(recording, valve)?;
    (evidence.criteria, evidence.remembered) = (*criteria, remembered.cloned());
    on_evidence(recording, evidence, valve, good, None)
}

/// Diagnoses a recording against a model that is not ours, with the effects that stand about it already, and data of the
/// good valve as in [`diagnose_against`].
///
/// # Errors
/// As [`diagnose`]; also [`DiagnoseError::Foreign`] where that model refuses.
pub fn diagnose_foreign(recording: &Recording, foreign: &Foreign, good: &[Recording]) -> Result<Diagnosed, DiagnoseError> {
    let preparation = Preparation { input: recording.input, ..Preparation::default() };
    let mut evidence = Evidence::of(Course::of(recording, &preparation)?)?;
    let valve = evidence.about(foreign)?;
    let base = evidence.base.clone();
    let found = on_evidence(recording, evidence, &valve, good, Some(foreign))?;
    match base.and_then(|base| base.refused()) {
        Some(problem) => Err(foreign.refused(problem)),
        None => Ok(found),
    }
}

fn on_evidence(
    recording: &Recording,
    mut evidence: Evidence,
    valve: &Valve,
    good: &[Recording],
    foreign: Option<&Foreign>,
) -> Result<Diagnosed, DiagnoseError> {
    let model_error = |source| DiagnoseError::Model { model: valve.name.clone(), source: Box::new(source) };
    let given = Model::base(valve).map_err(model_error)?.on(&evidence);
    if let Some(found) = process::look(recording, &mut evidence, &given) {
        return Ok(found);
    }
    if let Some((mistake, share)) = comparable::mistake(&evidence, valve).map_err(model_error)? {
        return Ok(incomparable::incomparable(recording, &evidence, &given, mistake, share));
    }
    let slower = Witness { recordings: good, valve };
    let good = if seen::speaks(&evidence, good) { Some(Good::of(good, valve, foreign, &evidence)?) } else { None };
    let witness = (good.is_none() && foreign.is_none() && !slower.recordings.is_empty()).then_some(slower);
    if let Some(denied) = good.as_ref().filter(|good| good.is_denied()) {
        evidence.notes.push(format!(
            "the model, also with what could be mended, is off by {} RMSE on the one recording that it was identified from: that recording does not vouch for it",
            figure(denied.rmse_bar.1, "bar")
        ));
    }
    if let Some(good) = &good {
        evidence.noise_bar = good.noise_of_bar(&evidence);
    }
    if let Some((base, good)) = evidence.base.as_mut().zip(good.as_ref().and_then(|g| g.evidence.base.as_ref())) {
        base.read_as(good.read());
    }
    let mut base = Model::base(good.as_ref().map_or(valve, |g| &g.valve)).map_err(model_error)?.on(&evidence);
    if let Some(good) = &good {
        base = base.off_by(good.form_error_bar());
    }
    if evidence.is_slow() {
        base = base.of_process(evidence.step_s());
        evidence.notes.push(format!(
            "a sample every {} s shows a process rather than the valve in it: its lag counts as part of the model, and only friction and play of the valve are looked for",
            evidence.step_s()
        ));
    }
    evidence.notes.extend(valve.warnings());
    let unsettled = settled::unsettled(&mut evidence, &base);
    let mut fitter = Fitter::without(&evidence, &unsettled);
    if let Some(good) = &good {
        fitter.floor_bar = evidence.noise_bar.hypot(good.form_error_bar());
        fitter.against_good = true;
        fitter.is_vouched = !good.is_denied();
        fitter = fitter.trusting(good.trust.clone());
    }
    // Readings that measure nothing go first, so that they hide nothing else.
    let (null, base, mut scattered) = restored(&mut fitter, base);
    // Neighbouring readings that a tone between the samples drives apart tell of more noise than there is error in all.
    fitter.floor_bar = fitter.floor_bar.min(null.rmse_bar.hypot(good.as_ref().map_or(0.0, Good::form_error_bar)));
    let mut spoilt = scatter(&fitter, &null, |e| !e.restores());
    spoilt.retain(|s| !s.finding.masked.is_empty());
    mask(&spoilt, &mut fitter.measured);
    scattered.extend(spoilt);
    fitter.found.extend(scattered.iter().map(|s| s.effect.id()));
    let short = excerpt::excerpt(&fitter, &base, Some(&null));
    let mut looking = short.as_ref().map(|short| fitter.looking_at(short));
    let mut search = search::search_in(&mut fitter, looking.as_mut(), &base);
    if let Some(tone) = answered::tone_given_back(&fitter, &search) {
        search = answered::search_without(&fitter, &base, &search.null, &tone);
        fitter.found.push(tone.effect.id());
        scattered.push(tone);
    }
    start::drop_denied(&fitter, &mut search, &unsettled);
    before_form::cause_before_form(&fitter, &mut search);
    let mut hollow = hollow::drop_hollow(&fitter, &mut search, good.is_some());
    hollow.extend(hollow::drop_hollow_scatter(&fitter, &search, &mut scattered));
    // What only the scatter shows is looked for about the best course, and what no simulation keeps in step with: a tone, a stick-slip.
    let is_late = |e: &dyn Effect| e.kind() == Kind::Scatter || e.is_apart_from_form();
    let has = |e: &dyn Effect| fitter.found.contains(&e.id()) || search.chosen.model.effects.iter().any(|have| have.id() == e.id());
    let mut late = scatter(&fitter, &search.chosen, |e| !has(e));
    late.retain(|s| is_late(s.effect) || s.finding.masked.is_empty());
    hollow.retain(|id| late.iter().all(|s| s.effect.id() != *id));
    scattered.extend(late);
    let null = search.null.clone();
    let beside = Beside { recording, given: &given, good: good.as_ref(), witness, scattered: &scattered, unsettled: &unsettled };
    let (mut found, mut search) = beside.answer(&base, (&fitter, looking.as_ref()), search);
    if let Some(note) = guess::guess(&fitter, &found.diagnosis, &search.chosen) {
        search.chosen = null.clone();
        (found, search) = beside.answer(&base, (&fitter, looking.as_ref()), search);
        found.diagnosis.notes.push(note);
    }
    let mut chosen = search.chosen;
    let still = base.standing_still();
    if found.stands_apart {
        let search = apart::search(&mut fitter, looking.as_mut(), &still);
        let (named, search) = beside.answer(&still, (&fitter, looking.as_ref()), search);
        if apart::follows(&fitter, &null, &search.chosen) && named.diagnosis.is_followed() {
            match guess::guess(&fitter, &named.diagnosis, &search.chosen) {
                Some(note) => found.diagnosis.notes.push(note),
                None => (found, chosen) = (named, search.chosen),
            }
        }
    }
    let remains = found.diagnosis.unexplained.is_some();
    // The states of a process last longer than those that are tried, and a foreign model is taken as it is.
    if let Some(term) = (remains && foreign.is_none() && !evidence.is_slow()).then(|| discover::discover(&fitter, &chosen)).flatten() {
        let beside: Vec<_> = scattered.iter().filter_map(scatter::Scattered::specification).collect();
        term.enter(&mut found, &chosen, beside);
    }
    if found.diagnosis.verdict != Verdict::Match {
        found.diagnosis.coil_current = coil::coil_current(recording, &fitter, &null);
        if let Some(coil) = &found.diagnosis.coil_current {
            found.diagnosis.summary = format!("{} {}", found.diagnosis.summary, coil.text());
        }
    }
    if !hollow.is_empty() {
        let names: Vec<String> = hollow.iter().map(|id| title(id)).collect();
        let text = format!(
            "{} would take a part of the error, but leave half of it or more: a cause in name only, and none is named",
            names.join(" and ")
        );
        found.diagnosis.notes.push(text);
    }
    found.diagnosis.notes.extend(short.as_ref().and_then(|short| excerpt::note(&evidence, short)));
    // What a foreign model does on another stimulus is not simulated.
    found.diagnosis.next_experiment = if found.recalibration.is_none() { experiment::next_experiment(&found) } else { None };
    Ok(found)
}

#[cfg(test)]
mod planted;
#[cfg(test)]
mod tests;
