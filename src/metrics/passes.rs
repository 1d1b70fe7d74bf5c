//! A swept characteristic: full passes of the current up and down, smoothed onto a common grid.

use super::{NotMeasurable, Segment};

/// Points of the grid of currents.
pub const GRID: usize = 101;

/// Passes over the swept range; the pressure of each on the grid [bar].
pub struct Passes {
    /// The grid [A].
    pub current_a: Vec<f64>,
    /// Full rising passes.
    pub rising: Vec<Pass>,
    /// Full falling passes.
    pub falling: Vec<Pass>,
    /// Largest rate of the current [A/s].
    pub rate_a_per_s: f64,
}

/// One pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// Pressure on the grid, smoothed [bar].
    pub pressure_bar: Vec<f64>,
    /// Variance of the smoothed pressure that the scatter of the samples leaves, mean over the grid [bar^2].
    pub variance_bar2: f64,
    /// Mean rate of the current, without its sign [A/s].
    pub rate_a_per_s: f64,
    /// Place among all passes in time.
    pub place: usize,
}

/// Share of the swept range, at either end, that a full pass may miss; the grid leaves it out.
const EDGE: f64 = 0.02;

/// Half-width of the smoothing, as a share of the swept range: a parabola bends as little over it as a characteristic does.
const SMOOTHED: f64 = 0.03;

/// What the smoothing makes of a pressure that stands still [bar].
const ROUNDING_BAR: f64 = 1e-9;

/// Sweeps whose rates differ by this factor show what a standing valve would do.
const TWO_RATES: f64 = 1.5;

/// A sample of a sweep: current [A], pressure [bar], time [s].
pub type Point = (f64, f64, f64);

/// The samples of the segment, each pressure paired with the current that it answers to: one dead time and one lag earlier, and
/// behind a lag half a period more, by which a command that is held is late in the mean.
pub fn paired(segment: &Segment<'_>) -> Result<Vec<Point>, NotMeasurable> {
    let s = &segment.signals;
    let range = &segment.range;
    let held_s = match (segment.lag_s > 0.0, range.len()) {
        (true, 2..) => 0.5 * (s.time_s[range.end - 1] - s.time_s[range.start]) / (range.len() - 1) as f64,
        _ => 0.0,
    };
    let late_s = segment.delay_s + segment.lag_s + held_s;
    let pair = |k: usize| (delayed(s.time_s, s.current_a, k, late_s), s.pressure_bar[k], s.time_s[k]);
    let points: Vec<Point> = segment.range.clone().map(pair).filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
    super::enough(points.len(), segment.range.len())?;
    Ok(points)
}

/// The distance from the lowest to the highest of these pressures, where there is one at all [bar].
pub fn moved(low_bar: f64, high_bar: f64) -> Result<f64, NotMeasurable> {
    let moved_bar = (high_bar - low_bar).max(0.0);
    if moved_bar > ROUNDING_BAR { Ok(moved_bar) } else { Err(NotMeasurable::NoResponse { moved_bar }) }
}

/// Lowest pressure of a curve, and how far it moves from there [bar].
pub fn span(curve: &[f64]) -> Result<(f64, f64), NotMeasurable> {
    let (low, high) = curve.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    Ok((low, moved(low, high)?))
}

/// Splits samples into stretches of rising or falling current; a hold belongs to the stretch before it, the first to none.
pub fn stretches(points: &[Point]) -> Vec<(bool, &[Point])> {
    let mut found = Vec::new();
    let mut start = points.windows(2).take_while(|w| w[0].0 == w[1].0).count();
    while start + 1 < points.len() {
        let rising = points[start + 1].0 > points[start].0;
        let mut end = start + 1;
        while end < points.len() && (points[end].0 == points[end - 1].0 || (points[end].0 > points[end - 1].0) == rising) {
            end += 1;
        }
        found.push((rising, &points[start..end]));
        start = end - 1;
    }
    found
}

