//! What the rows say together: which group of valves, which effect, since when.
//!
//! A finding is an effect that is more frequent in one group (a value of a free column: lot, supplier, sensor) than
//! in all others, beyond what chance makes of so many comparisons (Fisher's exact test, Bonferroni's correction); where it
//! grows with a number (mileage, date) the onset is the split that separates best. An unknown rest that looks alike in
//! many valves is one finding.

use std::collections::{BTreeMap, BTreeSet};

use super::row::{Row, Status};
use crate::batch::statistics::wilson;

/// Family-wise level of the comparisons.
const LEVEL: f64 = 0.01;
/// A column with more values than this tells single valves apart, not groups.
const MOST_GROUPS: usize = 2000;
/// Fewer valves than this are no cluster.
const LEAST_CLUSTER: usize = 5;

/// One thing that is more than chance.
#[derive(Debug, Clone, PartialEq)]
pub struct FleetFinding {
    /// The column that groups, such as `lot`; `None`: over all.
    pub column: Option<String>,
    /// Its value.
    pub group: String,
    /// The effect, or the look of an unknown rest.
    pub what: String,
    /// How many of the group, and of how many.
    pub inside: (usize, usize),
    /// How many of the others.
    pub outside: (usize, usize),
    /// After Bonferroni's correction for all comparisons.
    pub p_value: f64,
    /// Where it begins, by a number of the list: column, value, and how many valves before and after have it.
    pub onset: Option<Onset>,
}

/// Since when.
#[derive(Debug, Clone, PartialEq)]
pub struct Onset {
    /// The column, such as `mileage`.
    pub column: String,
    /// The number at which it begins; of dates the days since 1970.
    pub at: f64,
    /// Whether the column holds dates.
    pub is_date: bool,
    /// Before it: how many of how many.
    pub before: (usize, usize),
    /// From it on.
    pub after: (usize, usize),
}

impl FleetFinding {
    /// The name by which the next collection knows it again.
    pub fn name(&self) -> String {
        format!("{} {}: {}", self.column.as_deref().unwrap_or("all"), self.group, self.what)
    }
}

/// The share of something in a group, with Wilson's interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// How many.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
    /// The share.
    pub value: f64,
    /// 95 % interval.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl Rate {
    /// Counts with their interval; of nothing, from 0 to 1.
    pub fn new(hits: usize, of: usize) -> Self {
        if of == 0 {
            return Self { hits, of, value: 0.0, low: 0.0, high: 1.0 };
        }
        let w = wilson(hits, of);
        Self { hits, of, value: hits as f64 / of as f64, low: w.low, high: w.high }
    }

    /// Corrected for a diagnosis that finds `found` of the faulty and accuses `accused` of the healthy
    /// (W. J. Rogan, B. Gladen, Am. J. Epidemiol. 107 (1978) 71); `None` where it tells nothing apart.
    pub fn corrected(self, found: Self, accused: Self) -> Option<(f64, f64, f64)> {
        let power = found.value - accused.value;
        if self.of == 0 || power < 0.05 {
            return None;
        }
        let value = (self.value - accused.value) / power;
        let variance = |r: Self| r.value * (1.0 - r.value) / r.of.max(1) as f64;
        let spread = (variance(self) + value.powi(2) * variance(found) + (1.0 - value).powi(2) * variance(accused)).sqrt() / power;
        Some((value.clamp(0.0, 1.0), (value - 1.96 * spread).clamp(0.0, 1.0), (value + 1.96 * spread).clamp(0.0, 1.0)))
    }
}

/// What a row is counted for: its causes, or the look of its unknown rest.
fn counted(row: &Row) -> BTreeSet<String> {
    if row.is_unknown() {
        return row.remainder.iter().map(|r| format!("unknown, {r}")).collect();
    }
    row.causes().map(|e| e.id.clone()).collect()
}

