//! Limits in a file of their own, per part number and revision (`schema = "hil.limits/1"`).

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::bounds::{LimitFile, limit};
use super::error::Wrong;
use super::serial::SerialForm;
use super::{Plan, PlanError};
use crate::document;
use crate::limits::DecisionRule;
use crate::units::Unit;

/// The schema key of a limits file.
pub const LIMITS_SCHEMA: &str = "hil.limits/1";

/// A limits file.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitsFile {
    /// `hil.limits/1`.
    #[schemars(with = "String")]
    pub schema: Spanned<String>,
    /// Part number that the limits are of.
    pub part_number: Option<String>,
    /// Revision of the part.
    pub revision: Option<String>,
    /// Where the limits come from.
    #[serde(default)]
    pub source: String,
    /// How a measured value is compared with its limit.
    #[serde(default)]
    pub decision_rule: DecisionRule,
    /// Form of the part's serial numbers.
    #[serde(default)]
    pub serial: SerialForm,
    /// The limits.
    #[schemars(with = "Vec<LimitEntry>")]
    pub limit: Vec<Spanned<LimitEntry>>,
    #[serde(skip)]
    #[schemars(skip)]
    source_text: (String, String),
}

/// One limit of one figure in one phase.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitEntry {
    /// Name of the phase.
    #[schemars(with = "String")]
    pub phase: Spanned<String>,
    /// Id of the metric.
    #[schemars(with = "String")]
    pub metric: Spanned<String>,
    /// The limit, which replaces the plan's.
    #[schemars(with = "LimitFile")]
    pub limit: Spanned<LimitFile>,
    /// Expanded uncertainty (k = 2) of the figure: the guard band, where the decision rule has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub uncertainty: Option<Spanned<String>>,
}

impl LimitsFile {
    /// Reads a limits file.
    pub fn load(path: &Path) -> Result<Self, PlanError> {
        let text = document::read(path)?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads the text of a limits file.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, PlanError> {
        document::expect_schema(text, source_name, LIMITS_SCHEMA, "a limits file")?;
        let mut file: Self = document::parse(text, source_name)?;
        if file.limit.is_empty() {
            return Err(Wrong::new(0..0, "the file has no [[limit]]").shown(text, source_name));
        }
        file.source_text = (text.into(), source_name.into());
        Ok(file)
    }

    /// Smallest and largest accepted value of a figure before any guard band: what its capability is judged by. `unit` is the
    /// record's; `None` where the file says nothing of the figure.
    pub fn tolerance(&self, phase: &str, metric: &str, unit: &str) -> Option<(Option<f64>, Option<f64>)> {
        let entry = self.limit.iter().map(Spanned::get_ref).find(|e| e.phase.get_ref() == phase && e.metric.get_ref() == metric)?;
        let limit = limit(&entry.limit, Unit::by_symbol(unit)?).ok()?;
        Some((limit.min, limit.max))
    }
}

impl Plan {
    /// Replaces the plan's limits by those of the file; every entry must find its phase and figure.
    pub fn apply_limits(&mut self, file: &LimitsFile) -> Result<(), PlanError> {
        for entry in &file.limit {
            self.apply(entry.get_ref(), file.decision_rule).map_err(|w| w.shown(&file.source_text.0, &file.source_text.1))?;
        }
        Ok(())
    }

    fn apply(&mut self, entry: &LimitEntry, rule: DecisionRule) -> Result<(), Wrong> {
        let names: Vec<String> = self.phases.iter().map(|p| p.name.clone()).collect();
        let Some(phase) = self.phases.iter_mut().find(|p| p.name == *entry.phase.get_ref()) else {
            let message = format!("the plan `{}` has no phase `{}` (phases: {})", self.name, entry.phase.get_ref(), names.join(", "));
            return Err(Wrong::new(entry.phase.span(), message));
        };
        let ids: Vec<&str> = phase.measures.iter().map(|m| m.metric.metric().id()).collect();
        let Some(index) = ids.iter().position(|id| id == entry.metric.get_ref()) else {
            let message =
                format!("the phase `{}` does not measure `{}` (it measures: {})", phase.name, entry.metric.get_ref(), ids.join(", "));
            return Err(Wrong::new(entry.metric.span(), message));
        };
        let unit = phase.measures[index].metric.metric().unit();
        let written = limit(&entry.limit, unit)?;
        let uncertainty = entry.uncertainty.as_ref().map(|text| {
            let value = unit.parse(text.get_ref()).map_err(|e| Wrong::new(text.span(), e.to_string()))?;
            written.drawn_in(rule.guard(value)).map_err(|e| Wrong::new(text.span(), e.to_string()))
        });
        let applied = match (rule, uncertainty.transpose()?) {
            (DecisionRule::Simple, _) => written,
            (_, Some(guarded)) => guarded,
            (_, None) => {
                let message = "needs `uncertainty`: the decision rule of the file takes it into account";
                return Err(Wrong::new(entry.limit.span(), message));
            }
        };
        phase.measures[index].limit = Some(applied);
        Ok(())
    }
}
