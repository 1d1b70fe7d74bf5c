//! The page of an identification: loop with curves, residuals over current and over time, parameters.

use maud::{Markup, html};

use crate::identify::Identified;
use crate::report::page;
use crate::report::plot::{Color, Figure, Stroke};

/// Runs of which the residual over time is drawn.
const RUNS: usize = 8;

/// The findings as one self-contained page.
pub fn html(found: &Identified) -> String {
    let valve = &found.valve;
    let body = html! {
        header.top {
            div {
                h1 { (valve.name) }
                .sub { "valve model " (valve.source) }
            }
        }
        @if !found.warnings.is_empty() {
            .notice.bad { @for warning in &found.warnings { p { (page::prose(warning)) } } }
        }
        @if found.quality.adequate { p { (sentence(&found.quality.why)) } } @else { .notice.bad { p { (sentence(&found.quality.why)) } } }
        (tiles(found))
        h2 { "The loop" }
        p.soft.hint { (crate::report::page::HINT) }
        .columns { (loops(found)) (closer(found)) }
        h2 { "What the model leaves" }
        (over_current(found))
        @for trace in found.traces.iter().take(RUNS) {
            (over_time(trace))
        }
        @if found.traces.len() > RUNS { p.soft { "And " (found.traces.len() - RUNS) " more runs or windows." } }
        h2 { "Parameters" }
        (parameters(found))
        @if !found.orders.is_empty() { (orders(found)) }
        h2 { "What was found and handled" }
        .card { ul { @for note in &found.notes { li { (page::prose(note)) } } } }
        footer { "Standard errors hold for a model of the right form; they are inflated by the correlation time of the residual." }
    };
    page::page(&format!("{}: identification", valve.name), &body)
}

/// A time of the model in the digits that its error allows, in a unit that reads well.
fn time(found: &Identified, name: &str, value_s: f64) -> (String, &'static str) {
    let (factor, unit) = if value_s < 1.0 { (1e3, "ms") } else { (1.0, "s") };
    match found.parameters.iter().find(|p| p.name == name) {
        Some(p) if super::is_determined(p) => (super::digits(factor * p.value, factor * p.std_error).0, unit),
        Some(_) if value_s > 0.0 => ("not determined".into(), ""),
        _ => (format!("{:.2}", factor * value_s), unit),
    }
}

/// The text as a sentence of its own.
fn sentence(text: &str) -> Markup {
    let mut letters = text.chars();
    let first: String = letters.next().into_iter().flat_map(char::to_uppercase).collect();
    page::prose(&format!("{first}{}.", letters.as_str()))
}

fn tiles(found: &Identified) -> Markup {
    let valve = &found.valve;
    let tile = |name: &str, value: String, unit: &str, note: String| {
        html! { .tile { .name { (name) } .value { (value) " " small { (unit) } } .note { (note) } } }
    };
    let (low, high) = found.seen_a();
    html! {
        .tiles {
            (tile("RMSE of the model", format!("{:.4}", found.rmse_bar), "bar", format!("sensor noise {:.4} bar", valve.noise_bar)))
            (tile("pressure explained", explained(found.quality.fit_percent), "%", if found.quality.adequate { "the form fits".into() } else { "the form does not fit".into() }))
            (tile("RMSE of the average model", format!("{:.4}", found.rmse_average_model_bar), "bar", "mean of both curves".into()))
            @let (delay, unit) = time(found, "delay", valve.delay_s);
            @let range = [valve.delay_range_s.0, valve.delay_range_s.1].map(|t| if valve.delay_s < 1.0 { format!("{:.1} ms", 1e3 * t) } else { format!("{t:.1} s") });
            (tile("delay", delay, unit, format!("margins are judged from {} to {}", range[0], range[1])))
            @let (lag, unit) = time(found, "lag", valve.lag_s);
            (tile("lag", lag, unit, if valve.lag_s > 0.0 { String::new() } else { "none is shown by the data".into() }))
            @if let crate::valve::Hysteresis::Hyperbolic { a_bar2 } = valve.hysteresis {
                @let (value, error) = found.parameters.iter().find(|p| p.name == "a").map_or_else(|| (format!("{a_bar2:.4}"), String::new()), super::figures);
                (tile("a", value, "bar²", if error.is_empty() { "hyperbola".into() } else { format!("hyperbola, standard error {error} bar²") }))
            } @else {
                (tile("hysteresis", valve.hysteresis.name().into(), "", String::new()))
            }
            (tile("curves seen", format!("{low:.3} .. {high:.3}"), "A", valve.floor_bar.map_or(String::new(), |f| format!("floor {f:.2} bar"))))
        }
    }
}

/// A share in the digits that it has, and never rounded to all.
fn explained(percent: f64) -> String {
    if percent > 99.995 { "> 99.99".into() } else { format!("{percent:.2}") }
}

/// A sweep is a line; step tests jump, and lines between their samples would say what was not measured.
fn stroke(found: &Identified) -> Stroke {
    if found.valve.hysteresis == crate::valve::Hysteresis::None { Stroke::Points } else { Stroke::Thin }
}

