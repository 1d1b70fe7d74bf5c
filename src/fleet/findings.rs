//! What the rows say together: which group of valves, which effect, since when.
//!
//! A finding is an effect that is more frequent in one group (a value of a free column: lot, supplier, sensor) than
//! in all others, beyond what chance makes of so many comparisons (Fisher's exact test, Bonferroni's correction),
//! as a whole or from some number of the list (mileage, date) on; the onset is the split that separates best. An unknown rest that looks alike in
//! many valves is one finding.

use std::collections::{BTreeMap, BTreeSet};

use super::comparison::{Comparison, StandsOut};
use super::onset::{Onset, onset};
use super::row::{Row, RowEffect, Status};
use super::standing::{LEAST_VALVES, LOOK, Standing};

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
    /// Effects that the valves of the group cannot be told to have rather than it.
    pub or: Vec<String>,
    /// How many of the group, and of how many.
    pub inside: (usize, usize),
    /// How many of the others.
    pub outside: (usize, usize),
    /// After Bonferroni's correction for all comparisons.
    pub p_value: f64,
    /// Where it begins, by a number of the list: column, value, and how many valves before and after have it.
    pub onset: Option<Onset>,
}

impl FleetFinding {
    /// The name by which the next collection knows it again.
    pub fn name(&self) -> String {
        format!("{} {}: {}", self.column.as_deref().unwrap_or("all"), self.group, self.what)
    }
}

/// All findings, the surest first. A group that is found is set aside for its effect before the next is looked for, so that a
/// bad lot does not make its supplier bad.
pub fn findings(rows: &[Row], standing: &Standing) -> Vec<FleetFinding> {
    let rows: Vec<&Row> = rows.iter().filter(|r| r.status == Status::Done).collect();
    let counted: Vec<BTreeSet<String>> = rows.iter().map(|r| standing.shown(r)).collect();
    let all = told_apart(&rows, &counted);
    let groups = groups(&rows);
    let strata = strata(&rows);
    let columns: Vec<(String, bool)> = numeric_columns(&rows).into_iter().map(|c| (c.clone(), holds_dates(&rows, &c))).collect();
    let numbers: Vec<Vec<Option<f64>>> = columns.iter().map(|(c, _)| rows.iter().map(|r| number(r.tags.get(c)?)).collect()).collect();
    // How an unknown rest looks is no matter of groups: that one is there is compared.
    let compared = || all.iter().filter(|(what, _)| !what.starts_with(LOOK));
    let comparisons = (groups.iter().map(|g| g.1.len()).sum::<usize>() * compared().count()) as f64;
    let with = |has: &[bool], members: &[usize], also: &dyn Fn(&Row) -> bool| -> Vec<bool> {
        let mut with = has.to_vec();
        members.iter().for_each(|m| with[*m] |= also(rows[*m]));
        with
    };
    let mut tried: Vec<FleetFinding> = Vec::new();
    for (what, (has, or)) in compared() {
        // In a group that stands out, the name alone says which of its valves have it: the error of some is no larger than that of others.
        let is_named = |row: &Row| {
            let names = standing.named(row);
            names.contains(*what) || or.iter().any(|w| names.contains(*w))
        };
        // And valves of it whose error stands apart from all others have what the group has, however it was named there.
        let is_off = |row: &Row| standing.is_off(row);
        let mut comparison = Comparison::new(has, &strata, &numbers);
        while let Some((column, group, members, StandsOut { inside, outside, p_value })) = surest(&groups, &comparison)
            && p_value * comparisons < LEVEL
        {
            tried.push(FleetFinding {
                column: Some(column.clone()),
                group: group.clone(),
                what: (*what).clone(),
                or: or.iter().map(|w| (*w).clone()).collect(),
                inside,
                outside,
                p_value: p_value * comparisons,
                onset: [with(has, members, &is_named), has.clone(), with(has, members, &is_off)]
                    .iter()
                    .find_map(|has| onset(&columns, &numbers, has, members)),
            });
            comparison.set_aside(members);
        }
    }
    tried.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let mut tried = one_each(tried, &rows, &counted);
    let alike = |has: &[bool]| has.iter().filter(|h| **h).count();
    for (what, (has, _)) in all.into_iter().filter(|(what, (has, _))| what.starts_with(LOOK) && alike(has) >= LEAST_CLUSTER) {
        tried.push(FleetFinding {
            column: None,
            group: "valves".into(),
            what: what.clone(),
            or: Vec::new(),
            inside: (alike(&has), rows.len()),
            outside: (0, 0),
            p_value: f64::NAN,
            onset: None,
        });
    }
    tried
}

