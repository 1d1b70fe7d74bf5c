//! The diagnosis as one self-contained page: the answer first, then what it rests on.

use maud::{Markup, PreEscaped, html};

use super::{drawings, tables};
use crate::diagnose::{Diagnosed, Diagnosis, Story, Verdict, title};
use crate::report::page::prose;

/// What this page has beyond the style of all reports.
const STYLE: &str = r#"
.badge.match { background: var(--pass); } .badge.explained { background: var(--measured); } .badge.partly { background: var(--marginal); } .badge.unexplained { background: var(--fail); }
.answer { border-left: 5px solid var(--c); background: color-mix(in srgb, var(--c) 7%, var(--card)); border-radius: 0 10px 10px 0; padding: 10px 18px; margin: 18px 0 0; }
.answer.match { --c: var(--pass); } .answer.explained { --c: var(--measured); } .answer.partly { --c: var(--marginal); } .answer.unexplained { --c: var(--fail); }
table.heat { table-layout: fixed; font-size: 12px; } table.heat td, table.heat th { padding: 3px 4px; border: 2px solid var(--card); text-align: center; vertical-align: middle; }
table.heat td.cell { background: color-mix(in srgb, var(--error) var(--p), var(--grid)); } table.heat th { text-align: left; font-size: 12px; } table.heat td.from { color: var(--soft); font-size: 11px; padding-top: 0; }
table.heat th.name { width: 19%; } table.heat th.model { width: 11%; font-weight: 400; }
td .gauge { min-width: 60px; } tr.named td { font-weight: 600; background: color-mix(in srgb, var(--good) 9%, var(--card)); }
h3 .soft { font-weight: 400; }
@media (max-width: 600px) {
  /* The name of a variable has a line of its own, so that all ranges are seen at once. */
  table.heat { font-size: 11px; } table.heat, table.heat tbody { display: block; } table.heat tbody { display: grid; grid-template-columns: max-content repeat(var(--cells), minmax(0, 1fr)); margin-bottom: 6px; } table.heat colgroup { display: none; } table.heat tr { display: contents; }
  table.heat td, table.heat th { padding: 3px 1px; border-width: 1px; width: auto; } table.heat th.name { grid-column: 1 / -1; width: auto; padding-top: 6px; } table.heat th.model { grid-column: 1; width: auto; padding-right: 5px; white-space: nowrap; } table.heat td.from { font-size: 9.5px; overflow-wrap: anywhere; }
  /* Why not, below what was tried. */
  table.tried, table.tried tbody { display: block; } table.tried thead { display: none; } table.tried tr { display: grid; grid-template-columns: minmax(0, 1fr) auto auto; gap: 0 10px; border-bottom: 1px solid var(--grid); padding: 5px 0; } table.tried td { border: 0; padding: 0 6px; } table.tried td.share { display: none; } table.tried tr.named { background: color-mix(in srgb, var(--good) 9%, var(--card)); } table.tried td.why { grid-column: 1 / -1; }
  table.tried td[data-of]::before { content: attr(data-of) " "; color: var(--soft); font-size: 12px; font-weight: 400; }
}
@media (prefers-color-scheme: dark) { .badge.match { background: #1d7a45; } .badge.explained { background: #2a62b8; } .badge.partly { background: #8a5a10; } .badge.unexplained { background: #b3261e; } }
@media print { .rest { display: none; } }
"#;

/// The page; `story` is what [`crate::diagnose::story`] makes of the same diagnosis.
pub fn page(found: &Diagnosed, story: &Story) -> String {
    let d = &found.diagnosis;
    let body = html! {
        style { (PreEscaped(STYLE)) }
        (heading(d))
        (tables::tiles(d))
        h2 { "Recording and simulation" }
        p.soft.hint { (crate::report::page::HINT) }
        @for run in story.runs.iter().take(1) { (drawings::run(found, run, story.runs.len() > 1)) }
        @if story.runs.len() > 1 {
            details.rest {
                summary { "The other runs" @if story.runs.len() > 9 { " (the eight with the largest error)" } }
                @for run in story.runs.iter().skip(1).take(8) { (drawings::run(found, run, true)) }
            }
        }
        h2 { "Where the model as given errs" }
        (drawings::slices(d, story))
        (tables::strips(d, story))
        @if !story.spectrum.is_empty() { (drawings::spectrum(d, story)) }
        @if !d.effects.is_empty() {
            h2 { "What is missing" }
            @if let Some(signature) = &story.signature { (drawings::signature(d, signature)) }
            @for (n, finding) in d.effects.iter().enumerate() { (tables::finding(n + 1, finding)) }
        }
        @if !d.form.is_empty() {
            h2 { "Form of curve, hysteresis and dynamics" }
            p.soft.hint { "Corrections that say nothing of a fault: this model may never have had the form of this valve." }
            @for (n, finding) in d.form.iter().enumerate() { (tables::finding(n + 1, finding)) }
        }
        @if !d.recalibration.is_empty() { (tables::recalibration(d)) }
        @if let Some(rest) = &d.unexplained { h2 { "What is left" } (tables::remainder(rest)) @if let Some(s) = &story.rest { (drawings::rest(d, s)) } }
        @if let Some(term) = &d.discovered {
            h2 { "A term that no effect of the library holds" }
            (super::discovered::discovered(term))
            @if let Some(signature) = story.signature.as_ref().filter(|_| d.effects.is_empty()) { (drawings::signature(d, signature)) }
        }
        @if tables::is_fitted(d) {
            h2 { "What was tried" }
            (tables::candidates(d))
            h2 { "How well each model does on data it has not seen" }
            (tables::errors(d))
        }
        h2 { "What to do next" }
        (tables::next(d, found.recalibration.is_some()))
        @if let Some(next) = &d.next_experiment { (drawings::experiment(next)) }
        @if !d.notes.is_empty() { h2 { "Noticed about recording and model" } .card { ul { @for note in &d.notes { li { (prose(note)) } } } } }
        footer {
            "Errors are measured minus simulated. The simulations run free: they see the recorded current, never the measured pressure. Schema "
            code { (d.schema) } "; nothing on this page was fetched."
        }
    };
    crate::report::page(&format!("{}: {}", d.recording, answer(d)), &body)
}

/// The verdict in the words of a badge, and the class of its colour.
fn verdict(verdict: Verdict) -> (&'static str, &'static str) {
    match verdict {
        Verdict::Match => ("MATCH", "match"),
        Verdict::Explained => ("EXPLAINED", "explained"),
        Verdict::PartlyExplained => ("PARTLY EXPLAINED", "partly"),
        Verdict::Unexplained => ("UNEXPLAINED", "unexplained"),
        Verdict::NotComparable => ("NOT COMPARABLE", "unexplained"),
    }
}

/// The answer as a headline.
fn answer(d: &Diagnosis) -> String {
    let named = d.effects.iter().map(|f| title(&f.id)).collect::<Vec<_>>();
    let named = match named.as_slice() {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    };
    match d.verdict {
        Verdict::Match => "Nothing is missing".into(),
        Verdict::PartlyExplained if d.unexplained.is_some() => format!("Missing in the model: {named}, and something unknown"),
        Verdict::Explained | Verdict::PartlyExplained => format!("Missing in the model: {named}"),
        Verdict::Unexplained => "Something is missing that the library does not hold".into(),
        Verdict::NotComparable => "Model and recording do not belong together".into(),
    }
}

fn heading(d: &Diagnosis) -> Markup {
    let (text, class) = verdict(d.verdict);
    html! {
        header.top {
            div {
                h1 { (answer(d)) }
                .sub { "recording " b { (d.recording) } " against model " b { (d.model) } }
            }
            .badges { span.badge.big.(class) { (text) } }
        }
        .answer.(class) {
            p.lead { (prose(&d.summary)) }
            @for f in d.effects.iter().filter(|f| !f.indistinguishable.is_empty()) {
                p { "This recording cannot tell " b { (title(&f.id)) } " from "
                    @for (k, id) in f.indistinguishable.iter().enumerate() { @if k > 0 { " or " } b { (title(id)) } }
                    @if d.next_experiment.as_ref().is_some_and(|n| n.separates()) { "; the next experiment below can." } @else { "." } }
            }
        }
    }
}
