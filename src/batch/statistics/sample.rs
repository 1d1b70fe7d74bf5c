//! Location and spread of one metric.

use serde::{Deserialize, Serialize};

use super::distribution::t_quantile;
use super::{CONFIDENCE, Finding, Interval};

/// Location and spread; the unit is the metric's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Number of values.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Interval of the mean (Student's t).
    pub mean_interval: Interval,
    /// Standard deviation with the divisor n - 1: the overall spread.
    pub deviation: f64,
    /// Smallest value.
    pub min: f64,
    /// Median.
    pub median: f64,
    /// Largest value.
    pub max: f64,
}

/// Mean and standard deviation, in two passes so that a large offset costs no digits.
pub(in crate::batch) fn mean_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0)).sqrt())
}

/// Location and spread of at least two values.
pub fn sample(values: &[f64]) -> Finding<Sample> {
    if values.len() < 2 {
        return Finding::absent(format!("{} value(s); a spread needs two", values.len()));
    }
    let (mean, deviation) = mean_deviation(values);
    let n = values.len() as f64;
    let half = t_quantile(0.5 + CONFIDENCE / 2.0, n - 1.0) * deviation / n.sqrt();
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    let median = if sorted.len() % 2 == 1 { sorted[middle] } else { 0.5 * (sorted[middle - 1] + sorted[middle]) };
    Finding::of(Sample {
        count: values.len(),
        mean,
        mean_interval: Interval { low: mean - half, high: mean + half },
        deviation,
        min: sorted[0],
        median,
        max: sorted[sorted.len() - 1],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NIST/SEMATECH e-Handbook 1.3.5.2, confidence limits for the mean (ZARR13.DAT): n = 195,
    /// mean 9.261460, deviation 0.022789, half width 0.003219. Here two points with those moments per half.
    #[test]
    fn interval_of_the_mean() {
        let half = t_quantile(0.975, 194.0) * 0.022789 / 195f64.sqrt();
        assert!((half - 0.003219).abs() < 1e-6, "{half}");
        let s = sample(&[1.0, 2.0, 3.0, 4.0]).value.unwrap();
        assert_eq!((s.mean, s.median, s.min, s.max), (2.5, 2.5, 1.0, 4.0));
        assert!((s.deviation - (5.0f64 / 3.0).sqrt()).abs() < 1e-15);
        // The table's t for 97.5 % and three degrees of freedom is 3.1824.
        assert!((s.mean_interval.high - 2.5 - 3.182_4 * s.deviation / 2.0).abs() < 1e-4, "{s:?}");
        assert!((s.mean_interval.high + s.mean_interval.low - 5.0).abs() < 1e-12, "{s:?}");
        let s = sample(&[9.0, 1.0, 2.0, 3.0, 5.0]).value.unwrap();
        assert_eq!((s.median, s.min, s.max, s.count), (3.0, 1.0, 9.0, 5));
        let s = sample(&[5.0, 2.0, 30.0, 1.0, 4.0, 9.0]).value.unwrap();
        assert_eq!((s.median, s.max), (4.5, 30.0));
        assert!(sample(&[1.0]).absent.is_some() && sample(&[1.0, 2.0]).value.is_some());
    }
}
