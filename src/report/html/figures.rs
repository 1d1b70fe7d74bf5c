//! The figures of the page: what was asked for and what came, over time and over each other.

use maud::{Markup, html};
use serde_json::Value;

use crate::record::{Outcome, TestRecord, Trace};
use crate::report::format;
use crate::report::plot::{Color, Figure, Scale, Stroke};
use crate::rig::Quality;
use crate::valve::Valve;

const TIME: &str = "time [s]";

/// Pressure, error and current over one time axis.
pub fn over_time(record: &TestRecord, trace: &Trace) -> Markup {
    let time = || trace.time_s.clone();
    let closed = trace.target_bar.iter().any(|v| v.is_finite());
    let delay_s = model(record).map_or(0.0, |v| v.delay_s);
    let shifted: Vec<f64> = time().into_iter().map(|t| t + delay_s).collect();
    let range = trace.time_s.first().copied().zip(trace.time_s.last().copied());

    let mut pressure = with_phases(Figure::new("Pressure", TIME, "pressure [bar]").height(290), record);
    if closed {
        let name = if delay_s > 0.0 { format!("reference, delayed by {:.0} ms", delay_s * 1e3) } else { "reference".into() };
        pressure = pressure.series(name, Color::Reference, Stroke::Dashed, shifted, trace.target_bar.clone());
    }
    pressure = pressure.series("measured", Color::Measured, Stroke::Line, time(), trace.pressure_bar.clone());
    let bad = |i: &usize| trace.quality.get(*i).is_some_and(|q| *q != Quality::Good);
    let bad: Vec<usize> = (0..trace.time_s.len()).filter(bad).collect();
    if !bad.is_empty() {
        let pick = |v: &[f64]| bad.iter().filter_map(|i| v.get(*i).copied()).collect();
        pressure = pressure.points("held, stale or implausible sample", Color::Limit, pick(&trace.time_s), pick(&trace.pressure_bar));
    }

    let mut current = Figure::new("Current", TIME, "current [A]").height(200);
    if closed {
        current = current.series("feed-forward", Color::FeedForward, Stroke::Line, time(), trace.feed_forward_a.clone());
    }
    current = current.series("command", Color::Reference, Stroke::Thin, time(), trace.current_a.clone());
    if trace.current_meas_a.iter().any(|v| v.is_finite()) {
        current = current.series("measured", Color::Measured, Stroke::Thin, time(), trace.current_meas_a.clone());
    }

    html! {
        (pressure.ranges(range, None).render())
        @if closed {
            (tolerance(Figure::new("Error: measured less delayed reference", TIME, "error [bar]").height(170), record)
                .series("error", Color::Error, Stroke::Thin, time(), error_bar(trace, delay_s))
                .ranges(range, None).render())
        }
        (current.ranges(range, None).render())
        @if trace.feedback_a.iter().any(|v| v.is_finite() && *v != 0.0) {
            (Figure::new("Part of the current from the feedback", TIME, "feedback [mA]").height(150)
                .series("feedback", Color::Feedback, Stroke::Thin, time(), trace.feedback_a.iter().map(|a| a * 1e3).collect())
                .ranges(range, None).render())
        }
    }
}

/// The largest error that each phase allows, as two edges over its time.
fn tolerance(figure: Figure, record: &TestRecord) -> Figure {
    let (mut x, mut upper) = (Vec::new(), Vec::new());
    for phase in &record.phases {
        let largest = phase.measurements.iter().filter(|m| m.metric == "max_error").find_map(|m| m.limit.as_ref()?.max);
        if let (Some((from, to)), Some(largest)) = (phase.span_s, largest) {
            x.extend([from, to, to]);
            upper.extend([largest, largest, f64::NAN]);
        }
    }
    if x.is_empty() {
        return figure;
    }
    let lower = upper.iter().map(|v| -v).collect();
    figure
        .dashed("limit of max_error", Color::Limit, x.clone(), upper)
        .dashed("", Color::Limit, x, lower)
        .caption("Dashed: the largest error that the plan allows in the phase.")
}