/// All findings, the surest first. A group that is found is set aside for its effect before the next is looked for, so that a
/// bad lot does not make its supplier bad.
pub fn findings(rows: &[Row]) -> Vec<FleetFinding> {
    let rows: Vec<&Row> = rows.iter().filter(|r| r.status == Status::Done).collect();
    let counted: Vec<BTreeSet<String>> = rows.iter().map(|r| counted(r)).collect();
    let all: BTreeSet<&String> = counted.iter().flatten().collect();
    let groups = groups(&rows);
    let comparisons = (groups.iter().map(|g| g.1.len()).sum::<usize>() * all.len()) as f64;
    let mut tried: Vec<FleetFinding> = Vec::new();
    for what in &all {
        let has: Vec<bool> = counted.iter().map(|c| c.contains(*what)).collect();
        let mut aside = vec![false; rows.len()];
        while let Some((column, group, members, found)) = surest(&groups, &has, &aside)
            && found.p_value * comparisons < LEVEL
        {
            let onset = onset(&rows, &counted, members, what);
            let p_value = (found.p_value * comparisons).min(1.0);
            tried.push(FleetFinding { column: Some(column.clone()), group: group.clone(), what: (*what).clone(), onset, p_value, ..found });
            members.iter().for_each(|m| aside[*m] = true);
        }
    }
    tried.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let total = |what: &String| counted.iter().filter(|c| c.contains(what)).count();
    for what in all.into_iter().filter(|w| w.starts_with("unknown, ") && total(w) >= LEAST_CLUSTER) {
        let inside = (total(what), rows.len());
        tried.push(FleetFinding {
            column: None,
            group: "valves".into(),
            what: what.clone(),
            inside,
            outside: (0, 0),
            p_value: f64::NAN,
            onset: None,
        });
    }
    tried
}

type Groups = BTreeMap<String, Vec<usize>>;

/// The group in which an effect stands out most from all that are not set aside.
fn surest<'a>(
    groups: &'a [(String, Groups)],
    has: &[bool],
    aside: &[bool],
) -> Option<(&'a String, &'a String, &'a Vec<usize>, FleetFinding)> {
    let left = |m: &&usize| !aside[**m];
    let everywhere = (has.iter().zip(aside).filter(|(h, a)| **h && !**a).count(), aside.iter().filter(|a| !**a).count());
    let stands_out = |(column, group, members): (&'a String, &'a String, &'a Vec<usize>)| {
        let inside = (members.iter().filter(left).filter(|m| has[**m]).count(), members.iter().filter(left).count());
        let outside = (everywhere.0 - inside.0, everywhere.1 - inside.1);
        if inside.0 == 0 || outside.1 == 0 || inside.0 * outside.1 <= outside.0 * inside.1 {
            return None;
        }
        let p_value = fisher(inside, outside);
        let found = FleetFinding { column: None, group: String::new(), what: String::new(), inside, outside, p_value, onset: None };
        Some((column, group, members, found))
    };
    let each = groups.iter().flat_map(|(column, groups)| groups.iter().map(move |(group, members)| (column, group, members)));
    each.filter_map(stands_out).min_by(|a, b| a.3.p_value.total_cmp(&b.3.p_value))
}

/// Columns that group, with the rows of each value. Numbers do not group.
fn groups(rows: &[&Row]) -> Vec<(String, Groups)> {
    let columns: BTreeSet<&String> = rows.iter().flat_map(|r| r.tags.keys()).collect();
    columns
        .into_iter()
        .filter_map(|column| {
            let mut groups = Groups::new();
            for (k, row) in rows.iter().enumerate() {
                if let Some(value) = row.tags.get(column).filter(|v| !v.is_empty()) {
                    groups.entry(value.clone()).or_default().push(k);
                }
            }
            let grouped: usize = groups.values().map(Vec::len).sum();
            let fit = (2..=MOST_GROUPS).contains(&groups.len())
                && grouped >= 3 * groups.len()
                && !groups.keys().all(|v| v.parse::<f64>().is_ok());
            fit.then(|| (column.clone(), groups))
        })
        .collect()
}

