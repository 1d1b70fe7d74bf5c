//! The differences as text (80 columns), Markdown and JSON.

use std::fmt::Write as _;

use super::{Change, RecordDiff, different};
use crate::record::Outcome;
use crate::report::{COLUMNS, fold, markdown as md};

fn outcome(outcome: Option<Outcome>) -> &'static str {
    outcome.map_or("no record", Outcome::text)
}

fn verdicts(diff: &RecordDiff) -> String {
    if diff.before == diff.after { outcome(diff.before).into() } else { format!("{} -> {}", outcome(diff.before), outcome(diff.after)) }
}

/// Records whose verdict changed, then the other different ones, then the equal ones.
fn ordered(diffs: &[RecordDiff]) -> Vec<&RecordDiff> {
    let mut ordered: Vec<&RecordDiff> = diffs.iter().collect();
    ordered.sort_by_key(|d| (d.before == d.after, !d.different()));
    ordered
}

fn summary(diffs: &[RecordDiff]) -> String {
    let count = |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    let counts = Counts::of(diffs);
    let mut text = format!(
        "{}, {} compared: {} beyond tolerance in {}, {} with another verdict",
        count(diffs.len(), "record", "records"),
        count(counts.compared, "figure", "figures"),
        count(counts.figures, "figure differs", "figures differ"),
        count(counts.records, "record", "records"),
        count(counts.verdicts, "record", "records"),
    );
    if counts.figures == 0 && counts.records == 0 {
        text = format!(
            "{}, {} compared: nothing differs beyond tolerance",
            count(diffs.len(), "record", "records"),
            count(counts.compared, "figure", "figures")
        );
    }
    text
}

/// How much differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
struct Counts {
    /// Figures that were compared.
    compared: usize,
    /// Figures, limits and verdicts of phases that differ.
    figures: usize,
    /// Records in which anything differs.
    records: usize,
    /// Records whose verdict differs.
    verdicts: usize,
}

impl Counts {
    fn of(diffs: &[RecordDiff]) -> Self {
        Self {
            compared: diffs.iter().map(|d| d.compared).sum(),
            figures: diffs.iter().map(|d| d.changes.iter().filter(|c| c.figure != "verdict").count()).sum(),
            records: diffs.iter().filter(|d| d.different()).count(),
            verdicts: diffs.iter().filter(|d| d.before != d.after).count(),
        }
    }
}

/// What moved first, in the order in which the plan ran: what comes after may follow from it.
fn first(diff: &RecordDiff) -> Option<String> {
    let change = diff.first.and_then(|at| diff.changes.get(at))?;
    Some(format!("first to move: {}: {}, {} -> {}", change.phase, change.figure, change.before, change.after))
}

/// The differences for a terminal.
pub fn text(diffs: &[RecordDiff]) -> String {
    let mut out = format!("{}\n", summary(diffs));
    for diff in ordered(diffs) {
        let state = if diff.different() { verdicts(diff) } else { format!("{}, no difference", verdicts(diff)) };
        for line in fold(&format!("{}: {state}", diff.name), COLUMNS) {
            let _ = writeln!(out, "{line}");
        }
        if diff.changes.len() > 1 {
            for line in first(diff).iter().flat_map(|text| fold(text, COLUMNS - 2)) {
                let _ = writeln!(out, "  {line}");
            }
        }
        for change in &diff.changes {
            for (n, line) in fold(&format!("{}: {}", change.phase, change.figure), COLUMNS - 4).iter().enumerate() {
                let _ = writeln!(out, "{} {line}", if n == 0 { if change.verdict { "  !" } else { "  *" } } else { "   " });
            }
            for line in fold(&format!("{} -> {}{}", change.before, change.after, delta(change)), COLUMNS - 6) {
                let _ = writeln!(out, "      {line}");
            }
        }
        if diff.different() {
            for note in &diff.notes {
                for line in fold(&format!("input changed: {note}"), COLUMNS - 4) {
                    let _ = writeln!(out, "    {line}");
                }
            }
        }
    }
    out
}

fn delta(change: &Change) -> String {
    match (change.delta, change.tolerance) {
        (Some(delta), Some(tolerance)) => format!(" ({delta:+.4}, allowed {tolerance})"),
        _ => String::new(),
    }
}

/// The differences for a pull request.
pub fn markdown(diffs: &[RecordDiff]) -> String {
    let title = if different(diffs) { "Reports differ" } else { "Reports agree" };
    let mut out = format!("## {title}\n\n{}.\n", summary(diffs));
    for diff in ordered(diffs).into_iter().filter(|d| d.different()) {
        let _ = writeln!(out, "\n### {}: {}\n", md::escape(&diff.name), verdicts(diff));
        if let Some(text) = first(diff).filter(|_| diff.changes.len() > 1) {
            let _ = writeln!(out, "{}.\n", md::escape(&text));
        }
        if !diff.changes.is_empty() {
            out.push_str("| phase | figure | before | after | change |\n|---|---|---:|---:|---:|\n");
        }
        for change in &diff.changes {
            let bold = if change.verdict { "**" } else { "" };
            let delta = change.delta.map_or_else(String::new, |d| format!("{d:+.4}"));
            let (before, after) = (md::escape(&change.before), md::escape(&change.after));
            let _ = writeln!(
                out,
                "| {} | `{}` | {before} | {bold}{after}{bold} | {delta} |",
                md::escape(&change.phase),
                md::code(&change.figure)
            );
        }
        for (n, note) in diff.notes.iter().enumerate() {
            let _ = writeln!(out, "{}- input changed: {}", if n == 0 { "\n" } else { "" }, md::escape(note));
        }
    }
    let equal: Vec<String> = diffs.iter().filter(|d| !d.different()).map(|d| md::escape(&d.name)).collect();
    if !equal.is_empty() {
        let _ = writeln!(out, "\nWithout a difference: {}.", equal.join(", "));
    }
    out
}

/// The differences as a JSON document (`schema = "hil.diff/1"`).
pub fn json(diffs: &[RecordDiff]) -> String {
    let value = serde_json::json!({ "schema": "hil.diff/1", "different": different(diffs), "counts": Counts::of(diffs), "records": ordered(diffs) });
    format!("{value:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::diff::{Tolerances, compare};
    use crate::report::tests::record;

    fn diffs() -> Vec<RecordDiff> {
        let (a, mut b) = (record(), record());
        b.outcome = Outcome::Error;
        b.seed = 8;
        b.phases[1].measurements[0].value = Some(0.1764);
        b.phases[1].measurements[1].outcome = Outcome::Fail;
        b.phases[1].measurements[1].value = Some(0.21);
        let none = Tolerances::default();
        vec![
            compare("equal", Some(&a), Some(&a), &none),
            compare("tip-in", Some(&a), Some(&b), &none),
            compare("new", None, Some(&a), &none),
        ]
    }

    #[test]
    fn text_names_verdicts_first() {
        insta::assert_snapshot!(text(&diffs()));
    }

    #[test]
    fn markdown_names_verdicts_first() {
        insta::assert_snapshot!(markdown(&diffs()));
    }

    #[test]
    fn json_says_whether_anything_differs() {
        let value: serde_json::Value = serde_json::from_str(&json(&diffs())).unwrap();
        assert_eq!(value["different"], true);
        assert_eq!(value["records"][2]["name"], "equal");
        assert!(json(&diffs()[..1]).contains("\"different\": false"));
    }
}
