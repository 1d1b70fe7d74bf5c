//! One thing that some rows show, group by group against all others: in the group as a whole, and from some number of the list on.

use std::collections::BTreeMap;

use super::chance::{Drawn, chance};

/// A group of more rows than this is tried as a whole only: it needs no split to stand out, and each costs a sort.
const MOST_SPLIT: usize = 2000;
/// Most splits of a group that are looked at.
const MOST_SPLITS: usize = 200;
/// The level is shared by halves between the groups as a whole and their splits.
const HALVES: f64 = 2.0;

/// Hits and rows of each stratum.
type Counts = BTreeMap<usize, (usize, usize)>;

/// What is compared.
#[derive(Debug, Clone)]
pub struct Comparison<'a> {
    /// Which rows show it.
    has: &'a [bool],
    /// Which rows are held against each other.
    strata: &'a [usize],
    /// The numbers of the list (mileage, date), column by column.
    numbers: &'a [Vec<Option<f64>>],
    aside: Vec<bool>,
    everywhere: Counts,
}

/// How a group stands out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandsOut {
    /// How many of the group, and of how many.
    pub inside: (usize, usize),
    /// How many of the others of the same strata.
    pub outside: (usize, usize),
    /// By chance alone, after all splits that were tried.
    pub p_value: f64,
}

impl<'a> Comparison<'a> {
    /// Of all rows.
    pub fn new(has: &'a [bool], strata: &'a [usize], numbers: &'a [Vec<Option<f64>>]) -> Self {
        let mut comparison = Self { has, strata, numbers, aside: vec![false; has.len()], everywhere: Counts::new() };
        comparison.everywhere = comparison.count(0..has.len());
        comparison
    }

    /// Leaves a group out from here on.
    pub fn set_aside(&mut self, members: &[usize]) {
        members.iter().for_each(|m| self.aside[*m] = true);
        self.everywhere = self.count(0..self.has.len());
    }

    fn count(&self, rows: impl Iterator<Item = usize>) -> Counts {
        let mut counts = Counts::new();
        rows.filter(|k| !self.aside[*k]).for_each(|k| self.add(&mut counts, k));
        counts
    }

    fn add(&self, counts: &mut Counts, row: usize) {
        let of = counts.entry(self.strata[row]).or_default();
        *of = (of.0 + usize::from(self.has[row]), of.1 + 1);
    }

    fn drawn(&self, counts: &Counts) -> Vec<Drawn> {
        let one = |(stratum, (hits, of)): (&usize, &(usize, usize))| {
            let (all_hits, all) = self.everywhere[stratum];
            Drawn { hits: *hits, of: *of, all_hits, all }
        };
        counts.iter().map(one).collect()
    }

    /// How a group stands out, where it has more than its share.
    pub fn group(&self, members: &[usize]) -> Option<StandsOut> {
        if !members.iter().any(|m| self.has[*m] && !self.aside[*m]) {
            return None;
        }
        let drawn = self.drawn(&self.count(members.iter().copied()));
        let sum = |of: fn(&Drawn) -> usize| drawn.iter().map(of).sum::<usize>();
        let inside = (sum(|d| d.hits), sum(|d| d.of));
        let outside = (sum(|d| d.all_hits) - inside.0, sum(|d| d.all) - inside.1);
        if inside.0 == 0 || outside.1 == 0 || inside.0 * outside.1 <= outside.0 * inside.1 {
            return None;
        }
        let part = if members.len() > MOST_SPLIT { 1.0 } else { self.part_from_some_number_on(members, inside.0) };
        let p_value = HALVES * chance(&drawn).min(part);
        Some(StandsOut { inside, outside, p_value: p_value.min(1.0) })
    }