/// All that is shown, with the rows that show it; what always comes together has one entry, under that which is named most often, and
/// the others beside it.
fn told_apart<'c>(rows: &[&Row], counted: &'c [BTreeSet<String>]) -> BTreeMap<&'c String, (Vec<bool>, Vec<&'c String>)> {
    let mut together: BTreeMap<(Vec<bool>, bool), Vec<&String>> = BTreeMap::new();
    for what in counted.iter().flatten().collect::<BTreeSet<&String>>() {
        let has = counted.iter().map(|c| c.contains(what)).collect();
        together.entry((has, what.starts_with(LOOK))).or_default().push(what);
    }
    let named = |what: &String| rows.iter().filter(|r| r.effects.iter().any(|e| e.id == *what)).count();
    let entry = |((has, _), mut names): ((Vec<bool>, bool), Vec<&'c String>)| {
        names.sort_by_key(|what| std::cmp::Reverse(named(what)));
        let first = names.remove(0);
        (first, (has, names))
    };
    together.into_iter().map(entry).collect()
}

/// Findings of one group, of which the later names nothing that the valves of the surer one can be told to have, as one.
fn one_each(tried: Vec<FleetFinding>, rows: &[&Row], counted: &[BTreeSet<String>]) -> Vec<FleetFinding> {
    let mut kept: Vec<FleetFinding> = Vec::new();
    for found in tried {
        let is_of_group = |row: &Row| found.column.as_ref().and_then(|c| row.tags.get(c)) == Some(&found.group);
        let showing: Vec<(&Row, &BTreeSet<String>)> =
            rows.iter().zip(counted).filter(|(row, shown)| is_of_group(row) && shown.contains(&found.what)).map(|(r, s)| (*r, s)).collect();
        let is_same = |surer: &FleetFinding| {
            let either = |e: &RowEffect| [&surer.what, &found.what].iter().all(|what| e.ids().any(|id| id == *what));
            let alike = showing.iter().filter(|(row, _)| row.effects.iter().any(either)).count();
            2 * alike >= showing.len() && showing.iter().all(|(_, shown)| shown.contains(&surer.what))
        };
        let same = kept.iter_mut().find(|k| (&k.column, &k.group) == (&found.column, &found.group) && is_same(k));
        match same {
            Some(surer) => surer.or.extend(std::iter::once(found.what).chain(found.or)),
            None => kept.push(found),
        }
    }
    kept
}

/// The rows of each value of a column.
pub type Groups = BTreeMap<String, Vec<usize>>;

/// The rows that are held against each other: those of one model, where it stands for enough of them, since what a model lacks stands
/// out wherever another model is used; and all others.
fn strata(rows: &[&Row]) -> Vec<usize> {
    let mut of_model: BTreeMap<&str, usize> = BTreeMap::new();
    rows.iter().for_each(|r| *of_model.entry(r.model_key()).or_default() += 1);
    let large: BTreeMap<&str, usize> = of_model.into_iter().filter(|m| m.1 >= LEAST_VALVES).zip(1..).map(|((m, _), k)| (m, k)).collect();
    rows.iter().map(|r| large.get(r.model_key()).copied().unwrap_or(0)).collect()
}

/// The group that stands out most.
fn surest<'g>(groups: &'g [(String, Groups)], of: &Comparison<'_>) -> Option<(&'g String, &'g String, &'g Vec<usize>, StandsOut)> {
    let each = groups.iter().flat_map(|(column, groups)| groups.iter().map(move |(group, members)| (column, group, members)));
    each.filter_map(|(column, group, members)| Some((column, group, members, of.group(members)?)))
        .min_by(|a, b| a.3.p_value.total_cmp(&b.3.p_value))
}

