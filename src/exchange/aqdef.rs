//! A lot in the quality departments' exchange format AQDEF (`.dfq`): keyed lines `K2002/3 text`.
//!
//! Written are the head (K0100), the part (K1...), one block per characteristic (K2...) and, value by value, the
//! measured data (K00..), each with its key, so that a value never depends on its place in a line. A value that could
//! not be measured is there with attribute 256, never as a number. Times are written with the year first: with the day
//! first, readers disagree on which of two small numbers is the month.
//!
//! Source of the keys: the Python package `aqdefreader` 1.3.0 and its test files (PyPI, Apache-2.0), which read this
//! file back in the tests. It is no certified implementation of the format.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use super::ExchangeError;
use crate::batch::journal::{self, Kind};
use crate::batch::statistics::normality;
use crate::batch::store::{self, Header};
use crate::batch::tally::{Attempt, MetricKey, deciding};

/// Attribute of a value that is none (K0002).
const ABSENT: u32 = 256;

/// When, where and by whom an attempt was made.
#[derive(Debug, Clone, Default, PartialEq)]
struct Circumstances {
    started: String,
    station: Option<String>,
    operator: Option<String>,
}

/// A lot ready to be written: the deciding attempt of every judged valve.
#[derive(Debug)]
pub struct Lot {
    header: Header,
    part_number: Option<String>,
    revision: Option<String>,
    metrics: Vec<MetricKey>,
    valves: Vec<(Attempt, Circumstances)>,
    /// Valves that were tried and never judged; they are not in the lot.
    pub not_judged: usize,
}

impl Lot {
    /// Reads a batch; `part` chooses the part number where there are several.
    ///
    /// # Errors
    /// [`ExchangeError`] where the folder holds no batch, no judged valve, or several part numbers.
    pub fn read(batch: &Path, part: Option<&str>) -> Result<Self, ExchangeError> {
        let header = store::read_header(batch)?;
        let tally = store::load(batch)?.tally;
        let mut circumstances = circumstances(batch, header.station.as_ref())?;
        let (mut valves, mut not_judged) = (Vec::new(), 0);
        for attempt in tally.valves().map(deciding) {
            if attempt.judged() {
                let of = circumstances.remove(&(attempt.position, attempt.number)).unwrap_or_default();
                valves.push((attempt.clone(), of));
            } else {
                not_judged += 1;
            }
        }
        let name = batch.display().to_string();
        let mut found: Vec<&str> = valves.iter().map(|(a, _)| a.dut.part_number.as_deref().unwrap_or("")).collect();
        found.sort_unstable();
        found.dedup();
        let listed = found.iter().map(|p| format!("`{p}`")).collect::<Vec<_>>().join(", ");
        let part_number = match (part, found.as_slice()) {
            (_, []) => return Err(ExchangeError::Empty { batch: name }),
            (Some(part), found) if found.contains(&part) => part.to_string(),
            (Some(part), _) => return Err(ExchangeError::UnknownPart { batch: name, wanted: part.into(), found: listed }),
            (None, [one]) => (*one).to_string(),
            (None, _) => return Err(ExchangeError::Parts { batch: name, found: listed }),
        };
        valves.retain(|(a, _)| a.dut.part_number.as_deref().unwrap_or("") == part_number);
        let revision = valves.iter().find_map(|(a, _)| a.dut.revision.clone());
        let part_number = Some(part_number).filter(|p| !p.is_empty());
        Ok(Self { header, part_number, revision, metrics: tally.metrics().to_vec(), valves, not_judged })
    }

    /// Number of valves in the lot.
    pub fn len(&self) -> usize {
        self.valves.len()
    }

    /// Whether the lot holds no valve; [`Lot::read`] refuses such a one.
    pub fn is_empty(&self) -> bool {
        self.valves.is_empty()
    }

    /// Number of characteristics.
    pub fn characteristics(&self) -> usize {
        self.metrics.len()
    }

    /// The file: UTF-8, with a byte order mark only where a character needs it.
    pub fn to_dfq(&self) -> Vec<u8> {
        let mut text = String::new();
        self.head(&mut text);
        for (k, metric) in self.metrics.iter().enumerate() {
            self.characteristic(&mut text, k, metric);
        }
        for (attempt, of) in &self.valves {
            self.values(&mut text, attempt, of);
        }
        let mark: &[u8] = if text.is_ascii() { b"" } else { "\u{feff}".as_bytes() };
        [mark, text.as_bytes()].concat()
    }

    fn head(&self, text: &mut String) {
        line(text, "K0100", None, &self.metrics.len().to_string());
        line(text, "K1001", None, self.part_number.as_deref().unwrap_or(&self.header.plan));
        let marked = if self.header.simulated { format!("SIMULATED {}", self.header.plan) } else { self.header.plan.clone() };
        line(text, "K1002", None, &marked);
        if let Some(revision) = &self.revision {
            line(text, "K1004", None, revision);
        }
    }

