//! Polynomials of any order.

/// A polynomial by its coefficients, highest power first, as the paper prints Eq. (3).
#[derive(Debug, Clone, PartialEq)]
pub struct Polynomial {
    /// Coefficients, highest power first; empty is the zero polynomial.
    pub coefficients: Vec<f64>,
}

impl Polynomial {
    /// A polynomial from its coefficients, highest power first.
    pub fn new(coefficients: impl Into<Vec<f64>>) -> Self {
        Self { coefficients: coefficients.into() }
    }

    /// Value at `x`, by Horner's rule.
    #[inline]
    pub fn eval(&self, x: f64) -> f64 {
        self.coefficients.iter().fold(0.0, |sum, c| sum * x + c)
    }

    /// Slope at `x`.
    #[inline]
    pub fn slope(&self, x: f64) -> f64 {
        let (mut value, mut slope) = (0.0, 0.0);
        for c in &self.coefficients {
            slope = slope * x + value;
            value = value * x + c;
        }
        slope
    }

    /// The same value everywhere as the mean of this and `other`.
    pub fn mean_with(&self, other: &Self) -> Self {
        let order = self.coefficients.len().max(other.coefficients.len());
        let at = |p: &Self, k: usize| (k + p.coefficients.len()).checked_sub(order).map_or(0.0, |k| p.coefficients[k]);
        Self { coefficients: (0..order).map(|k| 0.5 * (at(self, k) + at(other, k))).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_slope_and_mean_of_known_polynomials() {
        let p = Polynomial::new([2.0, -3.0, 5.0]);
        assert_eq!(p.eval(2.0), 7.0);
        assert_eq!(p.slope(2.0), 5.0);
        assert_eq!(p.mean_with(&Polynomial::new([1.0])).coefficients, [1.0, -1.5, 3.0]);
        assert_eq!(Polynomial::new([]).eval(3.0), 0.0);
    }
}
