//! The limits file (`schema = "hil.limits/1"`): what a part number and revision must hold, by which decision rule.
//!
//! The plan says what is measured; this file says what is accepted, so that a revision of the part needs no new plan. The
//! decision rule is stated, as ISO/IEC 17025:2017, 7.8.6 asks where conformity is stated: `simple` acceptance compares
//! the measured value with the limit; `guard_band` accepts only values that keep the expanded uncertainty away from it
//! (ILAC-G8:09/2019; JCGM 106:2012).

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::BatchError;
use super::serial::SerialForm;
use super::statistics::Tolerance;
use crate::document;
use crate::limits::{Bound, Limit, Verdict};
use crate::record::{Dut, LimitRecord, Measurement, Outcome, TestRecord};
use crate::units::Unit;

/// The schema key of a limits file.
pub const SCHEMA: &str = "hil.limits/1";

/// How a measured value is compared with a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DecisionRule {
    /// The measured value against the limit; the uncertainty is not taken into account.
    #[default]
    Simple,
    /// The measured value against the limit drawn in by the expanded uncertainty.
    GuardBand,
}

impl DecisionRule {
    /// The rule in words, for a report.
    pub fn text(self) -> &'static str {
        match self {
            DecisionRule::Simple => "simple acceptance: the measured value against the limit, uncertainty not taken into account",
            DecisionRule::GuardBand => "guarded acceptance: the limit is drawn in by the expanded uncertainty of each metric",
        }
    }
}

/// Limits of a part number and revision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitsFile {
    /// `hil.limits/1`.
    pub schema: String,
    /// Part number.
    pub part_number: String,
    /// Revision of the part; without it the limits hold for every revision.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revision: Option<String>,
    /// Decision rule.
    #[serde(default)]
    pub decision_rule: DecisionRule,
    /// Form of the serial numbers.
    #[serde(default)]
    pub serial: SerialForm,
    /// The limits; a measurement that none of them names keeps the limit of the plan.
    #[serde(default, rename = "limit")]
    pub limits: Vec<MetricLimit>,
}

/// The limit of one metric; every value carries its unit.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MetricLimit {
    /// Phase of the plan; without it the limit holds in every phase that has the metric.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<String>,
    /// Metric.
    pub metric: String,
    /// Smallest accepted value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<String>,
    /// Largest accepted value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<String>,
    /// Below this the verdict is MARGINAL.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marginal_min: Option<String>,
    /// Above this the verdict is MARGINAL.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marginal_max: Option<String>,
    /// Expanded uncertainty (k = 2) of the metric; the guard band.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<String>,
    /// Whether a value on the limit is accepted.
    #[serde(default)]
    pub bound: Bound,
}

