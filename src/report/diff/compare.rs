//! Compares two records, figure by figure.

use std::collections::BTreeMap;

use super::{Change, RecordDiff, Tolerances};
use crate::record::{Measurement, PhaseRecord, TestRecord};
use crate::report::format;
use crate::units::Unit;

/// Compares `before` with `after`; one that is missing is a difference.
pub fn compare(name: &str, before: Option<&TestRecord>, after: Option<&TestRecord>, tolerances: &Tolerances) -> RecordDiff {
    let mut diff = RecordDiff {
        name: name.into(),
        before: before.map(|r| r.outcome),
        after: after.map(|r| r.outcome),
        changes: Vec::new(),
        first: None,
        phases_in_common: 0,
        compared: 0,
        notes: Vec::new(),
    };
    let (Some(before), Some(after)) = (before, after) else { return diff };
    diff.notes = notes(before, after);
    if before.origin() != after.origin() {
        let name = |r: &TestRecord| format::origin_badge(r.origin()).map_or("real valve".to_string(), str::to_lowercase);
        diff.changes.push(change("run", "kind of run", true, name(before), name(after)));
    }
    for (a, b) in paired(&before.phases, &after.phases, |p| p.name.clone()) {
        diff.phases_in_common += usize::from(a.is_some() && b.is_some());
        phases(&mut diff, a, b, tolerances);
    }
    stability(&mut diff, before, after, tolerances);
    // Before the verdicts go to the front: the first figure in the order of the plan.
    let first = diff.changes.iter().find(|c| c.delta.is_some() && c.phase != "stability").cloned();
    // A stable sort: the order of the plan stays within each kind.
    diff.changes.sort_by_key(|c| !c.verdict);
    diff.first = first.and_then(|f| diff.changes.iter().position(|c| *c == f));
    diff
}

fn change(phase: &str, figure: impl Into<String>, verdict: bool, before: String, after: String) -> Change {
    Change { phase: phase.into(), figure: figure.into(), verdict, before, after, delta: None, tolerance: None }
}

/// Items of both lists side by side, in the order of the second list, what only the first has behind.
fn paired<'a, T>(before: &'a [T], after: &'a [T], key: impl Fn(&T) -> String) -> Vec<(Option<&'a T>, Option<&'a T>)> {
    let mut left: BTreeMap<String, Vec<&T>> = BTreeMap::new();
    for item in before.iter().rev() {
        left.entry(key(item)).or_default().push(item);
    }
    let mut pairs: Vec<_> = after.iter().map(|b| (left.get_mut(&key(b)).and_then(Vec::pop), Some(b))).collect();
    let gone = |item: &&T| left.get(&key(item)).is_some_and(|rest| rest.iter().any(|r| std::ptr::eq(*r, *item)));
    pairs.extend(before.iter().filter(gone).map(|a| (Some(a), None)));
    pairs
}

fn phases(diff: &mut RecordDiff, before: Option<&PhaseRecord>, after: Option<&PhaseRecord>, tolerances: &Tolerances) {
    let name = before.or(after).map_or("", |p| p.name.as_str());
    let verdict = |p: Option<&PhaseRecord>| p.map_or("not in the plan", format::phase_verdict).to_string();
    if verdict(before) != verdict(after) {
        diff.changes.push(change(name, "verdict", true, verdict(before), verdict(after)));
    }
    let none = Vec::new();
    let all = |p: Option<&PhaseRecord>| p.map_or(none.clone(), |p| p.measurements.clone());
    let (before, after) = (all(before), all(after));
    for (a, b) in paired(&before, &after, |m| m.definition.clone()) {
        measurements(diff, name, a, b, tolerances);
    }
}

fn measurements(diff: &mut RecordDiff, phase: &str, before: Option<&Measurement>, after: Option<&Measurement>, tolerances: &Tolerances) {
    let Some(either) = after.or(before) else { return };
    let figure = format::definition(either);
    let (Some(a), Some(b)) = (before, after) else {
        let print = |m: Option<&Measurement>| m.map_or("not measured".into(), format::value);
        diff.changes.push(change(phase, figure, false, print(before), print(after)));
        return;
    };
    diff.compared += 1;
    let verdict = a.outcome != b.outcome;
    let tolerance = tolerances.by_metric.get(&b.metric).copied().unwrap_or_else(|| last_digit(&b.unit));
    if verdict || beyond(a.value, b.value, tolerance) {
        let print = |m: &Measurement| if verdict { format!("{} {}", format::value(m), format::verdict(m)) } else { format::value(m) };
        let delta = a.value.zip(b.value).map(|(a, b)| b - a);
        diff.changes.push(Change { delta, tolerance: Some(tolerance), ..change(phase, &figure, verdict, print(a), print(b)) });
    }
    if a.limit != b.limit {
        let print = |m: &Measurement| {
            let warning = format::warning(m);
            let warning = if warning.is_empty() { warning } else { format!(", warns {warning}") };
            if m.limit.is_some() { format!("{}{warning}", format::limit(m)) } else { "no limit".into() }
        };
        diff.changes.push(change(phase, format!("limit of {figure}"), false, print(a), print(b)));
    }
}

/// A value that appears or is lost is always a difference.
fn beyond(before: Option<f64>, after: Option<f64>, tolerance: f64) -> bool {
    match (before, after) {
        // A ten-thousandth of slack: 0.124 - 0.123 is not exactly 0.001.
        (Some(a), Some(b)) => (b - a).abs() > tolerance * 1.0001,
        (a, b) => a.is_some() != b.is_some(),
    }
}

