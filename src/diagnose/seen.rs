//! Which movements of the current data of the good valve shows, and which only the record does: what the good valve does in those,
//! nobody knows.

use super::evidence::Evidence;
use crate::course::Run;
use crate::recording::Recording;

/// How long a valve shows a fast movement of the current [s].
const BEHIND_S: f64 = 0.5;

/// So many movements show what a valve does at their pace; what follows one of them may be a matter of where it was.
const SHOWN: usize = 3;

/// A current that goes nearly all of its way in a tenth of the time is one of steps.
const STEPS: (f64, f64) = (0.95, 0.1);

/// A turn of the current of less than this share of its range is no reversal that a loop would be seen by.
const REVERSAL: f64 = 0.02;

/// Whether one of the recordings moves as fast as the record does, so that they can speak for the model on it. A slower one beside it
/// says what the curves and the loop are where the drive has not been.
pub fn speaks(record: &Evidence, good: &[Recording]) -> bool {
    let needed = needed(record);
    let moves = |r: &Recording| lively(&r.runs.iter().map(|run| (run.step_s(), run.current_a.as_slice())).collect::<Vec<_>>()) >= needed;
    good.iter().any(moves)
}

/// How fast data has to move to speak for the model on this record [A/s].
fn needed(record: &Evidence) -> f64 {
    record.criteria.excites * lively(&record.grids.iter().map(|g| (g.dt_s, g.current_a.as_slice())).collect::<Vec<_>>())
}

/// RMS rate of the current over tenths of a second [A/s]: steps and slow ramps alike count by what they move.
fn lively(runs: &[(f64, &[f64])]) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for (dt_s, current) in runs.iter().filter(|r| r.0 > 0.0) {
        for way_a in ways(*dt_s, current) {
            sum += (way_a / (tenth(*dt_s) as f64 * dt_s)).powi(2);
            n += 1.0;
        }
    }
    f64::sqrt(sum / f64::max(n, 1.0))
}

/// Whether the record is of steps, and so is what of `good` moves as fast.
pub fn are_of_steps(good: &Evidence, record: &Evidence) -> bool {
    let needed = needed(record);
    let moves = |run: &&Run| lively(&[(run.dt_s, run.current_a.as_slice())]) >= needed;
    is_of_steps(record.grids.iter()) && is_of_steps(good.grids.iter().filter(moves))
}

/// Whether the current rests but for steps: a ramp goes a little way in each tenth of a second, however often it is sampled.
fn is_of_steps<'r>(runs: impl Iterator<Item = &'r Run>) -> bool {
    let mut all: Vec<f64> = runs.flat_map(|run| ways(run.dt_s, &run.current_a)).collect();
    all.sort_by(|a, b| b.total_cmp(a));
    let (few, whole) = (all[..(STEPS.1 * all.len() as f64) as usize].iter().sum::<f64>(), all.iter().sum::<f64>());
    whole > 0.0 && few >= STEPS.0 * whole
}

/// The ways that the current goes from each tenth of a second to the next [A].
fn ways(dt_s: f64, current_a: &[f64]) -> Vec<f64> {
    let thinned: Vec<f64> = current_a.iter().copied().filter(|i| i.is_finite()).step_by(tenth(dt_s)).collect();
    thinned.windows(2).map(|w| (w[1] - w[0]).abs()).collect()
}

/// How fast the current has moved over the tenth of a second before each sample [A/s].
fn rates(run: &Run) -> impl Iterator<Item = f64> {
    let every = tenth(run.dt_s);
    (0..run.len()).map(move |k| (run.current_a[k] - run.current_a[k.saturating_sub(every)]).abs() / (every as f64 * run.dt_s))
}

/// How fast the current moves in its fastest movements, the [`SHOWN`]-th of them, or in all where there are fewer [A/s].
fn fastest(runs: &[Run]) -> f64 {
    let mut rates: Vec<Vec<f64>> = runs.iter().map(|run| rates(run).collect()).collect();
    let mut slowest = 0.0;
    for _ in 0..SHOWN {
        let peaks = rates.iter().enumerate().flat_map(|(r, rates)| rates.iter().enumerate().map(move |(k, rate)| (*rate, r, k)));
        let Some((rate, run, at)) = peaks.filter(|(rate, ..)| *rate > 0.0).max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        slowest = rate;
        let about = (BEHIND_S / runs[run].dt_s) as usize;
        let end = (at + about + 1).min(rates[run].len());
        rates[run][at.saturating_sub(about)..end].fill(0.0);
    }
    slowest
}

