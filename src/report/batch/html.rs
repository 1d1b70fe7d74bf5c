//! The batch as one self-contained page: verdict and yield, charts, every valve, traceability, a place to sign.

use maud::{Markup, PreEscaped, html};

use super::{figures, limited, not_pooled, overridden, simulation_mark, tables, unsafe_mark};
use crate::batch::summary::BatchSummary;
use crate::report::badge;
use crate::report::format;

/// A place to sign; id and page number on every printed page.
const STYLE: &str = r"
#valves th { white-space: normal; } #valves td { white-space: nowrap; } #valves td:last-child { white-space: normal; }
td.share { width: 40%; } .gauge.pareto { height: 12px; } .gauge.pareto u { position: absolute; top: 0; bottom: 0; width: 2px; background: var(--ink); } .sign { display: grid; grid-template-columns: repeat(auto-fit, minmax(200px, 1fr)); gap: 14px 24px; margin-top: 34px; } .sign div { border-top: 1px solid var(--ink); padding-top: 4px; color: var(--soft); font-size: 12.5px; }
#filter { font: inherit; padding: 2px 8px; border: 1px solid var(--line); border-radius: 6px; background: var(--card); color: var(--ink); }
@media print { thead { display: table-header-group; } .scroll { overflow: visible; break-inside: auto; } .sign { break-inside: avoid; } details:not([open]) { display: none; } }
";

/// The page. `id` identifies the report on every printed page.
pub fn html(summary: &BatchSummary, id: &str) -> String {
    let charts: Vec<_> = limited(summary).collect();
    let body = html! {
        style { (PreEscaped(STYLE)) (PreEscaped(page_margins(id))) }
        (heading(summary, id))
        (tiles(summary))
        @if !summary.pareto.is_empty() { h2 { "Failures" } (figures::pareto(summary)) }
        @if !summary.outlier_valves.is_empty() {
            h2 { "Outliers" }
            .card {
                p.soft { "Valves that do not belong to the rest in some metric (generalised extreme Studentised deviate, 5 %)." }
                dl.facts { @for (serial, metrics) in summary.outlier_valves.iter().take(40) { dt { (serial) } dd { (metrics.join(", ")) } } }
                @if summary.outlier_valves.len() > 40 { p.soft { "and " (summary.outlier_valves.len() - 40) " more" } }
            }
        }
        h2 { "Metrics with a limit" }
        @for (k, m) in &charts {
            h3 { (m.name) }
            (figures::metric(summary, *k, m))
            details { summary { "Moving range" } (figures::moving_range(summary, *k, m)) }
        }
        h2 { "Statistics" }
        p.soft { "Over the deciding attempt of every judged valve. Intervals 95 %; below each index. Pp and Ppk by the quantiles of the distribution that fits (ISO 22514-2), Cp and Cpk from the short-term spread of a stable process with normal values; Cp and Pp need limits on both sides." }
        (tables::statistics(summary))
        h2 { "Valves" }
        (tables::valves(summary))
        h2 { "Traceability" }
        (tables::traceability(summary))
        .sign { div { "Tested by, date" } div { "Checked by, date" } div { "Released by, date" } }
        footer {
            "Report " code { (id) } ". The results relate only to the items tested. Written from the records alone (" code { (summary.schema) } "): nothing on this page was fetched. End of report."
        }
    };
    crate::report::page(&format!("Batch of {} on {}", summary.valves.len(), summary.batch.plan), &body)
}

fn page_margins(id: &str) -> String {
    let id: String = id.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '-').collect();
    format!(
        "@media print {{ @page {{ @bottom-left {{ content: 'report {id}'; font-size: 8pt; color: #555; }} \
         @bottom-right {{ content: 'page ' counter(page) ' of ' counter(pages); font-size: 8pt; color: #555; }} }} }}"
    )
}

fn heading(summary: &BatchSummary, id: &str) -> Markup {
    html! {
        header.top {
            div {
                h1 { "Batch of " (summary.valves.len()) " on " (summary.batch.plan) }
                .sub { "rig " (summary.batch.rig.kind) " " b { (summary.batch.rig.name) } ", report " code { (id) } }
            }
            .badges {
                @if let Some(word) = format::origin_badge(summary.origin) { span.badge.big.sim { (word) } }
                (badge(summary.outcome.text(), true))
            }
        }
        @if let Some(mark) = unsafe_mark(summary) { .alarm role="alert" { (mark) } }
        @if let Some(mark) = simulation_mark(summary) { .notice { (mark) "." } }
        @if let Some(text) = not_pooled(summary) { .notice { (text) "." } }
        @if let Some(text) = overridden(summary) { .notice.bad { "Careful: " (text) "." } }
        @if summary.not_tested > 0 { .notice.bad { (summary.not_tested) " valve(s) of the batch have not been tested yet." } }
        @for d in &summary.damage { .notice.bad { "Journal: " (d.text()) "." } }
    }
}

fn tiles(summary: &BatchSummary) -> Markup {
    let count = |outcome: &str| summary.counts.get(outcome).copied().unwrap_or(0);
    let (passed, marginal, failed) = (count("PASS"), count("MARGINAL"), count("FAIL"));
    let other = summary.valves.len() - passed - marginal - failed;
    html! {
        .tiles {
            .tile { .name { "first-pass yield" } .value { (percent(&summary.first_pass)) } .note { (interval(&summary.first_pass)) } }
            .tile { .name { "final yield" } .value { (percent(&summary.final_yield)) } .note { (interval(&summary.final_yield)) } }
            .tile { .name { "passed" } .value { (passed) } .note { "of " (summary.valves.len()) " valves" } }
            .tile { .name { "marginal" } .value { (marginal) } .note { "passed inside the warning band" } }
            .tile { .name { "failed" } .value { (failed) } .note { "outside a limit" } }
            .tile { .name { "no verdict" } .value { (other) } .note { "INVALID, ERROR, ABORTED" } }
        }
    }
}

/// Passed of judged, with the interval of the share.
fn interval(finding: &crate::batch::statistics::Finding<crate::batch::statistics::Proportion>) -> String {
    match &finding.value {
        Some(p) => format!("{} of {}: {:.1} to {:.1} %", p.passed, p.count, 100.0 * p.wilson.low, 100.0 * p.wilson.high),
        None => super::absent(finding),
    }
}

fn percent(finding: &crate::batch::statistics::Finding<crate::batch::statistics::Proportion>) -> String {
    finding.value.as_ref().map_or_else(|| "-".into(), |p| format!("{:.1} %", 100.0 * p.share))
}
