//! Counts per class.

use serde::{Deserialize, Serialize};

use super::Finding;

/// Classes of equal width.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Lower edge of the first class.
    pub start: f64,
    /// Width of a class.
    pub width: f64,
    /// Values per class.
    pub counts: Vec<usize>,
}

/// Classes by the Freedman-Diaconis rule (width 2 IQR / n^(1/3)), at least 5 and at most 60 of them.
pub fn histogram(values: &[f64]) -> Finding<Histogram> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (sorted.first(), sorted.last()) else {
        return Finding::absent("no value");
    };
    if low == high {
        return Finding::absent("all values are equal");
    }
    let n = sorted.len();
    let quartiles = sorted[3 * n / 4] - sorted[n / 4];
    let wanted = if quartiles > 0.0 { (high - low) / (2.0 * quartiles / (n as f64).cbrt()) } else { (n as f64).sqrt() };
    let classes = (wanted.ceil() as usize).clamp(5, 60);
    let width = (high - low) / classes as f64;
    let mut counts = vec![0; classes];
    for v in sorted {
        counts[(((v - low) / width) as usize).min(classes - 1)] += 1;
    }
    Finding::of(Histogram { start: low, width, counts })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_value_is_counted_once(values in prop::collection::vec(-1e3..1e3f64, 2..200)) {
            if let Some(h) = histogram(&values).value {
                prop_assert_eq!(h.counts.iter().sum::<usize>(), values.len());
                prop_assert!(h.counts[0] > 0 && h.counts[h.counts.len() - 1] > 0);
            }
        }
    }

    /// Squares of 0 to 999: the quartiles are 500^2 apart from 250^2, so 2 * 500 000 / 10 wide, and 998 001 takes ten classes.
    #[test]
    fn classes_by_freedman_and_diaconis() {
        let values: Vec<f64> = (0..1000).rev().map(|k| f64::from(k * k)).collect();
        let h = histogram(&values).value.unwrap();
        assert_eq!((h.start, h.width, h.counts.len()), (0.0, 99_800.1, 10));
        // The class of k^2 ends at sqrt(99800.1 j): 315.9, 446.8, 547.2, 631.8, 706.4, 773.8, 835.8, 893.5, 947.7.
        assert_eq!(h.counts, [316, 131, 101, 84, 75, 67, 62, 58, 54, 52]);
        // From another zero and half as fine, the same classes.
        let moved = histogram(&values.iter().map(|v| 0.5 * v - 40_960.0).collect::<Vec<_>>()).value.unwrap();
        assert_eq!((moved.start, moved.counts), (-40_960.0, h.counts));
        // Most values alike: the quartiles say nothing, and the square root of their number stands in.
        let alike: Vec<f64> = (0..64).map(|k| if k == 63 { 3.0 } else { 2.0 }).collect();
        assert_eq!(histogram(&alike).value.unwrap().counts, [63, 0, 0, 0, 0, 0, 0, 1]);
    }

    #[test]
    fn equal_values_have_no_histogram() {
        assert_eq!(histogram(&[2.0; 9]).absent.unwrap(), "all values are equal");
    }
}
