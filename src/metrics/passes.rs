//! A swept characteristic: full passes of the current up and down, on a common grid.

use super::{NotMeasurable, Segment};

/// Points of the grid of currents.
pub const GRID: usize = 101;

/// Passes over the swept range; the pressure of each on the grid [bar].
pub struct Passes {
    /// The grid [A].
    pub current_a: Vec<f64>,
    /// Full rising passes.
    pub rising: Vec<Vec<f64>>,
    /// Full falling passes.
    pub falling: Vec<Vec<f64>>,
    /// Largest rate of the current [A/s].
    pub rate_a_per_s: f64,
}

/// Share of the swept range, at either end, that a full pass may miss; the grid leaves it out.
const EDGE: f64 = 0.02;

/// The full passes of the segment, each pressure paired with the current of one dead time earlier.
pub fn passes(segment: &Segment<'_>) -> Result<Passes, NotMeasurable> {
    let s = &segment.signals;
    let points: Vec<(f64, f64, f64)> = segment
        .range
        .clone()
        .map(|k| (delayed(s.time_s, s.current_a, k, segment.delay_s), s.pressure_bar[k], s.time_s[k]))
        .filter(|p| p.0.is_finite() && p.1.is_finite())
        .collect();
    super::enough(points.len(), segment.range.len())?;
    let low = points.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let edge = EDGE * (high - low);
    let current_a: Vec<f64> = (0..GRID).map(|i| low + edge + (high - low - 2.0 * edge) * i as f64 / (GRID - 1) as f64).collect();
    let rate_a_per_s = points.windows(2).map(|w| ((w[1].0 - w[0].0) / (w[1].2 - w[0].2)).abs()).fold(0.0, f64::max);
    let mut found = Passes { current_a, rising: Vec::new(), falling: Vec::new(), rate_a_per_s };
    let mut start = 0;
    while start + 1 < points.len() && high > low {
        let rising = points[start + 1].0 > points[start].0;
        let mut end = start + 1;
        while end < points.len() && (points[end].0 == points[end - 1].0 || (points[end].0 > points[end - 1].0) == rising) {
            end += 1;
        }
        let pass = &points[start..end];
        let (first, last) = if rising { (pass[0].0, pass[pass.len() - 1].0) } else { (pass[pass.len() - 1].0, pass[0].0) };
        if first <= low + edge && last >= high - edge {
            let values = found.current_a.iter().map(|i| interpolate(pass, *i, rising)).collect();
            if rising { found.rising.push(values) } else { found.falling.push(values) }
        }
        start = end - 1;
    }
    Ok(found)
}

/// `column` at one `delay_s` before sample `k`, interpolated; the first value before the start.
fn delayed(time_s: &[f64], column: &[f64], k: usize, delay_s: f64) -> f64 {
    let wanted = time_s[k] - delay_s;
    let mut i = k;
    while i > 0 && time_s[i] > wanted {
        i -= 1;
    }
    if i == k || time_s[i] > wanted {
        return column[i];
    }
    column[i] + (wanted - time_s[i]) / (time_s[i + 1] - time_s[i]) * (column[i + 1] - column[i])
}

/// The pressure of a monotone pass at the current `at`.
fn interpolate(pass: &[(f64, f64, f64)], at: f64, rising: bool) -> f64 {
    let after = pass.partition_point(|p| if rising { p.0 < at } else { p.0 > at }).clamp(1, pass.len() - 1);
    let (a, b) = (pass[after - 1], pass[after]);
    if a.0 == b.0 { b.1 } else { a.1 + (at - a.0) / (b.0 - a.0) * (b.1 - a.1) }
}

/// Mean over passes, point by point.
pub fn mean(passes: &[Vec<f64>]) -> Vec<f64> {
    (0..GRID).map(|i| passes.iter().map(|p| p[i]).sum::<f64>() / passes.len() as f64).collect()
}
