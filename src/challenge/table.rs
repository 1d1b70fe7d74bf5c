//! The figures of a series of trials, each with its interval: a share of few cases is not much of a share.

use std::collections::BTreeMap;

use super::case::{Grade, UNKNOWN};
use super::score::{Outcome, Verdict};
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

/// What became of the single effects of one grade.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Curve {
    /// Named first.
    pub named: Share,
    /// Somewhere in the answer.
    pub class: Share,
    /// No name, admitted that something is missing.
    pub admitted: Share,
    /// Nothing said.
    pub silent: Share,
    /// Another was named.
    pub wrong: Share,
}

impl Curve {
    fn add(&mut self, outcome: Outcome) {
        self.named.add(outcome == Outcome::Named);
        self.class.add(outcome == Outcome::Class);
        self.admitted.add(outcome == Outcome::Admitted);
        self.silent.add(outcome == Outcome::Silent);
        self.wrong.add(outcome == Outcome::Wrong);
    }
}

/// The table of a series.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Single effects, by grade.
    pub detection: BTreeMap<Grade, Curve>,
    /// Single effects of all grades but the hidden one.
    pub single: Curve,
    /// Pairs of which both are named.
    pub pairs: Share,
    /// Wrong names on valves that hide one or two effects of the library.
    pub wrong_name: Share,
    /// Valves that hide something of the library, not too small to see: some cause is named.
    pub cause_named: Share,
    /// Healthy valves accused.
    pub false_alarm: Share,
    /// Healthy valves with the verdict `match`.
    pub healthy_match: Share,
    /// Effects outside the library: admitted, and no cause named.
    pub unknown_admitted: Share,
    /// Where a cause is named: the truth is in the credible set.
    pub set_holds_truth: Share,
    /// Size of the credible sets: median and ninth decile.
    pub set_size: Option<(f64, f64)>,
    /// 95 % intervals that hold what was planted.
    pub intervals: Share,
    /// Verdict `explained` with more than one and a half of the floor left on the second drive.
    pub explained_too_early: Share,
    /// Augmented models worse on the second drive by more than 2 %.
    pub worse: Share,
    /// Names beside the concealed ones.
    pub spurious: usize,
    /// Real over claimed gain: lowest decile, median, ninth decile.
    pub real_over_claimed: Option<(f64, f64, f64)>,
    /// Median of the misfit recovered on the second drive.
    pub recovered_median: Option<f64>,
    /// Worst tenth of it.
    pub recovered_worst_tenth: Option<f64>,
    /// What was concealed, what was named first (`-`: nothing), how often.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
}

/// A claim below this [bar] is nothing to divide by.
const LEAST_CLAIM_BAR: f64 = 0.01;

/// Puts trials into a table.
pub fn tabulate<'a>(trials: impl IntoIterator<Item = &'a Trial>) -> Table {
    let mut table = Table::default();
    let (mut recovered, mut sizes, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for Trial { case, score, answer, .. } in trials {
        let truth = case.ids();
        if truth.is_empty() {
            table.false_alarm.add(score.outcome == Outcome::FalseAlarm);
            table.healthy_match.add(answer.verdict == Verdict::Match);
        } else if truth == [UNKNOWN] {
            table.unknown_admitted.add(score.outcome == Outcome::Admitted);
        } else {
            if truth.len() == 1 {
                table.detection.entry(case.grade()).or_default().add(score.outcome);
                if case.grade() != Grade::Hidden {
                    table.single.add(score.outcome);
                }
            } else {
                table.pairs.add(score.outcome == Outcome::Named);
            }
            if case.grade() != Grade::Hidden {
                table.cause_named.add(score.first.is_some());
            }
            table.wrong_name.add(score.outcome == Outcome::Wrong);
            table.spurious += score.spurious;
            recovered.extend(score.recovered);
            sizes.extend(score.set_sizes.iter().map(|n| *n as f64));
        }
        score.set_holds_truth.into_iter().for_each(|holds| table.set_holds_truth.add(holds));
        score.intervals.iter().for_each(|holds| table.intervals.add(*holds));
        score.explained_too_early.into_iter().for_each(|early| table.explained_too_early.add(early));
        table.worse.add(score.worse);
        ratios.extend(score.gain_bar.filter(|g| g.0 > LEAST_CLAIM_BAR).map(|(claimed, real)| real / claimed));
        let first = score.first.clone().unwrap_or_else(|| "-".to_owned());
        *table.confusion.entry(case.name()).or_default().entry(first).or_insert(0) += 1;
    }
    table.recovered_median = quantile(&mut recovered, 0.5);
    table.recovered_worst_tenth = quantile(&mut recovered, 0.1);
    table.set_size = quantile(&mut sizes, 0.5).zip(quantile(&mut sizes, 0.9));
    let at = |share| quantile(&mut ratios.clone(), share);
    table.real_over_claimed = at(0.1).zip(at(0.5)).zip(at(0.9)).map(|((low, middle), high)| (low, middle, high));
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
    use super::super::case::{Case, Concealed};
    use super::super::draw::placed;
    use super::super::score::{Answer, Misfit, Named};
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
        let trial = |effects: Vec<Concealed>, visible: f64, verdict, named: &[&str]| {
            let case = Case { visible, ..placed(4, effects) };
            let effects = named.iter().map(|id| Named { id: (*id).into(), ..Named::default() }).collect();
            let answer = Answer { verdict, effects, form: Vec::new(), claimed_gain_bar: 0.4, with_commission: false };
            Trial::new(&case, answer, Misfit { base_bar: 0.5, augmented_bar: 0.1, floor_bar: 0.1 })
        };
        let one = |id| vec![Concealed { id, variant: 0, severity: 1.0 }];
        let trials = [
            trial(one("creep"), 3.0, Verdict::Explained, &["creep"]),
            trial(one("creep"), 0.6, Verdict::Explained, &["leakage"]),
            trial(one("creep"), 0.1, Verdict::Match, &[]),
            trial(Vec::new(), 0.0, Verdict::Match, &[]),
            trial(Vec::new(), 0.0, Verdict::Explained, &["stiction"]),
            trial(one(UNKNOWN), 2.0, Verdict::Explained, &["creep"]),
        ];
        let table = tabulate(&trials);
        let share = |hits, of| Share { hits, of };
        assert_eq!((table.detection[&Grade::Clear].named, table.detection[&Grade::Faint].wrong), (share(1, 1), share(1, 1)));
        assert_eq!((table.single.named, table.detection[&Grade::Hidden].silent), (share(1, 2), share(1, 1)));
        assert_eq!((table.false_alarm, table.healthy_match, table.unknown_admitted), (share(1, 2), share(1, 2), share(0, 1)));
        assert_eq!((table.wrong_name, table.set_holds_truth), (share(1, 3), share(1, 2)));
        assert_eq!(table.confusion["creep"], BTreeMap::from([("creep".into(), 1), ("leakage".into(), 1), ("-".into(), 1)]));
        assert_eq!((table.spurious, table.recovered_median, table.set_size), (1, Some(1.0), Some((1.0, 1.0))));
        assert_eq!(table.real_over_claimed, Some((1.0, 1.0, 1.0)));
    }
}
