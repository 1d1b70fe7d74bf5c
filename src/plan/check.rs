//! From the plan as it is written to the checked [`Plan`].

use std::collections::BTreeSet;
use std::path::Path;

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, Deserializer};

use super::bounds::limit;
use super::error::Wrong;
use super::file::{PhaseFile, PlanFile, SCHEMA};
use super::parameters::{Override, apply_overrides, substitute};
use super::stimulus::waveform;
use super::territory;
use super::{
    Attempts, ControllerFile, Interlocks, Level, LevelKind, Measure, Phase, Plan, PlanError, Preconditions, RetryOn, Role, Source,
    TimingLimits,
};
use crate::digest;
use crate::document;
use crate::metrics::MetricSpec;
use crate::units::{Pressure, Ratio, Temperature, Time};
use crate::valve::Valve;

/// Loop rate of a plan that names none [Hz]: the paper's.
const DEFAULT_RATE_HZ: f64 = 100.0;

/// Most samples of a plan: more than a day and a half at 100 Hz.
const MAX_SAMPLES: f64 = 2e7;

impl Plan {
    /// Reads a plan; `overrides` are the `--set KEY=VALUE` of the command line.
    ///
    /// # Errors
    /// [`PlanError`] with file, line, key and what is allowed.
    pub fn load(path: &Path, overrides: &[Override]) -> Result<Self, PlanError> {
        let text = document::read(path)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        Self::from_toml(&text, &path.display().to_string(), folder, overrides)
    }

    /// Reads the text of a plan; `source_name` stands in messages, paths in it are relative to `folder`.
    pub fn from_toml(text: &str, source_name: &str, folder: &Path, overrides: &[Override]) -> Result<Self, PlanError> {
        document::expect_schema(text, source_name, SCHEMA, "a plan")?;
        let syntax = |error: toml::de::Error| PlanError::Document(document::explain(text, source_name, &error));
        let mut root = DeTable::parse(text).map_err(syntax)?;
        apply_overrides(root.get_mut(), overrides)?;
        substitute(root.get_mut()).map_err(|w| w.shown(text, source_name))?;
        let file = PlanFile::deserialize(Deserializer::from(root)).map_err(syntax)?;
        for (key, name) in [("model", &file.model), ("valve", &file.valve)] {
            let outside = |problem: String| PlanError::Document(document::underline_key(text, source_name, key, &problem));
            name.as_deref().map_or(Ok(()), |name| territory::check_valve(folder, name)).map_err(outside)?;
        }
        let source = Source { name: source_name.into(), text: text.into(), folder: folder.into() };
        let overridden = overrides.iter().map(|o| o.0.clone()).collect();
        checked(file, source, overridden).map_err(|w| w.shown(text, source_name))
    }

    /// Whether the valve can do what the plan asks: pressures within the range that its curves reach, currents within
    /// its limits.
    pub fn check_valve(&self, valve: &Valve) -> Result<(), PlanError> {
        let (_, top) = valve.curves.pressure_range_bar();
        let (low, high) = valve.current_limits_a;
        let bottom = valve.floor_bar.unwrap_or(0.0).min(top);
        for phase in &self.phases {
            let (range, unit) = match phase.waveform.kind() {
                LevelKind::Pressure => ((bottom, top), "bar"),
                LevelKind::Current => ((low, high), "A"),
            };
            if let Some((level, span)) = phase.waveform.outside(range.0, range.1) {
                let message = format!(
                    "phase `{}` asks for {level} {unit}; the valve `{}` is good for {:.3} {unit} to {:.3} {unit}",
                    phase.name, valve.name, range.0, range.1
                );
                return Err(Wrong::new(span.clone(), message).shown(&self.source.text, &self.source.name));
            }
        }
        Ok(())
    }
}