/// Columns that group, with the rows of each value. Numbers and dates do not group.
pub fn groups(rows: &[&Row]) -> Vec<(String, Groups)> {
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
            let fit =
                (2..=MOST_GROUPS).contains(&groups.len()) && grouped >= 3 * groups.len() && !groups.keys().all(|v| number(v).is_some());
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
                row.effects = id.into_iter().map(|id| RowEffect { id: id.into(), ..RowEffect::default() }).collect();
                row
            })
            .collect()
    }

    fn found(rows: &[Row]) -> Vec<FleetFinding> {
        findings(rows, &Standing::of(rows))
    }

    #[test]
    fn the_bad_lot_its_effect_and_its_onset_are_found() {
        let found = found(&fleet(true));
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
        assert_eq!(found(&rows).iter().map(FleetFinding::name).collect::<Vec<_>>(), ["lot L07: leakage"]);
    }

    #[test]
    fn a_lack_of_the_model_in_one_lot_alone_is_no_lack_of_the_model() {
        let mut rows = fleet(true);
        for row in &mut rows {
            for effect in &mut row.effects {
                effect.claim = Some("lacks".into());
                if effect.id == "leakage" {
                    row.rmse_bar.insert("base".into(), 0.9);
                    effect.indistinguishable = vec!["reference_shift".into()];
                }
            }
        }
        let found = found(&rows);
        assert_eq!(found.iter().map(FleetFinding::name).collect::<Vec<_>>(), ["lot L07: leakage"]);
        assert_eq!(found[0].or, ["reference_shift"]);
        // Nor does what all valves of one of two models show, in the part that has it.
        for (k, row) in rows.iter_mut().enumerate() {
            let part = k % 2;
            row.model_sha256 = Some(format!("model {part}"));
            row.tags.insert("part".into(), format!("P{part}"));
            row.effects = (part == 0 && k % 30 > 1).then(|| RowEffect { id: "creep".into(), ..RowEffect::default() }).into_iter().collect();
        }
        assert_eq!(super::findings(&rows, &Standing::of(&rows)), []);
        // What all valves show stands out in no lot.
        for row in &mut rows {
            row.effects = vec![RowEffect { id: "creep".into(), claim: Some("lacks".into()), ..RowEffect::default() }];
        }
        assert_eq!(super::findings(&rows, &Standing::of(&rows)), []);
    }

    #[test]
    fn where_each_valve_has_its_own_model_every_effect_is_compared() {
        let mut rows = fleet(true);
        for (k, row) in rows.iter_mut().enumerate() {
            row.model_sha256 = Some(format!("model of {k}"));
            row.effects.iter_mut().for_each(|e| e.claim = Some("lacks".into()));
        }
        assert_eq!(found(&rows).iter().map(FleetFinding::name).collect::<Vec<_>>(), ["lot L07: leakage"]);
    }

    #[test]
    fn two_names_that_the_same_valves_cannot_be_told_to_have_are_one_finding() {
        let mut rows = fleet(true);
        for (n, effect) in rows.iter_mut().flat_map(|r| &mut r.effects).filter(|e| e.id == "leakage").enumerate() {
            effect.indistinguishable = (n % 3 > 0).then(|| "reference_shift".into()).into_iter().collect();
        }
        let told = found(&rows);
        assert_eq!(told.iter().map(FleetFinding::name).collect::<Vec<_>>(), ["lot L07: leakage"]);
        assert_eq!(told[0].or, ["reference_shift"]);
        // Where most of those valves have both for sure, both are found.
        for effect in rows.iter_mut().flat_map(|r| &mut r.effects) {
            effect.indistinguishable.clear();
        }
        for row in rows.iter_mut().filter(|r| r.effects.iter().any(|e| e.id == "leakage")).skip(1) {
            row.effects.push(RowEffect { id: "reference_shift".into(), ..RowEffect::default() });
        }
        assert_eq!(found(&rows).len(), 2);
    }

    #[test]
    fn the_onset_of_a_finding_rests_on_all_valves_that_name_it() {
        let mut rows = fleet(true);
        for (k, row) in rows.iter_mut().enumerate() {
            row.effects.iter_mut().for_each(|e| e.claim = Some("lacks".into()));
            let km = number(&row.tags["mileage"]).unwrap();
            // Below 80,000 km its error is like that of the others.
            let is_large = k % 20 == 7 && km > 80_000.0;
            row.rmse_bar.insert("base".into(), if is_large { 0.9 } else { 0.1 + 0.01 * (k % 5) as f64 });
        }
        let told = found(&rows);
        let onset = told[0].onset.as_ref().unwrap();
        assert_eq!((onset.before.0, onset.after), (0, (6, 6)), "{onset:?}");
    }

    #[test]
    fn a_valve_of_the_group_that_is_as_far_off_has_it_by_another_name() {
        let mut rows = fleet(true);
        for (k, row) in rows.iter_mut().enumerate() {
            let is_bad = row.effects.iter().any(|e| e.id == "leakage");
            row.rmse_bar.insert("base".into(), if is_bad { 0.9 } else { 0.1 + 0.01 * (k % 5) as f64 });
        }
        // Every other one of them is named otherwise.
        for (k, row) in rows.iter_mut().filter(|r| r.effects.iter().any(|e| e.id == "leakage")).enumerate() {
            if k % 2 == 0 {
                row.effects[0].id = "creep".into();
            }
        }
        let told = found(&rows);
        let onset = told[0].onset.as_ref().unwrap();
        assert_eq!((told[0].what.as_str(), onset.before.0, onset.after), ("leakage", 0, (6, 6)), "{onset:?}");
    }

    #[test]
    fn an_even_fleet_has_no_finding() {
        assert_eq!(found(&fleet(false)), []);
    }

    #[test]
    fn rests_that_look_alike_are_one_finding() {
        let mut rows = fleet(false);
        for row in rows.iter_mut().take(8) {
            (row.verdict, row.effects, row.remainder) = (Some("unexplained".into()), Vec::new(), Some("depends on pressure".into()));
        }
        let found = found(&rows);
        assert!(found.iter().any(|f| f.column.is_none() && f.inside.0 == 8 && f.what == "unknown, depends on pressure"), "{found:?}");
    }

    #[test]
    fn dates_are_numbers_too() {
        assert_eq!(number("1970-01-11"), Some(10.0));
        assert_eq!((number("12.5"), number("L7")), (Some(12.5), None));
        assert_eq!((date(10.4).as_str(), date(20_519.0).as_str()), ("1970-01-11", "2026-03-07"));
    }
}
