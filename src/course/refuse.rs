//! What carries no comparison with a model: the only refusals.

use super::{Course, CourseError};

/// A current that moves by less than this share of its size is constant: it is rounding.
const STILL: f64 = 1e-6;
/// A pressure within so many deviations of its own noise shows nothing but noise: ten thousand normal readings lie
/// within 7.8 of them.
const NOISE_ALONE: f64 = 8.0;
/// Share of the readings at each end that may be outliers.
const OUTLIERS: f64 = 0.001;

/// See [`Course::carries`].
pub fn carries(course: &Course, fewest: usize) -> Result<(), CourseError> {
    let source_name = course.source.clone();
    let (low, high) = course.current_range_a();
    let readings = course.readings();
    if readings == 0 {
        return Err(match course.apart.clone() {
            Some((current_s, pressure_s)) => CourseError::NothingInCommon { source_name, current_s, pressure_s },
            None => CourseError::MissingChannel { source_name, channel: "pressure_bar" },
        });
    }
    if readings < fewest {
        return Err(CourseError::TooShort { source_name, readings, wanted: fewest });
    }
    if high - low <= STILL * low.abs().max(high.abs()) {
        return Err(CourseError::ConstantCurrent { source_name, span_a: high - low, mean_a: 0.5 * (low + high) });
    }
    let mut pressures = course.pressure_bar();
    pressures.retain(|p| p.is_finite());
    let at =
        |values: &mut [f64], share: f64| *values.select_nth_unstable_by((share * (readings - 1) as f64).round() as usize, f64::total_cmp).1;
    let span_bar = at(&mut pressures, 1.0 - OUTLIERS) - at(&mut pressures, OUTLIERS);
    let noise_bar = course.noise.bar;
    if span_bar <= NOISE_ALONE * noise_bar || span_bar <= 0.0 {
        return Err(CourseError::ConstantPressure { source_name, span_bar, noise_bar });
    }
    Ok(())
}