/// A number that a column holds: a plain one, or a date as the days since 1970.
pub fn number(text: &str) -> Option<f64> {
    let date = || text.get(..10)?.parse::<jiff::civil::Date>().ok();
    text.parse().ok().filter(|v: &f64| v.is_finite()).or_else(|| {
        let days = date()?.since((jiff::Unit::Day, jiff::civil::date(1970, 1, 1))).ok()?;
        Some(f64::from(days.get_days()))
    })
}

/// The date of a number of [`number`], to the day.
pub fn date(days: f64) -> String {
    let span = jiff::Span::new().try_days(days.round() as i64).ok();
    span.and_then(|span| jiff::civil::date(1970, 1, 1).checked_add(span).ok()).map_or_else(|| format!("{days}"), |date| date.to_string())
}

/// Whether a column of numbers holds dates.
pub fn holds_dates(rows: &[&Row], column: &str) -> bool {
    let first = rows.iter().filter_map(|r| r.tags.get(column)).find(|text| number(text).is_some());
    first.is_some_and(|text| text.parse::<f64>().is_err())
}

/// Columns of numbers: those in which nearly every row has one, and not the same.
pub fn numeric_columns(rows: &[&Row]) -> Vec<String> {
    let columns: BTreeSet<&String> = rows.iter().flat_map(|r| r.tags.keys()).collect();
    let holds = |column: &&String| {
        let values: Vec<f64> = rows.iter().filter_map(|r| number(r.tags.get(*column)?)).collect();
        10 * values.len() >= 9 * rows.len() && values.iter().any(|v| *v != values[0])
    };
    columns.into_iter().filter(holds).cloned().collect()
}

/// The split of a group along a number that separates those with an effect best from those without, where it beats
/// chance after all splits that were tried.
fn onset(rows: &[&Row], counted: &[BTreeSet<String>], members: &[usize], what: &str) -> Option<Onset> {
    numeric_columns(rows)
        .into_iter()
        .filter_map(|column| {
            let mut at: Vec<(f64, bool)> =
                members.iter().filter_map(|m| Some((number(rows[*m].tags.get(&column)?)?, counted[*m].contains(what)))).collect();
            at.sort_by(|a, b| a.0.total_cmp(&b.0));
            let is_date = holds_dates(rows, &column);
            let hits = at.iter().filter(|a| a.1).count();
            let (mut before, mut best) = (0, None);
            for k in 1..at.len() {
                before += usize::from(at[k - 1].1);
                if at[k].0 == at[k - 1].0 {
                    continue;
                }
                let (b, a) = ((before, k), (hits - before, at.len() - k));
                let gain = likelihood(b) + likelihood(a) - likelihood((hits, at.len()));
                if a.0 * b.1 > b.0 * a.1 && best.as_ref().is_none_or(|(g, _)| gain > *g) {
                    best = Some((gain, Onset { column: column.clone(), at: 0.5 * (at[k].0 + at[k - 1].0), is_date, before: b, after: a }));
                }
            }
            // a split that was looked for has to gain more than one that was given: half the log of their number beside
            // the 3.3 nats of the level
            best.filter(|(gain, _)| *gain > 3.3 + 0.5 * (at.len() as f64).ln())
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, onset)| onset)
}

/// Log-likelihood of `k` of `n` at its own rate.
fn likelihood((k, n): (usize, usize)) -> f64 {
    let (k, n) = (k as f64, n as f64);
    let term = |x: f64| if x > 0.0 { x * (x / n).ln() } else { 0.0 };
    term(k) + term(n - k)
}

