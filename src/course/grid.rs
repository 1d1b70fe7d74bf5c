//! A part of a run on an even grid: the command by its convention, every reading where it was taken.

use std::ops::Range;

use super::Input;
use crate::recording::Run;

/// Times that leave an even grid by less than this share of a step lie on it.
const EVEN: f64 = 0.02;
/// Grid samples per recorded sample, at most: a finer grid would only cost time.
const FINEST: usize = 50;
/// A reading should not stand farther from its place on the grid than this [steps]; farther only where they crowd.
const FAR: f64 = 1.5;
/// Shares of the shortest steps between samples that set the grid, tried in turn until the readings find their places.
const SHORTEST: [f64; 4] = [0.5, 0.25, 0.1, 0.02];

/// A part on its grid.
pub struct Laid {
    /// Time step [s]; 0 for one sample.
    pub dt_s: f64,
    pub current_a: Vec<f64>,
    pub pressure_bar: Vec<f64>,
    /// How far each reading lies behind its sample [steps].
    pub offset_steps: Option<Vec<f32>>,
    pub oil_temp_c: Option<Vec<f64>>,
    pub supply_bar: Option<Vec<f64>>,
    /// Samples that do not lie on the grid.
    pub uneven: usize,
}

/// Lays the samples `part` of a run on a grid; the columns of a run that lie on one already are moved, not copied.
pub fn lay(run: &mut Run, part: Range<usize>, input: Input) -> Laid {
    match even_step(&run.time_s[part.clone()]) {
        Some(dt_s) => {
            let moved = part == (0..run.len());
            let mut take = |values: &mut Vec<f64>| if moved { std::mem::take(values) } else { values[part.clone()].to_vec() };
            let pressure_bar = run.pressure_bar.as_mut().map(&mut take).unwrap_or_else(|| vec![f64::NAN; part.len()]);
            let slow = |values: &mut Option<Vec<f64>>| {
                values.as_mut().map(|v| {
                    let mut values = take(v);
                    fill(&mut values, Input::Ramp);
                    values
                })
            };
            let (oil_temp_c, supply_bar) = (slow(&mut run.oil_temp_c), slow(&mut run.supply_bar));
            let mut current_a = take(&mut run.current_a);
            fill(&mut current_a, input);
            Laid { dt_s, current_a, pressure_bar, offset_steps: None, oil_temp_c, supply_bar, uneven: 0 }
        }
        None => uneven(run, part, input),
    }
}

/// The step of the even grid on which all times lie; `None` where they do not. For one time 0.
fn even_step(time_s: &[f64]) -> Option<f64> {
    let (first, last) = (*time_s.first()?, *time_s.last()?);
    let steps = (time_s.len() - 1) as f64;
    if time_s.len() < 2 {
        return Some(0.0);
    }
    let dt_s = round((last - first) / steps, steps);
    let off = time_s.iter().enumerate().map(|(k, t)| (t - first - k as f64 * dt_s).abs()).fold(0.0, f64::max);
    (off <= EVEN * dt_s || rounded_by(time_s).is_some_and(|r| r <= 0.7 * dt_s && off <= 0.51 * r)).then_some(dt_s)
}

/// A step that seven digits give as well is that: a clock far from zero has rounded its times, and must not show.
fn round(step_s: f64, steps: f64) -> f64 {
    let digits = 10f64.powi(6 - step_s.log10().floor() as i32);
    let rounded = (step_s * digits).round() / digits;
    if rounded > 0.0 && (rounded - step_s).abs() * steps <= 0.25 * EVEN * step_s { rounded } else { step_s }
}

/// The power of ten that all times are multiples of [s]: then they are rounded to it.
fn rounded_by(time_s: &[f64]) -> Option<f64> {
    (0..=5)
        .map(|digits| 10f64.powi(digits))
        .find(|per_s| time_s.iter().all(|t| (t * per_s - (t * per_s).round()).abs() < 1e-2))
        .map(f64::recip)
}

/// Fills what is missing by the convention of the input; before the first value stands the first.
fn fill(values: &mut [f64], input: Input) {
    let Some(first) = values.iter().position(|v| v.is_finite()) else { return };
    let value = values[first];
    values[..first].fill(value);
    let mut last = first;
    for k in first + 1..values.len() {
        if !values[k].is_finite() {
            continue;
        }
        let (from, to) = (values[last], values[k]);
        for (n, value) in values[last + 1..k].iter_mut().enumerate() {
            let share = (n + 1) as f64 / (k - last) as f64;
            *value = if input == Input::Held { from } else { from + share * (to - from) };
        }
        last = k;
    }
    let value = values[last];
    values[last + 1..].fill(value);
}