/// The full passes of the segment.
pub fn passes(segment: &Segment<'_>) -> Result<Passes, NotMeasurable> {
    let points = paired(segment)?;
    // The range that the phase itself commands: its first samples still answer to the phase before.
    let commanded = || segment.range.clone().map(|k| segment.signals.current_a[k]).filter(|i| i.is_finite());
    let (low, high) = (commanded().fold(f64::INFINITY, f64::min), commanded().fold(f64::NEG_INFINITY, f64::max));
    let edge = EDGE * (high - low);
    let current_a: Vec<f64> = (0..GRID).map(|i| low + edge + (high - low - 2.0 * edge) * i as f64 / (GRID - 1) as f64).collect();
    let rate_a_per_s = points.windows(2).map(|w| ((w[1].0 - w[0].0) / (w[1].2 - w[0].2)).abs()).fold(0.0, f64::max);
    let mut found = Passes { current_a, rising: Vec::new(), falling: Vec::new(), rate_a_per_s };
    if high <= low {
        return Ok(found);
    }
    for (rising, stretch) in stretches(&points) {
        let (first, last) = if rising { (stretch[0], stretch[stretch.len() - 1]) } else { (stretch[stretch.len() - 1], stretch[0]) };
        if first.0 <= low + edge && last.0 >= high - edge {
            let (pressure_bar, variance_bar2) = smoothed(stretch, rising, &found.current_a, SMOOTHED * (high - low));
            let rate_a_per_s = ((last.0 - first.0) / (last.2 - first.2)).abs();
            let place = found.rising.len() + found.falling.len();
            let pass = Pass { pressure_bar, variance_bar2, rate_a_per_s, place };
            if rising { found.rising.push(pass) } else { found.falling.push(pass) }
        }
    }
    Ok(found)
}

impl Passes {
    /// The passes of one direction that count: the very first pass starts from an unknown history, and is left out where
    /// there is another of its direction.
    pub fn counted(&self, rising: bool) -> Vec<&Pass> {
        let all = if rising { &self.rising } else { &self.falling };
        all.iter().filter(|p| p.place > 0 || all.len() == 1).collect()
    }

    /// Pressure of a direction on the grid: the mean of its passes. Where they run at two rates, what they tend to as the
    /// rate goes to zero, so that no lag is left, known or not.
    pub fn curve(&self, rising: bool) -> Vec<f64> {
        let counted = self.counted(rising);
        let rates: Vec<f64> = counted.iter().map(|p| p.rate_a_per_s).collect();
        let (slow, fast) = rates.iter().fold((f64::INFINITY, 0.0f64), |(l, h), r| (l.min(*r), h.max(*r)));
        let n = counted.len() as f64;
        let mean_rate = rates.iter().sum::<f64>() / n;
        let square: f64 = rates.iter().map(|r| (r - mean_rate).powi(2)).sum();
        (0..self.current_a.len())
            .map(|i| {
                let mean = counted.iter().map(|p| p.pressure_bar[i]).sum::<f64>() / n;
                if fast < TWO_RATES * slow {
                    return mean;
                }
                let slope = counted.iter().map(|p| (p.rate_a_per_s - mean_rate) * p.pressure_bar[i]).sum::<f64>() / square;
                mean - slope * mean_rate
            })
            .collect()
    }
}

/// `column` at one `delay_s` before sample `k`, interpolated; the first value before the start.
fn delayed(time_s: &[f64], column: &[f64], k: usize, delay_s: f64) -> f64 {
    let wanted = time_s[k] - delay_s;
    let mut i = k;
    while i > 0 && time_s[i] > wanted {
        i -= 1;
    }
    if i == k || time_s[i] >= wanted {
        return column[i];
    }
    column[i] + (wanted - time_s[i]) / (time_s[i + 1] - time_s[i]) * (column[i + 1] - column[i])
}