fn with_phases(mut figure: Figure, record: &TestRecord) -> Figure {
    for (n, phase) in record.phases.iter().enumerate() {
        if let Some((from, to)) = phase.span_s {
            let color = match phase.outcome {
                Outcome::Fail | Outcome::Error | Outcome::Invalid | Outcome::Aborted => Color::Error,
                _ if n % 2 == 0 => Color::Neutral,
                _ => Color::Clear,
            };
            figure = figure.band_x(phase.name.clone(), color, from, to);
        }
    }
    figure
}

/// The difference that the error figure draws.
fn error_bar(trace: &Trace, delay_s: f64) -> Vec<f64> {
    let reference = delayed(&trace.time_s, &trace.target_bar, delay_s);
    trace.pressure_bar.iter().zip(reference).map(|(p, r)| p - r).collect()
}

/// `values` read `delay_s` earlier, between the samples; NaN before the first.
fn delayed(time_s: &[f64], values: &[f64], delay_s: f64) -> Vec<f64> {
    if delay_s == 0.0 {
        return values.to_vec();
    }
    let mut at = 0;
    let last = time_s.len().saturating_sub(1);
    let read = |t: &f64| {
        let wanted = t - delay_s;
        while at < last && time_s[at + 1] <= wanted {
            at += 1;
        }
        if wanted < time_s[at] || at == last {
            return f64::NAN;
        }
        let part = (wanted - time_s[at]) / (time_s[at + 1] - time_s[at]);
        // At a sample its own value counts, also where the next one is missing.
        if part == 0.0 { values[at] } else { values[at] + part * (values[at + 1] - values[at]) }
    };
    time_s.iter().map(read).collect()
}

/// The hysteresis loop with the reference curves of the model.
pub fn loops(record: &TestRecord, trace: &Trace) -> Markup {
    let model = model(record);
    if trace.time_s.is_empty() && model.is_none() {
        return html! {};
    }
    let delay_s = model.as_ref().map_or(0.0, |v| v.delay_s);
    let command = delayed(&trace.time_s, &trace.current_a, delay_s);
    let axis = if delay_s > 0.0 { format!("current, delayed by {:.0} ms [A]", delay_s * 1e3) } else { "current [A]".into() };
    let mut figure = Figure::new("Pressure over current", axis.as_str(), "pressure [bar]").height(380);
    if !trace.time_s.is_empty() {
        figure = figure.series("measured", Color::Measured, Stroke::Thin, command.clone(), trace.pressure_bar.clone());
    }
    let mut closer = None;
    if let Some(valve) = model {
        let curves = &valve.curves;
        let (low, high) = curves.range_a;
        let current: Vec<f64> = (0..=200).map(|n| low + (high - low) * f64::from(n) / 200.0).collect();
        let grid = current.clone();
        let of = |curve: &dyn Fn(f64) -> f64| grid.iter().map(|i| curve(*i)).collect::<Vec<f64>>();
        let (rising, falling) = (of(&|i| curves.ascending_at(i)), of(&|i| curves.descending_at(i)));
        figure = figure
            .dashed(format!("ascending curve of {}", valve.name), Color::Ascending, current.clone(), rising)
            .dashed("descending curve", Color::Descending, current.clone(), falling)
            .caption("The path of the samples and the reference curves of the model that the controller used.");
        let off = |curve: &dyn Fn(f64) -> f64| of(&|i| curve(i) - curves.average_at(i));
        let sampled = command.iter().zip(&trace.pressure_bar).map(|(i, p)| p - curves.average_at(*i)).collect();
        let within = command.iter().copied().filter(|i| i.is_finite());
        let seen = within.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), i| (l.min(i), h.max(i)));
        closer = Some(
            Figure::new("The same, less the average curve", axis.as_str(), "pressure - average [bar]")
                .height(380)
                .series("measured", Color::Measured, Stroke::Thin, command.clone(), sampled)
                .dashed("ascending curve", Color::Ascending, current.clone(), off(&|i| curves.ascending_at(i)))
                .dashed("descending curve", Color::Descending, current, off(&|i| curves.descending_at(i)))
                .ranges((seen.0 < seen.1).then_some(seen), None)
                .caption("The loop magnified. The command is delayed by the dead time of the model; what lag remains widens a fast loop."),
        );
    }
    html! {
        h2 { "Hysteresis" }
        @match closer {
            Some(closer) => .columns { (figure.render()) (closer.render()) },
            None => (figure.render()),
        }
    }
}

