//! The report as one self-contained HTML file: the verdict first, then the evidence.

mod bode;
mod figures;
mod tables;
mod verdict;

use maud::{Markup, html};

pub use verdict::badge;

use super::format;
use crate::record::{TestRecord, Trace};

/// The record and its samples as a page. An empty trace leaves the figures over time out.
pub fn html(record: &TestRecord, trace: &Trace) -> String {
    let body = html! {
        (heading(record))
        (tables::tiles(record))
        h2 { "Measurements" }
        (tables::measurements(record))
        @if !trace.time_s.is_empty() {
            h2 { "Over time" }
            p.soft.hint { (super::page::HINT) }
            (figures::over_time(record, trace))
        }
        (bode::bode(record, trace))
        (figures::loops(record, trace))
        @if let Some(stability) = &record.stability {
            h2 { "Stability of the loop" }
            .columns {
                (figures::stability(stability))
                (tables::margins(stability))
            }
        }
        h2 { "Timing" }
        (tables::timing(record))
        (figures::timing(record))
        h2 { "What ran" }
        (tables::identity(record))
        footer { "A view of one record (" code { (record.schema) } "). The page is complete in itself: nothing is fetched." }
    };
    super::page(&format!("{} on {}: {}", record.plan.name, record.dut.serial, format::run_verdict(record)), &body)
}

fn heading(record: &TestRecord) -> Markup {
    html! {
        header.top {
            div {
                h1 { (record.plan.name) }
                .sub { "valve " b { (record.dut.serial) } " on rig " (record.rig.kind) " " b { (record.rig.name) } ", " (format::tally(record)) }
            }
            .badges {
                @if let Some(word) = format::origin_badge(record.origin()) { span.badge.big.sim { (word) } }
                (badge(format::run_verdict(record), true))
            }
        }
        @if record.ended_unsafe() { .alarm role="alert" { (format::UNSAFE) } }
        @if let Some(mark) = format::simulation_mark(record) { .notice { (mark) "." } }
        @if !record.reasons.is_empty() {
            .notice.bad { @for reason in &record.reasons { p { (reason) } } }
        }
    }
}