/// The pressure of a monotone stretch on `grid`: at each point a parabola through the samples within `reach_a` (A. Savitzky, M. J.
/// E. Golay, Analytical Chemistry 36 (1964) 1627), or a straight line where there are few. With the mean variance that the
/// scatter about the parabolas leaves.
pub fn smoothed(stretch: &[Point], rising: bool, grid: &[f64], reach_a: f64) -> (Vec<f64>, f64) {
    let turned: Vec<Point>;
    let points = if rising {
        stretch
    } else {
        turned = stretch.iter().rev().copied().collect();
        &turned
    };
    let (first, last) = (grid[0], grid[grid.len() - 1]);
    let mut variance = 0.0;
    let values = grid
        .iter()
        .map(|at| {
            // What lies beyond the grid has just turned, and answers to another branch.
            let (from, to) = ((at - reach_a).max(first), (at + reach_a).min(last));
            let window = &points[points.partition_point(|p| p.0 < from)..points.partition_point(|p| p.0 <= to)];
            match parabola(window, *at, reach_a) {
                Some((value, spread)) => {
                    variance += spread / grid.len() as f64;
                    value
                }
                None => interpolate(points, *at),
            }
        })
        .collect();
    (values, variance)
}

/// Value at `at` of the least-squares parabola through `window`, with its variance; `None` where six samples are not there.
fn parabola(window: &[Point], at: f64, reach_a: f64) -> Option<(f64, f64)> {
    if window.len() < 6 {
        return None;
    }
    let mut normal = nalgebra::Matrix3::<f64>::zeros();
    let mut right = nalgebra::Vector3::<f64>::zeros();
    let row = |x: f64| nalgebra::Vector3::new(1.0, (x - at) / reach_a, ((x - at) / reach_a).powi(2));
    for p in window {
        let v = row(p.0);
        normal += v * v.transpose();
        right += v * p.1;
    }
    let inverse = normal.try_inverse()?;
    let found = inverse * right;
    let rest: f64 = window.iter().map(|p| (p.1 - row(p.0).dot(&found)).powi(2)).sum();
    Some((found[0], rest / (window.len() - 3) as f64 * inverse[(0, 0)]))
}