/// Which samples of `record` lie behind a movement so fast that the fastest of `good` do not reach this share of it.
pub fn faster(good: &Evidence, record: &Evidence, share: f64) -> Vec<bool> {
    let fastest = fastest(&good.grids) / share;
    let of_run = |run: &Run| {
        let behind = (BEHIND_S / run.dt_s) as usize;
        let mut last = None;
        let seen = rates(run).enumerate().map(|(k, rate)| {
            if rate > fastest {
                last = Some(k);
            }
            last.is_some_and(|l| k - l <= behind)
        });
        seen.collect::<Vec<bool>>()
    };
    record.grids.iter().flat_map(of_run).collect()
}

/// Samples in a tenth of a second, at least one.
fn tenth(dt_s: f64) -> usize {
    ((0.1 / dt_s).round() as usize).max(1)
}

/// Which samples of `record` lie behind a swing between two reversals so small that `good` shows next to none of the kind: how the
/// loop closes there is a matter of its form, which larger loops do not tell.
pub fn smaller(good: &Evidence, record: &Evidence) -> Vec<bool> {
    let mut known: Vec<f64> = good.grids.iter().flat_map(swings).collect();
    known.sort_by(f64::total_cmp);
    // One wiggle at the end of a sweep shows nothing.
    let smallest = known.get(known.len() / 20).copied().unwrap_or(f64::INFINITY);
    record.grids.iter().flat_map(swings).map(|swing| swing < record.criteria.reaches * smallest).collect()
}

