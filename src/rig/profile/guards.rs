//! The checks of what guards a run: interlocks, lost samples in a row, and a device that repeats its last value.

use super::context::Context;
use super::cycle_file::*;
use super::file::*;
use super::parts::*;
use super::signal::{Signal, SignalName};

/// Requests in a row that differ from one another where only the quantity or the last digit of the set-point tells them apart.
pub const DISTINCT: u32 = 4;
/// Lost samples in a row that end a run where the profile names no number.
const LOST_MAX: u32 = 3;

/// The interlocks in canonical units.
pub(super) fn interlock(c: &Context, file: &ProfileFile, signals: &[Signal], cycle: &Cycle) -> Result<Interlock, ProfileError> {
    let i = &file.interlock;
    let current_deviation = match (i.current_deviation, i.current_deviation_for) {
        (None, None) => None,
        (Some(by), Some(time)) if by.value() > 0.0 && time.value() > 0.0 && file.signal.current.is_some() => {
            Some((by.value(), time.value()))
        }
        _ => {
            let message = "needs `current_deviation_for` beside it, both above zero, and a measured `current`";
            return Err(c.error("interlock.current_deviation", message));
        }
    };
    let lost_max = i.lost_max.unwrap_or(LOST_MAX).max(1);
    if let (Some(rule), true) = (repeating(signals, cycle), lost_max > DISTINCT) {
        let message = format!(
            "{lost_max} lost samples in a row, but {rule} repeats every {DISTINCT} requests, so a reply from {DISTINCT} slots ago would pass for a fresh one; allowed: 1 to {DISTINCT}"
        );
        return Err(c.error("interlock.lost_max", message));
    }
    let pressure_max_bar = i.pressure_max.map(|q| q.value());
    let sensor = signals.iter().find(|s| s.name == SignalName::Pressure).and_then(|s| s.valid);
    // No valve moves its pressure over half of what the bench may see from one sample to the next: that is a spike of the sensor.
    let largest_bar = pressure_max_bar.or(sensor.map(|(low, high)| high - low));
    Ok(Interlock {
        pressure_max_bar,
        pressure_rate_max_bar_per_s: i.pressure_rate_max.map(|q| q.value()),
        pressure_step_max_bar: largest_bar.map(|bar| 0.5 * bar).filter(|_| i.pressure_rate_max.is_none()),
        current_max_a: i.current_max.map(|q| q.value()),
        current_deviation,
        lost_max,
    })
}

/// The proof of freshness that repeats soonest, where one of the slot's does.
fn repeating(signals: &[Signal], cycle: &Cycle) -> Option<&'static str> {
    let token = signals.iter().any(|s| s.name == SignalName::Token);
    cycle.transactions.iter().find_map(|t| match t.freshness {
        Freshness::Quantity => Some("the quantity"),
        Freshness::Echo if !token => Some("the last digit of the set-point"),
        _ => None,
    })
}

/// Where no counter shows that the measured values are new, only `frozen_after` notices a device that repeats its last value.
pub(super) fn frozen(c: &Context, file: &ProfileFile, signals: &[Signal]) -> Result<(), ProfileError> {
    let counter = signals.iter().any(|s| s.name == SignalName::Counter);
    match &file.signal.pressure {
        Some(pressure) if !counter && pressure.frozen_after.is_none() => Err(c.error(
            "signal.pressure.frozen_after",
            "missing: without a `counter` nothing notices a device that repeats its last value; write for instance frozen_after = \"500 ms\"",
        )),
        _ => Ok(()),
    }
}