impl LimitsFile {
    /// Reads a limits file.
    pub fn load(path: &Path) -> Result<Self, BatchError> {
        let text = document::read(path).map_err(|e| BatchError::Input(e.0))?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads the text of a limits file; `source_name` stands in the messages.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, BatchError> {
        let file: Self = document::parse(text, source_name).map_err(|e| BatchError::Input(e.0))?;
        let wrong = |key: &str, problem: String| BatchError::Input(format!("{source_name}: {key}: {problem}"));
        if file.schema != SCHEMA {
            return Err(wrong("schema", format!("is `{}`; a limits file has `{SCHEMA}`", file.schema)));
        }
        for (k, limit) in file.limits.iter().enumerate() {
            let key = format!("limit[{k}] ({})", limit.metric);
            let unit = limit.unit().map_err(|problem| wrong(&key, problem))?;
            let Some(unit) = unit else {
                return Err(wrong(&key, "has neither `min` nor `max`".into()));
            };
            for rule in [DecisionRule::Simple, file.decision_rule] {
                let own = limit.resolve(unit, rule).map_err(|problem| wrong(&key, problem))?;
                own.check().map_err(|e| wrong(&key, e.to_string()))?;
            }
            if file.decision_rule == DecisionRule::GuardBand && limit.uncertainty.is_none() {
                return Err(wrong(&key, "needs `uncertainty`: the decision rule is a guard band".into()));
            }
        }
        Ok(file)
    }

    /// Whether the file speaks of this valve.
    pub fn covers(&self, dut: &Dut) -> bool {
        dut.part_number.as_deref().is_none_or(|p| p == self.part_number)
            && (self.revision.is_none() || dut.revision.is_none() || dut.revision == self.revision)
    }

    fn of(&self, phase: &str, metric: &str) -> Option<&MetricLimit> {
        let named = self.limits.iter().find(|l| l.metric == metric && l.phase.as_deref() == Some(phase));
        named.or_else(|| self.limits.iter().find(|l| l.metric == metric && l.phase.is_none()))
    }

    /// The limits of a metric before the guard band: what its capability is judged by. `unit` is the record's.
    pub fn tolerance(&self, phase: &str, metric: &str, unit: &str) -> Option<Tolerance> {
        let unit = Unit::by_symbol(unit)?;
        let limit = self.of(phase, metric)?.resolve(unit, DecisionRule::Simple).ok()?;
        Some(Tolerance { min: limit.min, max: limit.max })
    }

    /// Judges the measurements of a record by this file. An outcome that is no verdict on the valve stays.
    ///
    /// # Errors
    /// [`BatchError::Input`] where a limit has the wrong dimension, or names what the plan does not measure.
    pub fn judge(&self, record: &mut TestRecord) -> Result<(), BatchError> {
        let wrong = |what: String| BatchError::Input(format!("limits of part {}: {what}", self.part_number));
        for limit in &self.limits {
            let here = |p: &&crate::record::PhaseRecord| limit.phase.as_ref().is_none_or(|name| *name == p.name);
            if !record.phases.iter().filter(here).any(|p| p.measurements.iter().any(|m| m.metric == limit.metric)) {
                let phase = limit.phase.as_ref().map_or_else(String::new, |p| format!(" in phase `{p}`"));
                return Err(wrong(format!("the plan `{}` does not measure `{}`{phase}", record.plan.name, limit.metric)));
            }
        }
        for phase in &mut record.phases {
            let mut own = Outcome::Pass;
            let mut judged = false;
            for m in &mut phase.measurements {
                if let Some(limit) = self.of(&phase.name, &m.metric) {
                    apply(limit, self.decision_rule, m).map_err(|problem| wrong(format!("{}/{}: {problem}", phase.name, m.metric)))?;
                }
                if m.limit.is_some() {
                    own = own.max(m.outcome);
                    judged = true;
                }
            }
            if judged && matches!(phase.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail) {
                phase.outcome = own;
            }
        }
        if matches!(record.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail) {
            let verdicts = record.phases.iter().map(|p| p.outcome).filter(|o| *o != Outcome::NotRun);
            record.outcome = verdicts.max().unwrap_or(record.outcome);
        }
        Ok(())
    }
}

fn apply(limit: &MetricLimit, rule: DecisionRule, m: &mut Measurement) -> Result<(), String> {
    let unit = Unit::by_symbol(&m.unit).ok_or_else(|| format!("the unit `{}` is unknown", m.unit))?;
    let limit = limit.resolve(unit, rule)?;
    m.outcome = match limit.judge(m.value) {
        Verdict::Pass => Outcome::Pass,
        Verdict::Marginal => Outcome::Marginal,
        Verdict::Fail => Outcome::Fail,
    };
    let bound = if limit.bound == Bound::Inclusive { "inclusive" } else { "exclusive" };
    m.limit = Some(LimitRecord {
        min: limit.min,
        max: limit.max,
        marginal_min: limit.marginal_min,
        marginal_max: limit.marginal_max,
        bound: bound.into(),
    });
    Ok(())
}

impl MetricLimit {
    /// The unit that the texts carry; `None` where there is no bound.
    fn unit(&self) -> Result<Option<&'static Unit>, String> {
        let Some(text) = self.min.as_ref().or(self.max.as_ref()) else { return Ok(None) };
        Unit::of_text(text).map(Some).ok_or_else(|| format!("`{text}` carries no known unit"))
    }