fn checked(file: PlanFile, source: Source, overridden: Vec<String>) -> Result<Plan, Wrong> {
    if !file.name.get_ref().chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c)) || file.name.get_ref().is_empty() {
        return Err(Wrong::new(file.name.span(), "the name becomes part of file names: letters, digits, `-`, `_` and `.` only"));
    }
    let rate_hz = match &file.rate {
        None => DEFAULT_RATE_HZ,
        Some(rate) if (0.1..=10_000.0).contains(&rate.get_ref().value()) => rate.get_ref().value(),
        Some(rate) => return Err(Wrong::new(rate.span(), format!("`{}` is outside 0.1 Hz to 10 kHz", rate.get_ref()))),
    };
    let period_s = 1.0 / rate_hz;
    let controller = file.controller.over(ControllerFile::defaults(period_s))?;
    if file.phase.is_empty() {
        return Err(Wrong::new(file.name.span(), "the plan has no [[phase]]; one at least is wanted"));
    }
    let mut phases: Vec<Phase> = Vec::new();
    let mut names = BTreeSet::new();
    let mut before = None;
    for (role, group) in [(Role::Setup, &file.setup), (Role::Main, &file.phase), (Role::Teardown, &file.teardown)] {
        for written in group {
            if !names.insert(written.name.get_ref().clone()) {
                return Err(Wrong::new(written.name.span(), format!("a second phase `{}`; names are unique", written.name.get_ref())));
            }
            let phase = phase(written, role, before, &source, controller, file.on_fail, period_s)?;
            interlocked(&phase, &file.interlocks)?;
            // A question changes nothing of where the valve stands.
            if phase.prompt.is_none() {
                before = Some(Level { kind: phase.waveform.kind(), value: phase.waveform.at(phase.waveform.duration_s()) });
            }
            phases.push(phase);
        }
    }
    let samples: f64 = phases.iter().map(|p| p.waveform.duration_s() * rate_hz * f64::from(p.repeat)).sum();
    if samples > MAX_SAMPLES {
        return Err(Wrong::new(file.name.span(), format!("the plan has {samples:.0} samples; at most {MAX_SAMPLES:.0} are allowed")));
    }
    Ok(Plan {
        name: file.name.get_ref().clone(),
        description: file.description,
        sha256: digest::sha256(&source.text),
        period_s,
        parameters: file.parameters.iter().map(|(name, value)| (name.clone(), value.to_string())).collect(),
        overridden,
        model: file.model,
        valve: file.valve,
        controller,
        phases,
        interlocks: Interlocks {
            max_pressure_bar: file.interlocks.max_pressure.map(Pressure::value),
            max_current_a: file.interlocks.max_current.map(crate::units::Current::value),
            max_pressure_rate_bar_per_s: file.interlocks.max_pressure_rate.map(crate::units::PressureRate::value),
            silence_s: file.interlocks.silence.map_or(0.2, Time::value),
        },
        timing: TimingLimits {
            max_lost: file.timing.max_lost.map_or(0.01, Ratio::value),
            max_stale: file.timing.max_stale.map_or(0.01, Ratio::value),
            max_missed: file.timing.max_missed.map_or(0.01, Ratio::value),
            max_lateness_p99_s: file.timing.max_lateness_p99.map(Time::value),
            max_lateness_s: file.timing.max_lateness.map(Time::value),
        },
        preconditions: Preconditions {
            oil_temp_c: file
                .preconditions
                .oil_temp
                .as_ref()
                .map(|w| window(w.span(), w.get_ref().min, w.get_ref().max, Temperature::value))
                .transpose()?,
            supply_bar: file
                .preconditions
                .supply
                .as_ref()
                .map(|w| window(w.span(), w.get_ref().min, w.get_ref().max, Pressure::value))
                .transpose()?,
        },
        attempts: match &file.attempts.max {
            Some(max) if !(1..=100).contains(max.get_ref()) => return Err(Wrong::new(max.span(), "1 to 100 attempts are allowed")),
            max => Attempts {
                max: max.as_ref().map_or(1, |m| *m.get_ref()),
                retry_on: file.attempts.retry_on.clone().unwrap_or_else(|| vec![RetryOn::Error, RetryOn::Invalid]),
            },
        },
        source,
    })
}

