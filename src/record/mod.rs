//! What a run leaves behind: the one value that every report is a view of (`schema = "hil.record/1"`).
//!
//! Nothing here depends on when, where or with which version it ran, except the fields under [`Provenance`],
//! which `hil diff` and the accepted reports leave out.

mod file;

pub use file::{RECORD_FILE, RecordError, SCHEMA, records};

use serde::{Deserialize, Serialize};

use crate::recording::Run;
use crate::rig::Quality;

/// The verdict of a measurement, a phase or a run, the least severe first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Outcome {
    /// Within its limits.
    Pass,
    /// Within its limits, but inside the warning band.
    Marginal,
    /// Did not run, or has no limit to be judged by.
    NotRun,
    /// Outside its limits.
    Fail,
    /// Timing or preconditions broken: neither PASS nor FAIL.
    Invalid,
    /// The rig or the station failed.
    Error,
    /// Stopped by a signal or an operator.
    Aborted,
}

impl Outcome {
    /// As records, journals and reports write it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Pass => "PASS",
            Self::Marginal => "MARGINAL",
            Self::NotRun => "NOT_RUN",
            Self::Fail => "FAIL",
            Self::Invalid => "INVALID",
            Self::Error => "ERROR",
            Self::Aborted => "ABORTED",
        }
    }

    /// Whether the run has come to no verdict, so that its figures say nothing of the valve.
    pub fn is_broken(self) -> bool {
        matches!(self, Self::Invalid | Self::Error | Self::Aborted)
    }
}

/// The record of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TestRecord {
    /// `hil.record/1`.
    pub schema: String,
    /// The plan that ran.
    pub plan: PlanIdentity,
    /// The valve under test.
    pub dut: Dut,
    /// The rig that it ran on.
    pub rig: crate::rig::RigIdentity,
    /// Whether the pressure came from a simulation; such a record never enters statistics of real valves.
    pub simulated: bool,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// The worst of the phases, or INVALID, ERROR or ABORTED.
    pub outcome: Outcome,
    /// Why the outcome is INVALID, ERROR or ABORTED; empty otherwise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// Every planned phase in the order of the plan, also those that did not run.
    pub phases: Vec<PhaseRecord>,
    /// Evidence of the run's own timing.
    pub timing: Timing,
    /// Stability margins of the closed loop; `None` where the plan never closes it.
    pub stability: Option<serde_json::Value>,
    /// The valve model that the controller used, for plots and for a later diagnosis.
    pub model: Option<serde_json::Value>,
    /// Whether the safe state was reached at the end, with the evidence; `None` in simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub safe_state: Option<SafeStateRecord>,
    /// When, where and with what it ran.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
}

/// Which plan ran.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanIdentity {
    /// The plan's name.
    pub name: String,
    /// SHA-256 of the plan file's bytes, hex.
    pub sha256: String,
    /// Every parameter's effective value, as text with its unit, in the order of the plan.
    #[serde(default)]
    pub parameters: Vec<(String, String)>,
    /// The parameters that `--set` changed.
    #[serde(default)]
    pub overridden: Vec<String>,
}

/// The valve under test.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Dut {
    /// Serial number; for a simulation the valve file's name unless `--serial` gave one.
    pub serial: String,
    /// Part number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_number: Option<String>,
    /// Revision of the part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revision: Option<String>,
    /// Lot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lot: Option<String>,
}

/// One phase of the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhaseRecord {
    /// The phase's name, unique within the plan.
    pub name: String,
    /// `setup`, `main` or `teardown`.
    pub role: String,
    /// Verdict of the phase.
    pub outcome: Outcome,
    /// Why, where the outcome is not PASS and no measurement says it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Rig time at the phase's first and last sample [s]; `None` where it did not run.
    pub span_s: Option<(f64, f64)>,
    /// What was measured, in the order of the plan.
    pub measurements: Vec<Measurement>,
    /// What a person was asked, and answered; `None` where the phase asks nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt: Option<PromptRecord>,
}

/// A question and its answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PromptRecord {
    /// What was asked.
    pub text: String,
    /// `confirm`, `number`, `choice` or `remark`.
    pub kind: String,
    /// What was answered; `None` where nobody did.
    pub answer: Option<String>,
    /// Where the answer came from: `page`, `terminal` or `file`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
}

/// One figure with its definition and, where there is one, its limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// Id of the metric, for instance `rmse`.
    pub metric: String,
    /// The figure in `unit`, rounded to the unit's fixed digits, or to as many more as its verdict needs; `None` where it could not be
    /// measured.
    pub value: Option<f64>,
    /// Unit of the value.
    pub unit: String,
    /// The limit it is judged by.
    pub limit: Option<LimitRecord>,
    /// Verdict; NOT_RUN where there is no limit.
    pub outcome: Outcome,
    /// Id and version of the definition with its parameters, for instance `rmse.delayed.v1(delay=20 ms)`.
    pub definition: String,
    /// Why there is no value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// A limit as it was applied, in the unit of the measurement.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LimitRecord {
    /// Smallest accepted value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest accepted value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// Below this the verdict is MARGINAL.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub marginal_min: Option<f64>,
    /// Above this the verdict is MARGINAL.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub marginal_max: Option<f64>,
    /// `inclusive` or `exclusive`.
    pub bound: String,
}