    /// The limit in `unit` by `rule`.
    fn resolve(&self, unit: &'static Unit, rule: DecisionRule) -> Result<Limit, String> {
        let value = |text: &Option<String>| text.as_ref().map(|t| unit.parse(t)).transpose().map_err(|e| e.to_string());
        let guard = value(&self.uncertainty)?.unwrap_or(0.0);
        if guard < 0.0 {
            return Err("`uncertainty` is negative".into());
        }
        let drawn_in = if rule == DecisionRule::GuardBand { guard } else { 0.0 };
        let (min, max) = (value(&self.min)?.map(|v| v + drawn_in), value(&self.max)?.map(|v| v - drawn_in));
        // A warning bound that the guard band has swallowed warns of nothing more.
        let (mut marginal_min, mut marginal_max) = (value(&self.marginal_min)?, value(&self.marginal_max)?);
        if rule == DecisionRule::GuardBand {
            marginal_min = marginal_min.map(|v| min.map_or(v, |m| v.max(m)));
            marginal_max = marginal_max.map(|v| max.map_or(v, |m| v.min(m)));
        }
        let limit = Limit { min, max, marginal_min, marginal_max, bound: self.bound };
        if min.zip(max).is_some_and(|(min, max)| min > max) && rule == DecisionRule::GuardBand {
            return Err(format!("the guard band of {} leaves nothing between `min` and `max`", unit.print(guard)));
        }
        Ok(limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::PhaseRecord;

    const FILE: &str = r#"
schema = "hil.limits/1"
part_number = "EXAMPLE-1"
revision = "B"

[[limit]]
metric = "rmse"
max = "500 mbar"
marginal_max = "0.45 bar"
uncertainty = "100 mbar"

[[limit]]
phase = "hold"
metric = "rmse"
max = "0.2 bar"
uncertainty = "0.05 bar"
"#;

    fn measurement(value: f64) -> Measurement {
        let (metric, unit) = ("rmse".to_string(), "bar".to_string());
        Measurement { metric, value: Some(value), unit, limit: None, outcome: Outcome::NotRun, definition: String::new(), reason: None }
    }

    fn record(ramp: f64, hold: f64) -> TestRecord {
        let phase = |name: &str, value| PhaseRecord {
            name: name.into(),
            role: "main".into(),
            outcome: Outcome::Pass,
            reason: None,
            span_s: Some((0.0, 1.0)),
            measurements: vec![measurement(value)],
        };
        let mut record = crate::batch::example::record("V1", 1);
        record.phases = vec![phase("ramp", ramp), phase("hold", hold)];
        record.outcome = Outcome::Pass;
        record
    }

    fn verdicts(file: &LimitsFile, ramp: f64, hold: f64) -> (Outcome, Outcome, Outcome) {
        let mut r = record(ramp, hold);
        file.judge(&mut r).unwrap();
        (r.phases[0].outcome, r.phases[1].outcome, r.outcome)
    }

    #[test]
    fn simple_acceptance_compares_the_value_itself() {
        use Outcome::{Fail, Marginal, Pass};
        let file = LimitsFile::from_toml(FILE, "x.toml").unwrap();
        assert_eq!(verdicts(&file, 0.3, 0.2), (Pass, Pass, Pass));
        assert_eq!(verdicts(&file, 0.47, 0.1), (Marginal, Pass, Marginal));
        assert_eq!(verdicts(&file, 0.3, 0.21), (Pass, Fail, Fail));
    }

    #[test]
    fn a_guard_band_keeps_the_uncertainty_away_from_the_limit() {
        use Outcome::{Fail, Pass};
        let file = LimitsFile::from_toml(&FILE.replace("[[limit]]\nmetric", "decision_rule = \"guard_band\"\n[[limit]]\nmetric"), "x.toml")
            .unwrap();
        assert_eq!(verdicts(&file, 0.39, 0.14), (Pass, Pass, Pass));
        assert_eq!(verdicts(&file, 0.41, 0.16), (Fail, Fail, Fail));
        let t = file.tolerance("hold", "rmse", "bar").unwrap();
        assert_eq!(t.max, Some(0.2), "capability is judged by the tolerance, not by the drawn-in limit");
    }

    #[test]
    fn what_cannot_be_judged_is_said() {
        let file = LimitsFile::from_toml(&FILE.replace("\"hold\"", "\"holt\""), "x.toml").unwrap();
        insta::assert_snapshot!(file.judge(&mut record(0.1, 0.1)).unwrap_err(), @"limits of part EXAMPLE-1: the plan `example` does not measure `rmse` in phase `holt`");
        let message = |from: &str, to: &str| LimitsFile::from_toml(&FILE.replacen(from, to, 1), "x.toml").unwrap_err().to_string();
        insta::assert_snapshot!(message("0.45 bar", "0.6 bar"), @"x.toml: limit[0] (rmse): `marginal_max` (0.6) is larger than `max` (0.5)");
        insta::assert_snapshot!(message("0.45 bar", "0.45 s"), @"x.toml: limit[0] (rmse): `0.45 s` is not a pressure: the unit `s` is of a time; allowed: bar, mbar, Pa, kPa, MPa, psi");
        assert!(message("metric", "metrik").contains("unknown field `metrik`"));
    }

    #[test]
    fn an_error_of_the_station_stays_one() {
        let file = LimitsFile::from_toml(FILE, "x.toml").unwrap();
        let mut r = record(0.1, 0.1);
        r.outcome = Outcome::Invalid;
        file.judge(&mut r).unwrap();
        assert_eq!(r.outcome, Outcome::Invalid);
    }
}
