//! One-dimensional searches: a bracketed root and a bracketed maximum.

/// The root of `f` in `[low, high]`, whose ends have opposite signs, to the last bits by bisection.
pub fn bisect(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let sign = f(low) > 0.0;
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if (f(middle) > 0.0) == sign { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The largest value of `f` from one end of the ascending grid to the other: each peak that the grid shows is refined, because the
/// highest of a row of narrow ones may show lower than another that a point of the grid happens to meet.
pub fn maximum(f: impl Fn(f64) -> f64, grid: &[f64]) -> Option<f64> {
    let values: Vec<f64> = grid.iter().map(|x| f(*x)).collect();
    let peak = |k: &usize| {
        let (before, after) = (k.checked_sub(1).map(|b| values[b]), values.get(k + 1));
        before.is_none_or(|b| values[*k] > b) && after.is_none_or(|a| values[*k] >= *a)
    };
    let refined = (0..grid.len()).filter(peak).map(|k| {
        let (low, high) = (grid[k.saturating_sub(1)], grid[(k + 1).min(grid.len() - 1)]);
        section(&f, low, high).max(values[k])
    });
    refined.max_by(f64::total_cmp)
}

/// The highest value of a function with one peak between `low` and `high`, by golden section.
fn section(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const SECTION: f64 = 0.618_033_988_749_894_8;
    let (mut left, mut right) = (high - SECTION * (high - low), low + SECTION * (high - low));
    let (mut at_left, mut at_right) = (f(left), f(right));
    // To a part in 10^8 of the bracket: the value of a peak is then known to its square.
    for _ in 0..40 {
        if at_left > at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - SECTION * (high - low);
            at_left = f(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + SECTION * (high - low);
            at_right = f(right);
        }
    }
    at_left.max(at_right)
}

/// `count` frequencies from `low` to `high` in equal ratios.
pub fn logarithmic(low: f64, high: f64, count: usize) -> Vec<f64> {
    let ratio = (high / low).ln() / (count - 1) as f64;
    (0..count).map(|i| low * (ratio * i as f64).exp()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_and_a_peak_are_found_to_the_last_bits() {
        // Falling and rising, and a root at the end of the bracket.
        assert!((bisect(|x| 2.0 - x * x, 0.0, 2.0) - 2f64.sqrt()).abs() < 1e-15);
        assert!((bisect(|x| x * x - 2.0, 0.0, 2.0) - 2f64.sqrt()).abs() < 1e-15);
        assert_eq!(bisect(|x| x - 1.0, 0.0, 1.0), 1.0);
        // Between the points of the grid, and at its ends.
        let grid = logarithmic(1.0, 100.0, 3);
        assert!(grid.iter().zip([1.0, 10.0, 100.0]).all(|(x, wanted)| (x / wanted - 1.0).abs() < 1e-14), "{grid:?}");
        assert!((maximum(|x| 5.0 - (x - 17.0).powi(2), &grid).unwrap() - 5.0).abs() < 1e-12);
        assert_eq!((maximum(|x| x, &grid), maximum(|x| -x, &grid)), (Some(grid[2]), Some(-1.0)));
        // A peak between two points of one height; and a narrow one of 3 at 2.4 beside a wide one of 2, which a point of the grid meets.
        let even: Vec<f64> = (0..8).map(f64::from).collect();
        assert!((maximum(|x| 7.0 - (x - 1.5).powi(2), &even).unwrap() - 7.0).abs() < 1e-12);
        let two = |x: f64| (3.0 - 4.0 * (x - 2.4).abs()).max(2.0 - 0.5 * (x - 5.0).abs());
        assert!((maximum(two, &even).unwrap() - 3.0).abs() < 1e-7 && maximum(two, &[]).is_none());
    }
}
