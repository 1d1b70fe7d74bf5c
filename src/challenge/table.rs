//! The figures of a series of trials, each with its interval: a share of few cases is not much of a share.

use std::collections::BTreeMap;

use super::draw::UNKNOWN;
use super::trial::Trial;

/// So many of so many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Share {
    /// Cases in which it holds.
    pub hits: usize,
    /// Cases in all.
    pub of: usize,
}

impl Share {
    fn add(&mut self, hit: bool) {
        self.of += 1;
        self.hits += usize::from(hit);
    }

    /// The share, `None` of no cases.
    pub fn value(self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }

    /// Wilson's 95 % interval (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209), `None` of no cases.
    pub fn wilson(self) -> Option<(f64, f64)> {
        let (p, n, z) = (self.value()?, self.of as f64, 1.959_964);
        let middle = p + z * z / (2.0 * n);
        let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        let scale = 1.0 + z * z / n;
        Some((((middle - half) / scale).max(0.0), ((middle + half) / scale).min(1.0)))
    }
}

/// The table of a series.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Single effects named first.
    pub named_first: Share,
    /// The clear ones among them.
    pub named_clear: Share,
    /// The faint ones among them.
    pub named_faint: Share,
    /// Single effects named, or in a named one's class of at most three.
    pub in_class: Share,
    /// Pairs of which both are named.
    pub pairs: Share,
    /// Healthy valves left alone.
    pub healthy_left_alone: Share,
    /// Effects outside the library that were admitted as unexplained.
    pub unknown_admitted: Share,
    /// False names on valves that hide one or two effects of the library.
    pub spurious: usize,
    /// Median of the misfit recovered on the second drive.
    pub recovered_median: Option<f64>,
    /// Worst tenth of it.
    pub recovered_worst_tenth: Option<f64>,
    /// What was concealed, what was named first (`-`: nothing), how often.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
}

/// Puts trials into a table.
pub fn tabulate<'a>(trials: impl IntoIterator<Item = &'a Trial>) -> Table {
    let mut table = Table::default();
    let mut recovered = Vec::new();
    for Trial { case, score, .. } in trials {
        let truth = case.ids();
        if truth.is_empty() {
            table.healthy_left_alone.add(score.right);
        } else if truth == [UNKNOWN] {
            table.unknown_admitted.add(score.right);
        } else {
            if truth.len() == 1 {
                table.named_first.add(score.right);
                if case.effects[0].severity > 0.9 {
                    table.named_clear.add(score.right)
                } else {
                    table.named_faint.add(score.right)
                }
                table.in_class.add(score.in_class);
            } else {
                table.pairs.add(score.right);
            }
            table.spurious += score.spurious;
            recovered.extend(score.recovered);
        }
        let first = score.first.clone().unwrap_or_else(|| "-".to_owned());
        *table.confusion.entry(case.name()).or_default().entry(first).or_insert(0) += 1;
    }
    table.recovered_median = quantile(&mut recovered, 0.5);
    table.recovered_worst_tenth = quantile(&mut recovered, 0.1);
    table
}

/// Quantile with linear interpolation between order statistics.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let at = share * values.len().checked_sub(1)? as f64;
    let (low, part) = (at.floor() as usize, at.fract());
    let high = (low + 1).min(values.len() - 1);
    Some(values[low] + part * (values[high] - values[low]))
}

#[cfg(test)]
mod tests {
    use super::super::draw::{Concealed, placed};
    use super::super::score::{Answer, Misfit, Named, Verdict, score};
    use super::*;

    #[test]
    fn wilson_gives_the_published_figures() {
        // 31 of 32: 84 to 99 %; 0 of 20: 0 to 16 %
        let (low, high) = Share { hits: 31, of: 32 }.wilson().unwrap_or_default();
        assert!((low - 0.843).abs() < 0.002 && (high - 0.994).abs() < 0.002, "{low} {high}");
        let (low, high) = Share { hits: 0, of: 20 }.wilson().unwrap_or_default();
        assert!(low < 1e-12 && (high - 0.161).abs() < 0.002, "{low} {high}");
        assert_eq!(Share::default().wilson(), None);
    }

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(&mut [0.0, 10.0], 0.1), Some(1.0));
        assert_eq!(quantile(&mut [], 0.5), None);
    }

    #[test]
    fn a_table_counts_each_kind_of_case_apart() {
        let trial = |effects: Vec<Concealed>, verdict, named: &[&str]| {
            let case = placed(4, effects);
            let effects = named.iter().map(|id| Named { id: (*id).into(), indistinguishable: Vec::new() }).collect();
            let answer = Answer { verdict, effects };
            let misfit = Misfit { base_bar: 0.5, augmented_bar: 0.1, floor_bar: 0.1 };
            let score = score(&case, &answer, Some(misfit));
            Trial { case, answer, misfit, score }
        };
        let one = |id, severity| vec![Concealed { id, variant: 0, severity }];
        let trials = [
            trial(one("creep", 1.0), Verdict::Explained, &["creep"]),
            trial(one("creep", 0.4), Verdict::Explained, &["leakage"]),
            trial(Vec::new(), Verdict::Match, &[]),
            trial(one(UNKNOWN, 1.0), Verdict::Explained, &["creep"]),
        ];
        let table = tabulate(&trials);
        assert_eq!(
            (table.named_first, table.named_clear, table.named_faint),
            (Share { hits: 1, of: 2 }, Share { hits: 1, of: 1 }, Share { hits: 0, of: 1 })
        );
        assert_eq!((table.healthy_left_alone, table.unknown_admitted), (Share { hits: 1, of: 1 }, Share { hits: 0, of: 1 }));
        assert_eq!(table.confusion["creep"], BTreeMap::from([("creep".to_owned(), 1), ("leakage".to_owned(), 1)]));
        assert_eq!((table.spurious, table.recovered_median), (1, Some(1.0)));
    }
}
