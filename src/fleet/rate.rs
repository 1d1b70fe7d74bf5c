//! A share with its interval, and what is left of it once a diagnosis that misses and invents is allowed for.

use crate::batch::statistics::wilson;

/// The share of something in a group, with Wilson's interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// How many.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
    /// The share.
    pub value: f64,
    /// 95 % interval.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl Rate {
    /// Counts with their interval; of nothing, from 0 to 1.
    pub fn new(hits: usize, of: usize) -> Self {
        if of == 0 {
            return Self { hits, of, value: 0.0, low: 0.0, high: 1.0 };
        }
        let w = wilson(hits, of);
        Self { hits, of, value: hits as f64 / of as f64, low: w.low, high: w.high }
    }

    /// Corrected for a diagnosis that finds `found` of the faulty and accuses `accused` of the healthy
    /// (W. J. Rogan, B. Gladen, Am. J. Epidemiol. 107 (1978) 71); `None` where it tells nothing apart.
    pub fn corrected(self, found: Self, accused: Self) -> Option<(f64, f64, f64)> {
        let power = found.value - accused.value;
        if self.of == 0 || power < 0.05 {
            return None;
        }
        let value = (self.value - accused.value) / power;
        let variance = |r: Self| r.value * (1.0 - r.value) / r.of.max(1) as f64;
        let spread = (variance(self) + value.powi(2) * variance(found) + (1.0 - value).powi(2) * variance(accused)).sqrt() / power;
        Some((value.clamp(0.0, 1.0), (value - 1.96 * spread).clamp(0.0, 1.0), (value + 1.96 * spread).clamp(0.0, 1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_corrected_for_what_the_diagnosis_misses_and_invents() {
        let (found, accused) = (Rate::new(80, 100), Rate::new(5, 100));
        let corrected = Rate::new(125, 1000).corrected(found, accused);
        assert!(corrected.is_some_and(|(v, low, high)| (v - 0.1).abs() < 1e-9 && low < 0.1 && high > 0.1), "{corrected:?}");
        assert_eq!(Rate::new(1, 10).corrected(Rate::new(5, 100), Rate::new(5, 100)), None);
    }
}