fn phase(
    file: &PhaseFile,
    role: Role,
    before: Option<Level>,
    source: &Source,
    controller: crate::control::ControllerSettings,
    on_fail: super::OnFail,
    period_s: f64,
) -> Result<Phase, Wrong> {
    let stimulus = match (&file.stimulus, &file.prompt) {
        (Some(stimulus), None) => stimulus,
        (None, Some(written)) => return asking(file, written, role, source, controller),
        (Some(_), Some(prompt)) => return Err(Wrong::new(prompt.span(), "a phase has a `stimulus` or a `prompt`, not both")),
        (None, None) => {
            let message = format!("the phase `{}` has neither a `stimulus` nor a `prompt`", file.name.get_ref());
            return Err(Wrong::new(file.name.span(), message));
        }
    };
    let waveform = waveform(stimulus, before, &source.folder)?;
    let repeat = match &file.repeat {
        Some(repeat) if !(1..=100_000).contains(repeat.get_ref()) => {
            return Err(Wrong::new(repeat.span(), "1 to 100000 repetitions are allowed"));
        }
        repeat => repeat.as_ref().map_or(1, |r| *r.get_ref()),
    };
    let mut measures = Vec::new();
    for written in &file.measure {
        let metric = written.metric.get_ref().clone();
        metric.check().map_err(|problem| Wrong::new(written.metric.span(), problem))?;
        let id = metric.metric().id();
        if metric.needs().target && waveform.kind() == LevelKind::Current {
            let message = format!("`{id}` needs a target pressure, but the phase `{}` commands a current", file.name.get_ref());
            return Err(Wrong::new(written.metric.span(), message));
        }
        // The samples of a phase span its duration less one period.
        let spanned_s = waveform.duration_s() - period_s;
        if let MetricSpec::SteadyOffset(m) = &metric
            && m.window.value() > spanned_s + 1e-9
        {
            let (window, phase) = (m.window, file.name.get_ref());
            return Err(Wrong::new(
                written.metric.span(),
                format!("the window of {window} is longer than the phase `{phase}`, whose samples span {spanned_s:.3} s"),
            ));
        }
        let unit = metric.metric().unit();
        let limit = written.limit.as_ref().map(|l| limit(l, unit)).transpose()?;
        measures.push(Measure { metric, limit });
    }
    Ok(Phase {
        name: file.name.get_ref().clone(),
        role,
        waveform,
        prompt: None,
        repeat,
        controller: file.controller.over(controller)?,
        measures,
        on_fail: file.on_fail.unwrap_or(on_fail),
    })
}

/// A phase that asks a person.
fn asking(
    file: &PhaseFile,
    written: &Spanned<super::PromptFile>,
    role: Role,
    source: &Source,
    controller: crate::control::ControllerSettings,
) -> Result<Phase, Wrong> {
    if let Some(measure) = file.measure.first() {
        return Err(Wrong::new(measure.metric.span(), "a phase with a `prompt` measures nothing but the answer"));
    }
    if let Some(repeat) = &file.repeat {
        return Err(Wrong::new(repeat.span(), "a phase with a `prompt` asks once"));
    }
    Ok(Phase {
        name: file.name.get_ref().clone(),
        role,
        waveform: super::Waveform::none(),
        prompt: Some(super::prompt::checked(written, source)?),
        repeat: 1,
        controller,
        measures: Vec::new(),
        // Nobody goes on where the answer says no, unless the plan says so.
        on_fail: file.on_fail.unwrap_or(super::OnFail::Stop),
    })
}

/// A phase that asks for what the plan's own interlock forbids would stop the run each time.
fn interlocked(phase: &Phase, interlocks: &super::InterlocksFile) -> Result<(), Wrong> {
    let (limit, key, unit) = match phase.waveform.kind() {
        LevelKind::Pressure => (interlocks.max_pressure.map(Pressure::value), "max_pressure", "bar"),
        LevelKind::Current => (interlocks.max_current.map(crate::units::Current::value), "max_current", "A"),
    };
    let Some(limit) = limit else { return Ok(()) };
    match phase.waveform.outside(f64::NEG_INFINITY, limit) {
        Some((level, span)) => Err(Wrong::new(
            span.clone(),
            format!("phase `{}` asks for {level} {unit}, and the interlock `{key}` stops the run above {limit} {unit}", phase.name),
        )),
        None => Ok(()),
    }
}

fn window<T: Copy + std::fmt::Display>(
    span: std::ops::Range<usize>,
    min: T,
    max: T,
    value: impl Fn(T) -> f64,
) -> Result<(f64, f64), Wrong> {
    if value(min) > value(max) {
        return Err(Wrong::new(span, format!("`min` ({min}) is larger than `max` ({max})")));
    }
    Ok((value(min), value(max)))
}
