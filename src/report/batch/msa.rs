//! A gauge study as text and Markdown.

use std::fmt::Write as _;

use crate::batch::measuring::MeasuringCapability;
use crate::batch::msa::GaugeStudy;
use crate::batch::statistics::Finding;

/// The study for a terminal.
pub fn msa_text(name: &str, unit: &str, study: &GaugeStudy, capability: &MeasuringCapability) -> String {
    let mut out = String::new();
    let (parts, appraisers, trials) = study.size;
    let _ = writeln!(out, "gauge R&R of {name}: {parts} parts, {appraisers} appraisers, {trials} trials");
    let _ = writeln!(out, "{}", "=".repeat(80));
    let _ = writeln!(out, "{:<16} {:>5} {:>14} {:>14} {:>10} {:>9}", "source", "df", "squares", "mean square", "F", "p");
    for line in &study.anova {
        let optional = |v: Option<f64>, digits: usize| v.map_or_else(String::new, |v| format!("{v:.digits$}"));
        let _ = writeln!(
            out,
            "{:<16} {:>5} {:>14.6} {:>14} {:>10} {:>9}",
            line.source,
            line.freedom,
            line.squares,
            optional(line.mean_square, 6),
            optional(line.f, 3),
            optional(line.p_value, 4)
        );
    }
    let pooled = if study.pooled { "not significant at 25 %: pooled with the repeatability" } else { "significant at 25 %: kept" };
    let _ = writeln!(out, "interaction {pooled}\n");
    let _ = writeln!(
        out,
        "{:<16} {:>14} {:>12} {:>12} {:>12}",
        "component",
        format!("sigma [{unit}]"),
        "contribution",
        "of study",
        "of tolerance"
    );
    for c in &study.components {
        let tolerance = c.of_tolerance.map_or_else(|| "-".into(), |t| format!("{:.2} %", 100.0 * t));
        let (contribution, of_study) = (100.0 * c.contribution, 100.0 * c.study_variation);
        let _ = writeln!(out, "{:<16} {:>14.6} {contribution:>10.2} % {of_study:>10.2} % {tolerance:>12}", c.source, c.deviation);
    }
    out.push('\n');
    for (label, text) in figures(study).into_iter().chain(capability_lines(unit, capability)) {
        let _ = writeln!(out, "{label:<24} {text}");
    }
    out
}

/// The study as Markdown.
pub fn msa_markdown(name: &str, unit: &str, study: &GaugeStudy, capability: &MeasuringCapability) -> String {
    let (parts, appraisers, trials) = study.size;
    let mut out = format!("# Gauge R&R of {name}\n\n{parts} parts, {appraisers} appraisers, {trials} trials.\n\n");
    for (label, text) in figures(study).into_iter().chain(capability_lines(unit, capability)) {
        let _ = writeln!(out, "- {label}: {text}");
    }
    out.push_str("\n| component | sigma | contribution | of study | of tolerance |\n|---|--:|--:|--:|--:|\n");
    for c in &study.components {
        let tolerance = c.of_tolerance.map_or_else(|| "-".into(), |t| format!("{:.2} %", 100.0 * t));
        let _ = writeln!(
            out,
            "| {} | {:.6} | {:.2} % | {:.2} % | {tolerance} |",
            c.source,
            c.deviation,
            100.0 * c.contribution,
            100.0 * c.study_variation
        );
    }
    out
}

fn figures(study: &GaugeStudy) -> Vec<(&'static str, String)> {
    let tolerance = match study.grr_of_tolerance.value {
        Some(v) => format!("{:.2} %", 100.0 * v),
        None => study.grr_of_tolerance.absent.clone().unwrap_or_default(),
    };
    let categories = match study.distinct_categories.value {
        Some(n) => format!("{n} (5 or more are wanted)"),
        None => study.distinct_categories.absent.clone().unwrap_or_default(),
    };
    vec![
        ("%GRR of tolerance", tolerance),
        ("%GRR of study", format!("{:.2} %", 100.0 * study.grr_of_study)),
        ("distinct categories", categories),
        ("verdict", format!("{} (below 10 % acceptable, 10 to 30 % conditional)", study.verdict)),
    ]
}

/// Capability by uncertainty, after VDA 5.
fn capability_lines(unit: &str, capability: &MeasuringCapability) -> Vec<(&'static str, String)> {
    let share = |of: &Finding<f64>, most: &str| match of.value {
        Some(v) => format!("{:.2} % (at most {most} %)", 100.0 * v),
        None => of.absent.clone().unwrap_or_default(),
    };
    let budget: Vec<String> = capability.budget.iter().map(|i| format!("{} {:.3e}", i.name, i.uncertainty)).collect();
    vec![
        ("%Q_MS", share(&capability.q_ms, "15")),
        ("%Q_MP", share(&capability.q_mp, "30")),
        ("smallest tolerance", format!("{:.6} {unit}", capability.smallest_tolerance)),
        ("uncertainties", budget.join(", ")),
    ]
}