/// At each sample the length of the last whole swing before it, from reversal to reversal [A]; before the second reversal that of the
/// first way.
fn swings(run: &Run) -> Vec<f64> {
    let current = &run.current_a;
    let (low, high) = current.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), i| (l.min(*i), h.max(*i)));
    let least = REVERSAL * (high - low);
    let Some(first) = current.first().copied() else { return Vec::new() };
    let (mut turn, mut furthest, mut rising, mut last) = (first, first, None, None);
    let mut out: Vec<Option<f64>> = Vec::with_capacity(current.len());
    for i in current {
        let ahead = match rising {
            Some(true) => i - furthest,
            Some(false) => furthest - i,
            None => 0.0,
        };
        if rising.is_none() && (i - first).abs() > least {
            (rising, furthest) = (Some(*i > first), *i);
        } else if ahead > 0.0 {
            furthest = *i;
        } else if ahead < -least {
            last = Some((furthest - turn).abs());
            (turn, furthest, rising) = (furthest, *i, rising.map(|r| !r));
        }
        out.push(last);
    }
    let before = out.iter().flatten().next().copied().unwrap_or(high - low);
    out.into_iter().map(|swing| swing.unwrap_or(before)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::evidence::tests::held;

    #[test]
    fn steps_are_steps_and_ramps_are_ramps_however_often_they_are_sampled() {
        let of_steps = |rate_hz: f64, current_a: &dyn Fn(f64) -> f64| {
            let current_a: Vec<f64> = (0..(60.0 * rate_hz) as usize).map(|k| current_a(k as f64 / rate_hz)).collect();
            is_of_steps([Run::even(None, 0.0, 1.0 / rate_hz, current_a.clone(), current_a)].iter())
        };
        for rate_hz in [10.0, 50.0, 100.0, 1000.0, 5000.0] {
            assert!(of_steps(rate_hz, &|t_s| if ((t_s / 2.0) as usize).is_multiple_of(2) { 0.3 } else { 0.6 }), "steps at {rate_hz} Hz");
            assert!(!of_steps(rate_hz, &|t_s| 0.2 + 0.6 * (1.0 - (t_s / 30.0 - 1.0).abs())), "a sweep at {rate_hz} Hz");
            assert!(!of_steps(rate_hz, &|t_s| 0.5 + 0.3 * t_s.sin()), "an oscillation at {rate_hz} Hz");
            assert!(!of_steps(rate_hz, &|_| 0.5), "no movement at {rate_hz} Hz");
        }
    }

    #[test]
    fn a_slow_sweep_beside_a_drive_of_steps_is_no_other_drive() {
        let run = |current_a: &dyn Fn(f64) -> f64| {
            let current_a: Vec<f64> = (0..6000).map(|k| current_a(f64::from(k) / 100.0)).collect();
            Run::even(None, 0.0, 0.01, current_a.clone(), current_a)
        };
        let steps = || run(&|t_s| if ((t_s / 2.0) as usize).is_multiple_of(2) { 0.3 } else { 0.6 });
        let (sweep, waves) = (|| run(&|t_s| 0.2 + 0.6 * (1.0 - (t_s / 30.0 - 1.0).abs())), run(&|t_s| 0.5 + 0.3 * t_s.sin()));
        let record = held(vec![steps()]);
        assert!(are_of_steps(&held(vec![steps()]), &record) && are_of_steps(&held(vec![sweep(), steps()]), &record));
        assert!(!are_of_steps(&held(vec![waves.clone(), steps()]), &record) && !are_of_steps(&held(vec![steps()]), &held(vec![waves])));
        assert!(!are_of_steps(&held(vec![sweep()]), &record));
    }

    #[test]
    fn a_movement_twice_as_fast_as_any_of_the_good_valve_is_unseen_for_half_a_second() {
        // Up by 0.3 A within so many samples of 10 ms, after 2 s.
        let run = |within: usize| {
            let current: Vec<f64> = (0..600).map(|k: usize| 0.3 + 0.3 * (k.saturating_sub(200) as f64 / within as f64).min(1.0)).collect();
            Run::even(None, 0.0, 0.01, current.clone(), current)
        };
        let evidence = |within: usize| held(vec![run(within)]);
        let unseen = |good: usize, record: usize| {
            let all = faster(&evidence(good), &evidence(record), 0.5);
            (all.iter().position(|u| *u), all.iter().filter(|u| **u).count())
        };
        assert_eq!(unseen(10, 10), (None, 0));
        assert_eq!(unseen(10, 6), (None, 0), "not twice as fast over a tenth of a second");
        let (first, count) = unseen(40, 10);
        assert!(first.is_some_and(|k| (200..=210).contains(&k)) && (50..=70).contains(&count), "{first:?} {count}");
    }

    #[test]
    fn what_follows_one_fast_movement_or_two_is_not_known_of_the_next() {
        // Steps of 0.1 A every second, and so many of 0.4 A among them.
        let drive = |fast: usize| {
            let step = |k: usize| if k % 4 == 1 && k / 4 < fast { 0.4 } else { 0.1 };
            let current: Vec<f64> = (0..2000).map(|k: usize| if (k / 100).is_multiple_of(2) { 0.3 } else { 0.3 + step(k / 100) }).collect();
            held(vec![Run::even(None, 0.0, 0.01, current.clone(), current)])
        };
        let unseen = |good: usize| faster(&drive(good), &drive(4), 0.5).contains(&true);
        // A step goes up and down again.
        assert!([0, 1].iter().all(|good| unseen(*good)) && [2, 3, 4].iter().all(|good| !unseen(*good)));
        assert!((fastest(&drive(1).grids) - 1.0).abs() < 1e-9 && (fastest(&drive(2).grids) - 4.0).abs() < 1e-9);
    }

    #[test]
    fn a_swing_half_as_large_as_any_of_the_good_valve_is_unseen() {
        let waves = |swings: &[f64]| {
            let mut current = vec![0.3];
            for (k, swing) in swings.iter().enumerate() {
                let (from, way) = (current[current.len() - 1], if k % 2 == 0 { *swing } else { -swing });
                current.extend((1..=100).map(|j| from + way * f64::from(j) / 100.0));
            }
            held(vec![Run::even(None, 0.0, 0.01, current.clone(), current)])
        };
        let good = waves(&[0.5, 0.5, 0.4, 0.2, 0.2, 0.2]);
        let share = |record: &Evidence| {
            let new = smaller(&good, record);
            new.iter().filter(|u| **u).count() as f64 / new.len() as f64
        };
        assert!(share(&waves(&[0.5, 0.3, 0.2, 0.15, 0.15])) < 1e-9);
        assert!(share(&waves(&[0.5, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05])) > 0.6);
        let one_wiggle =
            waves(&[0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.05]);
        let small = waves(&[0.5, 0.05, 0.05, 0.05, 0.05, 0.05]);
        assert!(smaller(&one_wiggle, &small).iter().any(|u| *u), "one wiggle at the end shows nothing");
    }
}
