//! What is kept of every record while a batch runs: numbers, not records, so that memory stays small.

use std::borrow::Cow;
use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::record::{Dut, LimitRecord, Measurement, Origin, Outcome, TestRecord};

/// One metric of the batch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MetricKey {
    /// Phase of the plan.
    pub phase: String,
    /// Metric; a second one of the same id in the same phase is `id#2`.
    pub metric: String,
    /// Unit of its values.
    pub unit: String,
    /// Definition, from the first record.
    pub definition: String,
    /// The limit that it was judged by, from the first record.
    pub limit: Option<LimitRecord>,
}

/// One attempt on one valve.
#[derive(Debug, Clone, PartialEq)]
pub struct Attempt {
    /// Place of the valve in the batch, from 0.
    pub position: usize,
    /// Which attempt, from 1.
    pub number: u32,
    /// The valve.
    pub dut: Dut,
    /// Its outcome.
    pub outcome: Outcome,
    /// What its pressures came from.
    pub origin: Origin,
    /// Whether it ended with a current that nobody saw go.
    pub ended_unsafe: bool,
    /// Why there is no verdict, or what failed first.
    pub reason: Option<String>,
    /// Value and verdict of each metric, in the order of [`Tally::metrics`]; NaN where there is none.
    pub values: Vec<(f64, Outcome)>,
}

impl Attempt {
    /// Whether the attempt judged the valve; an INVALID, ERROR or ABORTED one says nothing of it.
    pub fn judged(&self) -> bool {
        matches!(self.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail)
    }
    /// Whether the valve was accepted.
    pub fn accepted(&self) -> bool {
        matches!(self.outcome, Outcome::Pass | Outcome::Marginal)
    }
}

/// The attempts of a batch.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    metrics: Vec<MetricKey>,
    // Earliest place in the batch at which each metric stands: valve, attempt, place in the record.
    ranks: Vec<(usize, u32, usize)>,
    lookup: HashMap<(String, String), usize>,
    attempts: Vec<Attempt>,
}

impl Tally {
    /// Adds a record.
    pub fn add(&mut self, position: usize, number: u32, record: &TestRecord) {
        let mut values = vec![(f64::NAN, Outcome::NotRun); self.metrics.len()];
        let mut failed = None;
        for (place, (phase, metric, m)) in measurements(record).enumerate() {
            let rank = (position, number, place);
            let column = *self.lookup.entry((phase.to_string(), metric.clone().into_owned())).or_insert_with(|| {
                self.metrics.push(MetricKey {
                    phase: phase.into(),
                    metric: metric.clone().into_owned(),
                    unit: m.unit.clone(),
                    definition: m.definition.clone(),
                    limit: m.limit.clone(),
                });
                self.ranks.push(rank);
                self.metrics.len() - 1
            });
            self.ranks[column] = self.ranks[column].min(rank);
            if column >= values.len() {
                values.resize(column + 1, (f64::NAN, Outcome::NotRun));
            }
            values[column] = (m.value.unwrap_or(f64::NAN), m.outcome);
            if m.outcome == Outcome::Fail && failed.is_none() {
                failed = Some(format!("{phase}/{metric}"));
            }
        }
        let reason = record.reasons.first().cloned().or(failed);
        let dut = record.dut.clone();
        let (origin, ended_unsafe) = (record.origin(), record.ended_unsafe());
        self.attempts.push(Attempt { position, number, dut, outcome: record.outcome, origin, ended_unsafe, reason, values });
    }