    fn characteristic(&self, text: &mut String, k: usize, metric: &MetricKey) {
        let number = k + 1;
        let mut field = |key: &str, value: &str| line(text, key, Some(number), value);
        field("K2001", &number.to_string());
        field("K2002", &format!("{} {}", metric.phase, metric.metric));
        // A variable characteristic, not an attribute one.
        field("K2004", "0");
        let values: Vec<f64> = self.valves.iter().filter_map(|(a, _)| measured(a, k)).collect();
        let normal = normality(&values).value.is_some_and(|n| n.plausible);
        // 1: normal. 0 leaves the choice of the distribution to the reader.
        field("K2011", if normal { "1" } else { "0" });
        field("K2022", &values.iter().map(|v| decimals(*v)).max().unwrap_or(0).to_string());
        for (limit, kind, value) in [("K2110", "K2120", lower(metric)), ("K2111", "K2121", upper(metric))] {
            if let Some(value) = value {
                field(limit, &value.to_string());
            }
            field(kind, if value.is_some() { "1" } else { "0" });
        }
        field("K2142", &metric.unit);
    }

    fn values(&self, text: &mut String, attempt: &Attempt, of: &Circumstances) {
        for k in 0..self.metrics.len() {
            let mut field = |key: &str, value: &str| line(text, key, Some(k + 1), value);
            let value = measured(attempt, k);
            field("K0001", &value.unwrap_or(0.0).to_string());
            field("K0002", &if value.is_some() { 0 } else { ABSENT }.to_string());
            if let Some(time) = time(&of.started) {
                field("K0004", &time);
            }
            if let Some(lot) = &attempt.dut.lot {
                field("K0006", &format!("#{lot}"));
            }
            if let Some(operator) = &of.operator {
                field("K0008", operator);
            }
            if let Some(station) = &of.station {
                field("K0010", station);
            }
            field("K0014", &attempt.dut.serial);
        }
    }
}

fn lower(metric: &MetricKey) -> Option<f64> {
    metric.limit.as_ref().and_then(|l| l.min)
}

fn upper(metric: &MetricKey) -> Option<f64> {
    metric.limit.as_ref().and_then(|l| l.max)
}

/// The value of metric `k`; nothing where it could not be measured.
fn measured(attempt: &Attempt, k: usize) -> Option<f64> {
    attempt.values.get(k).map(|v| v.0).filter(|v| v.is_finite())
}

/// Digits behind the point of a value as it is written.
fn decimals(value: f64) -> usize {
    value.to_string().split_once('.').map_or(0, |(_, digits)| digits.len())
}

/// RFC 3339 as `YYYY-MM-DD/hh:mm:ss`, in the zone in which it was written.
fn time(rfc3339: &str) -> Option<String> {
    let (date, rest) = rfc3339.split_once(['T', ' '])?;
    Some(format!("{date}/{}", rest.get(..8)?))
}

/// One keyed line; what a person typed may hold no line end and no control character.
fn line(text: &mut String, key: &str, number: Option<usize>, value: &str) {
    let clean: String = value.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let number = number.map_or(String::new(), |n| format!("/{n}"));
    // Writing to a string cannot fail.
    let _ = write!(text, "{key}{number} {}\r\n", clean.trim());
}

/// Time, station and operator of every attempt, from the journal.
fn circumstances(batch: &Path, common: Option<&serde_json::Value>) -> Result<BTreeMap<(usize, u32), Circumstances>, ExchangeError> {
    let mut all = BTreeMap::new();
    journal::read(batch, |_, line| {
        if let (Kind::Finished, Some(record)) = (line.event, line.record) {
            let provenance = record.provenance.unwrap_or_default();
            // What all attempts share stands in the head of the batch.
            let text = |key: &str| provenance.station.as_ref().or(common)?.get(key)?.as_str().map(String::from);
            let started = if provenance.started.is_empty() { line.at } else { provenance.started.clone() };
            let of = Circumstances { started, station: text("id"), operator: text("operator") };
            all.entry((line.position, line.attempt)).or_insert(of);
        }
        Ok(())
    })?;
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_cannot_be_broken_by_what_a_person_typed() {
        let mut text = String::new();
        line(&mut text, "K1001", None, "A1\r\nK2110/1 99");
        assert_eq!(text, "K1001 A1  K2110/1 99\r\n");
    }

    #[test]
    fn times_have_the_year_first() {
        assert_eq!(time("2026-11-12T08:05:09.25Z").unwrap(), "2026-11-12/08:05:09");
        assert_eq!(time("2026-11-12T08:05:09+01:00").unwrap(), "2026-11-12/08:05:09");
        assert_eq!(time("today"), None);
    }

    #[test]
    fn digits_are_those_of_the_value() {
        assert_eq!([decimals(0.5), decimals(12.0), decimals(-0.125), decimals(1e-7)], [1, 0, 3, 7]);
    }
}