/// Evidence of the run's own timing; the keys that the contract names, and the histograms behind them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Timing {
    /// Planned loop period [s].
    pub period_s: f64,
    /// Median lateness of a slot [s]; `None` in simulation, which has no clock.
    pub lateness_p50_s: Option<f64>,
    /// 99th percentile of the lateness [s].
    pub lateness_p99_s: Option<f64>,
    /// Largest lateness [s].
    pub lateness_max_s: Option<f64>,
    /// Slots skipped because the loop came too late.
    pub missed_slots: u64,
    /// Slots without a usable reply.
    pub lost_samples: u64,
    /// Replies refused because their freshness could not be shown.
    pub stale_samples: u64,
    /// Samples in all.
    pub samples: u64,
    /// Round-trip times: median, 99th percentile, maximum [s].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub round_trip_s: Option<(f64, f64, f64)>,
    /// Histogram of the lateness: upper edge [s] and count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lateness_histogram: Vec<(f64, u64)>,
    /// Histogram of the period: upper edge [s] and count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub period_histogram: Vec<(f64, u64)>,
}

/// Whether the rig ended in its safe state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SafeStateRecord {
    /// Whether a measurement confirmed it.
    pub confirmed: bool,
    /// What was written and read back.
    pub evidence: String,
    /// Latest fresh reading of the current [A]; `None` where the rig measures none, or none came.
    #[serde(default)]
    pub current_a: Option<f64>,
    /// Time from the first write of zero to the confirmation, or until it was given up [s].
    #[serde(default)]
    pub within_s: Option<f64>,
}

impl From<crate::rig::SafeState> for SafeStateRecord {
    fn from(state: crate::rig::SafeState) -> Self {
        Self { confirmed: state.confirmed, evidence: state.evidence, current_a: state.current_a, within_s: state.within_s }
    }
}

/// What a pressure came from; verdicts of the three are never pooled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// A valve.
    Real,
    /// An emulated valve behind real bytes on a wire.
    Emulated,
    /// A simulation.
    Simulated,
}

impl TestRecord {
    /// What the pressures came from.
    pub fn origin(&self) -> Origin {
        match (self.simulated, self.rig.emulated) {
            (true, _) => Origin::Simulated,
            (false, true) => Origin::Emulated,
            (false, false) => Origin::Real,
        }
    }

    /// Whether the run ended with a current that nobody saw go.
    pub fn ended_unsafe(&self) -> bool {
        self.safe_state.as_ref().is_some_and(|s| !s.confirmed)
    }
}

/// When, where and with what a run was made; left out of diffs and of accepted reports.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of the program.
    pub version: String,
    /// Start of the run, RFC 3339.
    pub started: String,
    /// Station, instruments, operator, oil: as the station file gives them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub station: Option<serde_json::Value>,
}

/// The samples of a run, column by column; stored beside the record (`trace.parquet`).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Rig time [s].
    pub time_s: Vec<f64>,
    /// Index of the phase of each sample.
    pub phase: Vec<u16>,
    /// Target pressure [bar]; NaN in an open-loop phase.
    pub target_bar: Vec<f64>,
    /// Commanded current [A].
    pub current_a: Vec<f64>,
    /// Part of the command from the feed-forward [A]; NaN in an open-loop phase.
    pub feed_forward_a: Vec<f64>,
    /// Part of the command from the feedback [A]; NaN in an open-loop phase.
    pub feedback_a: Vec<f64>,
    /// Measured pressure [bar].
    pub pressure_bar: Vec<f64>,
    /// Measured current [A]; NaN where the rig has none.
    pub current_meas_a: Vec<f64>,
    /// Oil temperature [degC]; NaN where the rig has none.
    pub oil_temp_c: Vec<f64>,
    /// Supply pressure [bar]; NaN where the rig has none.
    pub supply_bar: Vec<f64>,
    /// Quality of each sample.
    pub quality: Vec<Quality>,
    /// Lateness of each slot [s].
    pub lateness_s: Vec<f64>,
    /// Round-trip time of each transaction [s].
    pub round_trip_s: Vec<f64>,
}

impl Trace {
    /// The trace as a recorded run; the pressure of a sample that is not good is a gap.
    pub fn run(&self) -> Run {
        let recorded = |values: &Vec<f64>| values.iter().any(|v| v.is_finite()).then(|| values.clone());
        let good = |(k, p): (usize, &f64)| if self.quality.get(k).is_none_or(|q| *q == Quality::Good) { *p } else { f64::NAN };
        Run {
            name: None,
            time_s: self.time_s.clone(),
            current_a: self.current_a.clone(),
            pressure_bar: Some(self.pressure_bar.iter().enumerate().map(good).collect()),
            target_bar: recorded(&self.target_bar),
            current_meas_a: recorded(&self.current_meas_a),
            oil_temp_c: recorded(&self.oil_temp_c),
            supply_bar: recorded(&self.supply_bar),
        }
    }
}
