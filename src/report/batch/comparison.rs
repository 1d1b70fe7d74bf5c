//! Two batches side by side, as text and Markdown.

use std::fmt::Write as _;

use super::p_value;
use crate::batch::comparison::{Comparison, Movement};
use crate::report::{fold, format};

/// The comparison for a terminal: what moved first.
pub fn comparison_text(c: &Comparison) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "{}", verdict(c));
    let _ = writeln!(out, "{}", "=".repeat(80));
    for warning in &c.warnings {
        let _ = writeln!(out, "careful: {warning}");
    }
    let _ = writeln!(out, "final yield: {}", yields(c));
    let _ = writeln!(out, "{:<34} {:>10} {:>10}  change (95 % interval)", "metric", "mean A", "mean B");
    let _ = writeln!(out, "{}", "-".repeat(80));
    for m in ordered(c) {
        let names = fold(&m.name, 33);
        for name in &names[..names.len() - 1] {
            let _ = writeln!(out, "{name}");
        }
        let (a, b) = means(m);
        let _ = writeln!(out, "{:<34} {a:>10} {b:>10}  {}", names[names.len() - 1], change(m));
    }
    for name in &c.only_in_one {
        let _ = writeln!(out, "{name}: in one of the two batches only");
    }
    out
}

/// The comparison as Markdown.
pub fn comparison_markdown(c: &Comparison) -> String {
    let mut out = format!("# {}\n\n", verdict(c));
    for warning in &c.warnings {
        let _ = writeln!(out, "> Careful: {warning}\n");
    }
    let _ = writeln!(out, "Final yield: {}\n", yields(c));
    out.push_str("| metric | mean A | mean B | change (95 % interval) |\n|---|--:|--:|---|\n");
    for m in ordered(c) {
        let (a, b) = means(m);
        let _ = writeln!(out, "| {} | {a} | {b} | {} |", m.name, change(m));
    }
    for name in &c.only_in_one {
        let _ = writeln!(out, "\n{name}: in one of the two batches only");
    }
    out
}

fn verdict(c: &Comparison) -> &'static str {
    if c.moved { "The batches differ by more than noise" } else { "No difference beyond noise" }
}

fn yields(c: &Comparison) -> String {
    match &c.yields.value {
        Some(y) => {
            let share = |(passed, count): (usize, usize)| format!("{passed} of {count} ({:.1} %)", 100.0 * passed as f64 / count as f64);
            format!("{} and {} (Fisher p {})", share(y.first), share(y.second), p_value(y.p_value))
        }
        None => c.yields.absent.clone().unwrap_or_default(),
    }
}

fn ordered(c: &Comparison) -> Vec<&Movement> {
    let mut all: Vec<&Movement> = c.metrics.iter().collect();
    all.sort_by_key(|m| !m.change.value.as_ref().is_some_and(|c| c.significant));
    all
}

fn means(m: &Movement) -> (String, String) {
    m.means.map_or_else(|| ("-".into(), "-".into()), |(a, b)| (format::number(a, &m.unit), format::number(b, &m.unit)))
}

fn change(m: &Movement) -> String {
    match &m.change.value {
        Some(c) => {
            let number = |v| format::number(v, &m.unit);
            let mark = if c.significant { "MOVED " } else { "" };
            format!("{mark}{} ({} to {})", format::quantity(c.difference, &m.unit), number(c.interval.low), number(c.interval.high))
        }
        None => m.change.absent.clone().unwrap_or_default(),
    }
}
