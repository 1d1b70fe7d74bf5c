//! The report for a terminal: 80 columns, plain text, the same bytes everywhere.

use std::fmt::Write as _;

use super::format;
use crate::record::{Measurement, PhaseRecord, TestRecord};

/// Width that every line fits in.
pub const COLUMNS: usize = 80;

/// The record as text.
pub fn text(record: &TestRecord) -> String {
    let mut out = String::new();
    heading(&mut out, record);
    out.push('\n');
    let _ = writeln!(out, "{:<35} {:>13}  {:<19} verdict", "measurement", "value", "limit");
    rule(&mut out, '-');
    for phase in &record.phases {
        phase_lines(&mut out, phase);
    }
    if let Some(stability) = &record.stability {
        out.push('\n');
        let gains = format::gains(stability).map_or_else(String::new, |(kp, ki)| {
            format!(" at K_P {}, K_I {}", format::quantity(kp, "mA/bar"), format::quantity(ki, "mA/(bar s)"))
        });
        wrapped(&mut out, "", &format!("stability of the loop{gains}: {}", format::stable(stability)));
        rule(&mut out, '-');
        for margin in format::margins(stability) {
            let _ = writeln!(out, "{}", format!("  {:<28} {:>22}  {}", margin.name, margin.print(), margin.remark).trim_end());
        }
    }
    out.push_str("\ntiming\n");
    rule(&mut out, '-');
    for (name, value) in format::timing(record) {
        wrapped(&mut out, &format!("  {name:<20} "), &value);
    }
    if let Some(safe) = &record.safe_state {
        let state = if safe.confirmed { "confirmed" } else { "NOT CONFIRMED" };
        wrapped(&mut out, "  safe state           ", &format!("{state}: {}", safe.evidence));
    }
    out
}

fn heading(out: &mut String, record: &TestRecord) {
    let verdict = format::run_verdict(record);
    let title = format!("{} on {}", record.plan.name, record.dut.serial);
    let width = COLUMNS.saturating_sub(verdict.len() + 1);
    let title: String = title.chars().take(width).collect();
    let _ = writeln!(out, "{title:<width$} {verdict}");
    rule(out, '=');
    if record.ended_unsafe() {
        rule(out, '#');
        let _ = writeln!(out, "###   {}   ###", format::UNSAFE);
        rule(out, '#');
    }
    if let Some(mark) = format::simulation_mark(record) {
        wrapped(out, "", mark);
    }
    for reason in &record.reasons {
        wrapped(out, "because    ", reason);
    }
    wrapped(out, "plan       ", &format!("{} (sha256 {})", record.plan.name, short(&record.plan.sha256)));
    let dut = &record.dut;
    let facts = [("part", &dut.part_number), ("revision", &dut.revision), ("lot", &dut.lot)];
    let facts: String = facts.iter().filter_map(|(n, v)| v.as_ref().map(|v| format!(", {n} {v}"))).collect();
    wrapped(out, "valve      ", &format!("{}{facts}", dut.serial));
    wrapped(out, "rig        ", &format!("{} {} (sha256 {})", record.rig.kind, record.rig.name, short(&record.rig.sha256)));
    for (name, value) in &record.rig.details {
        wrapped(out, "           ", &format!("{name}: {value}"));
    }
    wrapped(out, "seed       ", &record.seed.to_string());
    let parameters: Vec<String> = record
        .plan
        .parameters
        .iter()
        .map(|(key, value)| {
            let star = if record.plan.overridden.contains(key) { " (set by hand)" } else { "" };
            format!("{key} = {value}{star}")
        })
        .collect();
    if !parameters.is_empty() {
        wrapped(out, "parameters ", &parameters.join(", "));
    }
    wrapped(out, "limits     ", &format::tally(record));
}

fn phase_lines(out: &mut String, phase: &PhaseRecord) {
    let role = if phase.role == "main" { String::new() } else { format!(" ({})", phase.role) };
    let name = format!("{}{role}, {}", phase.name, format::span(phase));
    let name = fold(&name, 70);
    for (n, line) in name.iter().enumerate() {
        let verdict = if n == 0 { format::phase_verdict(phase) } else { "" };
        let _ = writeln!(out, "{}", format!("{line:<70} {verdict}").trim_end());
    }
    if let Some(asked) = format::asked(phase) {
        wrapped(out, "  ", &asked);
    }
    if let Some(reason) = &phase.reason {
        wrapped(out, "  because ", reason);
    }
    for measurement in &phase.measurements {
        measurement_lines(out, measurement);
    }
}

fn measurement_lines(out: &mut String, measurement: &Measurement) {
    let mut name = fold(&format::definition(measurement), 33);
    let (value, limit, verdict) = (format::value(measurement), format::limit(measurement), format::verdict(measurement));
    // Figures that are too long for their columns get lines of their own.
    let fits = value.len() <= 13 && limit.len() <= 19;
    let last = if fits { name.pop().unwrap_or_default() } else { String::new() };
    for line in name {
        let _ = writeln!(out, "  {line}");
    }
    if fits {
        let _ = writeln!(out, "{}", format!("  {last:<33} {value:>13}  {limit:<19} {verdict}").trim_end());
    } else {
        let _ = writeln!(out, "{value:>49}{:22}{verdict}", "");
        wrapped(out, "      limit ", &limit);
    }
    let warning = format::warning(measurement);
    if !warning.is_empty() {
        wrapped(out, &" ".repeat(51), &format!("warns {warning}"));
    }
    if let Some(reason) = &measurement.reason {
        wrapped(out, "      ", reason);
    }
}

/// The first digits of a hash, enough to tell two files apart by eye.
pub(super) fn short(sha256: &str) -> &str {
    sha256.get(..12).unwrap_or(sha256)
}

fn rule(out: &mut String, sign: char) {
    out.extend(std::iter::repeat_n(sign, COLUMNS));
    out.push('\n');
}

/// `text` after `lead`, broken at blanks; later lines are indented by the width of `lead`.
fn wrapped(out: &mut String, lead: &str, text: &str) {
    let indent = lead.chars().count();
    for (n, line) in fold(text, COLUMNS - indent).iter().enumerate() {
        let lead = if n == 0 { lead.to_string() } else { " ".repeat(indent) };
        let _ = writeln!(out, "{}", format!("{lead}{line}").trim_end());
    }
}

/// Breaks `text` into lines of at most `width` characters, at blanks where it can; never empty.
pub fn fold(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let mut word: Vec<char> = word.chars().collect();
        loop {
            let last = lines.len() - 1;
            let used = lines[last].chars().count();
            let room = width.saturating_sub(if used == 0 { 0 } else { used + 1 });
            if word.len() <= room {
                if used > 0 {
                    lines[last].push(' ');
                }
                lines[last].extend(word.iter());
                break;
            }
            if used == 0 {
                let rest = word.split_off(width.max(1).min(word.len()));
                lines[last].extend(word.iter());
                word = rest;
            }
            lines.push(String::new());
        }
    }
    lines
}
