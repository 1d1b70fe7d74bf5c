//! `hil explain`: what a metric, an effect, a margin or a key of a plan means, from the doc comments themselves.

mod doc_comments;

use clap::Args;

use self::doc_comments::{Entry, entries, module_doc, snake};
use super::{CliError, CliResult, exit};
use crate::physics::{EFFECTS, Effect};
use crate::report::{COLUMNS, fold};

/// Sources of the rooms that hold the terms, from `build.rs`: file and text.
const SOURCES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/sources.rs"));

/// Most entries that are printed for one term.
const MOST: usize = 6;

/// Which term.
#[derive(Debug, Args)]
pub struct ExplainArgs {
    /// A metric, an effect, a margin, a key of a plan or of a valve file; all that can be asked for where it is left out
    term: Option<String>,
    /// Print docs/metrics.md instead
    #[arg(long, hide = true)]
    page: bool,
    /// Runs of each shipped plan on the page; 0 leaves the verdicts out
    #[arg(long, hide = true, default_value_t = 0)]
    seeds: u64,
    /// Folder of the shipped plans
    #[arg(long, hide = true, default_value = "plans")]
    plans: std::path::PathBuf,
}

/// Prints the explanation.
pub fn run(args: &ExplainArgs) -> CliResult {
    let all: Vec<Entry> = SOURCES.iter().flat_map(|(file, text)| entries(file, text)).collect();
    if args.page {
        super::print(&super::metrics_page::page(&args.plans, args.seeds, &metrics(&all))?)?;
        return Ok(exit::DONE);
    }
    let text = match &args.term {
        None => overview(&all),
        Some(term) => explain(&all, term).map_err(CliError::usage)?,
    };
    super::print(&text)?;
    Ok(exit::DONE)
}

/// Every metric with its definition and its source, one paragraph each.
fn metrics(all: &[Entry]) -> Vec<(String, String)> {
    let names = all.iter().filter(|e| e.parent.as_deref() == Some("MetricSpec")).map(|e| e.name.clone());
    names
        .filter_map(|name| {
            let found = all.iter().find(|e| e.name == name && e.kind == "struct" && e.file.starts_with("metrics"))?;
            Some((name, found.doc.replace("Source:\n", "*Source:* ").replace("\n\n", " ")))
        })
        .collect()
}

/// The rooms in the order in which an answer is wanted, with the heading of the overview.
const ROOMS: [(&str, &str); 8] = [
    ("metrics", "Metrics"),
    ("control", "Control and stability"),
    ("plan", "Plans"),
    ("limits", "Limits"),
    ("valve", "Valve models"),
    ("identify", "Identification"),
    ("batch", "Batches and measuring systems"),
    ("diagnose", "Diagnosis"),
];

fn rank(entry: &Entry) -> usize {
    ROOMS.iter().position(|r| entry.file.starts_with(r.0)).unwrap_or(ROOMS.len())
}

/// The explanation of `term`, or a message with the nearest terms.
fn explain(all: &[Entry], term: &str) -> Result<String, String> {
    let wanted = snake(term);
    if let Some(effect) = EFFECTS.iter().find(|e| e.id() == wanted) {
        return Ok(effect_page(*effect));
    }
    let with = |matches: &dyn Fn(&Entry) -> bool| all.iter().filter(|e| matches(e)).collect::<Vec<_>>();
    let mut found = with(&|e| e.name == wanted || e.aliases.contains(&wanted));
    if found.is_empty() {
        // A name that carries its unit: gain_margin finds gain_margin_db.
        found = with(&|e| e.name.strip_prefix(wanted.as_str()).is_some_and(|rest| rest.starts_with('_')));
        found.sort_by_key(|e| e.name.len());
    }
    if found.is_empty() {
        return Err(unknown(all, term, &wanted));
    }
    // Within a room the fullest definition first; a mere reference to another place last.
    found.sort_by_key(|e| (rank(e), e.doc.starts_with("See "), e.kind == "fn", e.kind == "variant", std::cmp::Reverse(e.doc.len())));
    let mut out = String::new();
    for entry in found.iter().take(MOST) {
        write(&mut out, all, entry);
    }
    if found.len() > MOST {
        out.push_str(&format!("{} more places use this name.\n", found.len() - MOST));
    }
    Ok(out)
}

