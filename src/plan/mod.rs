//! The declarative test: phases, stimuli, measurements.
//!
//! A plan is read in two steps: [`PlanFile`] as it is written, then [`Plan`], checked and in canonical units. After
//! a `Plan` exists and [`Plan::check_valve`] has passed, nothing downstream validates again.

mod bounds;
mod check;
mod controller;
mod error;
mod file;
mod level;
mod limits_file;
mod parameters;
mod prompt;
mod serial;
mod stimulus;
mod stimulus_table;
mod territory;
mod waveform;

use std::path::PathBuf;

pub use bounds::LimitFile;
pub use controller::ControllerFile;
pub use error::PlanError;
pub use file::{
    AttemptsFile, InterlocksFile, MeasureFile, OnFail, ParameterValue, PhaseFile, PlanFile, PreconditionsFile, RetryOn, SCHEMA, TimingFile,
    Window,
};
pub use level::{Level, LevelKind, LevelRate};
pub use limits_file::{LIMITS_SCHEMA, LimitEntry, LimitsFile};
pub use parameters::Override;
pub use prompt::{Answer, AnswerFile, Kind as PromptKind, Picture, Prompt, PromptFile};
pub use serial::{CheckCharacter, SerialError, SerialForm};
pub use stimulus::StimulusFile;
pub use territory::{allow_anywhere, project};
pub use waveform::{Piece, Waveform};

use crate::control::ControllerSettings;
use crate::limits::Limit;
use crate::metrics::MetricSpec;

/// A checked plan.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Name.
    pub name: String,
    /// What the plan is for, and where its limits come from.
    pub description: String,
    /// SHA-256 of the file's bytes, hex.
    pub sha256: String,
    /// Loop period [s].
    pub period_s: f64,
    /// Every parameter with its effective text.
    pub parameters: Vec<(String, String)>,
    /// Names of what `--set` changed.
    pub overridden: Vec<String>,
    /// The valve model that the controller believes in: path or bare name; `None` for the valve that runs.
    pub model: Option<String>,
    /// The valve that a simulation runs where the command names none; path or bare name.
    pub valve: Option<String>,
    /// Controller of the phases that say nothing else.
    pub controller: ControllerSettings,
    /// Every phase in the order in which it runs: setup, main, teardown.
    pub phases: Vec<Phase>,
    /// What stops the run at once.
    pub interlocks: Interlocks,
    /// What makes the run INVALID by its timing.
    pub timing: TimingLimits,
    /// What must hold while it runs.
    pub preconditions: Preconditions,
    /// How often a valve may be tried.
    pub attempts: Attempts,
    source: Source,
}

/// Text and name of the plan's file, for messages that underline.
#[derive(Debug, Clone, Default)]
struct Source {
    name: String,
    text: String,
    folder: PathBuf,
}

/// What a phase is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Brings the valve to its start: bleed, warm-up, fill.
    Setup,
    /// Measures.
    Main,
    /// Brings the valve back.
    Teardown,
}

impl Role {
    /// As the record names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Setup => "setup",
            Self::Main => "main",
            Self::Teardown => "teardown",
        }
    }
}

/// A checked phase.
#[derive(Debug, Clone)]
pub struct Phase {
    /// Name, unique in the plan.
    pub name: String,
    /// What it is for.
    pub role: Role,
    /// What is commanded: a current (open loop) or a pressure (closed loop).
    pub waveform: Waveform,
    /// What a person is asked instead of a command.
    pub prompt: Option<Prompt>,
    /// How often the stimulus runs.
    pub repeat: u32,
    /// The controller in this phase.
    pub controller: ControllerSettings,
    /// What is measured.
    pub measures: Vec<Measure>,
    /// What a FAIL means for the phases after it.
    pub on_fail: OnFail,
}

impl Phase {
    /// Samples of one repetition.
    pub fn samples_per_repetition(&self, period_s: f64) -> usize {
        if self.prompt.is_some() {
            return 0;
        }
        ((self.waveform.duration_s() / period_s).round() as usize).max(1)
    }

    /// Whether the loop is closed.
    pub fn closed_loop(&self) -> bool {
        self.waveform.kind() == LevelKind::Pressure
    }
}

/// A figure with its limit.
#[derive(Debug, Clone, PartialEq)]
pub struct Measure {
    /// The figure.
    pub metric: MetricSpec,
    /// What it is judged by; `None` to report only.
    pub limit: Option<Limit>,
}

/// What stops the run at once and makes the rig safe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interlocks {
    /// Largest measured pressure [bar].
    pub max_pressure_bar: Option<f64>,
    /// Largest measured current [A].
    pub max_current_a: Option<f64>,
    /// Largest rate of the measured pressure [bar/s].
    pub max_pressure_rate_bar_per_s: Option<f64>,
    /// Longest time without a good sample [s].
    pub silence_s: f64,
}

/// What makes a run INVALID by its timing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimingLimits {
    /// Largest share of lost samples.
    pub max_lost: f64,
    /// Largest share of stale samples.
    pub max_stale: f64,
    /// Largest share of missed slots.
    pub max_missed: f64,
    /// Largest 99th percentile of the lateness [s].
    pub max_lateness_p99_s: Option<f64>,
    /// Largest lateness [s].
    pub max_lateness_s: Option<f64>,
}

/// What must hold while the plan runs; outside it the run is INVALID.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Preconditions {
    /// Oil temperature [degC].
    pub oil_temp_c: Option<(f64, f64)>,
    /// Supply pressure [bar].
    pub supply_bar: Option<(f64, f64)>,
}

/// How often a valve may be tried, and after which outcomes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attempts {
    /// Attempts in all; 1 for no retry.
    pub max: u32,
    /// Outcomes after which another attempt is allowed.
    pub retry_on: Vec<RetryOn>,
}

impl Plan {
    /// Planned duration of the whole run [s].
    pub fn duration_s(&self) -> f64 {
        self.samples() as f64 * self.period_s
    }

    /// Planned samples of the whole run.
    pub fn samples(&self) -> usize {
        self.phases.iter().map(|p| p.samples_per_repetition(self.period_s) * p.repeat as usize).sum()
    }

    /// Whether any phase closes the loop with feedback.
    pub fn closes_the_loop(&self) -> bool {
        self.phases.iter().any(|p| p.closed_loop() && p.controller.mode != crate::control::Mode::FeedForward)
    }

    /// The phases that ask a person, with their questions.
    pub fn prompts(&self) -> impl Iterator<Item = (&Phase, &Prompt)> {
        self.phases.iter().filter_map(|p| Some((p, p.prompt.as_ref()?)))
    }

    /// The folder of the plan's file, which paths in it are relative to.
    pub fn folder(&self) -> &std::path::Path {
        &self.source.folder
    }
}

#[cfg(test)]
mod tests;
