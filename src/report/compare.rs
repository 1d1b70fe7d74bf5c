//! Several records, recordings and simulations over each other: traces, errors against the first, loops, figures.

use std::fmt::Write as _;

use maud::{Markup, html};

use super::plot::{Color, Figure, Stroke};
use super::{badge, format};
use crate::record::TestRecord;

/// Runs that are drawn; of more, the first.
const RUNS: usize = 6;

/// What an item is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A record of a run.
    Record,
    /// A recording.
    Recording,
    /// A model, simulated on the current of the first item that has one.
    Model,
}

/// One run of an item, from its own start.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Name of the run; empty where it has none.
    pub name: String,
    /// Time since its start [s].
    pub time_s: Vec<f64>,
    /// Commanded current [A].
    pub current_a: Vec<f64>,
    /// Pressure [bar]; empty where there is none.
    pub pressure_bar: Vec<f64>,
}

/// One of the compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// What it is called.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// Its runs.
    pub tracks: Vec<Track>,
    /// Its record, where it is one.
    pub record: Option<Box<TestRecord>>,
}

/// The compared, with the difference of each from the first.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    items: Vec<Item>,
    /// Per item and run: pressure of the first less that of the item where both are measured or the item is a model.
    differences: Vec<Vec<Vec<f64>>>,
}

/// How far an item is from the first.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Distance {
    /// The item.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// RMS of the difference [bar].
    pub rmse_bar: Option<f64>,
    /// Largest difference [bar].
    pub max_bar: Option<f64>,
    /// Samples at which both are there.
    pub samples: usize,
}

impl Comparison {
    /// Compares every item with the first: run by run in their order, over the time since the start of the run.
    pub fn new(items: Vec<Item>) -> Self {
        let differences = items
            .iter()
            .map(|item| items[0].tracks.iter().zip(&item.tracks).map(|(first, track)| difference(first, track)).collect())
            .collect();
        Self { items, differences }
    }

    /// The distances of all items but the first.
    pub fn distances(&self) -> Vec<Distance> {
        self.items
            .iter()
            .zip(&self.differences)
            .skip(1)
            .map(|(item, runs)| {
                let finite: Vec<f64> = runs.iter().flatten().copied().filter(|v| v.is_finite()).collect();
                let some = !finite.is_empty();
                Distance {
                    name: item.name.clone(),
                    kind: item.kind,
                    rmse_bar: some.then(|| (finite.iter().map(|v| v * v).sum::<f64>() / finite.len() as f64).sqrt()),
                    max_bar: some.then(|| finite.iter().fold(0.0, |m: f64, v| m.max(v.abs()))),
                    samples: finite.len(),
                }
            })
            .collect()
    }

    /// The figures as data.
    pub fn figures(&self) -> serde_json::Value {
        let of = |v: Option<f64>| v.map(|v| (v * 1e6).round() / 1e6);
        let distances: Vec<serde_json::Value> = self
            .distances()
            .iter()
            .map(|d| serde_json::json!({ "name": d.name, "kind": d.kind, "rmse_bar": of(d.rmse_bar), "max_bar": of(d.max_bar), "samples": d.samples }))
            .collect();
        serde_json::json!({ "schema": "hil.comparison/1", "first": self.items[0].name, "against_first": distances })
    }
}

/// The first less the other at the times of the first; NaN where one of them is not there.
fn difference(first: &Track, other: &Track) -> Vec<f64> {
    if first.pressure_bar.is_empty() || other.pressure_bar.is_empty() {
        return Vec::new();
    }
    let mut at = 0;
    let read = |(t, p): (&f64, &f64)| {
        while at + 1 < other.time_s.len() && other.time_s[at + 1] <= *t {
            at += 1;
        }
        let (t0, p0) = (other.time_s[at], other.pressure_bar[at]);
        if (t - t0).abs() < 1e-9 {
            return p - p0;
        }
        match (other.time_s.get(at + 1), other.pressure_bar.get(at + 1)) {
            (Some(t1), Some(p1)) if *t > t0 => p - (p0 + (p1 - p0) * (t - t0) / (t1 - t0)),
            _ => f64::NAN,
        }
    };
    first.time_s.iter().zip(&first.pressure_bar).map(read).collect()
}

fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::Record => "record",
        Kind::Recording => "recording",
        Kind::Model => "simulated on the first current",
    }
}

fn print(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |v| format::quantity(v, "bar"))
}

/// The distances for a terminal.
pub fn text(c: &Comparison) -> String {
    let width = c.items.iter().map(|i| i.name.chars().count()).max().unwrap_or(0).max(8);
    let mut out = format!("{:<width$}  {:>12}  {:>12}  {:>9}\n", "against", "RMS", "largest", "samples");
    let _ = writeln!(out, "{:<width$}  ({})", c.items[0].name, kind(c.items[0].kind));
    for d in c.distances() {
        let _ = writeln!(out, "{:<width$}  {:>12}  {:>12}  {:>9}", d.name, print(d.rmse_bar), print(d.max_bar), d.samples);
    }
    out
}

/// The page.
pub fn page(c: &Comparison) -> String {
    let first = &c.items[0];
    let body = html! {
        header.top {
            div {
                h1 { "Comparison" }
                .sub { (c.items.iter().map(|i| i.name.as_str()).collect::<Vec<_>>().join(", ")) ", each against " b { (first.name) } }
            }
        }
        .tiles {
            @for d in c.distances() {
                .tile { .name { (d.name) } .value { (d.rmse_bar.map_or("-".into(), |v| format!("{v:.3}"))) " " small { "bar" } } .note { "RMS, largest " (print(d.max_bar)) ", " (kind(d.kind)) } }
            }
        }
        h2 { "Over time" }
        p.soft.hint { (super::page::HINT) }
        @for n in 0..first.tracks.len().min(RUNS) { (over_time(c, n)) }
        @if first.tracks.len() > RUNS { p.soft { "And " (first.tracks.len() - RUNS) " more runs, which count in the figures above." } }
        h2 { "Over the current" }
        (loops(c))
        @if c.items.iter().filter(|i| i.record.is_some()).count() > 1 { h2 { "Figures of the records" } (records(c)) }
        footer { "Differences are " b { (first.name) } " less the other, at the times of " b { (first.name) } ": measured less simulated where the other is a model. Runs are laid over each other in their order, each from its own start." }
    };
    super::page(&format!("Comparison with {}", first.name), &body)
}

