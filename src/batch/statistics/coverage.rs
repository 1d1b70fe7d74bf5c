//! How often the interval of Ppk holds the truth, on lots of known distributions.

use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::capability::{Tolerance, capability};
use super::fitted::Fitted;
use super::{Finding, control_chart};

/// Distributions that lots are drawn from: name, distribution.
const LOTS_OF: [(&str, Fitted); 5] = [
    ("normal", Fitted::Normal { mean: 0.0, deviation: 1.0 }),
    ("gamma 16", Fitted::Gamma { shape: 16.0, scale: 1.0 }),
    ("log-normal", Fitted::LogNormal { side: 1.0, threshold: 0.0, mean_log: 0.0, deviation_log: 0.3 }),
    ("t 6", Fitted::StudentT { location: 0.0, scale: 1.0, freedom: 6.0 }),
    ("uniform", Fitted::Uniform { low: 0.0, high: 1.0 }),
];

/// Share of lots whose interval holds the true Ppk among those with an index, and share of lots with an index.
fn cover(truth: &Fitted, count: usize, lots: u64, wanted: f64) -> (f64, f64) {
    let (middle, high) = (truth.quantile(0.5), truth.quantile(0.99865));
    let tolerance = Tolerance { min: None, max: Some(middle + wanted * (high - middle)) };
    let lot = |seed: u64| {
        use rand::seq::SliceRandom;
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut values = truth.draw(count, &mut rng);
        values.shuffle(&mut rng);
        let chart = control_chart(&values, &(0..count).collect::<Vec<_>>());
        let Finding { value: Some(ppk), .. } = capability(&values, tolerance, &chart).ppk else { return (0, 0) };
        (1, usize::from(ppk.interval.low <= wanted && wanted <= ppk.interval.high))
    };
    let (given, held) = (0..lots).into_par_iter().map(lot).reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    (held as f64 / given as f64, given as f64 / lots as f64)
}

/// `HIL_LOTS` sets the number of lots: 1000 for the figures of docs/acceptance.md.
#[test]
fn the_interval_of_ppk_covers_whatever_the_shape() {
    let lots = std::env::var("HIL_LOTS").ok().and_then(|v| v.parse().ok()).unwrap_or(40);
    for (name, truth) in LOTS_OF {
        for count in [100, 400] {
            let (held, given) = cover(&truth, count, lots, 1.33);
            eprintln!("{name:<12} n {count:<4} covers {:5.1} %  index in {:5.1} %", 100.0 * held, 100.0 * given);
            // Four standard errors below 90 %, so that chance does not fail the test.
            let least = 0.9 - 4.0 * (0.09 / lots as f64).sqrt();
            assert!(held >= least && given >= 0.8, "{name}, n = {count}: {held} of {given}");
        }
    }
}
