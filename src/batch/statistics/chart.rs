//! Individuals and moving-range chart with run rules.
//!
//! Limits: NIST/SEMATECH e-Handbook of Statistical Methods 6.3.2.2, <https://www.itl.nist.gov/div898/handbook/pmc/section3/pmc322.htm>.
//! The run rules are those of [`super::rules`].

use serde::{Deserialize, Serialize};

use super::Finding;
use super::rules::{FALSE_ALARMS, RULES, Rule};

/// d2 for a moving range of two, as the tables give it.
pub const WITHIN_D2: f64 = 1.128;
/// D4 for a moving range of two.
const D4: f64 = 3.267;
/// Fewer values than this give limits that mean nothing.
const FEWEST: usize = 10;

/// Where a rule spoke.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Signal {
    /// Which rule.
    pub rule: Rule,
    /// The rule in words, with the number that it has for this batch.
    pub text: String,
    /// How often.
    pub count: usize,
    /// Position in the batch (from 0) of the last point of each of the first twenty.
    pub at: Vec<usize>,
}

/// Individuals and moving-range chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ControlChart {
    /// Centre of the individuals.
    pub centre: f64,
    /// Mean moving range.
    pub mean_moving_range: f64,
    /// Short-term standard deviation: mean moving range / 1.128.
    #[doc(alias("sigma", "short-term standard deviation"))]
    pub within_deviation: f64,
    /// Lower limit of the individuals.
    #[doc(alias = "LCL")]
    pub lower: f64,
    /// Upper limit of the individuals.
    #[doc(alias = "UCL")]
    pub upper: f64,
    /// Upper limit of the moving range.
    pub range_upper: f64,
    /// Limit of the individuals beyond which a point is a signal, in short-term standard deviations from the centre.
    pub signal_sigma: f64,
    /// Share of batches in control in which any rule speaks, all rules together.
    pub false_alarms: f64,
    /// The rules that spoke, in the order of [`Rule`].
    pub signals: Vec<Signal>,
    /// Whether the points beyond three sigma are no more than chance gives (1 % level, 0.27 % of the points expected).
    #[doc(alias("process stability", "stable process"))]
    pub stable: bool,
}

/// The chart of `values` in the order of the test; `positions` are their places in the batch.
pub fn control_chart(values: &[f64], positions: &[usize]) -> Finding<ControlChart> {
    if values.len() < FEWEST {
        return Finding::absent(format!("{} value(s); control limits need {FEWEST}", values.len()));
    }
    let n = values.len() as f64;
    let centre = values.iter().sum::<f64>() / n;
    let mean_moving_range = values.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / (n - 1.0);
    if mean_moving_range == 0.0 {
        return Finding::absent("all values are equal");
    }
    let sigma = mean_moving_range / WITHIN_D2;
    let range_upper = D4 * mean_moving_range;
    let z: Vec<f64> = values.iter().map(|v| (v - centre) / sigma).collect();
    let freedom = moving_range_freedom(values.len());
    let mut signals = Vec::new();
    for rule in RULES {
        let number = rule.number(values.len(), freedom);
        push(&mut signals, rule, number, &rule.speaks(&z, number), positions);
    }
    let beyond = z.iter().filter(|z| z.abs() > 3.0).count();
    Finding::of(ControlChart {
        centre,
        mean_moving_range,
        within_deviation: sigma,
        lower: centre - 3.0 * sigma,
        upper: centre + 3.0 * sigma,
        range_upper,
        signal_sigma: Rule::FarOut.number(values.len(), freedom),
        false_alarms: FALSE_ALARMS,
        signals,
        stable: beyond <= chance_limit(values.len()),
    })
}

/// The number of points beyond three sigma that a stable normal process exceeds with a probability below 1 %.
fn chance_limit(n: usize) -> usize {
    const RATE: f64 = 0.0027;
    let mut term = (n as f64 * (1.0 - RATE).ln()).exp();
    let mut sum = term;
    let mut k = 0;
    while sum < 0.99 {
        term *= (n - k) as f64 / (k + 1) as f64 * RATE / (1.0 - RATE);
        sum += term;
        k += 1;
    }
    k
}

fn push(signals: &mut Vec<Signal>, rule: Rule, number: f64, at: &[usize], positions: &[usize]) {
    if !at.is_empty() {
        let at_positions = at.iter().take(20).map(|&i| positions.get(i).copied().unwrap_or(i)).collect();
        signals.push(Signal { rule, text: rule.text(number), count: at.len(), at: at_positions });
    }
}

