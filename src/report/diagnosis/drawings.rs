//! The figures of the page of a diagnosis.

use maud::{Markup, html};

use crate::diagnose::{Diagnosed, Diagnosis, NextExperiment, RunStory, Signature, Story};
use crate::report::plot::{Color, Figure, Scale, Stroke};

const TIME: &str = "time [s]";

/// Recording and simulations of one run, the worst stretch enlarged, the error before and after, the current.
pub fn run(found: &Diagnosed, run: &RunStory, named: bool) -> Markup {
    let (curves, d) = (&found.curves, &found.diagnosis);
    let of = |values: &[f64]| values.get(run.samples.clone()).unwrap_or_default().to_vec();
    let (time, measured, base, augmented) = (of(&curves.time_s), of(&curves.measured_bar), of(&curves.base_bar), of(&curves.augmented_bar));
    let changed = curves.augmented_bar != curves.base_bar;
    let after = after(d);
    let range = time.first().copied().zip(time.last().copied());
    let head = match (&run.name, named) {
        (Some(name), _) => format!("Pressure, run {name}"),
        (None, true) => "Pressure, one run".into(),
        (None, false) => "Pressure".into(),
    };
    let pressure = |title: String, time_label: &str| {
        // What was measured lies on top, thin: neither model hides it.
        let mut figure = Figure::new(title, time_label, "pressure [bar]");
        if changed {
            figure = figure.series(after, Color::Good, Stroke::Line, time.clone(), augmented.clone());
        }
        figure.series("model as given", Color::Error, Stroke::Dashed, time.clone(), base.clone()).series(
            "measured",
            Color::Reference,
            Stroke::Thin,
            time.clone(),
            measured.clone(),
        )
    };
    let inside = |t: &f64| (run.worst_s.0..=run.worst_s.1).contains(t);
    let span = [&measured, &base]
        .into_iter()
        .flat_map(|values| time.iter().zip(values.iter()).filter(|(t, v)| inside(t) && v.is_finite()).map(|(_, v)| *v))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let margin = 0.08 * (span.1 - span.0).max(0.05);
    let error = |model: &[f64]| measured.iter().zip(model).map(|(y, p)| y - p).collect::<Vec<f64>>();
    let noise = d.rmse_bar.noise_floor;
    let mut residual = Figure::new("Error: measured less simulated", TIME, "error [bar]")
        .height(190)
        .band_y("", Color::Neutral, -2.0 * noise, 2.0 * noise)
        .series("model as given", Color::Error, Stroke::Thin, time.clone(), error(&base))
        .ranges(range, None)
        .caption("The grey strip is twice the sensor noise: inside it there is nothing to explain.");
    if changed {
        residual = residual.series(after, Color::Good, Stroke::Thin, time.clone(), error(&augmented));
    }
    html! {
        (pressure(head, TIME).height(270).band_x("worst", Color::Error, run.worst_s.0, run.worst_s.1).ranges(range, None).render())
        (residual.render())
        .columns {
            (pressure("The worst stretch, enlarged".into(), "time of the stretch [s]").height(230)
                .ranges(Some(run.worst_s), Some((span.0 - margin, span.1 + margin))).render())
            (Figure::new("Current", TIME, "current [A]").height(230)
                .series("command", Color::Measured, Stroke::Thin, time.clone(), of(&curves.current_a))
                .ranges(range, None).render())
        }
    }
}

/// What the second simulation is called.
fn after(d: &Diagnosis) -> &'static str {
    match (d.effects.len(), d.discovered.is_some()) {
        (0, false) => "recalibrated",
        (0, true) => "with the term that was found",
        (1, false) => "with the missing effect",
        (1, true) => "with the missing effect and the term",
        (_, false) => "with the missing effects",
        (_, true) => "with the missing effects and the term",
    }
}

/// The error over time as bars: when it occurs.
pub fn slices(d: &Diagnosis, story: &Story) -> Markup {
    html! { @for run in story.runs.iter().take(3) { (slices_of(d, run)) } }
}

