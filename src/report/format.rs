//! The words that all reports share: a figure with its unit, a limit, a verdict, the margins of stability.

use serde_json::Value;

use crate::record::{LimitRecord, Measurement, Origin, Outcome, PhaseRecord, TestRecord};
use crate::units::Unit;

/// The verdict of a run in the word that fits: one that ran and has no limit is done, and judged by nothing.
pub fn run_verdict(record: &TestRecord) -> &'static str {
    let ran = record.phases.iter().any(|p| p.span_s.is_some());
    if record.outcome == Outcome::NotRun && ran { "DONE" } else { record.outcome.text() }
}

/// Verdict of a measurement; one without a limit was measured, but judged by nothing.
pub fn verdict(measurement: &Measurement) -> &'static str {
    match measurement.limit {
        None if measurement.outcome == Outcome::NotRun => "no limit",
        _ => measurement.outcome.text(),
    }
}

/// Verdict of a phase; one that ran without a limit is judged by nothing.
pub fn phase_verdict(phase: &PhaseRecord) -> &'static str {
    if phase.outcome == Outcome::NotRun && phase.span_s.is_some() { "no limit" } else { phase.outcome.text() }
}

/// A number in the fixed digits of `unit`, without the unit.
pub fn number(value: f64, unit: &str) -> String {
    let whole = unit == "1" && value == value.trunc();
    let decimals = if whole { 0 } else { Unit::by_symbol(unit).map_or(4, |u| u.decimals) };
    let text = format!("{value:.decimals$}");
    // A rounded -0.000 and 0.000 are the same figure.
    if text.starts_with('-') && text[1..].bytes().all(|b| b == b'0' || b == b'.') { text[1..].into() } else { text }
}

/// A number with its unit.
pub fn quantity(value: f64, unit: &str) -> String {
    if unit == "1" { number(value, unit) } else { format!("{} {unit}", number(value, unit)) }
}

/// A number with all the digits that it has, and at least the fixed ones of `unit`: a limit as it was typed, a value with the
/// digits that its verdict needs.
pub fn exact(value: f64, unit: &str) -> String {
    let fixed = number(value, unit);
    // Nine digits carry every typed number; what is beyond is dust of the binary form.
    let typed: f64 = format!("{value:.9}").parse().unwrap_or(value);
    if fixed.parse() == Ok(typed) { fixed } else { format!("{typed}") }
}

/// The measured value, or a dash.
pub fn value(measurement: &Measurement) -> String {
    let unit = if measurement.unit == "1" { String::new() } else { format!(" {}", measurement.unit) };
    measurement.value.map_or_else(|| "-".into(), |v| exact(v, &measurement.unit) + &unit)
}

/// The limit with its unit: `<= 0.200 bar`, `0.100 .. 0.200 bar`; empty where there is none.
pub fn limit(measurement: &Measurement) -> String {
    let Some(limit) = &measurement.limit else { return String::new() };
    let unit = if measurement.unit == "1" { String::new() } else { format!(" {}", measurement.unit) };
    let print = |v: f64| exact(v, &measurement.unit);
    let equal = if limit.bound == "exclusive" { "" } else { "=" };
    match (limit.min, limit.max) {
        (Some(min), Some(max)) => format!("{} .. {}{unit}", print(min), print(max)),
        (None, Some(max)) => format!("<{equal} {}{unit}", print(max)),
        (Some(min), None) => format!(">{equal} {}{unit}", print(min)),
        (None, None) => String::new(),
    }
}

/// The edge of the warning band: `> 0.180 bar`; empty where there is none.
pub fn warning(measurement: &Measurement) -> String {
    let Some(LimitRecord { marginal_min, marginal_max, .. }) = measurement.limit else { return String::new() };
    let edges = [marginal_min.map(|v| ("<", v)), marginal_max.map(|v| (">", v))];
    let texts: Vec<String> = edges.into_iter().flatten().map(|(sign, v)| format!("{sign} {}", quantity(v, &measurement.unit))).collect();
    texts.join(", ")
}

