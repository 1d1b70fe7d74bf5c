//! A fleet as text, JSON and one page.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use maud::{Markup, html};
use serde_json::{Value, json};

use super::plot::{Color, Figure, Stroke};
use crate::diagnose::figure;
use crate::fleet::findings::{FleetFinding, date, groups, holds_dates, number, numeric_columns};
use crate::fleet::levels::{Level, levels};
use crate::fleet::rate::Rate;
use crate::fleet::row::{Row, Status};
use crate::fleet::standing::Standing;

/// Most rows of a table on the page: the rest is in the Parquet table.
const MOST_ROWS: usize = 400;
/// A column of more groups than this has no table of its own.
const MOST_GROUPS: usize = 100;
/// Most dots of a figure.
const MOST_DOTS: usize = 2000;

/// The figures of a fleet.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Rows in all, and those without an answer.
    pub rows: usize,
    /// Inputs that could not be used.
    pub unusable: usize,
    /// Valves with a cause.
    pub faulty: Rate,
    /// Corrected for what the diagnosis misses and invents: value and 95 % interval.
    pub corrected: Option<(f64, f64, f64)>,
    /// Whether a confusion was given.
    pub has_confusion: bool,
    /// Valves with something that no effect carries.
    pub unknown: Rate,
    /// Valves of which nothing is said.
    pub healthy: Rate,
    /// Effects, most frequent first.
    pub effects: Vec<(String, usize)>,
    /// What is more than chance, and whether it is new.
    pub findings: Vec<(FleetFinding, bool)>,
}

impl Summary {
    /// Counts. `confusion`: share of the faulty that is found, of the healthy that is accused.
    pub fn new(rows: &[Row], standing: &Standing, found: &[FleetFinding], new: &[&String], confusion: Option<(Rate, Rate)>) -> Self {
        let done: Vec<&Row> = rows.iter().filter(|r| r.status == Status::Done).collect();
        let count = |holds: &dyn Fn(&Row) -> bool| Rate::new(done.iter().filter(|r| holds(r)).count(), done.len());
        let mut effects: BTreeMap<String, usize> = BTreeMap::new();
        for effect in done.iter().flat_map(|r| standing.causes(r)) {
            *effects.entry(effect.id.clone()).or_insert(0) += 1;
        }
        let mut effects: Vec<(String, usize)> = effects.into_iter().collect();
        effects.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        let faulty = count(&|r| standing.is_faulty(r));
        Self {
            rows: rows.len(),
            unusable: rows.len() - done.len(),
            faulty,
            corrected: confusion.and_then(|(found, accused)| faulty.corrected(found, accused)),
            has_confusion: confusion.is_some(),
            unknown: count(&|r| standing.is_unknown(r)),
            healthy: count(&|r| !standing.is_faulty(r) && !standing.is_unknown(r)),
            effects,
            findings: found.iter().map(|f| (f.clone(), new.contains(&&f.name()))).collect(),
        }
    }
}

fn rate(r: Rate) -> String {
    format!("{} of {} ({:.1} %; {:.1} to {:.1} %)", r.hits, r.of, 100.0 * r.value, 100.0 * r.low, 100.0 * r.high)
}

fn corrected(s: &Summary) -> String {
    match (s.corrected, s.has_confusion) {
        (Some((v, low, high)), _) => {
            format!("{:.1} % ({:.1} to {:.1} %), corrected for what the diagnosis misses and invents", 100.0 * v, 100.0 * low, 100.0 * high)
        }
        (None, true) => "the diagnosis tells too little apart for a correction".to_owned(),
        (None, false) => "not corrected for what the diagnosis misses and invents: give `--confusion`".to_owned(),
    }
}

fn sentence(f: &FleetFinding) -> String {
    let what = std::iter::once(&f.what).chain(&f.or).cloned().collect::<Vec<_>>().join(" or ");
    let mut text = match &f.column {
        Some(column) => format!(
            "{column} {}: {} in {} of {}, elsewhere in {} of {} (p {:.1e})",
            f.group, what, f.inside.0, f.inside.1, f.outside.0, f.outside.1, f.p_value
        ),
        None => format!("{}: {} of {} look alike", what, f.inside.0, f.inside.1),
    };
    if let Some(o) = &f.onset {
        let [at, low, high] = [o.at, o.between.0, o.between.1].map(|at| if o.is_date { date(at) } else { format!("{at:.0}") });
        let ((b, before), (a, after)) = (o.before, o.after);
        let _ = write!(text, "; since {} {at} ({low} to {high}): {b} of {before} before, {a} of {after} after", o.column);
    }
    text
}