/// The head of an effect's source file, and its parameters.
fn effect_page(effect: &dyn Effect) -> String {
    let mut out = format!("{} (effect)\n", effect.id());
    let doc = effect.doc();
    // The first line is the name once more, as a heading.
    let body = if doc.starts_with('#') { doc.split_once('\n').map_or("", |d| d.1) } else { &doc };
    paragraphs(&mut out, body.trim_start_matches('\n'), 2);
    if !effect.parameters().is_empty() {
        out.push_str("\n  parameters:\n");
    }
    for parameter in effect.parameters() {
        let (low, high) = (parameter.unit.print(parameter.range.0), parameter.unit.print(parameter.range.1));
        let default = parameter.default.map_or_else(String::new, |v| format!("; {} where it is not given", parameter.unit.print(v)));
        listed(&mut out, parameter.name, &format!("{}; {low} to {high}{default}", parameter.meaning));
    }
    out.push('\n');
    out
}

/// A name with its meaning in the columns of a list.
fn listed(out: &mut String, name: &str, meaning: &str) {
    let lead = format!("  {name:<20} ");
    let indent = lead.chars().count().min(40);
    for (n, line) in fold(meaning, COLUMNS - indent).iter().enumerate() {
        let lead = if n == 0 { lead.clone() } else { " ".repeat(indent) };
        out.push_str(&format!("{lead}{line}\n"));
    }
}

fn write(out: &mut String, all: &[Entry], entry: &Entry) {
    let of = entry.parent.as_ref().map_or_else(String::new, |p| format!(" of {}", snake(p)));
    out.push_str(&format!("{} ({}{of}, src/{})\n", entry.name, entry.kind, entry.file));
    paragraphs(out, &entry.doc, 2);
    let members: Vec<&Entry> =
        all.iter().filter(|e| e.file == entry.file && e.parent.as_deref().map(snake) == Some(entry.name.clone())).collect();
    if matches!(entry.kind, "struct" | "enum") && entry.parent.is_none() && !members.is_empty() {
        out.push('\n');
        for member in members {
            listed(out, &member.name, member.doc.split("\n\n").next().unwrap_or_default());
        }
    }
    if rank(entry) == 0 && entry.parent.is_none() && matches!(entry.kind, "struct" | "enum") {
        let source = SOURCES.iter().find(|s| s.0 == entry.file).map_or("", |s| s.1);
        out.push('\n');
        paragraphs(out, &module_doc(source), 2);
    }
    out.push('\n');
}

/// Paragraphs, folded; lines of a list and indented formulas keep their place.
fn paragraphs(out: &mut String, text: &str, indent: usize) {
    let mut paragraph = String::new();
    let flush = |paragraph: &mut String, out: &mut String| {
        if !paragraph.is_empty() {
            for line in fold(paragraph, COLUMNS - indent) {
                out.push_str(&format!("{:indent$}{line}\n", ""));
            }
            paragraph.clear();
        }
    };
    for line in text.lines() {
        let own = line.is_empty() || line.starts_with("- ") || line.starts_with("  ") || line.starts_with('|') || line.ends_with(':');
        if own {
            flush(&mut paragraph, out);
        }
        if line.is_empty() {
            out.push('\n');
        } else {
            paragraph.push_str(line);
            paragraph.push(' ');
        }
        if line.ends_with(':') {
            flush(&mut paragraph, out);
        }
    }
    flush(&mut paragraph, out);
}

fn unknown(all: &[Entry], term: &str, wanted: &str) -> String {
    let mut near: Vec<(usize, &str)> = all
        .iter()
        .flat_map(|e| std::iter::once(&e.name).chain(&e.aliases).map(String::as_str))
        .chain(EFFECTS.iter().map(|e| e.id()))
        .map(|name| (distance(wanted, name), name))
        .filter(|(distance, _)| *distance <= 2.max(wanted.len() / 4))
        .collect();
    near.sort_unstable();
    near.dedup();
    let names: Vec<String> = near.iter().take(5).map(|n| format!("`{}`", n.1)).collect();
    let hint = if names.is_empty() { String::new() } else { format!(": did you mean {}?", names.join(", ")) };
    format!("`{term}` is not a term of hil{hint}\n`hil explain` lists all terms")
}

/// How far a typed term is from a name, or from the nearest of its words.
fn distance(wanted: &str, name: &str) -> usize {
    if name.contains(wanted) {
        return 0;
    }
    let words = name.split('_').map(|word| strsim::osa_distance(wanted, word) + 1);
    words.chain([strsim::osa_distance(wanted, name)]).min().unwrap_or(usize::MAX)
}