    /// Brings the attempts into the order of the batch, and the metrics into that of the first valve's record: neither depends on
    /// which thread was faster.
    pub fn sort(&mut self) {
        self.attempts.sort_by_key(|a| (a.position, a.number));
        let mut order: Vec<usize> = (0..self.metrics.len()).collect();
        order.sort_by_key(|&k| self.ranks[k]);
        for attempt in &mut self.attempts {
            attempt.values = order.iter().map(|&k| attempt.values.get(k).copied().unwrap_or((f64::NAN, Outcome::NotRun))).collect();
        }
        self.metrics = order.iter().map(|&k| self.metrics[k].clone()).collect();
        self.ranks = order.iter().map(|&k| self.ranks[k]).collect();
        self.lookup = self.metrics.iter().enumerate().map(|(k, m)| ((m.phase.clone(), m.metric.clone()), k)).collect();
    }

    /// The metrics; call [`Tally::sort`] before.
    pub fn metrics(&self) -> &[MetricKey] {
        &self.metrics
    }

    /// The attempts.
    pub fn attempts(&self) -> &[Attempt] {
        &self.attempts
    }

    /// The attempts of each valve, in the order of the batch; call [`Tally::sort`] before.
    pub fn valves(&self) -> impl Iterator<Item = &[Attempt]> {
        self.attempts.chunk_by(|a, b| a.position == b.position)
    }
}

/// The measurements of a record with phase and name; the second of an id in a phase is `id#2`.
pub fn measurements(record: &TestRecord) -> impl Iterator<Item = (&str, Cow<'_, str>, &Measurement)> {
    record.phases.iter().flat_map(|phase| {
        phase.measurements.iter().enumerate().map(|(k, m)| {
            let before = phase.measurements[..k].iter().filter(|b| b.metric == m.metric).count();
            let name = if before == 0 { Cow::Borrowed(m.metric.as_str()) } else { Cow::Owned(format!("{}#{}", m.metric, before + 1)) };
            (phase.name.as_str(), name, m)
        })
    })
}

/// The attempt that decides on a valve: the last that judged it, or the last of all.
pub fn deciding(attempts: &[Attempt]) -> &Attempt {
    attempts.iter().rfind(|a| a.judged()).unwrap_or(&attempts[attempts.len() - 1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::example::record;

    #[test]
    fn attempts_are_kept_and_the_last_judgement_decides() {
        let mut tally = Tally::default();
        let mut invalid = record("A", 1);
        invalid.outcome = Outcome::Invalid;
        invalid.reasons = vec!["lost samples".into()];
        tally.add(1, 1, &record("B", 119));
        tally.add(0, 2, &record("A", 1));
        tally.add(0, 1, &invalid);
        tally.add(0, 3, &invalid);
        tally.sort();
        let valves: Vec<&[Attempt]> = tally.valves().collect();
        assert_eq!((valves.len(), valves[0].len()), (2, 3));
        assert_eq!(deciding(valves[0]).number, 2);
        assert_eq!(valves[0][0].reason.as_deref(), Some("lost samples"));
        assert_eq!(tally.metrics().len(), 1);
    }

    /// The same records in another order give the same table, also where a record lacks a metric or has one twice.
    #[test]
    fn the_order_of_arrival_does_not_show() {
        let mut short = record("A", 1);
        short.phases[0].measurements.clear();
        let mut twice = record("B", 2);
        let mut second = twice.phases[0].measurements[0].clone();
        second.value = Some(7.0);
        twice.phases[0].measurements.push(second);
        twice.phases[0].measurements[0].value = None;
        let records = [short, twice, record("C", 3)];
        let table = |order: [usize; 3]| {
            let mut tally = Tally::default();
            order.iter().for_each(|&k| tally.add(k, 1, &records[k]));
            tally.sort();
            let values: Vec<String> = tally.attempts().iter().map(|a| format!("{:?}", a.values)).collect();
            (tally.metrics().iter().map(|m| m.metric.clone()).collect::<Vec<_>>(), values)
        };
        let (names, values) = table([0, 1, 2]);
        assert_eq!(names, ["rmse", "rmse#2"]);
        assert!(values[1].contains("7.0"));
        for order in [[2, 1, 0], [1, 2, 0], [2, 0, 1]] {
            assert_eq!(table(order), (names.clone(), values.clone()));
        }
    }
}
