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
    let quartiles = sorted[(3 * n / 4).min(n - 1)] - sorted[n / 4];
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

    #[test]
    fn equal_values_have_no_histogram() {
        assert_eq!(histogram(&[2.0; 9]).absent.unwrap(), "all values are equal");
    }
}
