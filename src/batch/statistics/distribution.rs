//! Quantiles and tail probabilities that the figures of this room need.

use statrs::distribution::{Beta, ChiSquared, ContinuousCDF, FisherSnedecor, Normal, StudentsT};

/// Quantile of the standard normal distribution.
pub(super) fn normal_quantile(p: f64) -> f64 {
    Normal::standard().inverse_cdf(p)
}

/// Distribution function of the standard normal distribution.
pub(super) fn normal_cdf(z: f64) -> f64 {
    Normal::standard().cdf(z)
}

/// Quantile of Student's t; NaN where `freedom` is not positive.
pub(in crate::batch) fn t_quantile(p: f64, freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom).map_or(f64::NAN, |t| t.inverse_cdf(p))
}

/// Two-sided tail probability of Student's t.
pub(in crate::batch) fn t_two_sided(t: f64, freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom).map_or(f64::NAN, |d| 2.0 * d.cdf(-t.abs()))
}

/// Quantile of chi-squared, by bisection of its distribution function to full precision.
pub(super) fn chi_squared_quantile(p: f64, freedom: f64) -> f64 {
    let Ok(d) = ChiSquared::new(freedom) else { return f64::NAN };
    let mut high = freedom.max(1.0);
    while d.cdf(high) < p && high < 1e12 {
        high *= 2.0;
    }
    bisect(0.0, high, |x| d.cdf(x) < p)
}

/// Quantile of the beta distribution.
pub(super) fn beta_quantile(p: f64, a: f64, b: f64) -> f64 {
    let Ok(d) = Beta::new(a, b) else { return f64::NAN };
    bisect(0.0, 1.0, |x| d.cdf(x) < p)
}

/// Upper tail probability of F.
pub(in crate::batch) fn f_upper(f: f64, numerator: f64, denominator: f64) -> f64 {
    FisherSnedecor::new(numerator, denominator).map_or(f64::NAN, |d| d.sf(f))
}

/// The point where `below` turns false, to the last bit that matters.
pub(super) fn bisect(mut low: f64, mut high: f64, below: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the tables in NIST/SEMATECH e-Handbook 1.3.6.7 (normal, t, chi-squared, F).
    #[test]
    fn agrees_with_printed_tables() {
        assert!((normal_quantile(0.975) - 1.960).abs() < 5e-4);
        assert!((t_quantile(0.975, 10.0) - 2.228).abs() < 5e-4);
        assert!((chi_squared_quantile(0.95, 10.0) - 18.307).abs() < 5e-4);
        assert!((chi_squared_quantile(0.025, 30.0) - 16.791).abs() < 5e-4);
        assert!((f_upper(3.326, 5.0, 10.0) - 0.05).abs() < 5e-5);
        assert!((beta_quantile(0.5, 3.0, 3.0) - 0.5).abs() < 1e-12);
    }
}