/// Degrees of freedom of a spread with the same relative variance as a mean moving range of `n` values.
///
/// With normal values, |x(i+1) - x(i)| / E has the variance pi/2 - 1 = 0.5708, and neighbours, which share a value,
/// the covariance (sqrt(3) + pi/6 - 2) / 2 = 0.12783; a standard deviation with f degrees of freedom has 1 / (2 f). So
/// f tends to 0.605 n (J. D. Cryer, T. P. Ryan, J. Quality Technology 22 (1990) 187-192).
pub(super) fn moving_range_freedom(n: usize) -> f64 {
    use std::f64::consts::PI;
    let m = n as f64 - 1.0;
    let variance = (m * (PI / 2.0 - 1.0) + 2.0 * (m - 1.0) * ((3f64.sqrt() + PI / 6.0 - 2.0) / 2.0)) / (m * m);
    1.0 / (2.0 * variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(values: &[f64]) -> ControlChart {
        let positions: Vec<usize> = (0..values.len()).collect();
        control_chart(values, &positions).value.unwrap()
    }

    /// NIST/SEMATECH e-Handbook 6.3.2.2, ten batches of flow rate: centre 50.81, mean moving range 1.8778,
    /// limits 45.8159 and 55.8041; the process is in control.
    #[test]
    fn the_handbook_example() {
        let c = chart(&[49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]);
        assert!((c.centre - 50.81).abs() < 1e-9);
        assert!((c.mean_moving_range - 1.8778).abs() < 5e-5);
        assert!((c.upper - 55.8041).abs() < 5e-5, "{}", c.upper);
        assert!((c.lower - 45.8159).abs() < 5e-5, "{}", c.lower);
        assert!((c.range_upper - 3.267 * 1.8778).abs() < 5e-4, "{}", c.range_upper);
        assert!(c.stable && c.signals.is_empty(), "{:?}", c.signals);
    }

    /// Batches in control, drawn afresh: any rule speaks in at most two of a hundred (design: one).
    #[test]
    fn the_rules_together_are_silent_where_nothing_is_wrong() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(9);
        for n in [25, 100, 400] {
            let speaks = (0..500)
                .filter(|_| {
                    let values: Vec<f64> = (0..n).map(|_| StandardNormal.sample(&mut rng)).collect();
                    !chart(&values).signals.is_empty()
                })
                .count();
            assert!(speaks <= 10, "n = {n}: {speaks} of 500");
        }
    }

    /// What the rules are there for is still found: a shift of three sigma for half a batch, a slow drift, one wild valve.
    #[test]
    fn a_shift_a_drift_and_a_wild_valve_are_found() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(10);
        let disturbances: [fn(usize) -> f64; 3] =
            [|k| if k >= 50 { 3.0 } else { 0.0 }, |k| 0.05 * k as f64, |k| if k == 70 { 8.0 } else { 0.0 }];
        for (which, disturbance) in disturbances.into_iter().enumerate() {
            let found = (0..50)
                .filter(|_| {
                    let value = |k: usize| {
                        let z: f64 = StandardNormal.sample(&mut rng);
                        z + disturbance(k)
                    };
                    !chart(&(0..100).map(value).collect::<Vec<_>>()).signals.is_empty()
                })
                .count();
            assert!(found >= 45, "{which}: {found} of 50");
        }
    }

    /// 0.27 % of 10 000 points is 27: that many are no sign of an unstable process, sixty are.
    #[test]
    fn chance_alone_is_not_called_unstable() {
        assert!((30..60).contains(&chance_limit(10_000)), "{}", chance_limit(10_000));
        assert_eq!(chance_limit(1), 0);
        assert_eq!(chance_limit(10), 1);
        // 99 % quantiles of the binomial distribution, summed term by term with whole binomial coefficients.
        assert_eq!([55, 56, 100, 400, 1000, 3000].map(chance_limit), [1, 2, 2, 4, 7, 15]);
    }

    /// One difference spreads by pi/2 - 1 of its mean squared, two that share a value by hand: (2 * 0.570796 + 2 * 0.127825) / 4.
    #[test]
    fn freedom_of_few_moving_ranges() {
        for (n, freedom) in [(2, 0.875_969_197), (3, 1.431_391_027), (10, 5.638_812_266)] {
            assert!((moving_range_freedom(n) - freedom).abs() < 1e-8, "{n}: {}", moving_range_freedom(n));
        }
    }

    /// Where the zero of a metric lies says nothing of the process.
    #[test]
    fn signals_do_not_depend_on_the_zero_of_the_metric() {
        let values: Vec<f64> = (0..60).map(|k| f64::from(k * 37 % 11) + if k > 30 { 12.0 } else { 0.0 }).collect();
        let (here, there) = (chart(&values), chart(&values.iter().map(|v| v + 1024.0).collect::<Vec<_>>()));
        assert!(!here.signals.is_empty() && here.signals == there.signals && here.stable == there.stable, "{here:?} {there:?}");
    }

    #[test]
    fn positions_name_the_place_in_the_batch() {
        let mut values: Vec<f64> = (0..30).map(|i| [0.0, 1.0, 0.4][i % 3]).collect();
        values[20] = 50.0;
        let positions: Vec<usize> = (0..30).map(|i| i + 100).collect();
        let c = control_chart(&values, &positions).value.unwrap();
        assert_eq!(c.signals[0].rule, Rule::FarOut);
        assert_eq!(c.signals[0].at, [120]);
    }
}