/// Fisher's exact test, one-sided: chance of at least `inside.0` of the hits in the group.
fn fisher(inside: (usize, usize), outside: (usize, usize)) -> f64 {
    let (hits, all) = (inside.0 + outside.0, inside.1 + outside.1);
    let log = |n: usize| statrs::function::factorial::ln_factorial(n as u64);
    let choose = |n: usize, k: usize| log(n) - log(k) - log(n - k);
    let most = hits.min(inside.1);
    (inside.0..=most)
        .filter(|k| hits - k <= outside.1)
        .map(|k| (choose(inside.1, k) + choose(outside.1, hits - k) - choose(all, hits)).exp())
        .sum::<f64>()
        .min(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::row::RowEffect;
    use super::super::table::example;
    use super::*;

    /// 20 lots of 15 valves; in lot 7, leakage above 60,000 km; elsewhere two of a hundred have something.
    fn fleet(bad: bool) -> Vec<Row> {
        (0..300)
            .map(|k| {
                let (lot, km) = (k % 20, (k * 37 % 100) as f64 * 1000.0);
                let mut row = example(&k.to_string());
                row.tags = [("lot", format!("L{lot:02}")), ("mileage", format!("{km}")), ("serial", format!("S{k}"))]
                    .map(|(a, b)| (a.into(), b))
                    .into();
                let id = if bad && lot == 7 && km > 60_000.0 { Some("leakage") } else { (k % 47 == 3).then_some("creep") };
                row.effects = id.into_iter().map(|id| RowEffect { id: id.into(), claim: None, parameters: Default::default() }).collect();
                row
            })
            .collect()
    }

    #[test]
    fn the_bad_lot_its_effect_and_its_onset_are_found() {
        let found = findings(&fleet(true));
        assert_eq!(found.iter().map(FleetFinding::name).collect::<Vec<_>>(), ["lot L07: leakage"]);
        let onset = found[0].onset.as_ref().map(|o| (o.column.as_str(), o.before.0));
        assert_eq!(onset, Some(("mileage", 0)));
        assert!(found[0].onset.as_ref().is_some_and(|o| (59_000.0..79_000.0).contains(&o.at)), "{:?}", found[0].onset);
    }

    #[test]
    fn a_bad_lot_does_not_make_its_supplier_bad() {
        let mut rows = fleet(true);
        for row in &mut rows {
            let supplier = if row.tags["lot"].as_str() < "L10" { "north" } else { "south" };
            row.tags.insert("supplier".into(), supplier.into());
        }
        assert_eq!(findings(&rows).iter().map(FleetFinding::name).collect::<Vec<_>>(), ["lot L07: leakage"]);
    }

    #[test]
    fn an_even_fleet_has_no_finding() {
        assert_eq!(findings(&fleet(false)), []);
    }

    #[test]
    fn fishers_test_gives_the_published_figure() {
        // R. A. Fisher's tea tasting: 4 of 4 right of 8 cups, p = 1/70
        assert!((fisher((4, 4), (0, 4)) - 1.0 / 70.0).abs() < 1e-12);
        assert!((fisher((3, 4), (1, 4)) - 17.0 / 70.0).abs() < 1e-12);
    }

    #[test]
    fn a_rate_is_corrected_for_what_the_diagnosis_misses_and_invents() {
        let (found, accused) = (Rate::new(80, 100), Rate::new(5, 100));
        let corrected = Rate::new(125, 1000).corrected(found, accused);
        assert!(corrected.is_some_and(|(v, low, high)| (v - 0.1).abs() < 1e-9 && low < 0.1 && high > 0.1), "{corrected:?}");
        assert_eq!(Rate::new(1, 10).corrected(Rate::new(5, 100), Rate::new(5, 100)), None);
    }

    #[test]
    fn rests_that_look_alike_are_one_finding() {
        let mut rows = fleet(false);
        for row in rows.iter_mut().take(8) {
            (row.verdict, row.effects, row.remainder) = (Some("unexplained".into()), Vec::new(), Some("depends on pressure".into()));
        }
        let found = findings(&rows);
        assert!(found.iter().any(|f| f.column.is_none() && f.inside.0 == 8 && f.what == "unknown, depends on pressure"), "{found:?}");
    }

    #[test]
    fn dates_are_numbers_too() {
        assert_eq!(number("1970-01-11"), Some(10.0));
        assert_eq!((number("12.5"), number("L7")), (Some(12.5), None));
        assert_eq!((date(10.4).as_str(), date(20_519.0).as_str()), ("1970-01-11", "2026-03-07"));
    }
}
