//! Anderson-Darling test of normality with estimated mean and spread.
//!
//! M. A. Stephens in R. B. D'Agostino, M. A. Stephens (eds.), "Goodness-of-Fit Techniques" (1986), Table 4.9; the
//! same form as `nortest::ad.test` in R, <https://rdrr.io/pkg/nortest/man/ad.test.html>.

use serde::{Deserialize, Serialize};

use super::Finding;
use super::distribution::normal_cdf;
use super::sample::mean_deviation;

/// Result of the test.
#[doc(alias = "Anderson-Darling")]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Normality {
    /// A squared, as computed.
    pub statistic: f64,
    /// Probability of such a value if the values were normal.
    pub p_value: f64,
    /// Whether normality stands at the 1 % level.
    pub plausible: bool,
}

/// The test; it needs eight values of which five differ.
pub fn normality(values: &[f64]) -> Finding<Normality> {
    let n = values.len();
    if n < 8 {
        return Finding::absent(format!("{n} value(s); the test needs 8"));
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let distinct = 1 + sorted.windows(2).filter(|w| w[1] > w[0]).count();
    if distinct < 5 {
        return Finding::absent(format!("{distinct} distinct value(s): the resolution is too coarse"));
    }
    let (mean, deviation) = mean_deviation(&sorted);
    // Far out, ln(cdf) would be ln(0): the floor keeps it finite and the statistic huge.
    let log_cdf = |z: f64| normal_cdf(z).max(f64::MIN_POSITIVE).ln();
    let z: Vec<f64> = sorted.iter().map(|v| (v - mean) / deviation).collect();
    let sum: f64 = (0..n).map(|i| (2 * i + 1) as f64 * (log_cdf(z[i]) + log_cdf(-z[n - 1 - i]))).sum();
    let nf = n as f64;
    let statistic = -nf - sum / nf;
    let p_value = p_value(statistic * (1.0 + 0.75 / nf + 2.25 / (nf * nf)));
    Finding::of(Normality { statistic, p_value, plausible: p_value >= 0.01 })
}

/// Stephens' approximation for the modified statistic.
fn p_value(a: f64) -> f64 {
    let p = if a < 0.2 {
        1.0 - (-13.436 + 101.14 * a - 223.73 * a * a).exp()
    } else if a < 0.34 {
        1.0 - (-8.318 + 42.796 * a - 59.938 * a * a).exp()
    } else if a < 0.6 {
        (0.9177 - 4.279 * a - 1.38 * a * a).exp()
    } else if a < 10.0 {
        (1.2937 - 5.709 * a + 0.0186 * a * a).exp()
    } else {
        3.7e-24
    };
    p.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights of eleven men: S. S. Shapiro, M. B. Wilk, Biometrika 52 (1965) 606, Example 1. A squared 0.94677 is
    /// what `scipy.stats.anderson` 1.17 gives; they reject normality there (W = 0.79, p about 0.01), so do we.
    #[test]
    fn shapiro_wilk_weights() {
        let n = normality(&[148.0, 154.0, 158.0, 160.0, 161.0, 162.0, 166.0, 170.0, 182.0, 195.0, 236.0]).value.unwrap();
        assert!((n.statistic - 0.946_771_879_6).abs() < 1e-8, "{}", n.statistic);
        assert!((n.p_value - 0.010_454).abs() < 1e-5, "{}", n.p_value);
    }

    /// Stephens' critical values of the modified statistic: 0.752 at 5 %, 1.035 at 1 % (Table 4.7, case 3).
    #[test]
    fn p_values_meet_the_critical_values() {
        assert!((p_value(0.752) - 0.05).abs() < 0.001, "{}", p_value(0.752));
        assert!((p_value(1.035) - 0.01).abs() < 0.0005, "{}", p_value(1.035));
    }

    /// Table 4.7, case 3, upper tail, to the accuracy of the approximation; below it the probability rises to one without a step.
    #[test]
    fn p_values_follow_the_table_and_have_no_steps() {
        for (statistic, p) in [(0.341, 0.5), (0.470, 0.25), (0.561, 0.15), (0.631, 0.10), (0.873, 0.025), (1.159, 0.005)] {
            assert!((p_value(statistic) / p - 1.0).abs() < 0.03, "{statistic}: {}", p_value(statistic));
        }
        // By hand, one for each piece that the table does not tell apart: 1 - e^-5.5593, 1 - e^-1.3651, e^-1.0147.
        for (statistic, p) in [(0.1, 0.99615), (0.25, 0.74465), (0.4, 0.36251)] {
            assert!((p_value(statistic) - p).abs() < 1e-4, "{statistic}: {}", p_value(statistic));
        }
        for border in [0.2, 0.34, 0.6] {
            assert!((p_value(border - 1e-9) - p_value(border + 1e-9)).abs() < 0.004, "{border}");
        }
        assert!((1..2000).all(|k| p_value(0.005 * f64::from(k)) >= p_value(0.005 * f64::from(k + 1))));
        assert_eq!(p_value(10.0), 3.7e-24);
    }

    #[test]
    fn five_distinct_values_are_enough() {
        let four = [1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 4.0];
        assert!(normality(&four).absent.unwrap().starts_with("4 distinct"));
        assert!(normality(&[1.0, 2.0, 3.0, 4.0, 5.0, 2.0, 3.0, 4.0]).value.is_some());
    }

    #[test]
    fn coarse_or_few_values_carry_no_test() {
        assert!(normality(&[1.0; 7]).absent.unwrap().contains("needs 8"));
        assert!(normality(&[1.0, 2.0, 1.0, 2.0, 1.0, 2.0, 1.0, 2.0]).absent.unwrap().contains("resolution"));
        let far = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 1e9];
        assert!(!normality(&far).value.unwrap().plausible);
    }
}
