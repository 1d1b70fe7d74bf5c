//! A course that goes by levels, or smoothly.
//!
//! Optimal partition (Jackson et al., IEEE Signal Process. Lett. 12 (2005) 105), pruned as Killick, Fearnhead and Eckley, J. Am.
//! Stat. Assoc. 107 (2012) 1590.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

/// Squares that a parabola over the simulated pressure leaves of the measured one [bar^2].
pub(super) fn smooth(kept: &[usize], measured: &[f64], simulated: &[f64]) -> f64 {
    let (first, scale) = (simulated[kept[0]], (simulated[kept[kept.len() - 1]] - simulated[kept[0]]).abs().max(1e-9));
    let row = |k: usize| {
        let x = (simulated[k] - first) / scale;
        Vector3::new(1.0, x, x * x)
    };
    let normal = kept.iter().fold(Matrix3::identity() * 1e-9, |sum, k| sum + row(*k) * row(*k).transpose());
    let right = kept.iter().fold(Vector3::zeros(), |sum, k| sum + row(*k) * measured[*k]);
    let Some(coefficients) = normal.cholesky().map(|c| c.solve(&right)) else { return f64::INFINITY };
    kept.iter().map(|k| (measured[*k] - row(*k).dot(&coefficients)).powi(2)).sum()
}

/// Squares that a line from level to level leaves, through the middle of each [bar^2]: a smooth course follows it at least as well as
/// it follows the levels, whatever moves it, and so does noise that hangs together.
pub(super) fn from_level_to_level(levels: &[Range<usize>], values: &[f64]) -> f64 {
    let middle = |level: &Range<usize>| {
        let mean = values[level.clone()].iter().sum::<f64>() / level.len() as f64;
        (0.5 * (level.start + level.end - 1) as f64, mean)
    };
    let middles: Vec<(f64, f64)> = levels.iter().map(middle).collect();
    if middles.len() < 2 {
        return f64::INFINITY;
    }
    let left = |k: usize, at: usize| {
        // The first and the last go on as their neighbours.
        let from = if at as f64 > middles[k].0 { k.min(middles.len() - 2) } else { k.saturating_sub(1) };
        let ((x, y), (x1, y1)) = (middles[from], middles[from + 1]);
        values[at] - y - (y1 - y) * (at as f64 - x) / (x1 - x)
    };
    levels.iter().enumerate().flat_map(|(k, level)| level.clone().map(move |at| (k, at))).map(|(k, at)| left(k, at).powi(2)).sum()
}

/// The levels of a course: the partition of least squares, each further level at a price; the first `skip` points after a jump belong to
/// none.
pub(super) fn levels(values: &[f64], skip: usize, price: f64) -> Vec<Range<usize>> {
    let shortest = skip + 3;
    let count = values.len();
    let offset = values[0];
    let mut sums = vec![(0.0, 0.0)];
    for v in values {
        let (sum, squares) = sums[sums.len() - 1];
        sums.push((sum + (v - offset), squares + (v - offset).powi(2)));
    }
    let from = |begin: usize| if begin == 0 { 0 } else { begin + skip };
    let squares = |begin: usize, end: usize| {
        let (a, b) = (sums[from(begin)], sums[end]);
        b.1 - a.1 - (b.0 - a.0).powi(2) / (end - from(begin)) as f64
    };
    let mut best = vec![f64::INFINITY; count + 1];
    let mut before = vec![0; count + 1];
    best[0] = -price;
    let mut open = vec![0];
    for end in shortest.min(count)..=count {
        if end >= 2 * shortest {
            open.push(end - shortest);
        }
        for begin in &open {
            let cost = best[*begin] + squares(*begin, end) + price;
            if cost < best[end] {
                (best[end], before[end]) = (cost, *begin);
            }
        }
        let limit = best[end] + price;
        open.retain(|begin| best[*begin] + squares(*begin, end) <= limit);
    }
    let mut out = Vec::new();
    let mut end = count;
    while end > 0 {
        out.push(from(before[end])..end);
        end = before[end];
    }
    out.reverse();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_found_where_each_is_worth_its_price() {
        let values: Vec<f64> = (0..90).map(|k| f64::from(k / 30) * 2.0 + 0.1 * f64::from(k % 2)).collect();
        assert_eq!(levels(&values, 0, 1.0), [0..30, 30..60, 60..90]);
        // What follows a jump belongs to no level where a jump takes its time: four readings here.
        let slow: Vec<f64> = (0..90u32).map(|k| f64::from(k / 30 * 5) + f64::from((k % 30 + 1).min(5))).collect();
        let found = levels(&slow, 4, 1.0);
        assert_eq!(found[found.len() - 2..], [34..60, 64..90]);
        // The jumps of 2 over 30 values are worth 60 at most.
        assert_eq!(levels(&values, 0, 1000.0).len(), 1);
    }

    #[test]
    fn a_line_from_level_to_level_leaves_nothing_of_a_line_and_much_of_a_staircase() {
        let three = [0..30, 30..60, 60..90];
        let line: Vec<f64> = (0..90).map(f64::from).collect();
        assert!(from_level_to_level(&three, &line) < 1e-18);
        // A sawtooth of a third of a bar to both sides of the rests, of which the mean square is a twelfth.
        let stairs: Vec<f64> = (0..90).map(|k| f64::from(k / 30)).collect();
        assert!((from_level_to_level(&three, &stairs) / 90.0 - 1.0 / 12.0).abs() < 1e-3);
        assert!(from_level_to_level(&three[..1], &line).is_infinite());
    }

    #[test]
    fn a_parabola_over_what_was_simulated_leaves_nothing_of_one() {
        let simulated: Vec<f64> = (0..50).map(f64::from).collect();
        let measured: Vec<f64> = simulated.iter().map(|p| 3.0 - 0.2 * p + 0.01 * p * p).collect();
        let kept: Vec<usize> = (0..50).filter(|k| k % 7 != 3).collect();
        assert!(smooth(&kept, &measured, &simulated) < 1e-9);
        let bent: Vec<f64> = simulated.iter().map(|p| (p - 25.0).abs()).collect();
        assert!(smooth(&kept, &bent, &simulated) > 50.0);
    }
}
