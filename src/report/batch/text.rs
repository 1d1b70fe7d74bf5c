//! The batch for a terminal, in 80 columns.

use std::fmt::Write as _;

use super::{absent, index, limited, not_pooled, overridden, remarks, share, simulation_mark, tolerance, unsafe_mark};
use crate::batch::summary::BatchSummary;
use crate::report::{COLUMNS, fold, format};

/// Valves that are named when they did not pass; the others are in the files.
const NAMED: usize = 20;

/// The batch as text.
pub fn text(summary: &BatchSummary) -> String {
    let mut out = String::new();
    let verdict = summary.outcome.text();
    let title = format!("batch of {} on {}", summary.valves.len(), summary.batch.plan);
    let width = COLUMNS - verdict.len() - 1;
    let _ = writeln!(out, "{:<width$} {verdict}", title.chars().take(width).collect::<String>());
    rule(&mut out, '=');
    if let Some(mark) = unsafe_mark(summary) {
        rule(&mut out, '#');
        wrapped(&mut out, "###   ", &mark);
        rule(&mut out, '#');
    }
    if let Some(mark) = simulation_mark(summary) {
        wrapped(&mut out, "", mark);
    }
    if let Some(text) = not_pooled(summary) {
        wrapped(&mut out, "not pooled   ", &text);
    }
    wrapped(&mut out, "plan         ", &format!("{} (sha256 {})", summary.batch.plan, short(&summary.batch.plan_sha256)));
    wrapped(&mut out, "rig          ", &format!("{} {}", summary.batch.rig.kind, summary.batch.rig.name));
    wrapped(&mut out, "decision     ", &summary.batch.decision_rule);
    if let Some(text) = overridden(summary) {
        wrapped(&mut out, "careful      ", &text);
    }
    let counts: Vec<String> = summary.counts.iter().map(|(outcome, n)| format!("{n} {outcome}")).collect();
    wrapped(&mut out, "valves       ", &counts.join(", "));
    if summary.not_tested > 0 {
        wrapped(&mut out, "             ", &format!("{} not tested yet", summary.not_tested));
    }
    wrapped(&mut out, "first pass   ", &share(&summary.first_pass));
    wrapped(&mut out, "final yield  ", &share(&summary.final_yield));
    for d in &summary.damage {
        wrapped(&mut out, "journal      ", &d.text());
    }
    out.push('\n');
    let _ = writeln!(out, "{:<31} {:>9} {:>9}  {:<27}", "metric with a limit", "mean", "deviation", "Ppk (95 % interval)");
    rule(&mut out, '-');
    for (_, m) in limited(summary) {
        metric(&mut out, m);
    }
    pareto(&mut out, summary);
    let named: Vec<_> = summary.valves.iter().filter(|v| v.reason.is_some()).collect();
    if !named.is_empty() {
        out.push_str("\nnot passed\n");
        rule(&mut out, '-');
        for v in named.iter().take(NAMED) {
            let lead = format!("  {:<20} {:<9} ", v.serial, v.outcome.text());
            wrapped(&mut out, &lead, v.reason.as_deref().unwrap_or(""));
        }
        if named.len() > NAMED {
            let _ = writeln!(out, "  and {} more: see the page or the CSV", named.len() - NAMED);
        }
    }
    if !summary.outlier_valves.is_empty() {
        out.push_str("\noutliers\n");
        rule(&mut out, '-');
        for (serial, metrics) in summary.outlier_valves.iter().take(NAMED) {
            wrapped(&mut out, &format!("  {serial:<20} "), &metrics.join(", "));
        }
    }
    out
}

fn metric(out: &mut String, m: &crate::batch::statistics::MetricStatistics) {
    let name = fold(&m.name, 31);
    let last = name.len() - 1;
    for line in &name[..last] {
        let _ = writeln!(out, "{line}");
    }
    match &m.sample.value {
        Some(s) => {
            let number = |v| format::number(v, &m.unit);
            let _ = writeln!(out, "{:<31} {:>9} {:>9}  {:<27}", name[last], number(s.mean), number(s.deviation), index(&m.capability.ppk));
        }
        None => {
            let _ = writeln!(out, "{:<31} {}", name[last], absent(&m.sample));
        }
    }
    wrapped(out, "    limit ", &tolerance(&m.tolerance, &m.unit));
    if let Some(reason) = &m.capability.ppk.absent {
        wrapped(out, "    no Ppk: ", reason);
    }
    for remark in remarks(m) {
        wrapped(out, "    ", &remark);
    }
}

fn pareto(out: &mut String, summary: &BatchSummary) {
    if summary.pareto.is_empty() {
        return;
    }
    out.push_str("\nfailures\n");
    rule(out, '-');
    for bar in summary.pareto.iter().take(10) {
        let _ = writeln!(out, "  {:<50} {:>7}  {:>5.1} %", bar.cause, bar.count, 100.0 * bar.cumulative);
    }
}

fn short(sha256: &str) -> &str {
    sha256.get(..12).unwrap_or(sha256)
}

fn rule(out: &mut String, sign: char) {
    out.extend(std::iter::repeat_n(sign, COLUMNS));
    out.push('\n');
}

fn wrapped(out: &mut String, lead: &str, text: &str) {
    let indent = lead.chars().count();
    for (n, line) in fold(text, COLUMNS.saturating_sub(indent)).iter().enumerate() {
        let lead = if n == 0 { lead.to_string() } else { " ".repeat(indent) };
        let _ = writeln!(out, "{}", format!("{lead}{line}").trim_end());
    }
}