    /// The least chance of the group's part from some number of the list on, over all splits of all numbers.
    fn part_from_some_number_on(&self, members: &[usize], hits: usize) -> f64 {
        let (mut splits, mut least) = (0, 1.0_f64);
        for numbers in self.numbers {
            let mut at: Vec<(f64, usize)> = members.iter().filter(|m| !self.aside[**m]).filter_map(|m| Some((numbers[*m]?, *m))).collect();
            at.sort_by(|a, b| b.0.total_cmp(&a.0));
            let (mut counts, mut seen) = (Counts::new(), 0);
            for same in at.chunk_by(|a, b| a.0 == b.0) {
                same.iter().for_each(|(_, row)| self.add(&mut counts, *row));
                splits += 1;
                // Rows that have it not only make the part before them less sure.
                let more = same.iter().filter(|(_, row)| self.has[*row]).count();
                let step = hits.div_ceil(MOST_SPLITS);
                if seen + more > 1 && (seen + more) / step > seen / step {
                    least = least.min(chance(&self.drawn(&counts)));
                }
                seen += more;
            }
        }
        if splits == 0 { 1.0 } else { least * f64::from(splits) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_sets_in_with_a_number_stands_out_by_the_part_behind_it() {
        // Ten lots of 15; in lot 3, the four with the most kilometres have it; elsewhere one in 27.
        let lot = |k: usize| k / 15;
        let has: Vec<bool> = (0..150).map(|k| if lot(k) == 3 { k % 15 > 10 } else { k % 27 == 5 }).collect();
        let (strata, numbers) = (vec![0; 150], [(0..150).map(|k| Some((k % 15) as f64)).collect::<Vec<_>>()]);
        let members: Vec<usize> = (45..60).collect();
        let with = Comparison::new(&has, &strata, &numbers).group(&members).unwrap();
        let without = Comparison::new(&has, &strata, &[]).group(&members).unwrap();
        assert_eq!((with.inside, with.outside), ((4, 15), (5, 135)));
        assert!(with.p_value < 1e-3 && without.p_value > 1e-3, "{with:?} {without:?}");
        // Scattered over the kilometres it is no surer than before.
        let scattered: Vec<bool> = has.iter().enumerate().map(|(k, h)| if lot(k) == 3 { k % 4 == 1 } else { *h }).collect();
        let found = Comparison::new(&scattered, &strata, &numbers).group(&members).unwrap();
        assert!(found.p_value > 1e-3, "{found:?}");
    }

    #[test]
    fn rows_of_the_same_number_come_in_any_order() {
        // Lot 3: two have it at the highest number, two more at the next one, together with one that has not.
        let number = |k: usize| [(13, 5.0), (10, 4.0)].iter().find(|n| k % 15 >= n.0).map_or((k % 15 / 3) as f64, |n| n.1);
        let (strata, numbers) = (vec![0; 150], [(0..150).map(|k| Some(number(k))).collect::<Vec<_>>()]);
        let members: Vec<usize> = (45..60).collect();
        let p_values = (10..13).map(|without| {
            let has: Vec<bool> = (0..150).map(|k| if k / 15 == 3 { k % 15 > 9 && k % 15 != without } else { k % 27 == 5 }).collect();
            Comparison::new(&has, &strata, &numbers).group(&members).unwrap().p_value
        });
        let p_values: Vec<f64> = p_values.collect();
        assert!(p_values.iter().all(|p| *p == p_values[0]), "{p_values:?}");
    }

    #[test]
    fn under_chance_alone_the_least_of_all_splits_is_no_surer_than_it_says() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
        let (strata, numbers) = (vec![0; 150], [(0..150).map(|k| Some(f64::from(k % 15))).collect::<Vec<_>>()]);
        let members: Vec<usize> = (0..15).collect();
        let mut below = 0;
        for _ in 0..2000 {
            let has: Vec<bool> = (0..150).map(|_| rng.random::<f64>() < 0.1).collect();
            below += usize::from(Comparison::new(&has, &strata, &numbers).group(&members).is_some_and(|g| g.p_value < 0.05));
        }
        assert!(below <= 100, "{below} of 2000 below 0.05");
    }

    #[test]
    fn a_group_set_aside_is_no_evidence_for_another() {
        let has: Vec<bool> = (0..100).map(|k| k < 10).collect();
        let strata = vec![0; 100];
        let half: Vec<usize> = (0..50).collect();
        let mut comparison = Comparison::new(&has, &strata, &[]);
        assert!(comparison.group(&half).unwrap().p_value < 0.01);
        comparison.set_aside(&(0..10).collect::<Vec<_>>());
        assert_eq!(comparison.group(&half), None);
    }
}
