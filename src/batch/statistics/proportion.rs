//! A share of a count with its interval: the yield.

use serde::{Deserialize, Serialize};

use super::distribution::{beta_quantile, normal_quantile};
use super::{CONFIDENCE, Finding, Interval};

/// `passed` of `count` with its intervals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proportion {
    /// How many.
    pub passed: usize,
    /// Of how many.
    pub count: usize,
    /// The share.
    pub share: f64,
    /// Wilson score interval.
    pub wilson: Interval,
    /// Clopper-Pearson interval, which never covers less than its level.
    pub exact: Interval,
}

/// The share of `passed` in `count`.
pub fn proportion(passed: usize, count: usize) -> Finding<Proportion> {
    if count == 0 || passed > count {
        return Finding::absent("no valve has a verdict");
    }
    Finding::of(Proportion {
        passed,
        count,
        share: passed as f64 / count as f64,
        wilson: wilson(passed, count),
        exact: clopper_pearson(passed, count),
    })
}

/// Wilson score interval (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209-212).
pub fn wilson(passed: usize, count: usize) -> Interval {
    let (k, n) = (passed as f64, count as f64);
    let z = normal_quantile(0.5 + CONFIDENCE / 2.0);
    let middle = (k + z * z / 2.0) / (n + z * z);
    let half = z / (n + z * z) * (k * (n - k) / n + z * z / 4.0).sqrt();
    // At the ends the formula gives exactly 0 and 1, but for rounding.
    Interval {
        low: if passed == 0 { 0.0 } else { (middle - half).max(0.0) },
        high: if passed == count { 1.0 } else { (middle + half).min(1.0) },
    }
}

/// Clopper-Pearson interval (C. J. Clopper, E. S. Pearson, Biometrika 26 (1934) 404-413).
pub fn clopper_pearson(passed: usize, count: usize) -> Interval {
    let (k, n) = (passed as f64, count as f64);
    let tail = (1.0 - CONFIDENCE) / 2.0;
    Interval {
        low: if passed == 0 { 0.0 } else { beta_quantile(tail, k, n - k + 1.0) },
        high: if passed == count { 1.0 } else { beta_quantile(1.0 - tail, k + 1.0, n - k) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// R. G. Newcombe, Statistics in Medicine 17 (1998) 857-872, Table I, method 3.
    #[test]
    fn wilson_of_the_published_table() {
        for (k, n, low, high) in [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)] {
            let i = wilson(k, n);
            assert!((i.low - low).abs() < 5e-5 && (i.high - high).abs() < 5e-5, "{k}/{n}: {i:?}");
        }
    }

    /// Newcombe (1998), Table I, method 5, and 5 of 25 from
    /// influentialpoints.com/Training/confidence_intervals_of_proportions.htm (Conover's tables: 0.068 to 0.407).
    #[test]
    fn clopper_pearson_of_published_examples() {
        for (k, n, low, high) in [(81, 263, 0.2527, 0.3676), (15, 148, 0.0578, 0.1617), (0, 20, 0.0, 0.1684), (1, 29, 0.0009, 0.1776)] {
            let i = clopper_pearson(k, n);
            assert!((i.low - low).abs() < 5e-5 && (i.high - high).abs() < 5e-5, "{k}/{n}: {i:?}");
        }
        let i = clopper_pearson(5, 25);
        assert!((i.low - 0.068).abs() < 5e-4 && (i.high - 0.407).abs() < 5e-4, "{i:?}");
    }

    #[test]
    fn nothing_of_nothing_is_absent() {
        assert!(proportion(0, 0).value.is_none() && proportion(4, 3).value.is_none());
        let of = proportion(81, 263).value.unwrap();
        assert!((of.share - 0.307_984_790_9).abs() < 1e-9 && of.wilson == wilson(81, 263) && of.exact == clopper_pearson(81, 263));
        assert_eq!(proportion(3, 3).value.unwrap().wilson.high, 1.0);
    }
}