/// In a few lines.
pub fn text(s: &Summary) -> String {
    let mut text = format!("{} recordings, {} unusable\n", s.rows, s.unusable);
    let _ = writeln!(text, "with a cause          {}\n                      {}", rate(s.faulty), corrected(s));
    let _ = writeln!(text, "something unknown     {}\nnothing               {}", rate(s.unknown), rate(s.healthy));
    for (id, n) in &s.effects {
        let _ = writeln!(text, "  {id:<28} {n}");
    }
    for (f, new) in &s.findings {
        let _ = writeln!(text, "{} {}", if *new { "NEW " } else { "known" }, sentence(f));
    }
    text
}

/// Everything, `schema: "hil.fleet/1"`.
pub fn json(s: &Summary) -> String {
    let share = |r: Rate| json!({ "hits": r.hits, "of": r.of, "low": r.low, "high": r.high });
    let finding = |(f, new): &(FleetFinding, bool)| -> Value {
        let onset = f.onset.as_ref().map(
            |o| json!({ "column": o.column, "at": o.at, "between": o.between, "date": o.is_date.then(|| date(o.at)), "before": o.before, "after": o.after }),
        );
        let p_value = f.p_value.is_finite().then_some(f.p_value);
        json!({ "column": f.column, "group": f.group, "what": f.what, "or": f.or, "inside": f.inside, "outside": f.outside, "p_value": p_value, "onset": onset, "new": new })
    };
    let document = json!({
        "schema": "hil.fleet/1",
        "recordings": s.rows,
        "unusable": s.unusable,
        "faulty": share(s.faulty),
        "faulty_corrected": s.corrected.map(|(v, low, high)| json!({ "value": v, "low": low, "high": high })),
        "unknown": share(s.unknown),
        "healthy": share(s.healthy),
        "effects": s.effects.iter().map(|(id, n)| (id.clone(), json!(n))).collect::<serde_json::Map<_, _>>(),
        "findings": s.findings.iter().map(finding).collect::<Vec<_>>(),
    });
    format!("{document:#}\n")
}

/// The page; links are relative to the folder that it lies in.
pub fn page(rows: &[Row], standing: &Standing, s: &Summary, folder: &Path) -> String {
    let done: Vec<&Row> = rows.iter().filter(|r| r.status == Status::Done).collect();
    let body = html! {
        h1 { "Fleet" }
        p { (s.rows) " recordings, " (s.unusable) " unusable" }
        dl.facts {
            dt { "with a cause" } dd { (rate(s.faulty)) br; span.soft.flags { (super::page::prose(&corrected(s))) } }
            dt { "something unknown" } dd { (rate(s.unknown)) }
            dt { "nothing" } dd { (rate(s.healthy)) }
        }
        h2 { "More than chance" }
        @if s.findings.is_empty() { p { "No group of valves stands apart." } }
        ul { @for (f, new) in &s.findings { li { @if *new { strong { "new: " } } (sentence(f)) } } }
        h2 { "Effects" }
        (pareto(s, &done, standing))
        h2 { "Parameters" }
        (parameters(&done, standing))
        (by_group(&levels(rows, standing)))
        h2 { "Valves that stand apart" }
        (valves(&done, standing, folder))
        @if s.unusable > 0 { h2 { "Unusable inputs" } (unusable(rows)) }
    };
    super::page("Fleet", &body)
}

fn pareto(s: &Summary, done: &[&Row], standing: &Standing) -> Markup {
    let most = s.effects.first().map_or(1, |e| e.1).max(1);
    html! {
        @if s.effects.is_empty() { p.soft { "No valve has a cause." } } @else { .card.scroll { table.pareto {
            thead { tr { th { "effect" } th.num { "valves" } th { "" } } }
            tbody { @for (id, n) in &s.effects { tr { td { (id) } td.num { (n) } td.wide { span.gauge.fail { i style={ "width:" (100 * n / most) "%" } {} } } } } }
        } } }
        @for (column, groups) in groups(done).into_iter().filter(|(_, groups)| groups.len() <= MOST_GROUPS) {
            h3 { "By " (column) }
            .card.scroll { table {
                thead { tr { th { (column) } th.num { "valves" } th.num { "with a cause" } th { "95 % interval (Wilson)" } } }
                tbody { @for (group, members) in &groups {
                    @let hits = members.iter().filter(|m| standing.is_faulty(done[**m])).count();
                    @let r = Rate::new(hits, members.len());
                    tr { td { (group) } td.num { (members.len()) } td.num { (hits) } td { (format!("{:.1} to {:.1} %", 100.0 * r.low, 100.0 * r.high)) } }
                } }
            } }
        }
    }
}

/// Parameter and column of a figure.
type Axes = (String, String);
/// Number of the list, value, half the 95 % interval.
type Dot = (f64, f64, f64);

