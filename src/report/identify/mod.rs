//! What `hil identify` found, as text, as JSON and as a page.

mod html;

pub use html::html;

use std::fmt::Write;

use serde_json::{Value, json};

use crate::identify::{CurvePoint, Identified, Parameter};
use crate::report::text::{COLUMNS, fold};
use crate::valve::Hysteresis;

/// The JSON document; the keys are part of the contract.
pub fn json(found: &Identified) -> String {
    let valve = &found.valve;
    let a_bar2 = valve.hysteresis.a_bar2();
    let parameter = |p: &Parameter| {
        let known = p.std_error.is_finite();
        let interval = known.then_some([p.interval.0, p.interval.1]);
        (p.name.clone(), json!({ "value": p.value, "std_error": known.then_some(p.std_error), "interval": interval, "unit": p.unit }))
    };
    let document = json!({
        "schema": "hil.identification/1",
        "valve": valve.name,
        "curve": {
            "ascending": valve.curves.ascending.coefficients,
            "descending": valve.curves.descending.coefficients,
            "r2_ascending": found.r2_ascending,
            "r2_descending": found.r2_descending,
            "range_a": [valve.curves.range_a.0, valve.curves.range_a.1],
            "points": found.curve_points.iter().map(point).collect::<Vec<_>>(),
        },
        "hysteresis": valve.hysteresis.name(),
        "plays": plays(&valve.hysteresis),
        "input": found.input.name(),
        "a_bar2": a_bar2,
        "delay_s": valve.delay_s,
        "delay_range_s": [valve.delay_range_s.0, valve.delay_range_s.1],
        "lag_s": valve.lag_s,
        "floor_bar": valve.floor_bar,
        "noise_bar": valve.noise_bar,
        "fit_percent": found.quality.fit_percent,
        "adequate": found.quality.adequate,
        "why": found.quality.why,
        "residual": {
            "noise_ratio": found.quality.noise_ratio.is_finite().then_some(found.quality.noise_ratio),
            "share_by_current": found.quality.by_current,
            "share_by_rate": found.quality.by_rate,
        },
        "heldout_bar": found.heldout_bar,
        "recordings": recordings(found),
        "rmse_bar": found.rmse_bar,
        "rmse_fitted_bar": found.rmse_fitted_bar,
        "rmse_average_model_bar": found.rmse_average_model_bar,
        "parameters": Value::Object(found.parameters.iter().map(parameter).collect()),
        "correlation_time_samples": found.correlation_time_samples,
        "orders": found.orders.iter().map(|o| json!({ "order": o.order, "heldout_bar": o.heldout_bar })).collect::<Vec<_>>(),
        "notes": found.notes,
        "warnings": found.warnings,
    });
    let mut text = serde_json::to_string_pretty(&document).unwrap_or_default();
    text.push('\n');
    text
}

fn point(p: &CurvePoint) -> Value {
    json!({
        "current_a": p.current_a,
        "ascending_bar": p.ascending_bar,
        "ascending_std_error_bar": p.ascending_std_error_bar,
        "descending_bar": p.descending_bar,
        "descending_std_error_bar": p.descending_std_error_bar,
    })
}

/// The stack of a free loop; `null` for another form.
fn plays(hysteresis: &Hysteresis) -> Value {
    match hysteresis {
        Hysteresis::Free(stack) => {
            stack.plays().map(|(half_width, weight)| json!({ "half_width": half_width, "weight": weight })).collect()
        }
        Hysteresis::None | Hysteresis::Hyperbolic { .. } => Value::Null,
    }
}

/// What the model leaves of each recording.
fn recordings(found: &Identified) -> Vec<Value> {
    let of = found.valve.identification.iter().flat_map(|i| &i.recordings);
    of.map(|r| {
        json!({
            "name": r.name,
            "sha256": r.sha256,
            "samples": r.samples,
            "rmse_bar": r.rmse.value(),
            "form_error_bar": r.form_error.value(),
            "correlation_time_s": r.correlation_time.value(),
        })
    })
    .collect()
}

