//! Bands of the readings' range in which none falls, though the pressure passes them: found in the readings themselves.

use super::effect::Scatter;

/// Evenly spaced bands without a reading.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Comb {
    /// Where the first one above zero begins [bar].
    pub first_bar: f64,
    /// From one to the next [bar].
    pub period_bar: f64,
    /// Their width [bar].
    pub width_bar: f64,
    /// How well their edges are known [bar].
    pub error_bar: f64,
    /// How often the readings pass one slowly.
    pub passages: usize,
}

/// Fewest bands that make a comb: two are evenly spaced in any case.
const FEWEST: usize = 3;
/// Fewest slow passages of a band, and of all of them.
const PASSAGES: (usize, usize) = (2, 12);
/// A passage is slow where neither the reading nor the simulated pressure goes more than this share of the band from one sample to the
/// next, before and after: a sound converter then gives at least four readings within it.
const SLOW: f64 = 0.25;
/// Samples on both sides on which the simulated pressure is slow.
const AROUND: usize = 3;
/// Share of the readings that would be in the bands of a comb that may be there: what is averaged, or lost on its way.
const LEFT: f64 = 0.02;

/// An interval of pressure without a reading, and how often the readings pass it slowly.
struct Gap {
    from: f64,
    to: f64,
    passages: usize,
}

/// The comb of bands that the readings leave out.
pub(super) fn comb(of: &Scatter<'_>) -> Option<Comb> {
    let mut readings: Vec<f64> = of.measured_bar.iter().copied().filter(|y| y.is_finite()).collect();
    readings.sort_by(f64::total_cmp);
    let mut values = readings.clone();
    values.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    if values.len() < 4 * FEWEST {
        return None;
    }
    let mut apart: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
    apart.sort_by(f64::total_cmp);
    // The step of the readings themselves; next to nothing where they are fine.
    let step = apart[apart.len() / 4];
    let digit = digit(&values);
    // Steps that do not divide by the digit they are printed with come as one or two digits, two or three, and so on.
    let wide = |w: &[f64]| w[1] - w[0] > (1.9 * step).max(2.5 * digit).max(of.noise_bar);
    let mut gaps: Vec<Gap> = values.windows(2).filter(|w| wide(w)).map(|w| Gap { from: w[0], to: w[1], passages: 0 }).collect();
    if gaps.len() < FEWEST {
        return None;
    }
    for run in of.runs {
        for k in run.start + AROUND..run.end.saturating_sub(AROUND + 1) {
            pass(of, k, &mut gaps);
        }
    }
    gaps.retain(|g| g.passages >= PASSAGES.0);
    let mut widths: Vec<f64> = gaps.iter().map(|g| g.to - g.from).collect();
    widths.sort_by(f64::total_cmp);
    let width = *widths.get(widths.len() / 2)?;
    gaps.retain(|g| (g.to - g.from - width).abs() < 0.25 * width);
    let passages = gaps.iter().map(|g| g.passages).sum();
    if gaps.len() < FEWEST || passages < PASSAGES.1 || !is_cut(of, &readings, &gaps, step) {
        return None;
    }
    let nearest = gaps.windows(2).map(|w| w[1].from - w[0].from).fold(f64::INFINITY, f64::min);
    // Not every band between them need have been passed slowly.
    let (first, period, error_bar) = [3.0, 2.0, 1.0].into_iter().find_map(|parts| even(&gaps, nearest / parts, width, &readings))?;
    Some(Comb { first_bar: (first + 0.5 * step).rem_euclid(period), period_bar: period, width_bar: width - step, error_bar, passages })
}

/// The last digit that values are printed with; 0 where that is finer than any step of a converter [bar].
pub(super) fn digit(values: &[f64]) -> f64 {
    let is_of = |digit: &f64| values.iter().all(|v| (v / digit - (v / digit).round()).abs() < 1e-4);
    [1.0, 0.1, 0.01, 0.001].into_iter().find(is_of).unwrap_or(0.0)
}

/// Counts a slow passage from sample `k` to the next.
fn pass(of: &Scatter<'_>, k: usize, gaps: &mut [Gap]) {
    let y = |k: usize| of.measured_bar[k];
    let (low, high) = (y(k).min(y(k + 1)), y(k).max(y(k + 1)));
    let at = gaps.partition_point(|g| g.from < low - 1e-6);
    let Some(gap) = gaps.get_mut(at).filter(|g| g.to <= high + 1e-6) else { return };
    let width = gap.to - gap.from;
    let is_near = high - low < 1.5 * width;
    let readings_rest = [(k - 1, k), (k + 1, k + 2)].into_iter().all(|(a, b)| (y(a) - y(b)).abs() < SLOW * width);
    let simulated = of.simulated_bar[k - AROUND..=k + 1 + AROUND].windows(2).all(|w| (w[1] - w[0]).abs() < SLOW * width);
    gap.passages += usize::from(is_near && readings_rest && simulated);
}

/// Whether the readings end at the bands as if cut off: within half of the noise there lie as many as beyond, those aside that make the
/// edges. Of a pressure that jumps the noise makes them thin out, to an eighth and less.
fn is_cut(of: &Scatter<'_>, readings: &[f64], gaps: &[Gap], step: f64) -> bool {
    if step > 0.5 * of.noise_bar {
        return true;
    }
    let count = |from: f64, to: f64| readings.partition_point(|y| *y <= to) - readings.partition_point(|y| *y < from);
    let (near, far) = (0.5 * of.noise_bar, 2.0 * of.noise_bar);
    let both = |of: &dyn Fn(&Gap) -> [usize; 2]| gaps.iter().flat_map(of).sum::<usize>();
    let at_edge = both(&|g| [count(g.from - near, g.from), count(g.to, g.to + near)]).saturating_sub(2 * gaps.len());
    let beyond = both(&|g| [count(g.from - far, g.from - near), count(g.to + near, g.to + far)]);
    // Three times as wide a stretch holds three times as many; half of what that makes is enough.
    6 * at_edge >= beyond
}

/// Begin and period of the bands, and how well they are known, where the gaps are about `period` apart or multiples of that, and where
/// next to no reading lies in any such band.
fn even(gaps: &[Gap], period: f64, width: f64, readings: &[f64]) -> Option<(f64, f64, f64)> {
    if period < 1.4 * width {
        return None;
    }
    let begin = gaps[0].from;
    let mut period = period;
    // Each gap refines the period by which the next one, farther off, is numbered.
    for gap in &gaps[1..] {
        let number = ((gap.from - begin) / period).round();
        if (gap.from - begin - number * period).abs() > 0.25 * width {
            return None;
        }
        period = (gap.from - begin) / number;
    }
    let off = gaps.iter().map(|g| (g.from - begin - ((g.from - begin) / period).round() * period).abs()).fold(0.0, f64::max);
    if off > 0.25 * width {
        return None;
    }
    let is_within = |y: f64| (0.1 * width..0.9 * width).contains(&(y - begin).rem_euclid(period));
    let (low, high) = (gaps[0].from - period, gaps[gaps.len() - 1].to + period);
    let near: Vec<f64> = readings.iter().copied().filter(|y| (low..=high).contains(y)).collect();
    let within = near.iter().filter(|y| is_within(**y)).count() as f64;
    let expected = near.len() as f64 * 0.8 * width / period;
    (within < LEFT * expected).then_some((begin, period, (off / 3f64.sqrt()).max(1e-3 * width)))
}
