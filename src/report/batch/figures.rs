//! The charts of the batch page: Pareto, and per metric the histogram with its limits and the control charts.

use maud::{Markup, html};

use crate::batch::statistics::MetricStatistics;
use crate::batch::summary::BatchSummary;
use crate::record::Outcome;
use crate::report::format;
use crate::report::plot::{Color, Figure, Stroke};

/// What fails most: each cause with its share of all failures as a bar, and a mark at the share of all up to it.
pub fn pareto(summary: &BatchSummary) -> Markup {
    let shown = &summary.pareto[..summary.pareto.len().min(12)];
    let all: usize = summary.pareto.iter().map(|b| b.count).sum();
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let share = |count: usize| count as f64 / all.max(1) as f64;
    html! {
        .card.scroll {
            table.pareto {
                thead { tr { th { "cause" } th.num { "failures" } th.share { "share of the failures; the mark is the sum so far" } th.num { "share" } th.num { "cumulative" } } }
                tbody {
                    @for bar in shown {
                        tr {
                            td { (bar.cause) }
                            td.num { (bar.count) }
                            td.share { span.gauge.pareto.fail { i style={ "width:" (format!("{:.1}", 100.0 * share(bar.count))) "%" } {} u style={ "left:calc(" (format!("{:.1}", 100.0 * bar.cumulative)) "% - 2px)" } {} } }
                            td.num { (percent(share(bar.count))) }
                            td.num { (percent(bar.cumulative)) }
                        }
                    }
                }
            }
            @if summary.pareto.len() > shown.len() { p.soft { "and " (summary.pareto.len() - shown.len()) " more causes" } }
        }
    }
}

/// Histogram and control charts of one metric; what the data cannot carry is said in words.
pub fn metric(summary: &BatchSummary, k: usize, m: &MetricStatistics) -> Markup {
    html! {
        .columns {
            (histogram(m))
            (individuals(summary, k, m))
        }
    }
}

fn label(m: &MetricStatistics) -> String {
    let metric = m.name.rsplit_once('/').map_or(m.name.as_str(), |(_, metric)| metric);
    if m.unit == "1" { metric.into() } else { format!("{metric} [{}]", m.unit) }
}

fn histogram(m: &MetricStatistics) -> Markup {
    let Some(h) = &m.histogram.value else {
        return html! { .card { h3 { "Histogram" } p.soft { (m.histogram.absent.as_deref().unwrap_or("absent")) } } };
    };
    let classes: Vec<(f64, f64)> = h.counts.iter().enumerate().map(|(i, c)| (h.start + h.width * (i + 1) as f64, *c as f64)).collect();
    let mut figure = Figure::new(format!("Histogram, {} valves", h.counts.iter().sum::<usize>()), label(m), "valves in the class")
        .histogram("valves", Color::Measured, &classes)
        .height(200);
    // The limits belong into the picture, unless they lie so far away that nothing else would be left of it.
    let (low, high) = (h.start, h.start + h.width * h.counts.len() as f64);
    let reach = 4.0 * (high - low);
    let (mut from, mut to) = (low - h.width, high + h.width);
    for (name, limit) in [("min", m.tolerance.min), ("max", m.tolerance.max)] {
        if let Some(limit) = limit.filter(|l| *l > low - reach && *l < high + reach) {
            figure = figure.vertical(name, Color::Limit, limit);
            from = from.min(limit - h.width);
            to = to.max(limit + h.width);
        }
    }
    if let Some(s) = &m.sample.value {
        figure = figure.vertical("mean", Color::Neutral, s.mean);
    }
    figure.ranges(Some((from, to)), None).render()
}

fn individuals(summary: &BatchSummary, k: usize, m: &MetricStatistics) -> Markup {
    let (mut x, mut y) = (Vec::new(), Vec::new());
    let judged = summary.valves.iter().filter(|v| matches!(v.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail));
    for valve in judged {
        x.push((valve.position + 1) as f64);
        y.push(valve.values.get(k).copied().unwrap_or(f64::NAN));
    }
    let stroke = if x.len() > 400 { Stroke::Thin } else { Stroke::Line };
    let mut figure = Figure::new("Individuals", "valve, in the order of the test", label(m)).height(200);
    figure = figure.series("value", Color::Measured, stroke, x.clone(), y.clone());
    match &m.chart.value {
        Some(c) => {
            figure = figure
                .horizontal("centre", Color::Neutral, c.centre)
                .horizontal("3 sigma", Color::Neutral, c.upper)
                .horizontal("-3 sigma", Color::Neutral, c.lower)
                .horizontal("upper signal limit", Color::Error, c.centre + c.signal_sigma * c.within_deviation)
                .horizontal("lower signal limit", Color::Error, c.centre - c.signal_sigma * c.within_deviation);
            let said: Vec<String> = c.signals.iter().map(|s| format!("{} ({} times)", s.text, s.count)).collect();
            let rate = format!("all rules together: {} % false alarms", 100.0 * c.false_alarms);
            let said = if said.is_empty() {
                format!("No run rule speaks ({rate}).")
            } else {
                format!("Run rules that speak ({rate}): {}.", said.join("; "))
            };
            figure = figure.caption(said);
        }
        None => figure = figure.caption(m.chart.absent.clone().unwrap_or_default()),
    }
    figure.render()
}

/// Moving ranges of one metric.
pub fn moving_range(summary: &BatchSummary, k: usize, m: &MetricStatistics) -> Markup {
    let Some(c) = &m.chart.value else { return html! {} };
    let judged = summary.valves.iter().filter(|v| matches!(v.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail));
    let points: Vec<(f64, f64)> =
        judged.map(|v| ((v.position + 1) as f64, v.values.get(k).copied().unwrap_or(f64::NAN))).filter(|p| p.1.is_finite()).collect();
    let (x, y) = points.windows(2).map(|w| (w[1].0, (w[1].1 - w[0].1).abs())).unzip();
    Figure::new("Moving range", "valve, in the order of the test", label(m))
        .series("range of two", Color::FeedForward, if points.len() > 400 { Stroke::Thin } else { Stroke::Line }, x, y)
        .horizontal("mean", Color::Neutral, c.mean_moving_range)
        .horizontal("upper limit", Color::Error, c.range_upper)
        .caption(format!("Short-term deviation {}.", format::quantity(c.within_deviation, &m.unit)))
        .height(140)
        .render()
}
