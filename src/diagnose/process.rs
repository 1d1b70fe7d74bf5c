//! A slow recording of a closed loop: the diagnosis of a valve that sticks in it, or what is said where none is shown to.
//!
//! Whether the stem sticks is found from output and process value alone (`process_loop`); the model as given then only says what
//! it lacks.

use std::collections::BTreeMap;

use super::diagnosis::{Candidate, Claim, Curves, Diagnosed, Diagnosis, Errors, Estimate, Finding, Remainder, SCHEMA, Verdict};
use super::evidence::{Evidence, rms};
use super::locate::locate;
use super::model::Model;
use super::simulator::Simulator;
use crate::course::Input;
use crate::physics::{EFFECTS, Effect, specification};
use crate::process_loop::{Assessment, Besides, Comparison, Motion, Shape, Stiction, assess};
use crate::recording::Recording;
use crate::units::three_figures;
use crate::valve::{Hysteresis, Polynomial, ReferenceCurves, Valve};

/// Looks at the loop; the diagnosis where its valve is shown to stick and the model does not know it. Otherwise what was found
/// goes to the notes of the evidence.
pub fn look(recording: &Recording, evidence: &mut Evidence, given: &Model<'_>) -> Option<Diagnosed> {
    if !evidence.is_slow() {
        return None;
    }
    let run = evidence.longest().1;
    let found = assess(&run.pressure_bar, &run.current_a)?;
    evidence.controlled = true;
    let known = |effect: &dyn Effect| given.valve.effects.iter().any(|e| e.id == effect.id());
    let sticking = found.stiction.and_then(|s| Some((s, friction(&s)?))).filter(|(_, (effect, _))| !known(*effect));
    let notes = notes(&found, evidence.step_s());
    evidence.notes.extend(notes);
    let (stiction, (effect, theta)) = sticking?;
    let comparison = found.comparison.as_ref()?;
    let augmented = augmented(given.valve, evidence, &stiction, (effect, &theta));
    let finding = finding((effect, &theta), &stiction, comparison, &found, evidence.step_s());
    let heldout = errors(comparison, found.shape.as_ref());
    Some(diagnosed(recording, evidence, given, augmented, finding, comparison.bic, heldout))
}

/// The effect that stands for a stem that sticks, with its values.
fn friction(stiction: &Stiction) -> Option<(&'static dyn Effect, Vec<f64>)> {
    EFFECTS.iter().find_map(|effect| Some((*effect, effect.stick_slip(stiction.stem.friction())?)))
}

/// The process with the stem before it, as a valve file. A process that falls with its output is none; the given model then
/// takes the effect.
fn augmented(given: &Valve, evidence: &Evidence, stiction: &Stiction, (effect, theta): (&dyn Effect, &[f64])) -> Valve {
    let mut valve = given.clone();
    let process = stiction.process;
    if process.gain > 0.0 {
        let line = || Polynomial::new(vec![process.gain, process.offset]);
        let output = || evidence.grids.iter().flat_map(|g| g.current_a.iter().copied());
        let range = (output().fold(f64::INFINITY, f64::min), output().fold(f64::NEG_INFINITY, f64::max));
        valve.curves = ReferenceCurves::on_range(line(), line(), range);
        valve.hysteresis = Hysteresis::None;
        // A command that is held acts during the whole step before the reading, one on a line half of it.
        let earlier = if evidence.input == Input::Held { 1.0 } else { 0.5 };
        valve.delay_s = (process.delay as f64 - earlier) * evidence.step_s();
        valve.delay_range_s = (valve.delay_s, valve.delay_s);
        valve.lag_s = process.lag * evidence.step_s();
        valve.floor_bar = None;
        valve.noise_bar = evidence.noise_bar;
        valve.identification = None;
    }
    valve.effects.push(specification(effect, theta));
    valve
}

