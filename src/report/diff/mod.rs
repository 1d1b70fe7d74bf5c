//! What differs between two records of the same plan: verdicts first, then figures beyond tolerance.
//!
//! Figures in a record are already rounded to the fixed digits of their unit, so by default a figure may move by
//! one in its last digit; [`Tolerances`] gives a metric more room. When, where and with which version a record
//! was made is not compared.

mod compare;
mod print;

use std::collections::BTreeMap;

use serde::Serialize;

pub use compare::compare;
pub use print::{json, markdown, text};

/// How far a figure may move.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tolerances {
    /// Absolute tolerance by id of the metric, in the unit of the figure.
    pub by_metric: BTreeMap<String, f64>,
}

/// One thing that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// The phase, or `run`, `stability`.
    pub phase: String,
    /// What differs: a definition with its metric id, `verdict`, `limit of ..`.
    pub figure: String,
    /// Whether a verdict differs.
    pub verdict: bool,
    /// As it stands in the first record; a dash where it is not there.
    pub before: String,
    /// As it stands in the second.
    pub after: String,
    /// Second less first, in the unit of the figure; `None` where one is missing.
    pub delta: Option<f64>,
    /// What was allowed, in the same unit.
    pub tolerance: Option<f64>,
}

/// The differences of two records.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordDiff {
    /// Plan and valve, or the place in the folder.
    pub name: String,
    /// Outcome of the first record; `None` where there is no such record.
    pub before: Option<crate::record::Outcome>,
    /// Outcome of the second.
    pub after: Option<crate::record::Outcome>,
    /// What is beyond tolerance: verdicts first, then in the order of the plan.
    pub changes: Vec<Change>,
    /// Index in `changes` of the figure that moved first in the order in which the plan ran.
    pub first: Option<usize>,
    /// Phases that both have.
    #[serde(skip)]
    pub phases_in_common: usize,
    /// Figures that were compared.
    pub compared: usize,
    /// Inputs that differ (plan, parameters, seed): the reason, not the difference.
    pub notes: Vec<String>,
}

impl RecordDiff {
    /// Whether anything is beyond tolerance.
    pub fn different(&self) -> bool {
        self.before != self.after || !self.changes.is_empty()
    }
}

impl RecordDiff {
    /// Whether no phase of one has its like in the other: every change is something that only one of them has.
    pub fn nothing_in_common(&self) -> bool {
        self.phases_in_common == 0
    }
}

/// Whether any record differs beyond tolerance.
pub fn different(diffs: &[RecordDiff]) -> bool {
    diffs.iter().any(RecordDiff::different)
}
