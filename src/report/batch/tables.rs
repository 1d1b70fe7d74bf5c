//! The tables of the batch page: capability, valves, traceability.

use maud::{Markup, PreEscaped, html};

use super::{absent, index_reasons, limited, p_value, remarks, tolerance};
use crate::batch::statistics::{Finding, Index, MetricStatistics};
use crate::batch::summary::{BatchSummary, ValveRow};
use crate::record::Outcome;
use crate::report::format;

/// Columns of measured values in the table of valves at most; the rest is in the CSV.
const VALUE_COLUMNS: usize = 24;

/// Statistics of every metric; those with a limit first.
pub fn statistics(summary: &BatchSummary) -> Markup {
    let with: Vec<&MetricStatistics> = limited(summary).map(|l| l.1).collect();
    let without: Vec<&MetricStatistics> =
        summary.metrics.iter().filter(|m| m.tolerance.min.is_none() && m.tolerance.max.is_none()).collect();
    html! {
        (statistics_table(&with))
        @if !without.is_empty() {
            details { summary { (without.len()) " metrics without a limit" } (statistics_table(&without)) }
        }
    }
}

fn statistics_table(metrics: &[&MetricStatistics]) -> Markup {
    html! {
        .card.scroll {
            table.wide.sortable {
                thead { tr { th { "metric" } th { "limit" } th.num { "n" } th.num { "mean" } th.num { "deviation" } th.num { "min" } th.num { "max" } th.num { "Cp" } th.num { "Cpk" } th.num { "Pp" } th.num { "Ppk" } th.num { "normality" } } }
                tbody {
                    @for m in metrics {
                        tr {
                            td { (m.name) @for text in remarks(m) { .why { (text) } } @if m.tolerance.min.is_some() || m.tolerance.max.is_some() { @for text in index_reasons(m) { .why { "no " (text) } } } }
                            td.limit { (tolerance(&m.tolerance, &m.unit)) }
                            @match &m.sample.value {
                                Some(s) => {
                                    td.num { (s.count) } td.num { (format::quantity(s.mean, &m.unit)) } td.num { (format::number(s.deviation, &m.unit)) }
                                    td.num { (format::number(s.min, &m.unit)) } td.num { (format::number(s.max, &m.unit)) }
                                }
                                None => { td colspan="5" { span.why { (absent(&m.sample)) } } }
                            }
                            td.num { (index_cell(&m.capability.cp)) } td.num { (index_cell(&m.capability.cpk)) } td.num { (index_cell(&m.capability.pp)) } td.num { (index_cell(&m.capability.ppk)) }
                            td.num { @match &m.normality.value { Some(n) => { "p " (p_value(n.p_value)) } None => span.why { (absent(&m.normality)) } } }
                        }
                    }
                }
            }
        }
    }
}

/// An index with its interval below it.
fn index_cell(finding: &Finding<Index>) -> Markup {
    html! {
        @match &finding.value {
            Some(i) => {
                (format!("{:.2}", i.value))
                .why { (format!("{:.2} .. {:.2}", i.interval.low, i.interval.high)) @if i.method != "normal" { ", " (i.method) } }
            }
            None => "-",
        }
    }
}