/// Dashes and weight tell the lines apart where colours do not.
fn stroke(n: usize) -> Stroke {
    if n == 0 {
        Stroke::Line
    } else if n % 2 == 1 {
        Stroke::Dashed
    } else {
        Stroke::Thin
    }
}

fn over_time(c: &Comparison, run: usize) -> Markup {
    let of = match c.items[0].tracks[run].name.as_str() {
        "" => String::new(),
        name => format!(", run {name}"),
    };
    let label = if c.items[0].tracks.len() > 1 { format!("time of run {} [s]", run + 1) } else { "time [s]".into() };
    let mut pressure = Figure::new(format!("Pressure{of}"), label.as_str(), "pressure [bar]").height(280);
    let mut current = Figure::new(format!("Current{of}"), label.as_str(), "current [A]").height(160);
    let mut error = Figure::new(format!("{} less the others{of}", c.items[0].name), label.as_str(), "difference [bar]").height(180);
    let range = c.items[0].tracks[run].time_s.first().copied().zip(c.items[0].tracks[run].time_s.last().copied());
    for (n, item) in c.items.iter().enumerate() {
        let Some(track) = item.tracks.get(run) else { continue };
        if !track.pressure_bar.is_empty() {
            pressure = pressure.series(item.name.as_str(), Color::nth(n), stroke(n), track.time_s.clone(), track.pressure_bar.clone());
        }
        // A model has no current of its own.
        if item.kind != Kind::Model || n == 0 {
            current = current.series(item.name.as_str(), Color::nth(n), stroke(n), track.time_s.clone(), track.current_a.clone());
        }
        if n > 0
            && let Some(values) = c.differences[n].get(run).filter(|v| !v.is_empty())
        {
            error = error.series(item.name.as_str(), Color::nth(n), Stroke::Thin, c.items[0].tracks[run].time_s.clone(), values.clone());
        }
    }
    html! { (pressure.ranges(range, None).render()) (error.ranges(range, None).render()) (current.ranges(range, None).render()) }
}

fn loops(c: &Comparison) -> Markup {
    let mut figure = Figure::new("Pressure over current", "current [A]", "pressure [bar]").height(380);
    for (n, item) in c.items.iter().enumerate() {
        for (k, track) in item.tracks.iter().take(RUNS).enumerate().filter(|(_, t)| !t.pressure_bar.is_empty()) {
            let name = if k == 0 { item.name.as_str() } else { "" };
            figure = figure.series(name, Color::nth(n), Stroke::Thin, track.current_a.clone(), track.pressure_bar.clone());
        }
    }
    figure.caption("The command as it was given: a delay widens a fast loop.").render()
}

fn records(c: &Comparison) -> Markup {
    let records: Vec<(&str, &TestRecord)> = c.items.iter().filter_map(|i| Some((i.name.as_str(), i.record.as_deref()?))).collect();
    let mut rows: Vec<(String, String)> = Vec::new();
    for phase in records.iter().flat_map(|r| &r.1.phases) {
        for measurement in &phase.measurements {
            let row = (phase.name.clone(), measurement.definition.clone());
            if !rows.contains(&row) {
                rows.push(row);
            }
        }
    }
    let find = |record: &TestRecord, row: &(String, String)| {
        record.phases.iter().find(|p| p.name == row.0).and_then(|p| p.measurements.iter().find(|m| m.definition == row.1)).cloned()
    };
    html! {
        .card.scroll {
            table.wide {
                thead { tr { th { "phase" } th { "figure" } @for (name, record) in &records { th.num { (name) " " (badge(format::run_verdict(record), false)) } } } }
                tbody {
                    @for row in &rows {
                        tr {
                            td { (row.0) } td { code { (row.1) } }
                            @for (_, record) in &records {
                                @match find(record, row) {
                                    Some(m) => { td.num { (format::value(&m)) @if m.limit.is_some() { .why { (format::verdict(&m)) } } } },
                                    None => td.num { "-" },
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(name: &str, time_s: &[f64], pressure_bar: &[f64]) -> Item {
        let track =
            Track { name: String::new(), time_s: time_s.to_vec(), current_a: vec![0.5; time_s.len()], pressure_bar: pressure_bar.to_vec() };
        Item { name: name.into(), kind: Kind::Recording, tracks: vec![track], record: None }
    }

    #[test]
    fn the_first_less_the_others_at_the_times_of_the_first() {
        let c = Comparison::new(vec![item("a", &[0.0, 1.0, 2.0, 3.0], &[0.0, 1.0, 2.0, 9.0]), item("b", &[0.0, 2.0], &[0.5, 2.5])]);
        let d = &c.distances()[0];
        assert_eq!((d.samples, d.rmse_bar, d.max_bar), (3, Some(0.5), Some(0.5)));
        assert_eq!(&c.differences[1][0][..3], &[-0.5, -0.5, -0.5]);
        assert!(c.differences[1][0][3].is_nan(), "beyond the end of the other nothing is said");
        insta::assert_snapshot!(text(&c));
        assert!(page(&c).contains("a less the others"));
    }
}
