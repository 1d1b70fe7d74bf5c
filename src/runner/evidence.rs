//! Evidence of a run's own timing, and whether it suffices.

use crate::plan::TimingLimits;
use crate::record::{Timing, Trace};
use crate::rig::Quality;

/// Upper edges of the histogram of the lateness [s].
const LATENESS_EDGES_S: [f64; 12] = [20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 50e-3, f64::INFINITY];

/// The timing of a run; `simulated` rigs have no clock and so no lateness.
pub fn timing(trace: &Trace, period_s: f64, missed_slots: u64, simulated: bool) -> Timing {
    let count = |of: fn(&Quality) -> bool| trace.quality.iter().filter(|q| of(q)).count() as u64;
    let mut timing = Timing {
        period_s,
        missed_slots,
        lost_samples: count(|q| matches!(q, Quality::Held | Quality::Exception | Quality::Implausible)),
        stale_samples: count(|q| *q == Quality::Stale),
        samples: trace.time_s.len() as u64,
        ..Timing::default()
    };
    if simulated || trace.time_s.is_empty() {
        return timing;
    }
    let late = sorted(&trace.lateness_s);
    timing.lateness_p50_s = quantile(&late, 0.5);
    timing.lateness_p99_s = quantile(&late, 0.99);
    timing.lateness_max_s = late.last().copied();
    timing.lateness_histogram = histogram(&late, &LATENESS_EDGES_S);
    let round_trips = sorted(&trace.round_trip_s);
    if let (Some(p50), Some(p99), Some(max)) = (quantile(&round_trips, 0.5), quantile(&round_trips, 0.99), round_trips.last()) {
        timing.round_trip_s = Some((p50, p99, *max));
    }
    let periods: Vec<f64> = trace.time_s.windows(2).map(|w| w[1] - w[0]).collect();
    let edges: Vec<f64> = [0.5, 0.8, 0.9, 0.95, 0.99, 1.01, 1.05, 1.1, 1.2, 1.5, 2.0, 5.0].iter().map(|f| f * period_s).collect();
    let edges: Vec<f64> = edges.into_iter().chain([f64::INFINITY]).collect();
    timing.period_histogram = histogram(&sorted(&periods), &edges);
    timing
}

/// What breaks the plan's limits on the timing, in words.
pub fn broken(timing: &Timing, limits: &TimingLimits) -> Vec<String> {
    let mut reasons = Vec::new();
    let samples = timing.samples.max(1) as f64;
    let slots = samples + timing.missed_slots as f64;
    let mut share = |what: &str, count: u64, of: f64, most: f64| {
        if count as f64 > most * of {
            reasons.push(format!(
                "{what}: {count} of {of:.0} ({:.3} %), at most {:.3} % are allowed",
                100.0 * count as f64 / of,
                100.0 * most
            ));
        }
    };
    share("lost samples", timing.lost_samples, samples, limits.max_lost);
    share("stale samples", timing.stale_samples, samples, limits.max_stale);
    share("missed slots", timing.missed_slots, slots, limits.max_missed);
    let mut time = |what: &str, value: Option<f64>, most: Option<f64>| {
        if let (Some(value), Some(most)) = (value, most)
            && value > most
        {
            reasons.push(format!("{what}: {:.3} ms, at most {:.3} ms are allowed", value * 1e3, most * 1e3));
        }
    };
    time("lateness, 99th percentile", timing.lateness_p99_s, limits.max_lateness_p99_s);
    time("largest lateness", timing.lateness_max_s, limits.max_lateness_s);
    reasons
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Nearest-rank quantile of sorted values.
fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

/// Counts up to each edge; the unbounded last edge is written as the largest value seen.
fn histogram(sorted: &[f64], edges: &[f64]) -> Vec<(f64, u64)> {
    let Some(largest) = sorted.last() else { return Vec::new() };
    let mut below = 0;
    edges
        .iter()
        .map(|edge| {
            let up_to = sorted.partition_point(|v| v <= edge);
            let count = (up_to - below) as u64;
            below = up_to;
            (if edge.is_finite() { *edge } else { *largest }, count)
        })
        .filter(|(_, count)| *count > 0)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(quality: &[Quality]) -> Trace {
        let n = quality.len();
        Trace {
            time_s: (0..n).map(|k| k as f64 * 0.01).collect(),
            quality: quality.to_vec(),
            lateness_s: (0..n).map(|k| k as f64 * 1e-5).collect(),
            round_trip_s: vec![0.002; n],
            ..Trace::default()
        }
    }

    #[test]
    fn counts_and_percentiles() {
        let mut quality = vec![Quality::Good; 100];
        quality[3] = Quality::Held;
        quality[4] = Quality::Stale;
        let timing = timing(&trace(&quality), 0.01, 2, false);
        assert_eq!((timing.lost_samples, timing.stale_samples, timing.samples), (1, 1, 100));
        let micros = |v: Option<f64>| (v.unwrap() * 1e6).round();
        assert_eq!([timing.lateness_p50_s, timing.lateness_p99_s, timing.lateness_max_s].map(micros), [490.0, 980.0, 990.0]);
        assert_eq!(timing.lateness_histogram.iter().map(|b| b.1).sum::<u64>(), 100);
        let limits =
            TimingLimits { max_lost: 0.005, max_stale: 0.02, max_missed: 0.02, max_lateness_p99_s: Some(5e-4), max_lateness_s: None };
        insta::assert_snapshot!(broken(&timing, &limits).join("\n"), @"
        lost samples: 1 of 100 (1.000 %), at most 0.500 % are allowed
        lateness, 99th percentile: 0.980 ms, at most 0.500 ms are allowed
        ");
    }

    #[test]
    fn a_simulation_has_no_clock() {
        let timing = timing(&trace(&[Quality::Good; 10]), 0.01, 0, true);
        assert_eq!((timing.lateness_max_s, timing.round_trip_s), (None, None));
    }
}
