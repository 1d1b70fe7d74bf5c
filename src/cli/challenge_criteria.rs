//! `hil challenge --criteria`: what every threshold of a diagnosis is worth, at half, once and twice its value.

use rayon::prelude::*;

use super::challenge_contestant::Processes;
use crate::challenge::{Case, Outcome, score};
use crate::diagnose::Criteria;
use crate::report::thresholds::{Tally, Threshold};

/// The thresholds with the values that are tried beside the usual one: half of it and twice as much; what is below one, and
/// twice would be beyond, goes half-way to one.
pub(super) fn tried() -> Vec<(String, f64, [f64; 2])> {
    let beside = |value: f64| [0.5 * value, if value < 1.0 && 2.0 * value > 1.0 { 0.5 * (1.0 + value) } else { 2.0 * value }];
    Criteria::default().values().into_iter().map(|(name, value)| (name, value, beside(value))).collect()
}

/// The tallies of a series, threshold by threshold.
#[derive(Default)]
pub(super) struct Tallies {
    usual: Tally,
    beside: Vec<[Tally; 2]>,
    moved: Vec<[usize; 2]>,
}

impl Tallies {
    /// Asks a case again by each threshold at other values; `usual`: what it was worth by the usual ones.
    pub(super) fn ask(&mut self, case: &Case, usual: Outcome, contestant: &Processes) -> Result<(), String> {
        let tried = tried();
        self.beside.resize(tried.len(), [Tally::default(); 2]);
        self.moved.resize(tried.len(), [0; 2]);
        let again = contestant.again()?;
        if !tried.iter().all(|(name, _, values)| values.iter().all(|value| again.kept(name, *value).is_some())) {
            again.as_usual()?;
        }
        let answers = tried.par_iter().map(|(name, _, values)| {
            let at = |value: f64| again.by_criterion(name, value).map(|answer| score(case, &answer, None).outcome);
            Ok([at(values[0])?, at(values[1])?])
        });
        let answers = answers.collect::<Result<Vec<[Outcome; 2]>, String>>()?;
        self.usual.add(usual);
        for (k, outcomes) in answers.into_iter().enumerate() {
            for (at, outcome) in outcomes.into_iter().enumerate() {
                self.beside[k][at].add(outcome);
                self.moved[k][at] += usize::from(outcome != usual);
            }
        }
        Ok(())
    }

    /// The rows of the table.
    pub(super) fn rows(self) -> (Tally, Vec<Threshold>) {
        let Self { usual, beside, moved } = self;
        let rows = tried().into_iter().zip(beside).zip(moved).map(|(((name, value, values), tallies), moved)| Threshold {
            name,
            value,
            beside: [0, 1].map(|at| (values[at], tallies[at], moved[at])),
        });
        (usual, rows.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_and_twice_are_tried_and_a_share_stays_one() {
        let all = tried();
        let of = |name: &str| all.iter().find(|t| t.0 == name).map(|t| (t.1, t.2)).unwrap();
        assert_eq!(of("very_strong"), (10.0, [5.0, 20.0]));
        assert_eq!(of("power"), (0.5, [0.25, 1.0]));
        let (credible, [half, more]) = of("credible");
        assert!((half - 0.5 * credible).abs() < 1e-12 && (more - 0.95).abs() < 1e-12, "{half} {more}");
    }
}
