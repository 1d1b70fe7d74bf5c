//! Since when the valves of a group have what it stands out by, along a number of the list.

use statrs::function::beta::ln_beta;

/// The share of the belief that may lie on either side of the interval.
const TAIL: f64 = 0.025;
/// The level of a split that was given, 1 % [nats].
const GIVEN_NATS: f64 = 3.3;

/// Since when.
#[derive(Debug, Clone, PartialEq)]
pub struct Onset {
    /// The column, such as `mileage`.
    pub column: String,
    /// The number at which it begins; of dates the days since 1970. Half-way between the last valve before and the first after it,
    pub at: f64,
    /// and its 95 % interval, from a valve to a valve.
    pub between: (f64, f64),
    /// Whether the column holds dates.
    pub is_date: bool,
    /// Before it: how many of how many.
    pub before: (usize, usize),
    /// From it on.
    pub after: (usize, usize),
}

/// A split of a group: the valves on both sides, how many have it before and after, what it explains, and how far that speaks for it.
struct Split {
    between: (f64, f64),
    before: (usize, usize),
    after: (usize, usize),
    gain_nats: f64,
    evidence_nats: f64,
}

/// The split of a group along a number that separates those with an effect best from those without, where it beats
/// chance after all splits that were tried.
pub fn onset(columns: &[(String, bool)], numbers: &[Vec<Option<f64>>], has: &[bool], members: &[usize]) -> Option<Onset> {
    let along = |((column, is_date), numbers): (&(String, bool), &Vec<Option<f64>>)| {
        let mut at: Vec<(f64, bool)> = members.iter().filter_map(|m| Some((numbers[*m]?, has[*m]))).collect();
        at.sort_by(|a, b| a.0.total_cmp(&b.0));
        let splits = splits(&at);
        let best = splits.iter().reduce(|best, s| if s.gain_nats > best.gain_nats { s } else { best })?;
        // A split that was looked for has to gain more than one that was given: half the log of their number.
        if best.gain_nats <= GIVEN_NATS + 0.5 * (at.len() as f64).ln() {
            return None;
        }
        let between = interval(&splits);
        let Split { before, after, .. } = *best;
        let at = 0.5 * (best.between.0 + best.between.1);
        Some((best.gain_nats, Onset { column: column.clone(), at, between, is_date: *is_date, before, after }))
    };
    columns.iter().zip(numbers).filter_map(along).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, onset)| onset)
}

/// All splits of valves in the order of a number behind which the effect is more frequent.
fn splits(at: &[(f64, bool)]) -> Vec<Split> {
    let hits = at.iter().filter(|a| a.1).count();
    let as_one = likelihood((hits, at.len()));
    let mut hits_before = 0;
    let mut splits = Vec::new();
    for (k, pair) in at.windows(2).enumerate() {
        hits_before += usize::from(pair[0].1);
        let (before, after) = ((hits_before, k + 1), (hits - hits_before, at.len() - k - 1));
        if pair[0].0 < pair[1].0 && after.0 * before.1 > before.0 * after.1 {
            let gain_nats = likelihood(before) + likelihood(after) - as_one;
            let evidence_nats = evidence(before) + evidence(after);
            splits.push(Split { between: (pair[0].0, pair[1].0), before, after, gain_nats, evidence_nats });
        }
    }
    splits
}

/// Between which valves an onset lies that may be anywhere alike before the valves are looked at: the splits in their order but for a tail
/// on either side. The likelihood ratio of the best is no measure of that: an onset is no parameter that it bends around.
fn interval(splits: &[Split]) -> (f64, f64) {
    let most = splits.iter().map(|s| s.evidence_nats).fold(f64::NEG_INFINITY, f64::max);
    let belief: Vec<f64> = splits.iter().map(|s| (s.between.1 - s.between.0) * (s.evidence_nats - most).exp()).collect();
    let tail = TAIL * belief.iter().sum::<f64>();
    let first = beyond(belief.iter(), tail);
    let last = splits.len() - 1 - beyond(belief.iter().rev(), tail);
    (splits[first].between.0, splits[last].between.1)
}

/// The first with which those up to it weigh more than `tail`.
fn beyond<'a>(weights: impl Iterator<Item = &'a f64>, tail: f64) -> usize {
    let sums = weights.scan(0.0, |sum, weight| {
        *sum += weight;
        Some(*sum)
    });
    sums.take_while(|sum| *sum <= tail).count()
}

/// Log-likelihood of `k` of `n` at a rate that is not known (Jeffreys's prior).
fn evidence((k, n): (usize, usize)) -> f64 {
    ln_beta(k as f64 + 0.5, (n - k) as f64 + 0.5)
}

/// Log-likelihood of `k` of `n` at its own rate.
fn likelihood((k, n): (usize, usize)) -> f64 {
    let (k, n) = (k as f64, n as f64);
    let term = |x: f64| if x > 0.0 { x * (x / n).ln() } else { 0.0 };
    term(k) + term(n - k)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along(valves: &[(f64, bool)]) -> Option<Onset> {
        let numbers = vec![valves.iter().map(|v| Some(v.0)).collect()];
        let has: Vec<bool> = valves.iter().map(|v| v.1).collect();
        onset(&[("mileage".into(), false)], &numbers, &has, &Vec::from_iter(0..valves.len()))
    }

    #[test]
    fn an_onset_is_known_to_the_valves_beside_it() {
        let clean: Vec<(f64, bool)> = (0..16).map(|k| (f64::from(k) * 10.0 + if k >= 8 { 40.0 } else { 0.0 }, k >= 8)).collect();
        let found = along(&clean).unwrap();
        assert_eq!((found.at, found.between, found.before, found.after), (95.0, (70.0, 120.0), (0, 8), (8, 8)));
        // A healthy valve beyond it and an ill one before it leave more open, on the side where they are.
        let mut mixed = clean;
        (mixed[6].1, mixed[10].1) = (true, false);
        let found = along(&mixed).unwrap();
        assert!(found.between.0 <= 50.0 && found.between.1 >= 150.0 && (found.between.0..found.between.1).contains(&found.at), "{found:?}");
    }

    #[test]
    fn an_onset_lies_in_its_interval_as_often_as_that_says() {
        use rand::{RngExt, SeedableRng};
        let mut random = rand_pcg::Pcg64::seed_from_u64(11);
        for (count, wrong) in [(15, 0.0), (15, 0.05), (40, 0.1), (200, 0.25)] {
            let (mut told, mut held) = (0, 0);
            while told < 500 {
                let truth = random.random_range(0.0..1.0);
                let valve = |random: &mut rand_pcg::Pcg64| {
                    let at = random.random_range(0.0..1.0);
                    (at, (at > truth) != random.random_bool(wrong))
                };
                let valves: Vec<(f64, bool)> = (0..count).map(|_| valve(&mut random)).collect();
                if let Some(found) = along(&valves) {
                    told += 1;
                    held += usize::from((found.between.0..=found.between.1).contains(&truth));
                }
            }
            assert!(held * 100 >= 95 * told, "{held} of {told} with {count} valves, {wrong} of them named wrongly");
        }
    }

    #[test]
    fn what_does_not_go_with_the_number_has_no_onset() {
        let even: Vec<(f64, bool)> = (0..16).map(|k| (f64::from(k), k % 2 == 0)).collect();
        assert_eq!(along(&even), None);
        // Nor what ends with it.
        let ends: Vec<(f64, bool)> = (0..16).map(|k| (f64::from(k), k < 8)).collect();
        assert_eq!(along(&ends), None);
    }
}
