//! What each recording contributed: what it excites, and what the model leaves of it.

use super::segment::{Segment, shortest_step_s};
use super::select::correlation_of;
use crate::course::Course;
use crate::units::{Current, Pressure, Time};
use crate::valve::IdentifiedRecording;

/// Bands of pressure in which the error is told apart.
const BANDS: usize = 6;
/// Fewest samples of a band that has a figure.
const FEWEST: f64 = 20.0;
/// Share of the moving samples that are slower than the rate that is told.
const SLOWER: f64 = 0.9;

/// The recordings as they stand in the valve file; `residual` holds the residuals of the segments one after the other.
pub(super) fn recordings(
    courses: &[Course],
    sha256: &[String],
    segments: &[Segment],
    residual: &[f64],
    noise_bar: f64,
) -> Vec<IdentifiedRecording> {
    let mut offset = 0;
    let placed: Vec<(&Segment, &[f64])> = segments
        .iter()
        .map(|s| {
            offset += s.len();
            (s, &residual[offset - s.len()..offset])
        })
        .collect();
    courses
        .iter()
        .enumerate()
        .filter_map(|(source, course)| {
            let own: Vec<_> = placed.iter().copied().filter(|(s, _)| s.source == source).collect();
            described(course, sha256.get(source).cloned(), &own, noise_bar)
        })
        .collect()
}

fn described(course: &Course, sha256: Option<String>, own: &[(&Segment, &[f64])], noise_bar: f64) -> Option<IdentifiedRecording> {
    let step_s = own.first().map(|_| shortest_step_s(own.iter().map(|(s, _)| *s)))?;
    let used = || own.iter().flat_map(|(s, r)| (0..s.len()).filter(|k| s.weight[*k] > 0.0).map(move |k| (s.pressure_bar[k], r[k])));
    let wide = |(low, high): (f64, f64), v: f64| (low.min(v), high.max(v));
    let empty = (f64::INFINITY, f64::NEG_INFINITY);
    let pressure = used().map(|u| u.0).fold(empty, wide);
    let current = own.iter().flat_map(|(s, _)| s.current_a.iter().copied()).fold(empty, wide);
    let (count, squares) = used().fold((0.0, 0.0), |(n, q), (_, r)| (n + 1.0, q + r * r));
    if count == 0.0 {
        return None;
    }
    let mut rates: Vec<f64> =
        own.iter().flat_map(|(s, _)| s.current_a.windows(2).map(|w| (w[1] - w[0]).abs() / s.step_s)).filter(|r| *r > 0.0).collect();
    rates.sort_unstable_by(f64::total_cmp);
    let mut bands = [(0.0, 0.0); BANDS];
    for (p, r) in used() {
        let place = ((p - pressure.0) / (pressure.1 - pressure.0) * BANDS as f64) as usize;
        let (n, q) = &mut bands[place.min(BANDS - 1)];
        (*n, *q) = (*n + 1.0, *q + r * r);
    }
    let middle = |k: usize| pressure.0 + (pressure.1 - pressure.0) * (k as f64 + 0.5) / BANDS as f64;
    let rounded = |v: f64, digits: f64| (v * digits).round() / digits;
    let bar = |v: f64| Pressure::new(rounded(v, 1e5));
    let mean_square = squares / count;
    Some(IdentifiedRecording {
        name: course.source.clone(),
        sha256,
        samples: count as usize,
        step: Time::new(step_s),
        current: (Current::new(rounded(current.0, 1e6)), Current::new(rounded(current.1, 1e6))),
        pressure: (bar(pressure.0), bar(pressure.1)),
        fast_rate_a_per_s: rounded(rates.get(((rates.len() as f64) * SLOWER) as usize).copied().unwrap_or(0.0), 1e4),
        rmse: bar(mean_square.sqrt()),
        form_error: bar((mean_square - noise_bar * noise_bar).max(0.0).sqrt()),
        correlation_time: Time::new(rounded(correlation_of(own.iter().map(|(s, r)| (*r, s.weight.as_slice()))) * step_s, 1e5)),
        by_pressure: (0..BANDS)
            .filter(|k| bands[*k].0 >= FEWEST)
            .map(|k| (bar(middle(k)), bar((bands[k].1 / bands[k].0).sqrt())))
            .collect(),
    })
}