fn last_digit(unit: &str) -> f64 {
    10f64.powi(-(Unit::by_symbol(unit).map_or(4, |u| u.decimals) as i32))
}

fn stability(diff: &mut RecordDiff, before: &TestRecord, after: &TestRecord, tolerances: &Tolerances) {
    let (a, b) = match (&before.stability, &after.stability) {
        (None, None) => return,
        (Some(a), Some(b)) => (a, b),
        (a, _) => {
            let print = |there: bool| if there { "closed loop" } else { "no loop" }.to_string();
            diff.changes.push(change("stability", "verdict", true, print(a.is_some()), print(a.is_none())));
            return;
        }
    };
    let stable = format::stable;
    if stable(a) != stable(b) {
        diff.changes.push(change("stability", "verdict", true, stable(a), stable(b)));
    }
    for (a, b) in paired(&format::margins(a), &format::margins(b), |m| m.name.to_string()) {
        let tolerance = b.or(a).map_or(0.0, |m| tolerances.by_metric.get(m.name).copied().unwrap_or_else(|| last_digit(m.unit)));
        let value = |m: Option<&format::Margin>| m.and_then(|m| m.value);
        diff.compared += 1;
        if beyond(value(a), value(b), tolerance) {
            let print = |m: Option<&format::Margin>| m.map_or("-".into(), format::Margin::print);
            let name = b.or(a).map_or("", |m| m.name);
            let delta = value(a).zip(value(b)).map(|(a, b)| b - a);
            diff.changes.push(Change { delta, tolerance: Some(tolerance), ..change("stability", name, false, print(a), print(b)) });
        }
    }
}

fn notes(before: &TestRecord, after: &TestRecord) -> Vec<String> {
    let mut notes = Vec::new();
    let mut note = |what: &str, a: &str, b: &str| {
        if a != b {
            notes.push(format!("{what}: {a} -> {b}"));
        }
    };
    note("plan", &before.plan.name, &after.plan.name);
    note("plan file", short(&before.plan.sha256), short(&after.plan.sha256));
    note("valve", &before.dut.serial, &after.dut.serial);
    note("rig", &before.rig.name, &after.rig.name);
    note("rig file", short(&before.rig.sha256), short(&after.rig.sha256));
    note("seed", &before.seed.to_string(), &after.seed.to_string());
    for (a, b) in paired(&before.plan.parameters, &after.plan.parameters, |p| p.0.clone()) {
        let key = b.or(a).map_or("", |p| p.0.as_str());
        let print = |p: Option<&(String, String)>| p.map_or("none".to_string(), |p| p.1.clone());
        note(key, &print(a), &print(b));
    }
    let counts = |r: &TestRecord| format!("{}/{}/{}", r.timing.missed_slots, r.timing.lost_samples, r.timing.stale_samples);
    note("missed/lost/stale", &counts(before), &counts(after));
    notes
}

fn short(sha256: &str) -> &str {
    sha256.get(..12).unwrap_or(sha256)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{LimitRecord, Outcome};
    use crate::report::tests::record;

    fn diff(change: impl FnOnce(&mut TestRecord)) -> RecordDiff {
        let (a, mut b) = (record(), record());
        change(&mut b);
        compare("x", Some(&a), Some(&b), &Tolerances::default())
    }

    #[test]
    fn equal_records_and_another_day_do_not_differ() {
        let same = diff(|r| r.provenance = None);
        assert!(!same.different() && same.notes.is_empty(), "{same:?}");
        assert_eq!(same.compared, 4 + 8);
    }

    #[test]
    fn the_last_digit_may_move_and_two_may_not() {
        assert!(!diff(|r| r.phases[1].measurements[0].value = Some(0.1244)).different());
        let moved = diff(|r| r.phases[1].measurements[0].value = Some(0.1264));
        assert_eq!((moved.changes[0].before.as_str(), moved.changes[0].after.as_str()), ("0.1234 bar", "0.1264 bar"));
    }

    #[test]
    fn a_tolerance_is_of_one_metric() {
        let (a, mut b) = (record(), record());
        b.phases[1].measurements[0].value = Some(0.1264);
        b.phases[1].measurements[2].value = Some(0.0412);
        let tolerances = Tolerances { by_metric: BTreeMap::from([("rmse".to_string(), 0.01)]) };
        let diff = compare("x", Some(&a), Some(&b), &tolerances);
        assert_eq!(diff.changes.iter().map(|c| c.figure.as_str()).collect::<Vec<_>>(), ["feedback_share.v1"]);
    }

    #[test]
    fn verdicts_come_first_and_a_moved_limit_is_told() {
        let diff = diff(|r| {
            r.phases[1].measurements[0].limit = Some(LimitRecord { max: Some(0.3), bound: "inclusive".into(), ..LimitRecord::default() });
            r.phases[1].measurements[1].outcome = Outcome::Fail;
            r.phases[1].measurements[1].value = Some(0.21);
        });
        assert!(diff.changes[0].verdict && !diff.changes[1].verdict);
        assert_eq!(diff.changes[1].figure, "limit of rmse.delayed.v1(delay=20 ms)");
        assert_eq!(diff.changes[1].before, "<= 0.200 bar, warns > 0.180 bar");
    }

    #[test]
    fn what_is_lost_is_a_difference() {
        assert!(diff(|r| r.phases[1].measurements[0].value = None).different());
        assert!(diff(|r| drop(r.phases[1].measurements.remove(0))).different());
        assert!(diff(|r| drop(r.phases.remove(2))).different());
        assert!(diff(|r| r.stability = None).different());
        assert!(compare("x", Some(&record()), None, &Tolerances::default()).different());
    }
}