fn slices_of(d: &Diagnosis, run: &RunStory) -> Markup {
    let middle: Vec<f64> = run.slices.iter().map(|s| 0.5 * (s.from_s + s.to_s)).collect();
    let (head, time) = match &run.name {
        Some(name) => (format!("Error over time, run {name}"), "time of the run [s]"),
        None => ("Error over time".to_string(), TIME),
    };
    let base = run.slices.iter().map(|s| s.base_bar).collect();
    let mut figure = Figure::new(head, time, "RMS error [bar]").height(150).bars("model as given", Color::Error, middle.clone(), base);
    if d.adds() {
        figure = figure.bars(after(d), Color::Good, middle, run.slices.iter().map(|s| s.augmented_bar).collect());
    }
    figure.horizontal("sensor noise", Color::Neutral, d.rmse_bar.noise_floor).render()
}

/// The error over frequency.
pub fn spectrum(d: &Diagnosis, story: &Story) -> Markup {
    let x: Vec<f64> = story.spectrum.iter().map(|s| s.0).collect();
    let mut figure = Figure::new("Error over frequency", "frequency [Hz]", "density [bar/\u{221a}Hz]")
        .height(190)
        .scales(Scale::Log, Scale::Log)
        .line("model as given", Color::Error, x.clone(), story.spectrum.iter().map(|s| s.1).collect())
        .horizontal("white sensor noise", Color::Neutral, story.spectrum_noise);
    if super::tables::is_fitted(d) {
        figure = figure.line(after(d), Color::Good, x, story.spectrum.iter().map(|s| s.2).collect());
    }
    if let Some((low, high)) = d.place.band_hz.filter(|b| b.0 < b.1 && b.0 > 0.0) {
        figure = figure.band_x("80 % of the error", Color::Error, low, high);
    }
    figure.render()
}

/// The mean error over the variable on which it depends most.
pub fn signature(d: &Diagnosis, s: &Signature) -> Markup {
    let (quantity, remark) = if s.axis.along_movement {
        (
            "mean error along the movement [bar]",
            " Positive: the pressure is further along than the model, in the direction of the last movement of the current.",
        )
    } else {
        ("mean error [bar]", "")
    };
    // A history reaches over decades; a rate has both signs.
    let decades = s.at.iter().all(|v| *v > 0.0) && s.at.last().copied().unwrap_or(1.0) > 60.0 * s.at[0];
    let scale = if decades { Scale::Log } else { Scale::Linear };
    let noise = d.rmse_bar.noise_floor;
    Figure::new("The signature", s.axis.label.clone(), quantity)
        .height(260)
        .scales(scale, Scale::Linear)
        .band_y("", Color::Neutral, -noise, noise)
        .line("model as given", Color::Error, s.at.clone(), s.base_bar.clone())
        .points("", Color::Error, s.at.clone(), s.base_bar.clone())
        .line(after(d), Color::Good, s.at.clone(), s.augmented_bar.clone())
        .points("", Color::Good, s.at.clone(), s.augmented_bar.clone())
        .caption(format!(
            "Of all variables of the operating point, the mean error depends on this one most, and here the missing physics changes it most: from the red line to the green one. Each dot is the mean over an equal number of samples.{remark}"
        ))
        .render()
}

/// The mean of what is left over the variable on which it depends most.
pub fn rest(d: &Diagnosis, s: &Signature) -> Markup {
    let quantity = if s.axis.along_movement { "mean error along the movement [bar]" } else { "mean error [bar]" };
    let noise = d.rmse_bar.noise_floor;
    Figure::new("The rest, over the variable where most of it shows", s.axis.label.clone(), quantity)
        .height(220)
        .band_y("", Color::Neutral, -noise, noise)
        .line(
            if d.discovered.is_some() { "what the term leaves, too" } else { "what no effect carries" },
            Color::Error,
            s.at.clone(),
            s.base_bar.clone(),
        )
        .points("", Color::Error, s.at.clone(), s.base_bar.clone())
        .caption("Mean over ranges of equal count. No physics stands behind this line: it says where to look.")
        .render()
}

/// The proposed stimulus.
pub fn experiment(next: &NextExperiment) -> Markup {
    let (x, y) = next.table.iter().copied().unzip();
    Figure::new(format!("Proposed: {}", next.stimulus), "time of the experiment [s]", "current [A]")
        .height(170)
        .line("command", Color::Measured, x, y)
        .render()
}