/// The findings in 80 columns.
pub fn text(found: &Identified) -> String {
    let valve = &found.valve;
    let mut out = String::new();
    let _ = writeln!(out, "{}: {}\n", valve.name, valve.source);
    let _ = writeln!(out, "{:<16} {:>14}   {:>14}   unit", "parameter", "value", "std error");
    let of_a_curve = |p: &&Parameter| p.is_coefficient();
    let told = found.parameters.iter().filter(of_a_curve).all(is_determined);
    for p in found.parameters.iter().filter(|p| told || !p.is_coefficient()) {
        let (value, error) = figures(p);
        let _ = writeln!(out, "{:<16} {value:>14} ± {error:>14}   {}", p.name, p.unit);
    }
    if !told {
        curves(&mut out, found);
    }
    let _ = writeln!(out);
    let (low, high) = found.seen_a();
    let line = |out: &mut String, name: &str, value: String| {
        let _ = writeln!(out, "{name:<34} {value}");
    };
    line(&mut out, "curves seen from", format!("{low:.4} A to {high:.4} A"));
    if let Some(floor) = valve.floor_bar {
        line(&mut out, "floor", format!("{floor:.3} bar"));
    }
    line(&mut out, "sensor noise", format!("{:.4} bar", valve.noise_bar));
    line(&mut out, "RMSE of the model", format!("{:.4} bar", found.rmse_bar));
    if (found.rmse_fitted_bar - found.rmse_bar).abs() > 5e-5 {
        line(&mut out, "RMSE where it was fitted", format!("{:.4} bar", found.rmse_fitted_bar));
    }
    line(&mut out, "pressure explained", format!("{:.3} %", found.quality.fit_percent));
    if let Some(heldout) = found.heldout_bar {
        line(&mut out, "error on held-out samples", format!("{heldout:.4} bar"));
    }
    line(&mut out, "path between the curves", valve.hysteresis.name().into());
    line(&mut out, "command between its samples", found.input.name().into());
    line(&mut out, "RMSE of the average model", format!("{:.4} bar", found.rmse_average_model_bar));
    for (name, value) in [("R^2 rising", found.r2_ascending), ("R^2 falling", found.r2_descending)] {
        if let Some(value) = value {
            // Below zero a constant would be nearer to the steady samples of this direction than the curve.
            line(&mut out, name, if value < 0.0 { "below 0: no curve".into() } else { format!("{value:.6}") });
        }
    }
    if !found.orders.is_empty() {
        let tried: Vec<String> = found.orders.iter().map(|o| format!("{}: {:.4}", o.order, o.heldout_bar)).collect();
        paragraph(&mut out, "", &format!("held-out error [bar] by order of the curves: {}", tried.join(", ")));
    }
    let recordings = valve.identification.iter().flat_map(|i| &i.recordings);
    for r in recordings.filter(|_| found.valve.identification.as_ref().is_some_and(|i| i.recordings.len() > 1)) {
        paragraph(&mut out, "recording", &format!("{}: {} samples, RMSE {:.4} bar", r.name, r.samples, r.rmse.value()));
    }
    paragraph(&mut out, "fit", &found.quality.why);
    for (title, list) in [("note", &found.notes), ("warning", &found.warnings)] {
        for item in list {
            paragraph(&mut out, title, item);
        }
    }
    out
}

/// The curves at some currents, where their coefficients are not determined one by one though the curves are.
fn curves(out: &mut String, found: &Identified) {
    let bar = |value: f64, error: f64| {
        let (value, error) = digits(value, error);
        format!("{value:>12} ± {error:<8}")
    };
    let one = found.valve.hysteresis == Hysteresis::None;
    let names = if one { ["curve [bar]", ""] } else { ["rising [bar]", "falling [bar]"] };
    let _ = writeln!(out, "\n{:<16} {:<23} {}", "current [A]", format!("{:>12}", names[0]), format!("{:>13}", names[1]).trim_end());
    for p in &found.curve_points {
        let (rising, falling) = (bar(p.ascending_bar, p.ascending_std_error_bar), bar(p.descending_bar, p.descending_std_error_bar));
        let line = if one { format!("{:<16.4} {rising}", p.current_a) } else { format!("{:<16.4} {rising} {falling}", p.current_a) };
        let _ = writeln!(out, "{}", line.trim_end());
    }
    paragraph(out, "", "The coefficients of the curves stand in the valve file; one by one the recording does not determine them.");
}

/// A paragraph whose later lines stand under the first.
fn paragraph(out: &mut String, title: &str, text: &str) {
    let lead = if title.is_empty() { String::new() } else { format!("{title}: ") };
    for (n, line) in fold(text, COLUMNS - lead.len()).iter().enumerate() {
        let _ = if n == 0 { writeln!(out, "{lead}{line}") } else { writeln!(out, "{:width$}{line}", "", width = lead.len()) };
    }
}

/// Value and error in the digits that the error allows: two of the error, the same decimals for the value.
fn figures(p: &Parameter) -> (String, String) {
    let (value, error) = digits(p.value, p.std_error);
    (if is_determined(p) { value } else { "not determined".into() }, error)
}

/// Whether a value is larger than its error.
fn is_determined(p: &Parameter) -> bool {
    !p.std_error.is_finite() || p.std_error <= 0.0 || p.std_error < p.value.abs()
}

fn digits(value: f64, error: f64) -> (String, String) {
    if !error.is_finite() || error <= 0.0 {
        return (format!("{value:.6}"), "unknown".into());
    }
    // Two digits of the error, and the value to the same place: what lies below is not known.
    let place = error.log10().floor() as i32 - 1;
    let decimals = (-place).clamp(0, 12) as usize;
    let round = |v: f64| if place > 0 { (v / 10f64.powi(place)).round() * 10f64.powi(place) } else { v };
    let plain = |v: f64| format!("{:.decimals$}", round(v));
    let text = plain(value);
    // Nothing is left of the value: zero has no sign.
    let is_zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
    (if is_zero { text.trim_start_matches('-').into() } else { text }, plain(error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_the_digits_that_its_error_allows_and_zero_has_no_sign() {
        let of = |value, error| digits(value, error);
        assert_eq!(of(7.196_44, 1.09), ("7.2".into(), "1.1".into()));
        assert_eq!(of(-42.590_4, 0.079), ("-42.590".into(), "0.079".into()));
        assert_eq!(of(-3.2, 380.0), ("0".into(), "380".into()));
    }
}
