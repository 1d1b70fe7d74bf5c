//! Valves that do not belong to the rest: generalised extreme Studentised deviate.
//!
//! B. Rosner, Technometrics 25 (1983) 165-172; NIST/SEMATECH e-Handbook 1.3.5.17.3,
//! <https://www.itl.nist.gov/div898/handbook/eda/section3/eda35h3.htm>.

use serde::{Deserialize, Serialize};

use super::Finding;
use super::distribution::t_quantile;

const FEWEST: usize = 15;
const MOST: usize = 20;
const LEVEL: f64 = 0.05;

/// One outlier.
#[doc(alias("ESD", "outliers"))]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outlier {
    /// Place in the batch, from 0.
    pub position: usize,
    /// Its value.
    pub value: f64,
    /// Distance from the mean of what was left when it was found, in standard deviations.
    pub deviations: f64,
}

/// The outliers at the 5 % level, the farthest first; at most a tenth of the values and never more than twenty.
pub fn outliers(values: &[f64], positions: &[usize]) -> Finding<Vec<Outlier>> {
    let n = values.len();
    if n < FEWEST {
        return Finding::absent(format!("{n} value(s); the test needs {FEWEST}"));
    }
    let steps = deviates(values, (n / 10).clamp(1, MOST));
    // The number of outliers is the last step whose deviate exceeds its critical value, not the first that fails.
    let count = steps.iter().rposition(|s| s.deviate > s.critical).map_or(0, |i| i + 1);
    let found = steps.into_iter().take(count).map(|s| Outlier {
        position: positions.get(s.index).copied().unwrap_or(s.index),
        value: values[s.index],
        deviations: s.deviate,
    });
    Finding::of(found.collect())
}

struct Step {
    index: usize,
    deviate: f64,
    critical: f64,
}

fn deviates(values: &[f64], most: usize) -> Vec<Step> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let (mut low, mut high) = (0, order.len());
    let mut steps = Vec::with_capacity(most);
    for i in 1..=most {
        let rest = &order[low..high];
        let n = rest.len() as f64;
        let mean = rest.iter().map(|&k| values[k]).sum::<f64>() / n;
        let deviation = (rest.iter().map(|&k| (values[k] - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        // Of sorted values, the farthest from the mean is one of the two ends.
        let (bottom, top) = (mean - values[rest[0]], values[rest[rest.len() - 1]] - mean);
        let index = if top >= bottom { rest[rest.len() - 1] } else { rest[0] };
        let (nf, fi) = (values.len() as f64, i as f64);
        let t = t_quantile(1.0 - LEVEL / (2.0 * (nf - fi + 1.0)), nf - fi - 1.0);
        let critical = (nf - fi) * t / ((nf - fi - 1.0 + t * t) * (nf - fi + 1.0)).sqrt();
        steps.push(Step { index, deviate: top.max(bottom) / deviation, critical });
        if top >= bottom {
            high -= 1;
        } else {
            low += 1;
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROSNER: [f64; 54] = [
        -0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56, 1.58, 1.65, 1.69, 1.70, 1.76, 1.77, 1.81,
        1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10, 2.14, 2.15, 2.23, 2.24, 2.26, 2.35, 2.37, 2.40, 2.47, 2.54, 2.62, 2.64, 2.90, 2.92, 2.92,
        2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64, 5.34, 5.42, 6.01,
    ];

    /// The handbook's table for Rosner's data: statistics, critical values, three outliers although the first two
    /// steps alone would find none.
    #[test]
    fn the_handbook_example() {
        let steps = deviates(&ROSNER, 10);
        let statistics = [3.118, 2.942, 3.179, 2.810, 2.815, 2.848, 2.279, 2.310, 2.101, 2.067];
        let critical = [3.158, 3.151, 3.143, 3.136, 3.128, 3.120, 3.111, 3.103, 3.094, 3.085];
        for (i, step) in steps.iter().enumerate() {
            assert!((step.deviate - statistics[i]).abs() < 1e-3, "step {i}: {}", step.deviate);
            assert!((step.critical - critical[i]).abs() < 1.5e-3, "step {i}: {}", step.critical);
        }
        let positions: Vec<usize> = (0..54).collect();
        let found = outliers(&ROSNER, &positions).value.unwrap();
        assert_eq!(found.iter().map(|o| o.position).collect::<Vec<_>>(), [53, 52, 51]);
    }

    #[test]
    fn few_or_equal_values_name_nobody() {
        assert!(outliers(&[1.0; 14], &[]).value.is_none());
        assert!(outliers(&[1.0; 20], &[]).value.unwrap().is_empty());
        // One apart from others that are all alike: no spread is left without it.
        let mut values = [0.1; 30];
        values[7] = 5.0;
        assert_eq!(outliers(&values, &[]).value.unwrap().iter().map(|o| o.position).collect::<Vec<_>>(), [7]);
    }

    #[test]
    fn fifteen_values_are_enough_and_a_tenth_of_them_can_be_named() {
        let apart = |n: usize, wild: usize| -> Vec<usize> {
            let values: Vec<f64> = (0..n).map(|k| if k < wild { 1e4 * (k + 1) as f64 } else { (k as f64).sin() }).collect();
            outliers(&values, &[]).value.unwrap().iter().map(|o| o.position).collect()
        };
        assert_eq!(apart(15, 1), [0]);
        assert_eq!(apart(29, 2), [1, 0]);
        assert!(apart(29, 3).len() <= 2 && apart(60, 1) == [0]);
    }
}