/// Every valve; sortable, each with a link to its own report where there is one.
pub fn valves(summary: &BatchSummary) -> Markup {
    // What failed most stands first.
    let failures = |m: &MetricStatistics| summary.pareto.iter().find(|b| b.cause == m.name).map_or(0, |b| b.count);
    let mut shown: Vec<(usize, &MetricStatistics)> = limited(summary).collect();
    shown.sort_by_key(|(_, m)| std::cmp::Reverse(failures(m)));
    let more = shown.len().saturating_sub(VALUE_COLUMNS);
    shown.truncate(VALUE_COLUMNS);
    let has = |of: fn(&ValveRow) -> &Option<String>| summary.valves.iter().any(|v| of(v).is_some());
    let (part, revision, lot) = (has(|v| &v.part_number), has(|v| &v.revision), has(|v| &v.lot));
    let retried = summary.valves.iter().any(|v| v.attempts.len() > 1);
    // One string per row instead of a tree: a large batch has tens of thousands of rows.
    let mut rows = String::new();
    for v in &summary.valves {
        push_row(&mut rows, v, &shown, (part, revision, lot, retried));
    }
    html! {
        p.hint.soft { "Click a heading to sort. " label { "Show only: " input #filter data-filter="valves" type="search" placeholder="serial, lot, verdict"; } }
        @if more > 0 { p.soft { (more) " more metrics with a limit are in measurements.csv." } }
        .card.scroll {
            table #valves.sortable.wide.widest[shown.len() > 10] {
                thead { tr {
                    th.num { "no." } th { "serial" } @if part { th { "part" } } @if revision { th { "rev." } } @if lot { th { "lot" } }
                    th { "verdict" } @if retried { th { "attempts" } }
                    @for (_, m) in &shown { th.num { (breakable(&m.name)) @if m.unit != "1" { " [" (m.unit) "]" } } }
                    th { "reason" }
                } }
                tbody { (PreEscaped(rows)) }
            }
        }
    }
}

/// A name that may go on in another line behind `/` and before `_`.
fn breakable(name: &str) -> Markup {
    html! { @for part in name.split_inclusive('/') { @for (n, word) in part.split('_').enumerate() { @if n > 0 { wbr; "_" } (word) } wbr; } }
}

fn push_row(
    out: &mut String,
    v: &ValveRow,
    shown: &[(usize, &MetricStatistics)],
    (part, revision, lot, retried): (bool, bool, bool, bool),
) {
    use std::fmt::Write as _;
    let verdict = v.outcome.text();
    let class = match v.outcome {
        Outcome::Pass | Outcome::NotRun => "",
        Outcome::Marginal => " class=marginal",
        _ => " class=fail",
    };
    let serial = escape(&v.serial);
    let serial = match &v.report {
        Some(path) => format!("<a href=\"{}\">{serial}</a>", escape(path)),
        None => serial,
    };
    let _ = write!(out, "<tr{class}><td class=num>{}<td>{serial}", v.position + 1);
    for (has, text) in [(part, &v.part_number), (revision, &v.revision), (lot, &v.lot)] {
        if has {
            let _ = write!(out, "<td>{}", escape(text.as_deref().unwrap_or("")));
        }
    }
    let _ = write!(out, "<td><span class=\"badge {}\">{verdict}</span>", verdict.to_lowercase().replace('_', "-"));
    if retried {
        let attempts: Vec<&str> = v.attempts.iter().map(|a| a.text()).collect();
        let _ = write!(out, "<td>{}", attempts.join(", "));
    }
    for (k, m) in shown {
        match v.values.get(*k).filter(|v| v.is_finite()) {
            Some(value) => {
                let _ = write!(out, "<td class=num>{}", format::number(*value, &m.unit));
            }
            None => out.push_str("<td class=num>-"),
        }
    }
    let _ = writeln!(out, "<td>{}", escape(v.reason.as_deref().unwrap_or("")));
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// What stands behind the figures: plan, rig, station, instruments, decision rule.
pub fn traceability(summary: &BatchSummary) -> Markup {
    let b = &summary.batch;
    let parameters: Vec<String> = b
        .parameters
        .iter()
        .map(|(key, value)| if b.overridden.contains(key) { format!("{key} = {value} (set by hand)") } else { format!("{key} = {value}") })
        .collect();
    html! {
        .columns {
            .card {
                h3 { "Method" }
                dl.facts {
                    dt { "plan" } dd { (b.plan) }
                    dt { "plan SHA-256" } dd { code { (b.plan_sha256) } }
                    @if !parameters.is_empty() { dt { "parameters" } dd { (parameters.join(", ")) } }
                    dt { "decision rule" } dd { (b.decision_rule) }
                    @if let Some((part, sha)) = &b.limits { dt { "limits" } dd { (part) " (SHA-256 " code { (sha) } ")" } }
                    dt { "attempts" } dd { "at most " (b.attempts.0) @if !b.attempts.1.is_empty() && b.attempts.0 > 1 { ", a further one after " (b.attempts.1.join(", ")) } }
                    dt { "rig" } dd { (b.rig.kind) " " (b.rig.name) " (SHA-256 " code { (b.rig.sha256) } ")" }
                    dt { "seed" } dd { (b.seed) }
                    dt { "program" } dd { "hil " (b.version) }
                }
            }
            .card { h3 { "Station" } (station(b.station.as_ref())) }
        }
    }
}

fn station(station: Option<&serde_json::Value>) -> Markup {
    let Some(station) = station else { return html! { p.soft { "No station file was given." } } };
    let text = |key: &str| station.pointer(key).and_then(|v| v.as_str()).map(String::from);
    let facts = [
        ("station", text("/id")),
        ("location", text("/location")),
        ("operator", text("/operator")),
        ("oil", text("/oil/name")),
        ("oil temperature", text("/oil/temperature")),
        ("supply", text("/supply/pressure")),
    ];
    let instruments = station.pointer("/instrument").and_then(|v| v.as_array()).cloned().unwrap_or_default();
    let overrides = station.pointer("/overrides").and_then(|v| v.as_array()).cloned().unwrap_or_default();
    html! {
        dl.facts { @for (name, value) in facts { @if let Some(value) = value { dt { (name) } dd { (value) } } } }
        @if !instruments.is_empty() {
            table {
                thead { tr { th { "instrument" } th { "serial" } th { "certificate" } th { "calibrated" } th { "due" } } }
                tbody {
                    @for i in &instruments {
                        @let field = |key: &str| i.get(key).and_then(|v| v.as_str()).unwrap_or("").to_string();
                        tr { td { (field("quantity")) ": " (field("model")) } td { (field("serial")) } td { (field("certificate")) } td { (field("calibrated")) } td { (field("due")) } }
                    }
                }
            }
        }
        @for o in &overrides { .notice.bad { "Override: " (o.as_str().unwrap_or("")) } }
    }
}