/// What a channel holds: its times from the begin of the part, and its values.
fn known(time_s: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    time_s.iter().zip(values).filter(|(_, v)| v.is_finite()).map(|(t, v)| (t - time_s[0], *v)).collect()
}

fn uneven(run: &Run, part: Range<usize>, input: Input) -> Laid {
    let time_s = &run.time_s[part.clone()];
    let command = known(time_s, &run.current_a[part.clone()]);
    let readings = run.pressure_bar.as_ref().map_or_else(Vec::new, |p| known(time_s, &p[part.clone()]));
    let span_s = time_s[time_s.len() - 1] - time_s[0];
    let finest_s = span_s / (FINEST * time_s.len()) as f64;
    let mut places = Vec::new();
    let mut dt_s = span_s;
    for share in SHORTEST {
        dt_s = shortest(&command, share).min(shortest(&readings, share)).clamp(finest_s, span_s);
        places = place(&readings, dt_s);
        if readings.iter().zip(&places).all(|((t, _), k)| (t / dt_s - *k as f64).abs() <= FAR) {
            break;
        }
    }
    let last = places.last().copied().unwrap_or(0).max((span_s / dt_s).round() as usize);
    let mut pressure_bar = vec![f64::NAN; last + 1];
    let mut offsets = vec![0f32; last + 1];
    let mut off_grid = 0;
    for ((t, p), k) in readings.iter().zip(&places) {
        let offset = t / dt_s - *k as f64;
        pressure_bar[*k] = *p;
        if offset.abs() > EVEN {
            offsets[*k] = offset as f32;
            off_grid += 1;
        }
    }
    let slow = |values: &Option<Vec<f64>>| {
        values.as_ref().map(|v| known(time_s, &v[part.clone()])).filter(|k| !k.is_empty()).map(|k| lines(&k, dt_s, last + 1))
    };
    Laid {
        dt_s,
        current_a: if input == Input::Held { means(&command, dt_s, last + 1) } else { lines(&command, dt_s, last + 1) },
        pressure_bar,
        offset_steps: (off_grid > 0).then_some(offsets),
        oil_temp_c: slow(&run.oil_temp_c),
        supply_bar: slow(&run.supply_bar),
        uneven: off_grid,
    }
}

/// The step below which this share of the steps lies [s]; infinite where there is none.
fn shortest(known: &[(f64, f64)], share: f64) -> f64 {
    let mut steps: Vec<f64> = known.windows(2).map(|w| w[1].0 - w[0].0).collect();
    if steps.is_empty() {
        return f64::INFINITY;
    }
    let at = ((steps.len() - 1) as f64 * share) as usize;
    *steps.select_nth_unstable_by(at, f64::total_cmp).1
}

/// For each reading the sample of the grid next to it that no reading before has taken.
fn place(readings: &[(f64, f64)], dt_s: f64) -> Vec<usize> {
    let mut free = 0;
    readings
        .iter()
        .map(|(t, _)| {
            let at = ((t / dt_s).round() as usize).max(free);
            free = at + 1;
            at
        })
        .collect()
}

/// Values on straight lines between what is known, at each sample of the grid.
fn lines(known: &[(f64, f64)], dt_s: f64, count: usize) -> Vec<f64> {
    let mut j = 0;
    (0..count)
        .map(|k| {
            let t = k as f64 * dt_s;
            while j + 2 < known.len() && known[j + 1].0 <= t {
                j += 1;
            }
            let Some(((from_s, from), (to_s, to))) = known.get(j).copied().zip(known.get(j + 1).copied()) else {
                return known.first().map_or(f64::NAN, |k| k.1);
            };
            from + ((t - from_s) / (to_s - from_s)).clamp(0.0, 1.0) * (to - from)
        })
        .collect()
}

/// The mean of a held signal from each sample of the grid to the next: a message between two samples acts for the part
/// of the step that is left, so that on average it is neither early nor late.
fn means(known: &[(f64, f64)], dt_s: f64, count: usize) -> Vec<f64> {
    let mut j = 0;
    (0..count)
        .map(|k| {
            let (begin, end) = (k as f64 * dt_s, (k + 1) as f64 * dt_s);
            // A time on the grid but for its rounding acts from there on.
            while j + 1 < known.len() && known[j + 1].0 <= begin + 1e-6 * dt_s {
                j += 1;
            }
            let (mut area, mut from, mut n) = (0.0, begin, j);
            while n + 1 < known.len() && known[n + 1].0 < end - 1e-6 * dt_s {
                area += known[n].1 * (known[n + 1].0 - from);
                from = known[n + 1].0;
                n += 1;
            }
            if n == j { known[j].1 } else { (area + known[n].1 * (end - from)) / dt_s }
        })
        .collect()
}