fn loops(found: &Identified) -> Markup {
    let mut figure = Figure::new("Pressure over the delayed current", "current [A]", "pressure [bar]").height(420);
    let hysteresis = found.valve.hysteresis != crate::valve::Hysteresis::None;
    for (n, trace) in found.traces.iter().enumerate() {
        let name = if n == 0 { "measured" } else { "" };
        figure = figure.series(name, Color::Measured, stroke(found), trace.delayed_current_a.clone(), trace.measured_bar.clone());
    }
    let curves = &found.curves;
    figure = figure.line(
        if hysteresis { "ascending curve" } else { "curve" },
        Color::Ascending,
        curves.current_a.clone(),
        curves.ascending_bar.clone(),
    );
    if hysteresis {
        figure = figure.line("descending curve", Color::Descending, curves.current_a.clone(), curves.descending_bar.clone());
    }
    figure.caption("The curves are drawn over the range in which the recording shows them.").render()
}

/// The loop magnified: measured and model less the average of both curves.
fn closer(found: &Identified) -> Markup {
    let curves = &found.valve.curves;
    let seen = found.seen_a();
    // At a floor, and beyond what was seen, the average curve is a polynomial carried on: the loop would be a small part of the picture.
    let off = |current: &[f64], bar: &[f64]| {
        let less = |(i, p): (&f64, &f64)| if (seen.0..=seen.1).contains(i) { p - curves.average_at(*i) } else { f64::NAN };
        current.iter().zip(bar).map(less).collect::<Vec<f64>>()
    };
    let mut figure = Figure::new("The same, less the average curve", "current [A]", "pressure - average [bar]").height(420);
    for (n, trace) in found.traces.iter().enumerate() {
        let name = if n == 0 { "measured" } else { "" };
        let y = off(&trace.delayed_current_a, &trace.measured_bar);
        figure = figure.series(name, Color::Measured, stroke(found), trace.delayed_current_a.clone(), y);
    }
    let c = &found.curves;
    figure = figure.dashed("ascending curve", Color::Ascending, c.current_a.clone(), off(&c.current_a, &c.ascending_bar));
    if found.valve.hysteresis != crate::valve::Hysteresis::None {
        figure = figure.dashed("descending curve", Color::Descending, c.current_a.clone(), off(&c.current_a, &c.descending_bar));
    }
    figure
        .ranges(Some(seen), None)
        .caption("What lies between the curves is the hysteresis; a lag widens a fast loop beyond them. Drawn where the recording shows the curves.")
        .render()
}

fn over_current(found: &Identified) -> Markup {
    let mut figure = Figure::new("Residual over current", "current [A]", "measured - simulated [bar]");
    for (n, trace) in found.traces.iter().enumerate() {
        let name = if n == 0 { "residual" } else { "" };
        figure = figure.series(name, Color::Error, stroke(found), trace.delayed_current_a.clone(), error(trace));
    }
    figure.caption("A pattern here is a shape that the curves do not have; noise alone is a band of even height.").render()
}

/// Measured less simulated, as on every page.
fn error(trace: &crate::identify::Trace) -> Vec<f64> {
    trace.measured_bar.iter().zip(&trace.simulated_bar).map(|(y, p)| y - p).collect()
}

fn over_time(trace: &crate::identify::Trace) -> Markup {
    let of = trace.run.as_ref().map_or(String::new(), |run| format!(" of {run}"));
    html! {
        (Figure::new(format!("Pressure over time{of}"), "time [s]", "pressure [bar]")
            .series("model", Color::Feedback, Stroke::Line, trace.time_s.clone(), trace.simulated_bar.clone())
            .series("measured", Color::Reference, Stroke::Thin, trace.time_s.clone(), trace.measured_bar.clone())
            .render())
        (Figure::new(format!("Residual over time{of}"), "time [s]", "measured - simulated [bar]")
            .series("residual", Color::Error, Stroke::Thin, trace.time_s.clone(), error(trace))
            .height(160)
            .render())
    }
}

fn parameters(found: &Identified) -> Markup {
    html! {
        .card.scroll {
            table {
                thead { tr { th { "parameter" } th.num { "value" } th.num { "standard error" } th { "unit" } } }
                tbody {
                    @for p in &found.parameters {
                        @let (value, error) = super::figures(p);
                        tr { td { (p.name) } td.num { (value) } td.num { (error) } td { (p.unit) } }
                    }
                }
            }
        }
    }
}

fn orders(found: &Identified) -> Markup {
    let (x, y) = found.orders.iter().map(|o| (o.order as f64, o.heldout_bar)).unzip();
    Figure::new("Held-out error by order of the curves", "order", "error [bar]")
        .bars("held-out error", Color::Measured, x, y)
        .height(160)
        .caption("Fitted without some of the blocks or runs, judged on them; the lowest order is taken that the best does not beat beyond one standard error between the blocks.")
        .render()
}
