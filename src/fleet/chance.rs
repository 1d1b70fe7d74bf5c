//! How likely chance alone would put so many of what some valves show into one group.

use statrs::distribution::{ContinuousCDF, Normal};
use statrs::function::factorial::ln_factorial;

/// A variance of the number of hits from which on it is normal (ten standard deviations from either end).
const NORMAL: f64 = 100.0;

/// A group within one stratum: rows that are held against each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// How many of the group show it,
    pub hits: usize,
    /// of how many.
    pub of: usize,
    /// How many of all rows of the stratum show it, the group included,
    pub all_hits: usize,
    /// of how many.
    pub all: usize,
}

impl Drawn {
    /// Mean and variance of the hits of the group by chance.
    fn moments(&self) -> (f64, f64) {
        let (n, hits, all) = (self.of as f64, self.all_hits as f64, self.all as f64);
        let mean = n * hits / all;
        (mean, mean * (1.0 - hits / all) * (all - n) / (all - 1.0).max(1.0))
    }

    /// The chance of each number of hits, from none on.
    fn distribution(&self) -> Vec<f64> {
        let log = |n: usize| ln_factorial(n as u64);
        let choose = |n: usize, k: usize| log(n) - log(k) - log(n - k);
        let chance = |k: usize| {
            let others = self.all_hits - k;
            if others > self.all - self.of {
                return 0.0;
            }
            (choose(self.of, k) + choose(self.all - self.of, others) - choose(self.all, self.all_hits)).exp()
        };
        (0..=self.all_hits.min(self.of)).map(chance).collect()
    }
}

/// Chance of at least so many hits in the group: Fisher's exact test, one-sided, over strata the exact form of the test of Mantel and
/// Haenszel (J. Natl. Cancer Inst. 22 (1959) 719); where the numbers are large, its normal approximation with the correction for
/// continuity.
pub fn chance(strata: &[Drawn]) -> f64 {
    let hits: usize = strata.iter().map(|d| d.hits).sum();
    let (mean, variance) = strata.iter().map(Drawn::moments).fold((0.0, 0.0), |a, m| (a.0 + m.0, a.1 + m.1));
    if variance > NORMAL {
        return Normal::standard().sf((hits as f64 - 0.5 - mean) / variance.sqrt());
    }
    let sum = strata.iter().map(Drawn::distribution).fold(vec![1.0], |sum, next| {
        let mut both = vec![0.0; sum.len() + next.len() - 1];
        for (i, a) in sum.iter().enumerate() {
            for (j, b) in next.iter().enumerate() {
                both[i + j] += a * b;
            }
        }
        both
    });
    sum[hits.min(sum.len())..].iter().sum::<f64>().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fisher(hits: usize, of: usize, other_hits: usize, others: usize) -> f64 {
        chance(&[Drawn { hits, of, all_hits: hits + other_hits, all: of + others }])
    }

    #[test]
    fn fishers_test_gives_the_published_figure() {
        // R. A. Fisher's tea tasting: 4 of 4 right of 8 cups, p = 1/70
        assert!((fisher(4, 4, 0, 4) - 1.0 / 70.0).abs() < 1e-12);
        assert!((fisher(3, 4, 1, 4) - 17.0 / 70.0).abs() < 1e-12);
    }

    #[test]
    fn strata_are_compared_each_within_itself() {
        let cups = Drawn { hits: 4, of: 4, all_hits: 4, all: 8 };
        // Twice the same tasting: both right is the product.
        assert!((chance(&[cups, cups]) - 1.0 / 4900.0).abs() < 1e-12);
        // A stratum that lies in the group as a whole says nothing.
        let whole = Drawn { hits: 7, of: 9, all_hits: 7, all: 9 };
        assert!((chance(&[cups, whole]) - 1.0 / 70.0).abs() < 1e-12);
    }

    #[test]
    fn large_numbers_are_normal() {
        let large = Drawn { hits: 440, of: 1000, all_hits: 800, all: 2000 };
        assert!(large.moments().1 > NORMAL);
        let (normal, exact) = (chance(&[large]), large.distribution()[440..].iter().sum::<f64>());
        assert!((normal / exact - 1.0).abs() < 0.1, "{normal} {exact}");
    }
}
