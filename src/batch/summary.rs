//! The batch as one value, of which every batch report is a view (`schema = "hil.batch/1"`).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::journal::Damage;
use super::statistics::{Finding, MetricStatistics, ParetoBar, Proportion, Tolerance, metric, pareto, proportion};
use super::store::Header;
use super::tally::{Attempt, MetricKey, Tally, deciding};
use crate::record::{Origin, Outcome};

/// One valve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ValveRow {
    /// Place in the batch, from 0.
    pub position: usize,
    /// Serial number.
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
    /// Outcome of every attempt, in order; none is ever erased.
    pub attempts: Vec<Outcome>,
    /// Outcome of the first attempt that judged the valve, or of the first.
    pub first: Outcome,
    /// Outcome of the last attempt that judged the valve, or of the last.
    pub outcome: Outcome,
    /// What failed first, or why there is no verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Report of the valve, below the folder of the batch, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub report: Option<String>,
    /// Values of the metrics, in the order of [`BatchSummary::metrics`]; only for tables and plots.
    #[serde(skip)]
    pub values: Vec<f64>,
}

/// The batch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchSummary {
    /// `hil.batch/1`.
    pub schema: String,
    /// Verdict of the batch: the worst of its valves; INVALID, ERROR and ABORTED as they come.
    pub outcome: Outcome,
    /// What was asked for.
    pub batch: Header,
    /// What the pressures of the batch came from; statistics are over valves of this origin alone.
    #[serde(default = "real")]
    pub origin: Origin,
    /// Valves of another origin, by serial number: shown, and in no statistics.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_pooled: Vec<String>,
    /// Valves whose test ended with a current that nobody saw go, by serial number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub safe_state_not_confirmed: Vec<String>,
    /// Valves that were asked for and have no attempt yet.
    pub not_tested: usize,
    /// Number of valves per final outcome.
    pub counts: BTreeMap<String, usize>,
    /// Valves that passed at their first judged attempt.
    #[doc(alias("first-pass yield", "FPY"))]
    pub first_pass: Finding<Proportion>,
    /// Valves that passed in the end.
    pub final_yield: Finding<Proportion>,
    /// What failed, over the final attempts.
    pub pareto: Vec<ParetoBar>,
    /// Statistics per metric, over the deciding attempt of every judged valve.
    pub metrics: Vec<MetricStatistics>,
    /// Valves that are outliers in a metric with a limit, by serial number, with the metrics.
    pub outlier_valves: BTreeMap<String, Vec<String>>,
    /// The metrics as the records define them.
    pub definitions: Vec<MetricKey>,
    /// Every valve.
    pub valves: Vec<ValveRow>,
    /// Journal lines that are not whole.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub damage: Vec<Damage>,
}

/// Evaluates a batch. `tolerance` gives the limits that capability is judged by, where they are not those of the records;
/// `report` the path of a valve's own report.
pub fn summarise(
    header: &Header,
    tally: &Tally,
    damage: Vec<Damage>,
    tolerance: impl Fn(&MetricKey) -> Option<Tolerance> + Sync,
    report: impl Fn(&Attempt) -> Option<String>,
) -> BatchSummary {
    let valves: Vec<&[Attempt]> = tally.valves().collect();
    let decided: Vec<&Attempt> = valves.iter().map(|v| deciding(v)).collect();
    let origin = origin(header, &decided);
    let judged: Vec<&Attempt> = decided.iter().copied().filter(|a| a.judged() && a.origin == origin).collect();
    let first: Vec<&Attempt> = valves.iter().filter_map(|v| v.iter().find(|a| a.judged() && a.origin == origin)).collect();
    let serials =
        |of: &dyn Fn(&[Attempt]) -> bool| -> Vec<String> { valves.iter().filter(|v| of(v)).map(|v| v[0].dut.serial.clone()).collect() };
    let mut counts = BTreeMap::new();
    for attempt in &decided {
        *counts.entry(attempt.outcome.text().to_string()).or_default() += 1;
    }
    let metrics = statistics(tally.metrics(), &judged, &tolerance);
    let mut outlier_valves: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for m in metrics.iter().filter(|m| m.tolerance.min.is_some() || m.tolerance.max.is_some()) {
        for outlier in m.outliers.value.iter().flatten() {
            if let Some(attempt) = judged.get(outlier.position) {
                outlier_valves.entry(attempt.dut.serial.clone()).or_default().push(m.name.clone());
            }
        }
    }
    let causes: Vec<String> = decided.iter().flat_map(|a| causes(a, tally.metrics())).collect();
    let not_tested = header.valves.map_or(0, |all| all.saturating_sub(valves.len()));
    let worst = decided.iter().map(|a| a.outcome).max().unwrap_or(Outcome::NotRun);
    BatchSummary {
        schema: super::store::SCHEMA.into(),
        outcome: if not_tested > 0 { worst.max(Outcome::NotRun) } else { worst },
        batch: header.clone(),
        origin,
        not_pooled: serials(&|v| deciding(v).judged() && deciding(v).origin != origin),
        safe_state_not_confirmed: serials(&|v| v.iter().any(|a| a.ended_unsafe)),
        not_tested,
        counts,
        first_pass: proportion(first.iter().filter(|a| a.accepted()).count(), first.len()),
        final_yield: proportion(judged.iter().filter(|a| a.accepted()).count(), judged.len()),
        pareto: pareto(causes.iter().map(String::as_str)),
        metrics,
        outlier_valves,
        definitions: tally.metrics().to_vec(),
        valves: valves.iter().map(|v| row(v, &report)).collect(),
        damage,
    }
}

