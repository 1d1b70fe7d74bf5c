//! The reports of a batch: views of one [`BatchSummary`]; they compute nothing.

mod comparison;
mod csv;
mod figures;
mod html;
mod junit;
mod markdown;
mod msa;
mod tables;
mod text;

pub use comparison::{comparison_markdown, comparison_text};
pub use csv::csv;
pub use html::html;
pub use junit::junit;
pub use markdown::markdown;
pub use msa::{msa_markdown, msa_text};
pub use text::text;

use crate::batch::statistics::{Finding, Index, Interval, MetricStatistics, Proportion, Tolerance};
use crate::batch::summary::BatchSummary;
use crate::record::Origin;

use super::format;

/// A share in percent with its interval: `97.3 % (96.9 to 97.6 %)`.
fn share(finding: &Finding<Proportion>) -> String {
    match &finding.value {
        Some(p) => format!("{:.1} % ({:.1} to {:.1} %)", 100.0 * p.share, 100.0 * p.wilson.low, 100.0 * p.wilson.high),
        None => absent(finding),
    }
}

/// Why there is no figure.
fn absent<T>(finding: &Finding<T>) -> String {
    finding.absent.clone().unwrap_or_else(|| "absent".into())
}

/// The limits of a metric: `0.100 .. 0.200 bar`, `<= 0.200 bar`.
fn tolerance(tolerance: &Tolerance, unit: &str) -> String {
    match (tolerance.min, tolerance.max) {
        (Some(min), Some(max)) => format!("{} .. {}", format::number(min, unit), format::quantity(max, unit)),
        (None, Some(max)) => format!("<= {}", format::quantity(max, unit)),
        (Some(min), None) => format!(">= {}", format::quantity(min, unit)),
        (None, None) => String::new(),
    }
}

/// An index with its interval: `1.33 (1.21 to 1.45)`; a dash where it is absent.
fn index(finding: &Finding<Index>) -> String {
    match &finding.value {
        Some(Index { value, interval: Interval { low, high }, .. }) => format!("{value:.2} ({low:.2} to {high:.2})"),
        None => "-".into(),
    }
}

/// A probability: `0.034`, `< 0.001`.
fn p_value(p: f64) -> String {
    if p < 0.001 { "< 0.001".into() } else { format!("{p:.3}") }
}

/// The metrics that have a limit; these decide, so these come first.
fn limited(summary: &BatchSummary) -> impl Iterator<Item = (usize, &MetricStatistics)> {
    summary.metrics.iter().enumerate().filter(|(_, m)| m.tolerance.min.is_some() || m.tolerance.max.is_some())
}

/// What marks a simulated or emulated batch wherever its verdict is shown.
fn simulation_mark(summary: &BatchSummary) -> Option<&'static str> {
    match summary.origin {
        _ if summary.batch.simulated => Some("SIMULATION - the pressures come from a model; these figures say nothing of real valves"),
        Origin::Emulated => Some("EMULATED - an emulator stands for driver and valves; these figures say nothing of real ones"),
        _ => None,
    }
}

/// Valves of another origin than the batch, which are in none of its figures.
fn not_pooled(summary: &BatchSummary) -> Option<String> {
    let valves = &summary.not_pooled;
    (!valves.is_empty()).then(|| format!("EMULATED, and in no figure of this batch: {}", valves.join(", ")))
}

/// What stands above everything else where nobody saw a current go.
fn unsafe_mark(summary: &BatchSummary) -> Option<String> {
    let valves = &summary.safe_state_not_confirmed;
    (!valves.is_empty()).then(|| format!("{} (valve {})", crate::report::format::UNSAFE, valves.join(", ")))
}

/// What was changed by hand, so that nobody takes the batch for one of the plan as released.
fn overridden(summary: &BatchSummary) -> Option<String> {
    let names = &summary.batch.overridden;
    (!names.is_empty()).then(|| format!("parameters of the plan were changed by hand: {}", names.join(", ")))
}

/// The remarks that a reader must not miss: stability, normality, drift, outliers, missing values.
fn remarks(m: &MetricStatistics) -> Vec<String> {
    let mut remarks = Vec::new();
    if m.missing > 0 {
        remarks.push(format!("{} valve(s) without a value", m.missing));
    }
    if m.chart.value.as_ref().is_some_and(|c| !c.stable) {
        remarks.push("not stable: more points beyond 3 sigma than chance gives".into());
    }
    if let Some(n) = m.normality.value.as_ref().filter(|n| !n.plausible) {
        remarks.push(format!("not normal (Anderson-Darling A\u{b2} = {:.2}, p {})", n.statistic, p_value(n.p_value)));
    }
    if let Some(d) = m.drift.value.as_ref().filter(|d| d.significant) {
        remarks.push(format!(
            "drifts by {} over the batch ({} to {}, p {})",
            format::quantity(d.change, &m.unit),
            format::number(d.change_interval.low, &m.unit),
            format::number(d.change_interval.high, &m.unit),
            p_value(d.p_value)
        ));
    }
    if let Some(outliers) = m.outliers.value.as_ref().filter(|o| !o.is_empty()) {
        remarks.push(format!("{} outlier(s)", outliers.len()));
    }
    remarks
}

/// Why an index is absent, each reason once.
fn index_reasons(m: &MetricStatistics) -> Vec<String> {
    let c = &m.capability;
    let mut reasons: Vec<(String, String)> = Vec::new();
    for (names, finding) in [("Cp", &c.cp), ("Cpk", &c.cpk), ("Pp", &c.pp), ("Ppk", &c.ppk)] {
        // That a one-sided limit has no Cp needs no words.
        let Some(reason) = finding.absent.as_deref().filter(|r| *r != "needs both limits") else { continue };
        match reasons.iter_mut().find(|r| r.1 == reason) {
            Some(known) => known.0 = format!("{}, {names}", known.0),
            None => reasons.push((names.to_string(), reason.to_string())),
        }
    }
    reasons.into_iter().map(|(names, reason)| format!("{names}: {reason}")).collect()
}
