//! The report for a pull request: the verdict, a table per phase, the margins.

use std::fmt::Write as _;

use super::format;
use crate::record::{Measurement, Outcome, TestRecord};

/// The record as Markdown.
pub fn markdown(record: &TestRecord) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "# {} on {}: {}\n", escape(&record.plan.name), escape(&record.dut.serial), bold(record.outcome));
    if record.ended_unsafe() {
        let _ = writeln!(out, "# \u{26a0} {}\n", format::UNSAFE);
    }
    if let Some(mark) = format::simulation_mark(record) {
        let _ = writeln!(out, "> **{mark}.**\n");
    }
    for reason in &record.reasons {
        let _ = writeln!(out, "- {}", escape(reason));
    }
    if !record.reasons.is_empty() {
        out.push('\n');
    }
    let _ =
        writeln!(out, "Limits: {}. Rig: {} `{}`, seed {}.", format::tally(record), record.rig.kind, code(&record.rig.name), record.seed);
    if !record.plan.parameters.is_empty() {
        let list: Vec<String> = record
            .plan
            .parameters
            .iter()
            .map(|(key, value)| {
                let by_hand = if record.plan.overridden.contains(key) { " (set by hand)" } else { "" };
                format!("`{} = {}`{by_hand}", code(key), code(value))
            })
            .collect();
        let _ = writeln!(out, "Parameters: {}.", list.join(", "));
    }
    out.push_str("\n| phase | measurement | value | limit | verdict |\n|---|---|---:|---|---|\n");
    for phase in &record.phases {
        let role = if phase.role == "main" { String::new() } else { format!(" ({})", phase.role) };
        let said = format::asked(phase).into_iter().chain(phase.reason.clone());
        let why: String = said.map(|r| format!("<br>{}", escape(&r))).collect();
        let phase_verdict = match format::phase_verdict(phase) {
            verdict @ ("PASS" | "no limit") => verdict.to_string(),
            verdict => format!("**{}**", verdict.replace('_', " ")),
        };
        let _ = writeln!(out, "| **{}**{role} | {} | | | {}{why} |", escape(&phase.name), format::span(phase), phase_verdict);
        for measurement in &phase.measurements {
            let _ = writeln!(out, "{}", row(measurement));
        }
    }
    if let Some(stability) = &record.stability {
        let gains = format::gains(stability).map_or_else(String::new, |(kp, ki)| {
            format!(" at K_P {}, K_I {}", format::quantity(kp, "mA/bar"), format::quantity(ki, "mA/(bar s)"))
        });
        let _ = writeln!(out, "\n## Stability of the loop{gains}: {}\n", format::stable(stability));
        out.push_str("| margin | value | |\n|---|---:|---|\n");
        for margin in format::margins(stability) {
            let _ = writeln!(out, "| {} | {} | {} |", margin.name, margin.print(), margin.remark);
        }
    }
    out.push_str("\n## Timing\n\n");
    for (name, value) in format::timing(record) {
        let _ = writeln!(out, "- {name}: {value}");
    }
    if let Some(safe) = &record.safe_state {
        let state = if safe.confirmed { "confirmed" } else { "**not confirmed**" };
        let _ = writeln!(out, "- safe state {state}: {}", escape(&safe.evidence));
    }
    out
}

fn row(measurement: &Measurement) -> String {
    let warning = format::warning(measurement);
    let warning = if warning.is_empty() { warning } else { format!(" (warns {warning})") };
    let why = measurement.reason.as_ref().map_or_else(String::new, |r| format!("<br>{}", escape(r)));
    let verdict = match measurement.outcome {
        Outcome::Pass | Outcome::NotRun => format::verdict(measurement).to_string(),
        other => bold(other),
    };
    let limit = escape(&format!("{}{warning}", format::limit(measurement)));
    format!("| | `{}` | {} | {limit} | {verdict}{why} |", code(&format::definition(measurement)), format::value(measurement))
}

fn bold(outcome: Outcome) -> String {
    format!("**{}**", outcome.text().replace('_', " "))
}

/// Text from outside in a table cell: no markup, no second column.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\n' | '\r' => out.push(' '),
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '|' | '*' | '_' | '`' | '[' | ']' | '\\' => {
                out.push('\\');
                out.push(c);
            }
            _ => out.push(c),
        }
    }
    out
}

/// Text from outside between backticks.
pub(super) fn code(text: &str) -> String {
    text.replace('`', "'").replace('|', "\\|").replace(['\n', '\r'], " ")
}