fn real() -> Origin {
    Origin::Real
}

/// What a batch is one of: a simulation, or real valves as soon as one of them was real.
fn origin(header: &Header, decided: &[&Attempt]) -> Origin {
    if header.simulated {
        return Origin::Simulated;
    }
    let emulated = header.rig.emulated || decided.iter().any(|a| a.origin == Origin::Emulated);
    let any_real = decided.iter().any(|a| a.judged() && a.origin == Origin::Real);
    if emulated && !any_real { Origin::Emulated } else { Origin::Real }
}

/// What an attempt failed in: its failed metrics, or the outcome that stands in for a verdict.
fn causes(attempt: &Attempt, metrics: &[MetricKey]) -> Vec<String> {
    match attempt.outcome {
        Outcome::Pass | Outcome::Marginal => Vec::new(),
        Outcome::Fail => {
            let failed = attempt.values.iter().zip(metrics).filter(|(v, _)| v.1 == Outcome::Fail);
            failed.map(|(_, m)| format!("{}/{}", m.phase, m.metric)).collect()
        }
        other => vec![other.text().to_string()],
    }
}

fn statistics(
    keys: &[MetricKey],
    judged: &[&Attempt],
    tolerance: &(impl Fn(&MetricKey) -> Option<Tolerance> + Sync),
) -> Vec<MetricStatistics> {
    use rayon::prelude::*;
    keys.par_iter()
        .enumerate()
        .map(|(k, key)| {
            let values: Vec<f64> = judged.iter().map(|a| a.values.get(k).map_or(f64::NAN, |v| v.0)).collect();
            let limits = key.limit.as_ref().map_or_else(Tolerance::default, |l| Tolerance { min: l.min, max: l.max });
            metric(&format!("{}/{}", key.phase, key.metric), &key.unit, tolerance(key).unwrap_or(limits), &values)
        })
        .collect()
}

fn row(attempts: &[Attempt], report: &impl Fn(&Attempt) -> Option<String>) -> ValveRow {
    let decided = deciding(attempts);
    let first = attempts.iter().find(|a| a.judged()).unwrap_or(&attempts[0]);
    let dut = decided.dut.clone();
    ValveRow {
        position: decided.position,
        serial: dut.serial,
        part_number: dut.part_number,
        revision: dut.revision,
        lot: dut.lot,
        attempts: attempts.iter().map(|a| a.outcome).collect(),
        first: first.outcome,
        outcome: decided.outcome,
        reason: if decided.accepted() { None } else { decided.reason.clone() },
        report: report(decided),
        values: decided.values.iter().map(|v| v.0).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{example, store};
    use crate::rig::RigIdentity;

    fn header(valves: usize) -> Header {
        Header {
            schema: store::SCHEMA.into(),
            plan: "example".into(),
            plan_sha256: "00".into(),
            parameters: vec![],
            overridden: vec![],
            simulated: true,
            seed: 1,
            rig: RigIdentity::default(),
            valves: Some(valves),
            valves_sha256: None,
            population: None,
            limits: None,
            decision_rule: String::new(),
            attempts: (1, vec![]),
            station: None,
            version: String::new(),
        }
    }

    #[test]
    fn first_and_final_yield_pareto_and_what_is_missing() {
        let mut tally = Tally::default();
        let mut add = |position: usize, attempt: u32, outcome: Outcome, value: f64| {
            let mut r = example::record(&format!("V{position}"), 1);
            r.outcome = outcome;
            let m = &mut r.phases[0].measurements[0];
            m.value = Some(value);
            m.outcome = if value > 0.5 { Outcome::Fail } else { Outcome::Pass };
            tally.add(position, attempt, &r);
        };
        add(0, 1, Outcome::Pass, 0.4);
        add(1, 1, Outcome::Fail, 0.6);
        add(1, 2, Outcome::Pass, 0.4);
        add(2, 1, Outcome::Invalid, 0.4);
        add(2, 2, Outcome::Marginal, 0.4);
        add(3, 1, Outcome::Fail, 0.7);
        add(4, 1, Outcome::Error, 0.1);
        tally.sort();
        let s = summarise(&header(6), &tally, vec![], |_| None, |_| None);
        assert_eq!(s.not_tested, 1);
        let first = s.first_pass.value.unwrap();
        assert_eq!((first.passed, first.count), (2, 4), "an INVALID attempt judges nothing, a FAIL does");
        let last = s.final_yield.value.unwrap();
        assert_eq!((last.passed, last.count), (3, 4));
        let bars: Vec<(&str, usize)> = s.pareto.iter().map(|b| (b.cause.as_str(), b.count)).collect();
        assert_eq!(bars, [("ERROR", 1), ("main/rmse", 1)]);
        assert_eq!(s.valves[1].attempts, [Outcome::Fail, Outcome::Pass]);
        assert_eq!(s.metrics[0].sample.value.as_ref().unwrap().count, 4, "the valve with an ERROR has no figure in the statistics");
        assert_eq!(s.outcome, Outcome::Error);
    }
}