/// The definition, which begins with the id of the metric.
pub fn definition(measurement: &Measurement) -> String {
    let id = measurement.metric.as_str();
    if measurement.definition.starts_with(id) { measurement.definition.clone() } else { format!("{id}: {}", measurement.definition) }
}

/// What a person was asked in a phase, and answered.
pub fn asked(phase: &PhaseRecord) -> Option<String> {
    let prompt = phase.prompt.as_ref()?;
    let answer = match (&prompt.answer, &prompt.by) {
        (Some(answer), Some(by)) => format!("answered \u{201c}{answer}\u{201d} ({by})"),
        (Some(answer), None) => format!("answered \u{201c}{answer}\u{201d}"),
        (None, _) => "not answered".into(),
    };
    Some(format!("asked \u{201c}{}\u{201d}, {answer}", prompt.text))
}

/// From when to when a phase ran.
pub fn span(phase: &PhaseRecord) -> String {
    phase.span_s.map_or_else(|| "did not run".into(), |(from, to)| format!("{from:.3} .. {to:.3} s"))
}

/// How often each verdict fell among the measurements that have a limit, in the order of severity.
pub fn tally(record: &TestRecord) -> String {
    let judged = record.phases.iter().flat_map(|p| &p.measurements).filter(|m| m.limit.is_some());
    let mut counts: Vec<(Outcome, usize)> = Vec::new();
    for measurement in judged {
        match counts.iter_mut().find(|c| c.0 == measurement.outcome) {
            Some(count) => count.1 += 1,
            None => counts.push((measurement.outcome, 1)),
        }
    }
    counts.sort_unstable();
    let texts: Vec<String> = counts.iter().map(|(o, n)| format!("{n} {}", o.text())).collect();
    if texts.is_empty() { "no measurement has a limit".into() } else { texts.join(", ") }
}

/// Simulated and emulated records say so wherever their verdict is shown.
pub fn simulation_mark(record: &TestRecord) -> Option<&'static str> {
    match record.origin() {
        Origin::Simulated => Some("SIMULATION - the pressures come from a model, not from a valve"),
        Origin::Emulated => Some("EMULATED - an emulator stands for driver and valve: this says nothing of a real one"),
        Origin::Real => None,
    }
}

/// One word for what a record came from, where it was no valve.
pub fn origin_badge(origin: Origin) -> Option<&'static str> {
    match origin {
        Origin::Simulated => Some("SIMULATION"),
        Origin::Emulated => Some("EMULATED"),
        Origin::Real => None,
    }
}

/// What stands above everything else where nobody saw the current go.
pub const UNSAFE: &str = "SAFE STATE NOT CONFIRMED - REMOVE POWER";

/// One figure of the stability of the loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Margin {
    /// Name of the figure.
    pub name: &'static str,
    /// The figure in `unit`; `None` where it does not exist.
    pub value: Option<f64>,
    /// Unit of the value.
    pub unit: &'static str,
    /// Where it was found, or over what.
    pub remark: String,
}

impl Margin {
    /// The figure with its unit, or a dash.
    pub fn print(&self) -> String {
        self.value.map_or_else(|| "-".into(), |v| quantity(v, self.unit))
    }
}