/// All terms, room by room: the types and the variants of each.
fn overview(all: &[Entry]) -> String {
    let mut out = String::from("Terms that `hil explain TERM` explains (keys of plans and files are terms too):\n");
    for (n, (_, heading)) in ROOMS.iter().enumerate() {
        let of_errors = |e: &Entry| e.parent.as_deref().unwrap_or(&e.name).to_lowercase().ends_with("error");
        let metric = |e: &Entry| e.parent.as_deref() == Some("MetricSpec");
        let term = |e: &&Entry| rank(e) == n && matches!(e.kind, "struct" | "enum" | "variant") && !of_errors(e) && (n > 0 || metric(e));
        let mut names: Vec<&str> = all.iter().filter(term).map(|e| e.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        if !names.is_empty() {
            out.push_str(&format!("\n{heading}\n"));
            for line in fold(&names.join(", "), COLUMNS - 2) {
                out.push_str(&format!("  {line}\n"));
            }
        }
        if n == 0 {
            out.push_str("\nEffects\n");
            for line in fold(&EFFECTS.iter().map(|e| e.id()).collect::<Vec<_>>().join(", "), COLUMNS - 2) {
                out.push_str(&format!("  {line}\n"));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Entry> {
        SOURCES.iter().flat_map(|(file, text)| entries(file, text)).collect()
    }

    #[test]
    fn every_metric_of_a_plan_is_explained() {
        let all = all();
        let metrics: Vec<&Entry> = all.iter().filter(|e| e.parent.as_deref() == Some("MetricSpec")).collect();
        assert!(metrics.len() >= 15);
        for metric in metrics {
            let text = explain(&all, &metric.name).unwrap();
            assert!(text.starts_with(&format!("{} (struct, src/metrics/", metric.name)), "{text}");
        }
    }

    #[test]
    fn every_effect_is_explained_with_its_parameters() {
        for effect in EFFECTS {
            let text = explain(&all(), effect.id()).unwrap();
            for part in effect.parameters().iter().map(|p| p.name).chain(["Signature", "Source"]) {
                assert!(text.contains(part), "{part}: {text}");
            }
            assert!(text.lines().all(|l| l.chars().count() <= COLUMNS), "{text}");
        }
    }

    /// The words of the pages and of the trade, which are no names of the program.
    #[test]
    fn words_of_the_pages_are_explained() {
        let all = all();
        for term in [
            "Ppk",
            "Cpk",
            "Pp",
            "Cp",
            "GRR",
            "gauge R&R",
            "ndc",
            "%Q_MS",
            "%Q_MP",
            "EV",
            "AV",
            "PV",
            "TV",
            "AIC",
            "bootstrap",
            "Anderson-Darling",
            "Wilson",
            "Clopper-Pearson",
            "ESD",
            "first-pass yield",
            "final yield",
            "run rules",
            "Nelson",
            "moving range",
            "UCL",
            "LCL",
            "sigma",
            "ISO 14253-1",
            "guard band",
            "measurement uncertainty",
            "process stability",
            "K_P",
            "K_I",
            "K_P limit",
            "K_I limit",
            "Routh",
            "Pade",
            "max. sensitivity",
            "gain margin",
            "phase margin",
            "delay margin",
            "SIMC",
            "AMIGO",
            "lambda",
            "Smith predictor",
            "Bode",
            "dead band",
            "threshold",
            "reversal error",
            "dead time",
            "fall time",
            "held-out",
            "noise floor",
            "posterior share",
            "credible set",
            "BIC",
        ] {
            let text = explain(&all, term);
            assert!(text.as_ref().is_ok_and(|t| t.lines().count() > 1), "{term}: {text:?}");
        }
    }

    #[test]
    fn everything_fits_80_columns() {
        let all = all();
        for entry in &all {
            for line in explain(&all, &entry.name).unwrap().lines().chain(overview(&all).lines()) {
                assert!(line.chars().count() <= COLUMNS, "{line}");
            }
        }
    }

    /// Every heading and every abbreviation of a batch page and of a gauge study.
    #[test]
    fn the_words_of_the_pages_are_known() {
        let words = "Cp Cpk Pp Ppk GRR normality sample histogram control_chart moving_range outliers drift pareto proportion wilson first_pass \
            final_yield rule distribution q_ms q_mp repeatability distinct_categories decision_rule guard_band";
        for word in words.split_whitespace() {
            assert!(explain(&all(), word).is_ok(), "{word}");
        }
        assert!(explain(&all(), "Ppk").unwrap().contains("ISO 22514-2"));
    }

    #[test]
    fn a_margin_is_found_without_its_unit() {
        assert!(explain(&all(), "gain margin").unwrap().starts_with("gain_margin_db ("));
    }

    #[test]
    fn an_unknown_term_names_its_neighbours() {
        let message = explain(&all(), "setling_time").unwrap_err();
        assert!(message.contains("`settling_time`"), "{message}");
        assert!(explain(&all(), "qqqqqqqq").unwrap_err().contains("lists all"));
    }
}
