//! The batch as Markdown, for a pull request or a mail.

use std::fmt::Write as _;

use super::{index, limited, not_pooled, remarks, share, simulation_mark, tolerance, unsafe_mark};
use crate::batch::summary::BatchSummary;
use crate::report::format;
use crate::report::markdown::escape;

/// The batch as Markdown.
pub fn markdown(summary: &BatchSummary) -> String {
    let mut out = String::new();
    let b = &summary.batch;
    let _ = writeln!(out, "# Batch of {} on {}: {}\n", summary.valves.len(), b.plan, summary.outcome.text());
    if let Some(mark) = unsafe_mark(summary) {
        let _ = writeln!(out, "# \u{26a0} {}\n", escape(&mark));
    }
    if let Some(text) = not_pooled(summary) {
        let _ = writeln!(out, "> {}\n", escape(&text));
    }
    if let Some(mark) = simulation_mark(summary) {
        let _ = writeln!(out, "> {mark}\n");
    }
    let counts: Vec<String> = summary.counts.iter().map(|(outcome, n)| format!("{n} {outcome}")).collect();
    let _ = writeln!(out, "- Valves: {}", counts.join(", "));
    if summary.not_tested > 0 {
        let _ = writeln!(out, "- Not tested yet: {}", summary.not_tested);
    }
    let _ = writeln!(out, "- First-pass yield: {}", share(&summary.first_pass));
    let _ = writeln!(out, "- Final yield: {}", share(&summary.final_yield));
    let _ = writeln!(out, "- Decision rule: {}", b.decision_rule);
    let _ = writeln!(out, "- Plan: `{}`, SHA-256 `{}`", b.plan, b.plan_sha256);
    let _ = writeln!(out, "- Rig: {} {}, seed {}\n", b.rig.kind, b.rig.name, b.seed);
    out.push_str("| metric | limit | mean | deviation | Cpk | Ppk | remarks |\n|---|---|--:|--:|--:|--:|---|\n");
    for (_, m) in limited(summary) {
        let number = |v: Option<f64>| v.map_or_else(|| "-".into(), |v| format::number(v, &m.unit));
        let sample = m.sample.value.as_ref();
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} |",
            m.name,
            tolerance(&m.tolerance, &m.unit),
            number(sample.map(|s| s.mean)),
            number(sample.map(|s| s.deviation)),
            index(&m.capability.cpk),
            index(&m.capability.ppk),
            remarks(m).join("; ")
        );
    }
    if !summary.pareto.is_empty() {
        out.push_str("\n## Failures\n\n| cause | valves | cumulative |\n|---|--:|--:|\n");
        for bar in &summary.pareto {
            let _ = writeln!(out, "| {} | {} | {:.1} % |", bar.cause, bar.count, 100.0 * bar.cumulative);
        }
    }
    let named: Vec<_> = summary.valves.iter().filter(|v| v.reason.is_some()).collect();
    if !named.is_empty() {
        out.push_str("\n## Not passed\n\n| serial | outcome | attempts | reason |\n|---|---|---|---|\n");
        for v in named.iter().take(100) {
            let attempts: Vec<&str> = v.attempts.iter().map(|a| a.text()).collect();
            let _ = writeln!(
                out,
                "| {} | {} | {} | {} |",
                v.serial,
                v.outcome.text(),
                attempts.join(", "),
                v.reason.as_deref().unwrap_or("").replace('|', "\\|")
            );
        }
        if named.len() > 100 {
            let _ = writeln!(out, "\nand {} more.", named.len() - 100);
        }
    }
    out
}
