//! A plan as it is written (`schema = "hil.plan/1"`).

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::bounds::LimitFile;
use super::prompt::PromptFile;
use super::{ControllerFile, StimulusFile};
use crate::metrics::MetricSpec;
use crate::units::{Current, Frequency, Pressure, PressureRate, Ratio, Temperature, Time};

/// The schema key of a plan.
pub const SCHEMA: &str = "hil.plan/1";

/// A plan file. A text `"$name"` anywhere stands for the parameter of that name.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// `hil.plan/1`.
    #[schemars(with = "String")]
    pub schema: Spanned<String>,
    /// Name of the plan.
    #[schemars(with = "String")]
    pub name: Spanned<String>,
    /// What the plan is for, and where its limits come from.
    #[serde(default)]
    pub description: String,
    /// Loop rate; 100 Hz by default.
    #[schemars(with = "Option<Frequency>")]
    pub rate: Option<Spanned<Frequency>>,
    /// Values with a name, which `--set NAME=VALUE` can change.
    #[serde(default)]
    pub parameters: BTreeMap<String, ParameterValue>,
    /// Valve model that the controller believes in: a path or the bare name of a file in `valves/`; the valve that
    /// runs by default.
    pub model: Option<String>,
    /// Valve that `--sim` simulates where the command names none; the paper's by default.
    pub valve: Option<String>,
    /// The controller.
    #[serde(default)]
    pub controller: ControllerFile,
    /// What stops the run at once.
    #[serde(default)]
    pub interlocks: InterlocksFile,
    /// What makes the run INVALID by its timing.
    #[serde(default)]
    pub timing: TimingFile,
    /// What must hold while the plan runs.
    #[serde(default)]
    pub preconditions: PreconditionsFile,
    /// How often a valve may be tried.
    #[serde(default)]
    pub attempts: AttemptsFile,
    /// What a FAIL of a phase means for those after it; `continue` by default.
    #[serde(default)]
    pub on_fail: OnFail,
    /// Phases that bring the valve to its start: bleed, warm-up, fill.
    #[serde(default)]
    pub setup: Vec<PhaseFile>,
    /// Phases that measure.
    #[serde(default)]
    pub phase: Vec<PhaseFile>,
    /// Phases that bring the valve back.
    #[serde(default)]
    pub teardown: Vec<PhaseFile>,
}

/// The default of a parameter: a quantity as text, a number, or a switch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ParameterValue {
    /// A whole number.
    Integer(i64),
    /// A switch.
    Switch(bool),
    /// A quantity with its unit, or a name.
    Text(String),
}

impl std::fmt::Display for ParameterValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Integer(v) => write!(f, "{v}"),
            Self::Switch(v) => write!(f, "{v}"),
            Self::Text(v) => f.write_str(v),
        }
    }
}

/// A phase.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhaseFile {
    /// Name, unique in the plan.
    #[schemars(with = "String")]
    pub name: Spanned<String>,
    /// What is commanded: pressures close the loop, currents open it. A phase has this or `prompt`.
    #[schemars(with = "Option<StimulusFile>")]
    pub stimulus: Option<Spanned<StimulusFile>>,
    /// What a person is asked. Such a phase commands nothing and measures nothing but the answer.
    #[schemars(with = "Option<PromptFile>")]
    pub prompt: Option<Spanned<PromptFile>>,
    /// How often the stimulus runs; once by default.
    #[schemars(with = "Option<u32>")]
    pub repeat: Option<Spanned<u32>>,
    /// What differs from the plan's controller.
    #[serde(default)]
    pub controller: ControllerFile,
    /// What is measured.
    #[serde(default)]
    pub measure: Vec<MeasureFile>,
    /// What a FAIL means for the phases after it; the plan's by default.
    pub on_fail: Option<OnFail>,
}

/// A figure with its limit.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeasureFile {
    /// The figure with its parameters, for instance `metric.rmse = {}`.
    #[schemars(with = "MetricSpec")]
    pub metric: Spanned<MetricSpec>,
    /// What it is judged by; without it the figure is reported only.
    #[schemars(with = "Option<LimitFile>")]
    pub limit: Option<Spanned<LimitFile>>,
}

/// What a FAIL means for the phases after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnFail {
    /// The remaining phases run.
    #[default]
    Continue,
    /// The remaining main phases do not run; teardown does.
    Stop,
}

/// What stops the run at once and makes the rig safe.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InterlocksFile {
    /// Largest measured pressure.
    pub max_pressure: Option<Pressure>,
    /// Largest measured current.
    pub max_current: Option<Current>,
    /// Largest rate of the measured pressure.
    pub max_pressure_rate: Option<PressureRate>,
    /// Longest time without a good sample; 200 ms by default.
    pub silence: Option<Time>,
}

/// What makes a run INVALID by its timing.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TimingFile {
    /// Largest share of lost samples; 1 % by default.
    pub max_lost: Option<Ratio>,
    /// Largest share of stale samples; 1 % by default.
    pub max_stale: Option<Ratio>,
    /// Largest share of missed slots; 1 % by default.
    pub max_missed: Option<Ratio>,
    /// Largest 99th percentile of the lateness; none by default.
    pub max_lateness_p99: Option<Time>,
    /// Largest lateness; none by default.
    pub max_lateness: Option<Time>,
}

/// What must hold while the plan runs on a bench; outside it the run is INVALID.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PreconditionsFile {
    /// Oil temperature.
    #[schemars(with = "Option<Window<Temperature>>")]
    pub oil_temp: Option<Spanned<Window<Temperature>>>,
    /// Supply pressure.
    #[schemars(with = "Option<Window<Pressure>>")]
    pub supply: Option<Spanned<Window<Pressure>>>,
}

/// A window of a quantity.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Window<T> {
    /// Smallest accepted value.
    pub min: T,
    /// Largest accepted value.
    pub max: T,
}

/// How often a valve may be tried in a batch.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AttemptsFile {
    /// Attempts in all; 1 by default.
    #[schemars(with = "Option<u32>")]
    pub max: Option<Spanned<u32>>,
    /// Outcomes after which another attempt is allowed; `error` and `invalid` by default.
    pub retry_on: Option<Vec<RetryOn>>,
}

/// Outcomes after which another attempt may be allowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RetryOn {
    /// Outside a limit.
    Fail,
    /// The rig failed.
    Error,
    /// Timing or preconditions were broken.
    Invalid,
}