/// The boundary of stability in the plane of the gains, with the operating point.
pub fn stability(stability: &Value) -> Markup {
    let curve = |at: &str| -> Option<(Vec<f64>, Vec<f64>)> {
        let points = stability.pointer(at)?.as_array()?;
        Some(points.iter().filter_map(|p| Some((p.get(0)?.as_f64()?, p.get(1)?.as_f64()?))).filter(|p| p.0 >= 0.0 && p.1 >= 0.0).unzip())
    };
    let mut figure = Figure::new("Stability boundary", "K_P [mA/bar]", "K_I [mA/(bar s)]").height(300);
    if let Some((mut x, mut y)) = curve("/boundary/exact").filter(|c| !c.0.is_empty()) {
        figure = figure.line("exact delay", Color::Measured, x.clone(), y.clone());
        x.extend([x[x.len() - 1], x[0]]);
        y.extend([0.0, 0.0]);
        figure = figure.series("", Color::Good, Stroke::Area, x, y);
    }
    if let Some((x, y)) = curve("/boundary/routh") {
        figure = figure.dashed("Routh with Pade form, Eq. (18)", Color::Descending, x, y);
    }
    if let Some((kp, ki)) = format::gains(stability) {
        figure = figure.marker(format!("K_P {kp}, K_I {ki}"), Color::Error, kp, ki);
    }
    figure.caption("Shaded: stable with the exact delay. Gains outside the shaded area make the loop oscillate.").render()
}

/// Histograms of the lateness and of the period, where the rig has a clock.
pub fn timing(record: &TestRecord) -> Markup {
    let histogram = |title: &str, label: &str, classes: &[(f64, u64)]| {
        let classes: Vec<(f64, f64)> = classes.iter().map(|(edge, count)| (edge * 1e6, *count as f64)).collect();
        let wide = classes.first().zip(classes.last()).is_some_and(|(first, last)| first.0 > 0.0 && last.0 > 50.0 * first.0);
        let scale = if wide { Scale::Log } else { Scale::Linear };
        Figure::new(title, label, "samples").scales(scale, Scale::Linear).height(200).histogram("", Color::Measured, &classes).render()
    };
    let timing = &record.timing;
    html! {
        @if !timing.lateness_histogram.is_empty() || !timing.period_histogram.is_empty() {
            .columns {
                @if !timing.lateness_histogram.is_empty() { (histogram("Lateness of the slots", "lateness [us]", &timing.lateness_histogram)) }
                @if !timing.period_histogram.is_empty() { (histogram("Time between samples", "period [us]", &timing.period_histogram)) }
            }
        }
    }
}

/// The controller's model as the record holds it: the text of a valve file, or the same as an object.
fn model(record: &TestRecord) -> Option<Valve> {
    let text = match record.model.as_ref()? {
        Value::String(text) => text.clone(),
        object => toml::to_string(object).ok()?,
    };
    Valve::from_toml(&text, "record").ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delayed_value_is_read_between_the_samples() {
        let read = delayed(&[0.0, 1.0, 2.0, 3.0], &[0.0, 10.0, f64::NAN, 30.0], 1.0);
        assert!(read[0].is_nan() || read[0] == 0.0);
        assert_eq!(read[1..3], [0.0, 10.0]);
        assert!(read[3].is_nan());
        assert_eq!(delayed(&[0.0, 1.0, 2.0], &[0.0, 10.0, 20.0], 0.5)[1..], [5.0, 15.0]);
        assert!(delayed(&[], &[], 1.0).is_empty());
    }
}
