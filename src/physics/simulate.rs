//! A recorded run through a valve model, on the times of its samples.

use std::borrow::Cow;

use super::error::PhysicsError;
use super::finite::blame;
use super::pipeline::Pipeline;
use super::signal::Signals;
use crate::valve::{Input, Valve};

/// Time steps of which one differs by more than this share from their mean are resampled.
const UNEVEN: f64 = 0.02;

/// Simulates one recorded run: pressure [bar] at each time, free-running from the average curve at its first current.
///
/// A gap (NaN) in the current holds its last value. Uneven times are simulated on an even grid of their median step.
///
/// # Errors
/// [`PhysicsError`] for unequal lengths, times that do not increase, a current that is never recorded, a pressure that
/// leaves the numbers.
pub fn simulate(valve: &Valve, input: Input, time_s: &[f64], current_a: &[f64]) -> Result<Vec<f64>, PhysicsError> {
    simulate_with(valve, input, time_s, &Signals::current(current_a))
}

/// As [`simulate`], with what else was recorded for the effects to use.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_with(valve: &Valve, input: Input, time_s: &[f64], signals: &Signals<'_>) -> Result<Vec<f64>, PhysicsError> {
    let current_a = signals.current_a;
    for (what, length) in [
        ("currents", Some(current_a.len())),
        ("temperatures", signals.oil_temp_c.map(<[f64]>::len)),
        ("supply pressures", signals.supply_bar.map(<[f64]>::len)),
    ] {
        if let Some(length) = length.filter(|l| *l != time_s.len()) {
            return Err(PhysicsError::Input(format!("{} times, but {length} {what}", time_s.len())));
        }
    }
    if let Some(row) = time_s.windows(2).position(|w| w[1] <= w[0] || w[1].is_nan() || w[0].is_nan()) {
        return Err(PhysicsError::Input(format!("time does not increase at sample {}", row + 2)));
    }
    let Some(first) = current_a.iter().copied().find(|i| i.is_finite()) else {
        return if current_a.is_empty() { Ok(Vec::new()) } else { Err(PhysicsError::Input("the current is never recorded".into())) };
    };
    let held = without_gaps(current_a, first);
    let pipeline = Pipeline { input, ..Pipeline::of(valve)? };
    let (mut work, mut pressure) = (Vec::new(), Vec::new());
    let finite = |pressure: Vec<f64>, dt_s: f64, signals: &Signals<'_>| match pressure.iter().position(|p| !p.is_finite()) {
        None => Ok(pressure),
        Some(k) => Err(blame(&pipeline, (time_s[0], dt_s), signals, k)),
    };
    if time_s.len() < 2 || pipeline.is_static() {
        let signals = signals.with_current(&held);
        pipeline.run(time_s[0], 0.01, &signals, &mut work, &mut pressure);
        return finite(pressure, 0.01, &signals);
    }
    let span = time_s[time_s.len() - 1] - time_s[0];
    let dt_s = span / (time_s.len() - 1) as f64;
    if time_s.windows(2).all(|w| (w[1] - w[0] - dt_s).abs() <= UNEVEN * dt_s) {
        let signals = signals.with_current(&held);
        pipeline.run(time_s[0], dt_s, &signals, &mut work, &mut pressure);
        return finite(pressure, dt_s, &signals);
    }
    let mut steps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = steps.len() / 2;
    let dt_s = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let n = (span / dt_s).ceil();
    if n.is_nan() || n > (50 * time_s.len() + 1000) as f64 {
        return Err(PhysicsError::Input(format!(
            "the times leave gaps of up to {:.1} s at a step of {dt_s} s: split the recording into runs",
            steps.iter().fold(0.0, |a: f64, b| a.max(*b))
        )));
    }
    let even: Vec<f64> = (0..=n as usize).map(|k| time_s[0] + k as f64 * dt_s).collect();
    let current = match input {
        Input::Held => latest(time_s, &held, &even),
        Input::Ramp => interpolate(time_s, &held, &even),
    };
    let [oil, supply] = [signals.oil_temp_c, signals.supply_bar].map(|c| c.map(|c| interpolate(time_s, c, &even)));
    let signals = Signals { current_a: &current, oil_temp_c: oil.as_deref(), supply_bar: supply.as_deref(), ..*signals };
    pipeline.run(time_s[0], dt_s, &signals, &mut work, &mut pressure);
    Ok(interpolate(&even, &finite(pressure, dt_s, &signals)?, time_s))
}

/// A current whose gaps hold its last value, and before the first value that one.
fn without_gaps(current_a: &[f64], first_a: f64) -> Cow<'_, [f64]> {
    if current_a.iter().all(|i| i.is_finite()) {
        return Cow::Borrowed(current_a);
    }
    let mut last = first_a;
    let hold = |i: &f64| {
        if i.is_finite() {
            last = *i;
        }
        last
    };
    Cow::Owned(current_a.iter().map(hold).collect())
}

/// The value at `at` of what is `y` from each `x` on.
fn latest(x: &[f64], y: &[f64], at: &[f64]) -> Vec<f64> {
    let mut k = 0;
    at.iter()
        .map(|t| {
            while k + 1 < x.len() && x[k + 1] <= *t {
                k += 1;
            }
            y[k]
        })
        .collect()
}

/// Linear interpolation of `(x, y)` at increasing `at`; beyond the ends the end values.
fn interpolate(x: &[f64], y: &[f64], at: &[f64]) -> Vec<f64> {
    let mut k = 0;
    at.iter()
        .map(|t| {
            while k + 2 < x.len() && x[k + 1] <= *t {
                k += 1;
            }
            let share = ((t - x[k]) / (x[k + 1] - x[k])).clamp(0.0, 1.0);
            y[k] + share * (y[k + 1] - y[k])
        })
        .collect()
}
