//! Pareto of the failures: what fails most, and how much of all failures the first few carry.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// One cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParetoBar {
    /// What failed.
    pub cause: String,
    /// How often.
    pub count: usize,
    /// Share of all failures up to and including this cause.
    pub cumulative: f64,
}

/// The causes, the most frequent first; equal counts in the order of their names.
pub fn pareto<'a>(causes: impl IntoIterator<Item = &'a str>) -> Vec<ParetoBar> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for cause in causes {
        *counts.entry(cause).or_default() += 1;
    }
    let all: usize = counts.values().sum();
    let mut bars: Vec<(&str, usize)> = counts.into_iter().collect();
    bars.sort_by_key(|bar| std::cmp::Reverse(bar.1));
    let mut sum = 0;
    let bar = |(cause, count): (&str, usize)| {
        sum += count;
        ParetoBar { cause: cause.into(), count, cumulative: sum as f64 / all as f64 }
    };
    bars.into_iter().map(bar).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_frequent_first_and_the_last_reaches_one() {
        let bars = pareto(["b", "a", "b", "c", "b", "a", "d"]);
        let seen: Vec<_> = bars.iter().map(|b| (b.cause.as_str(), b.count)).collect();
        assert_eq!(seen, [("b", 3), ("a", 2), ("c", 1), ("d", 1)]);
        assert_eq!(bars[3].cumulative, 1.0);
        assert!((bars[0].cumulative - 3.0 / 7.0).abs() < 1e-15);
        assert!(pareto([]).is_empty());
    }
}