/// The margins of the record, in the order in which they are read.
pub fn margins(stability: &Value) -> Vec<Margin> {
    let get = |at: &str| stability.pointer(at).and_then(Value::as_f64);
    let at = |place: &str| get(place).map_or_else(String::new, |v| format!("at {}", quantity(v, "rad/s")));
    let mut margins = Vec::new();
    let mut add = |name, at: &str, unit, remark: String| margins.push(Margin { name, value: get(at), unit, remark });
    add("gain margin", "/gain_margin_db", "dB", at("/phase_crossover_rad_s"));
    add("phase margin", "/phase_margin_deg", "deg", at("/gain_crossover_rad_s"));
    add("delay margin", "/delay_margin_s", "s", String::new());
    add("maximum sensitivity", "/max_sensitivity", "1", String::new());
    add("K_P limit (Routh, Pade)", "/routh/kp_max_ma_per_bar", "mA/bar", String::new());
    add("K_I limit (Routh, Pade)", "/routh/ki_max_ma_per_bar_s", "mA/(bar s)", String::new());
    let there = |at: &str| stability.pointer(at).is_some_and(|v| !v.is_null());
    if there("/sampled") {
        let rate = get("/sampled/rate_hz").map_or_else(String::new, |v| format!("sampled at {}", quantity(v, "Hz")));
        add("gain margin, sampled", "/sampled/gain_margin_db", "dB", rate.clone());
        add("phase margin, sampled", "/sampled/phase_margin_deg", "deg", rate);
    }
    if there("/worst_over_delay_range") {
        let remark = "worst over delay range".to_string();
        add("gain margin, worst", "/worst_over_delay_range/gain_margin_db", "dB", remark.clone());
        add("phase margin, worst", "/worst_over_delay_range/phase_margin_deg", "deg", remark.clone());
        add("delay margin, worst", "/worst_over_delay_range/delay_margin_s", "s", remark.clone());
        add("max. sensitivity, worst", "/worst_over_delay_range/max_sensitivity", "1", remark.clone());
        add("gain margin, sampled, worst", "/worst_over_delay_range/sampled/gain_margin_db", "dB", remark.clone());
        add("phase margin, sampled, worst", "/worst_over_delay_range/sampled/phase_margin_deg", "deg", remark);
    }
    margins
}

/// Whether the loop is stable, in words, and without which effects it was judged.
pub fn stable(stability: &Value) -> String {
    let Some(stable) = stability.get("stable").and_then(Value::as_bool) else { return "not judged".into() };
    let left_out = stability.pointer("/loop/left_out").and_then(Value::as_array).into_iter().flatten();
    let without: Vec<&str> = left_out.filter_map(Value::as_str).collect();
    let judged = if without.is_empty() { String::new() } else { format!(" (judged without {})", without.join(", ")) };
    format!("{}{judged}", if stable { "stable" } else { "UNSTABLE" })
}

/// The gains that the margins are for.
pub fn gains(stability: &Value) -> Option<(f64, f64)> {
    let get = |at: &str| stability.pointer(at).and_then(Value::as_f64);
    Some((get("/loop/kp_ma_per_bar")?, get("/loop/ki_ma_per_bar_s")?))
}

/// The evidence of the run's timing: name and text.
pub fn timing(record: &TestRecord) -> Vec<(&'static str, String)> {
    let timing = &record.timing;
    let micros = |v: Option<f64>| v.map_or_else(|| "-".into(), |v| format!("{:.1} us", v * 1e6));
    let mut lines = vec![("period", format!("{:.3} ms", timing.period_s * 1e3)), ("samples", timing.samples.to_string())];
    if record.simulated && timing.lateness_max_s.is_none() {
        lines.push(("lateness", "none: a simulation has no clock".into()));
    } else {
        let (p50, p99, max) = (micros(timing.lateness_p50_s), micros(timing.lateness_p99_s), micros(timing.lateness_max_s));
        lines.push(("lateness", format!("median {p50}, 99 % {p99}, max {max}")));
    }
    if let Some((p50, p99, max)) = timing.round_trip_s {
        lines.push(("round trip", format!("median {}, 99 % {}, max {}", micros(Some(p50)), micros(Some(p99)), micros(Some(max)))));
    }
    let counts = (timing.missed_slots, timing.lost_samples, timing.stale_samples);
    lines.push(("missed, lost, stale", format!("{} slots, {} samples, {} samples", counts.0, counts.1, counts.2)));
    lines
}