/// Each parameter of each effect over each number of the list, with its 95 % interval.
fn parameters(done: &[&Row], standing: &Standing) -> Markup {
    let columns = numeric_columns(done);
    let mut dots: BTreeMap<Axes, Vec<Dot>> = BTreeMap::new();
    for row in done {
        for effect in standing.causes(row) {
            for (name, (value, error, unit)) in &effect.parameters {
                for column in &columns {
                    if let Some(x) = row.tags.get(column).and_then(|t| number(t)) {
                        let label = format!("{} {name} [{unit}]", effect.id);
                        dots.entry((label, column.clone())).or_default().push((x, *value, 1.96 * error.unwrap_or(f64::NAN)));
                    }
                }
            }
        }
    }
    dots.retain(|_, d| d.len() >= 5);
    html! {
        @if dots.is_empty() { p.soft { "No effect has five values over a number of the list." } }
        @for ((label, column), dots) in dots.iter().take(24) {
            (over(done, label, column, dots))
        }
    }
}

/// Each parameter by groups.
fn by_group(levels: &[Level]) -> Markup {
    html! {
        @if !levels.is_empty() { .card.scroll { table {
            thead { tr { th { "parameter" } th { "group" } th.num { "valves" } th.num { "mean" } th.num { "95 % interval (Student)" } } }
            tbody { @for l in levels.iter().take(MOST_ROWS) {
                @let figure = |v: f64| figure(v, &l.unit);
                tr {
                    td { (l.parameter) } td { (l.column) " " (l.group) } td.num { (l.count) } td.num { (figure(l.mean)) }
                    td.num { (figure(l.interval.low)) " to " (figure(l.interval.high)) }
                }
            } }
        } } }
    }
}

fn over(done: &[&Row], label: &str, column: &str, dots: &[Dot]) -> Markup {
    let (low, high) = dots.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d.0), h.max(d.0)));
    // Dates count from the first one; nothing lies on the edge.
    let (from, axis) =
        if holds_dates(done, column) { (low, format!("{column} [days since {}]", date(low))) } else { (0.0, column.to_owned()) };
    let margin = if high > low { 0.03 * (high - low) } else { 1.0 };
    let drawn: Vec<Dot> = dots.iter().step_by(dots.len().div_ceil(MOST_DOTS)).map(|d| (d.0 - from, d.1, d.2)).collect();
    let whiskers = drawn.iter().filter(|d| d.2.is_finite());
    let (wx, wy) = whiskers.flat_map(|d| [(d.0, d.1 - d.2), (d.0, d.1 + d.2), (d.0, f64::NAN)]).unzip();
    Figure::new(format!("{label} over {column}"), axis, label)
        .series("95 % interval", Color::Neutral, Stroke::Thin, wx, wy)
        .series("valves", Color::Measured, Stroke::Points, drawn.iter().map(|d| d.0).collect(), drawn.iter().map(|d| d.1).collect())
        .ranges(Some((low - from - margin, high - from + margin)), None)
        .height(200)
        .render()
}

fn valves(done: &[&Row], standing: &Standing, folder: &Path) -> Markup {
    let mut apart: Vec<&&Row> = done.iter().filter(|r| standing.is_faulty(r) || standing.is_unknown(r)).collect();
    let base = |r: &Row| r.rmse_bar.get("base").copied().unwrap_or(0.0);
    apart.sort_by(|a, b| base(b).total_cmp(&base(a)));
    html! {
        @if apart.is_empty() { p.soft { "None." } } @else { .card.scroll { table.verdicts {
            thead { tr { th { "id" } th { "verdict" } th { "effects" } th.num { "error before" } th { "from the list" } } }
            tbody { @for row in apart.iter().take(MOST_ROWS) { tr {
                td { @if let Some(d) = &row.document { a href=(link(d, folder)) { (row.id) } } @else { (row.id) } }
                td.verdict { (row.verdict.as_deref().unwrap_or("-").replace('_', " ")) }
                td { (standing.causes(row).map(|e| e.id.as_str()).collect::<Vec<_>>().join(", ")) @if standing.is_unknown(row) { (row.remainder.as_deref().unwrap_or("")) } }
                td.num { (format!("{:.3} bar", base(row))) }
                td.what { (row.tags.iter().map(|(k, v)| format!("{k} {v}")).collect::<Vec<_>>().join(", ")) }
            } } }
        } } }
        @if apart.len() > MOST_ROWS { p.soft { "and " (apart.len() - MOST_ROWS) " more in the table" } }
    }
}

fn link(document: &str, folder: &Path) -> String {
    let path = Path::new(document);
    path.strip_prefix(folder).unwrap_or(path).display().to_string()
}

fn unusable(rows: &[Row]) -> Markup {
    let bad: Vec<&Row> = rows.iter().filter(|r| r.status == Status::Unusable).collect();
    html! {
        .card.scroll { table { tbody { @for row in bad.iter().take(MOST_ROWS) { tr { td { (row.id) } td { (row.error.as_deref().unwrap_or("")) } } } } } }
        @if bad.len() > MOST_ROWS { p.soft { "and " (bad.len() - MOST_ROWS) " more in the table" } }
    }
}