/// The effect with what speaks for it.
fn finding(
    (effect, theta): (&'static dyn Effect, &[f64]),
    stiction: &Stiction,
    comparison: &Comparison,
    found: &Assessment,
    step_s: f64,
) -> Finding {
    let stem = stiction.stem;
    // The folds say how sure the band is; jump and motion have no spread of their own.
    let spread = 0.5 * (stiction.bands.1 - stiction.bands.0);
    let estimate = |(k, (p, value)): (usize, (&crate::physics::Parameter, &f64))| {
        let std_error = (k == 0).then_some(spread * value / stem.band);
        (p.name.to_string(), Estimate::normal(p, *value, std_error))
    };
    let parameters: BTreeMap<String, Estimate> = effect.parameters().iter().zip(theta).enumerate().map(estimate).collect();
    let ahead = comparison.gain.0 > 0.0;
    let (without, with) = errors(comparison, found.shape.as_ref());
    let gain = if ahead { comparison.gain } else { found.shape.as_ref().map_or(comparison.gain, |s| s.gain) };
    let in_bar = |nats: f64| without * (1.0 - (-nats).exp());
    let p_value = if ahead { comparison.p_value } else { found.shape.as_ref().map_or(1.0, |s| s.p_value) };
    Finding {
        id: effect.id().into(),
        claim: Claim::Lacks,
        share: 1.0 / (1.0 + (-0.5 * comparison.bic).exp()),
        is_class: false,
        parameters,
        heldout_gain_bar: without - with,
        heldout_gain_ci_bar: Some((in_bar(gain.0), in_bar(gain.1))),
        p_value,
        indistinguishable: Vec::new(),
        evidence: evidence_text(stiction, comparison, found, step_s, (without, with)),
    }
}

/// Held-out errors without and with friction, by what shows it: one step ahead, or the course [bar].
fn errors(comparison: &Comparison, shape: Option<&Shape>) -> (f64, f64) {
    match shape {
        Some(shape) if comparison.gain.0 <= 0.0 => (shape.heldout.1.sqrt(), shape.heldout.0.sqrt()),
        _ => comparison.heldout_rms,
    }
}

fn evidence_text(stiction: &Stiction, comparison: &Comparison, found: &Assessment, step_s: f64, (without, with): (f64, f64)) -> String {
    let stem = stiction.stem;
    let figure = |v: f64| three_figures(v, 6);
    let motion = match stem.motion {
        Motion::Steps => "sticks again after each move",
        Motion::Slides => "slides on until the output turns",
    };
    let mut text = format!(
        "a stem that sticks, identified together with the process, explains the loop better than any without friction that was tried (linear up to order eight, curved, with a periodic disturbance): S = {} (dead band and stick band; {} to {} over parts of the record), J = {} (slip) in the unit of the output, {} slips, after which it {motion}; BIC {:+.0}; error on held-out stretches {} {} without and {} bar with it",
        figure(stem.band),
        figure(stiction.bands.0),
        figure(stiction.bands.1),
        figure(stem.jump),
        stiction.slips,
        -comparison.bic,
        if comparison.gain.0 > 0.0 { "one step ahead" } else { "over the course" },
        figure(without),
        figure(with),
    );
    if let Some(oscillation) = found.oscillation {
        let regular = if oscillation.regularity > 1.0 { "regular" } else { "irregular" };
        text += &format!("; the oscillation of {} s is {regular}", figure(oscillation.period * step_s));
    }
    for symptom in &found.symptoms {
        let says = match symptom.stiction {
            Some(true) => "speaks for it",
            Some(false) => "does not speak for it",
            None => "is undecided",
        };
        text += &format!("; {} {says} ({:.2})", symptom.method, symptom.figure);
    }
    if let Some(width) = found.apparent {
        text += &format!("; the ellipse of pressure over output is {} wide", figure(width));
    }
    text
}

/// What is said of the loop whatever the verdict.
fn notes(found: &Assessment, step_s: f64) -> Vec<String> {
    let mut out = vec![
        "the recording shows a control loop: the current answers the pressure. Loop width and delay of a model that was identified from it may be friction of the valve".to_string(),
    ];
    if found.stiction.is_some() {
        return out;
    }
    out.extend(found.withheld.map(|why| format!("friction would explain more, but it is not named: {why}")));
    let Some(oscillation) = found.oscillation.filter(|o| o.regularity > 1.0) else {
        out.push("the loop shows no regular oscillation, and nothing shows friction in its valve".into());
        return out;
    };
    let period = three_figures(oscillation.period * step_s, 3);
    let besides = found.comparison.as_ref().map(|c| c.besides);
    out.push(match besides {
        _ if found.withheld.is_some() => format!("where its oscillation of {period} s comes from cannot be told from this record"),
        Some(Besides::Periodic(..)) => {
            format!("the loop oscillates with a period of {period} s, and nothing shows friction in its valve: a periodic disturbance from outside explains it best")
        }
        Some(Besides::Curve) => {
            format!("the loop oscillates with a period of {period} s, and nothing shows friction in its valve: a curved characteristic explains it best")
        }
        _ => format!(
            "the loop oscillates with a period of {period} s, and nothing shows friction in its valve: a linear loop does as well, so that it comes from the tuning or from a disturbance, which this record does not tell apart"
        ),
    });
    out
}

fn diagnosed(
    recording: &Recording,
    evidence: &Evidence,
    given: &Model<'_>,
    augmented: Valve,
    finding: Finding,
    bic: f64,
    (refit_heldout, augmented_heldout): (f64, f64),
) -> Diagnosed {
    let measured = evidence.pressure_bar();
    let simulated = |model: &Model<'_>| {
        let mut theta = model.calibrated();
        theta[super::base::AT.lag] = model.valve.lag_s;
        let mut out = Vec::new();
        Simulator::new(evidence).pressure(model, &theta, &mut out);
        out
    };
    let base_bar = simulated(given);
    let augmented_bar = Model::base(&augmented).map(|model| simulated(&model.on(evidence))).unwrap_or_else(|_| base_bar.clone());
    let base_residual: Vec<f64> = measured.iter().zip(&base_bar).map(|(y, p)| y - p).collect();
    let noise = evidence.noise_bar;
    let explained = augmented_heldout <= evidence.criteria.structure_named * noise;
    let rest_bar = (augmented_heldout.powi(2) - noise.powi(2)).max(0.0).sqrt();
    let unexplained =
        (!explained).then(|| Remainder { rms_bar: rest_bar, depends_on: Vec::new(), table_heldout_gain_bar: 0.0, windows: Vec::new() });
    let base = rms(&base_residual);
    let candidates =
        vec![Candidate { id: finding.id.clone(), heldout_rmse_bar: Some(augmented_heldout), bic: -bic, rejected_because: None }];
    let mut diagnosis = Diagnosis {
        schema: SCHEMA.into(),
        recording: recording.source.clone(),
        model: given.valve.name.clone(),
        verdict: if explained { Verdict::Explained } else { Verdict::PartlyExplained },
        summary: String::new(),
        mistake: None,
        rmse_bar: Errors { base, base_heldout: base, refit_heldout, augmented_heldout, noise_floor: noise },
        effects: vec![finding],
        form: Vec::new(),
        recalibration: Vec::new(),
        place: locate(evidence, &base_residual, &base_bar),
        candidates,
        unexplained,
        discovered: None,
        coil_current: None,
        other_drives: None,
        next_experiment: None,
        notes: evidence.notes.clone(),
    };
    diagnosis.summary = format!(
        "The valve of this control loop sticks. {} The errors on held-out data are those of the loop's own models, without and with friction.",
        super::words::summary(&diagnosis)
    );
    let curves = Curves { refit_bar: base_bar.clone(), base_bar, augmented_bar, ..Curves::along(evidence) };
    Diagnosed { diagnosis, augmented, curves, open: None, recalibration: None, stands_apart: false }
}