/// The pressure of rising samples at the current `at`.
fn interpolate(points: &[Point], at: f64) -> f64 {
    let after = points.partition_point(|p| p.0 < at).clamp(1, points.len() - 1);
    let (a, b) = (points[after - 1], points[after]);
    if a.0 == b.0 { b.1 } else { a.1 + (at - a.0) / (b.0 - a.0) * (b.1 - a.1) }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Columns;
    use super::*;

    /// Few samples, far apart: on the straight lines between them, and on the outer ones beyond.
    #[test]
    fn where_samples_are_few_the_pressure_lies_between_them() {
        let points = [(0.0, 1.0, 0.0), (1.0, 3.0, 1.0), (1.0, 5.0, 2.0), (3.0, 6.0, 3.0)];
        for (at, wanted) in [(0.5, 2.0), (2.0, 5.5), (-1.0, -1.0), (5.0, 7.0), (1.0, 3.0)] {
            assert!((interpolate(&points, at) - wanted).abs() < 1e-12, "{at}: {}", interpolate(&points, at));
        }
        assert_eq!(interpolate(&points[1..], 1.0), 5.0, "of two samples at one current the later");
        let (values, variance) = smoothed(&points, true, &[0.5, 2.0], 0.1);
        assert_eq!((values, variance), (vec![2.0, 5.5], 0.0));
    }

    /// A parabola gives itself back; about a constant, the spread of n samples in even steps is 9/4 of s^2 / n in the middle.
    #[test]
    fn the_smoothed_value_and_its_variance() {
        let window = |of: fn(f64) -> f64, n: i32| (-n..=n).map(|k| (0.01 * f64::from(k), of(f64::from(k)), 0.0)).collect::<Vec<Point>>();
        let (value, variance) = parabola(&window(|k| 7.0 + 0.2 * k - 0.01 * k * k, 40), 0.1, 0.4).unwrap();
        assert!((value - 8.0).abs() < 1e-9 && variance < 1e-18, "{value} {variance}");
        let (value, variance) = parabola(&window(|k| if k.rem_euclid(2.0) == 0.0 { 1.0 } else { -1.0 }, 500), 0.0, 5.0).unwrap();
        assert!(value.abs() < 0.01 && (variance / (2.25 / 1001.0) - 1.0).abs() < 0.01, "{value} {variance}");
        // Of seven, by Savitzky and Golay's coefficients (-2, 3, 6, 7, 6, 3, -2)/21; what is a cubic alone leaves its squares, 6, to
        // four degrees of freedom, and a third of it to the middle.
        let seven = |of: [f64; 7]| (-3..=3).zip(of).map(|(k, p)| (0.01 * f64::from(k), p, 0.0)).collect::<Vec<Point>>();
        let (value, _) = parabola(&seven([1.0, 0.0, 0.0, 21.0, 0.0, 0.0, 10.0]), 0.0, 0.03).unwrap();
        assert!((value - (7.0 - 22.0 / 21.0)).abs() < 1e-9, "{value}");
        let (value, variance) = parabola(&seven([-1.0, 1.0, 1.0, 0.0, -1.0, -1.0, 1.0]), 0.0, 0.03).unwrap();
        assert!(value.abs() < 1e-9 && (variance - 0.5).abs() < 1e-9, "{value} {variance}");
        // Six samples are enough for three coefficients, five are not.
        assert!(parabola(&window(|_| 1.0, 3)[..6], 0.0, 0.1).is_some() && parabola(&window(|_| 1.0, 2), 0.0, 0.1).is_none());
    }

    /// Six samples from the beginning of the grid on: the parabola, which misses each of them, and its variance in the mean over the grid.
    #[test]
    fn a_window_reaches_from_its_first_sample_to_its_last() {
        let points: Vec<Point> = (0..12).map(|k| (0.5 + 0.125 * f64::from(k), f64::from(k % 2), 0.0)).collect();
        let (values, variance) = smoothed(&points, true, &[0.5, 1.875], 0.625);
        let (first, last) = (parabola(&points[..6], 0.5, 0.625).unwrap(), parabola(&points[6..], 1.875, 0.625).unwrap());
        assert!((values[0] - first.0).abs() < 1e-12 && (values[1] - last.0).abs() < 1e-12 && values[0].abs() > 0.1, "{values:?}");
        assert!(variance > 0.1 && (variance - 0.5 * (first.1 + last.1)).abs() < 1e-12, "{variance}");
    }

    /// Up, down and half way up again; and a hold before the first movement, which costs it no rate.
    #[test]
    fn half_a_sweep_is_no_pass() {
        let current = |t: f64| {
            if t < 1.0 {
                0.0
            } else if t < 2.0 {
                t - 1.0
            } else if t < 3.0 {
                3.0 - t
            } else {
                t - 3.0
            }
        };
        let columns = Columns::new(351, |_| f64::NAN, current, current);
        let found = passes(&columns.segment(0.0)).unwrap();
        assert_eq!((found.rising.len(), found.falling.len()), (1, 1));
        let turned = Columns::new(351, |_| f64::NAN, |t| 1.0 - current(t), current);
        let found = passes(&turned.segment(0.0)).unwrap();
        assert_eq!((found.rising.len(), found.falling.len()), (1, 1));
        assert!((found.falling[0].rate_a_per_s - 1.0).abs() < 1e-9, "{}", found.falling[0].rate_a_per_s);
    }

    /// 1 A/s: 11 bar. 1.5 A/s: 11.5 bar, and so 10 bar standing; at 1.25 A/s in the other case the mean, 11.25 bar.
    #[test]
    fn two_rates_are_carried_on_to_standing_still() {
        let pass = |rate_a_per_s: f64, place| Pass { pressure_bar: vec![10.0 + rate_a_per_s], variance_bar2: 0.0, rate_a_per_s, place };
        let curve = |fast: f64| {
            let rising = vec![pass(1.0, 1), pass(fast, 3)];
            Passes { current_a: vec![0.5], rising, falling: Vec::new(), rate_a_per_s: fast }.curve(true)[0]
        };
        assert!((curve(1.5) - 10.0).abs() < 1e-9 && (curve(1.25) - 11.125).abs() < 1e-9, "{} {}", curve(1.5), curve(1.25));
    }

    /// Up in 1 s, down in 2 s at 100 Hz, answered to at once: rates, places, and the current one dead time earlier.
    #[test]
    fn a_pass_knows_its_rate_and_its_place() {
        let current = |t: f64| if t < 1.0 { 0.2 + 0.5 * t } else { 0.7 - 0.25 * (t - 1.0) };
        let columns = Columns::new(301, |_| f64::NAN, current, |t| 10.0 * current(t));
        let found = passes(&columns.segment(0.0)).unwrap();
        let (up, down) = (&found.rising[0], &found.falling[0]);
        assert!((found.rate_a_per_s - 0.5).abs() < 1e-9 && (up.rate_a_per_s - 0.5).abs() < 1e-9 && (down.rate_a_per_s - 0.25).abs() < 1e-9);
        assert_eq!((up.place, down.place, found.rising.len(), found.falling.len()), (0, 1, 1, 1));
        // 2 % of the swept range is left out at either end.
        assert!((found.current_a[0] - 0.21).abs() < 1e-12 && (found.current_a[100] - 0.69).abs() < 1e-12);
        assert!((found.current_a[50] - 0.45).abs() < 1e-12);
        assert!(found.current_a.iter().zip(&up.pressure_bar).all(|(i, p)| (p - 10.0 * i).abs() < 1e-9));
    }

    /// 35 ms: three and a half samples earlier; the first value before the start.
    #[test]
    fn a_delayed_column_is_interpolated() {
        let (time, column): (Vec<f64>, Vec<f64>) = (0..20).map(|k| (5.0 + 0.01 * f64::from(k), f64::from(k * k))).unzip();
        for (k, delay, wanted) in [(10, 0.035, 42.5), (10, 0.0, 100.0), (10, 0.03, 49.0), (3, 0.05, 0.0), (0, 0.02, 0.0), (3, 0.03, 0.0)] {
            assert!((delayed(&time, &column, k, delay) - wanted).abs() < 1e-6, "{k} {delay}: {}", delayed(&time, &column, k, delay));
        }
        // On a sample, whatever comes after it.
        assert_eq!(delayed(&[0.0, 0.25, 0.5, 0.75], &[1.0, 2.0, f64::NAN, 4.0], 3, 0.5), 2.0);
        // Behind a lag the command is late by half a period more: dead time 20 ms, lag 10 ms, 5 ms.
        let columns = Columns::new(50, |_| f64::NAN, |t| t, |_| 1.0);
        let mut segment = columns.segment(0.02);
        segment.range = 10..50;
        assert!((paired(&segment).unwrap()[5].0 - 0.13).abs() < 1e-9);
        segment.lag_s = 0.01;
        assert!((paired(&segment).unwrap()[5].0 - 0.115).abs() < 1e-9);
        // A command or a pressure that is not there is no pair.
        let mut columns = Columns::new(50, |_| f64::NAN, |t| t, |_| 1.0);
        columns.current[7] = f64::NAN;
        columns.pressure[9] = f64::NAN;
        assert_eq!(paired(&columns.segment(0.0)).unwrap().len(), 48);
    }

    #[test]
    fn a_hold_belongs_to_the_stretch_before_it() {
        let points: Vec<Point> = [0.0, 1.0, 1.0, 2.0, 1.0, 1.0, 0.0].into_iter().map(|i| (i, 0.0, 0.0)).collect();
        let found: Vec<(bool, usize)> = stretches(&points).iter().map(|(rising, s)| (*rising, s.len())).collect();
        assert_eq!(found, [(true, 4), (false, 4)]);
        let found: Vec<(bool, usize)> = stretches(&points[1..]).iter().map(|(rising, s)| (*rising, s.len())).collect();
        assert_eq!(found, [(true, 2), (false, 4)], "a hold that comes first is no stretch");
        assert!(stretches(&points[1..3]).is_empty());
        assert_eq!(stretches(&points[..2]).len(), 1);
        assert!(stretches(&points[..1]).is_empty());
    }
}
