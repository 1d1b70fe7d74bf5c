//! Tiles and tables of the page: measurements with their limits, margins, timing, identity.

use maud::{Markup, html};
use serde_json::Value;

use super::verdict::{badge, row_class};
use crate::record::{Measurement, Outcome, TestRecord};
use crate::report::format;

/// The figures that a reader looks for first: what was judged, and the margins.
pub fn tiles(record: &TestRecord) -> Markup {
    let all = || record.phases.iter().flat_map(|p| p.measurements.iter().map(move |m| (p, m)));
    let mut first: Vec<_> = all().filter(|(_, m)| m.limit.is_some()).collect();
    if first.is_empty() {
        first = all().filter(|(_, m)| m.value.is_some()).collect();
    }
    // The worst first, in the order of the plan among equals.
    first.sort_by_key(|(_, m)| std::cmp::Reverse(if m.outcome == Outcome::NotRun { Outcome::Pass } else { m.outcome }));
    let margins = record.stability.as_ref().map(format::margins).unwrap_or_default();
    html! {
        .tiles {
            @for (phase, measurement) in first.into_iter().take(4) {
                .tile {
                    .name { (measurement.metric.replace('_', " ")) " - " (phase.name) }
                    .value { (big_value(measurement)) }
                    .note { @if measurement.limit.is_some() { (badge(format::verdict(measurement), false)) " " } (format::limit(measurement)) }
                }
            }
            @for margin in margins.into_iter().take(2) {
                .tile { .name { (margin.name) } .value { (margin.print()) } .note { (margin.remark) } }
            }
        }
    }
}

fn big_value(measurement: &Measurement) -> Markup {
    html! {
        @match measurement.value {
            Some(value) => {
                (format::number(value, &measurement.unit))
                @if measurement.unit != "1" { " " small { (measurement.unit) } }
            }
            None => "-",
        }
    }
}

/// Every phase of the plan with what was measured in it.
pub fn measurements(record: &TestRecord) -> Markup {
    html! {
        .card.scroll {
            table.verdicts {
                thead { tr { th { "measurement" } th.num { "value" } th { "limit" } th { "share of the limit" } th { "verdict" } } }
                tbody {
                    @for phase in &record.phases {
                        tr.group {
                            td.what colspan="4" {
                                (phase.name) " "
                                span.soft { @if phase.role != "main" { "(" (phase.role) ") " } (format::span(phase)) }
                                @if let Some(asked) = format::asked(phase) { .why { (asked) } }
                                @if let Some(reason) = &phase.reason { .why { (reason) } }
                            }
                            td.verdict { (badge(format::phase_verdict(phase), false)) }
                        }
                        @for measurement in &phase.measurements { (measurement_row(measurement)) }
                    }
                }
            }
        }
    }
}

fn measurement_row(measurement: &Measurement) -> Markup {
    let warning = format::warning(measurement);
    html! {
        tr.(row_class(measurement.outcome)) {
            td.what { code { (format::definition(measurement)) } @if let Some(reason) = &measurement.reason { .why { (reason) } } }
            td.num { (format::value(measurement)) }
            td.limit { (format::limit(measurement)) @if !warning.is_empty() { .why { "warns " (warning) } } }
            td { (gauge(measurement)) }
            td.verdict { (badge(format::verdict(measurement), false)) }
        }
    }
}

/// How far the figure has gone towards its upper limit; nothing where it has none, or one of zero.
fn gauge(measurement: &Measurement) -> Markup {
    let share =
        measurement.value.zip(measurement.limit.as_ref().and_then(|l| l.max)).and_then(|(v, max)| (max > 0.0).then(|| v.abs() / max));
    html! {
        @if let Some(share) = share {
            span.gauge.(row_class(measurement.outcome)) title={ (format!("{:.0}", share * 100.0)) " % of the limit" } {
                i style={ "width:" (format!("{:.1}", share.min(1.0) * 100.0)) "%" } {}
            }
        }
    }
}

/// The margins beside the boundary plot.
pub fn margins(stability: &Value) -> Markup {
    html! {
        .card.scroll {
            @if let Some((kp, ki)) = format::gains(stability) {
                p { "K" sub { "P" } " " b { (format::quantity(kp, "mA/bar")) } ", K" sub { "I" } " " b { (format::quantity(ki, "mA/(bar s)")) } ": " b { (format::stable(stability)) } }
            }
            table {
                tbody { @for margin in format::margins(stability) { tr { td { (margin.name) } td.num { (margin.print()) } td.soft { (margin.remark) } } } }
            }
        }
    }
}

/// What shows that the samples came when they should.
pub fn timing(record: &TestRecord) -> Markup {
    html! { .card { dl.facts { @for (name, value) in format::timing(record) { dt { (name) } dd { (value) } } } } }
}

/// Everything that is needed to run the same test again.
pub fn identity(record: &TestRecord) -> Markup {
    let optional = |name: &str, value: &Option<String>| html! { @if let Some(value) = value { dt { (name) } dd { (value) } } };
    html! {
        .card {
            dl.facts {
                dt { "plan" } dd { (record.plan.name) " " code { "sha256 " (record.plan.sha256) } }
                @for (key, value) in &record.plan.parameters {
                    dt { (key) } dd { (value) @if record.plan.overridden.contains(key) { " " span.soft { "(set by hand)" } } }
                }
                dt { "valve" } dd { (record.dut.serial) }
                (optional("part number", &record.dut.part_number))
                (optional("revision", &record.dut.revision))
                (optional("lot", &record.dut.lot))
                dt { "rig" } dd { (record.rig.kind) " " (record.rig.name) " " code { "sha256 " (record.rig.sha256) } }
                @for (key, value) in &record.rig.details { dt { (key) } dd { (value) } }
                dt { "seed" } dd { (record.seed) }
                @if let Some(safe) = &record.safe_state {
                    dt { "safe state" } dd { @if safe.confirmed { "confirmed: " } @else { b { "not confirmed: " } } (safe.evidence) }
                }
                @if let Some(provenance) = &record.provenance {
                    dt { "started" } dd { (to_the_second(&provenance.started)) }
                    dt { "program" } dd { "hil " (provenance.version) }
                    @if let Some(station) = &provenance.station { dt { "station" } dd { (station_text(station)) } }
                }
            }
        }
    }
}

fn station_text(station: &Value) -> Markup {
    html! {
        @match station {
            Value::Object(map) => { @for (key, value) in map { div { span.soft { (key) ": " } (station_text(value)) } } }
            Value::String(text) => (text),
            other => (other.to_string()),
        }
    }
}

/// A time stamp without what lies below the second.
fn to_the_second(stamp: &str) -> String {
    match stamp.split_once('.') {
        Some((whole, rest)) => format!("{whole}{}", rest.trim_start_matches(|c: char| c.is_ascii_digit())),
        None => stamp.into(),
    }
}
