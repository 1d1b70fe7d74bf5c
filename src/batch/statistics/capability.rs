//! Capability indices with confidence intervals.
//!
//! ISO 22514-2, the method of quantiles: Pp is the width between the limits over the distance of the 0.135 % and the 99.865 %
//! quantile, Ppk the distance of the nearer limit from the median over that of its quantile. For normal values these are
//! the textbook's (NIST/SEMATECH e-Handbook 6.1.6, <https://www.itl.nist.gov/div898/handbook/pmc/section1/pmc16.htm>). The
//! distribution is chosen and its interval found by [`super::shape`].
//!
//! Cp and Cpk use the short-term spread (moving range) and belong to a stable process with normal values. Interval of Cp:
//! chi-squared. Interval of Cpk: A. F. Bissell, "How reliable is your capability index?", Applied Statistics 39 (1990) 331-340.

use serde::{Deserialize, Serialize};

use super::chart::{ControlChart, moving_range_freedom};
use super::distribution::{chi_squared_quantile, normal_quantile};
use super::sample::mean_deviation;
use super::shape::{Quantiles, Shape, Weighed, weigh};
use super::{CONFIDENCE, Finding, Interval};

/// Fewer values than this carry no capability: at 25 the interval of Cp is still +-28 %.
const FEWEST: usize = 25;

/// Limits of a metric; one of them may be missing.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Tolerance {
    /// Smallest accepted value.
    pub min: Option<f64>,
    /// Largest accepted value.
    pub max: Option<f64>,
}

impl Tolerance {
    /// Width between both limits.
    pub fn width(&self) -> Option<f64> {
        Some(self.max? - self.min?)
    }
}

/// One index with its interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Index {
    /// The estimate.
    pub value: f64,
    /// Its interval.
    pub interval: Interval,
    /// The distribution behind it: `normal`, `gamma`, ...
    pub method: String,
}

/// The four indices, and the distribution behind them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Capability {
    /// Cp, potential capability: the width between both limits over six short-term standard deviations. It says what the process
    /// could do if it were centred and stood still. Normal values of a stable process only.
    pub cp: Finding<Index>,
    /// Cpk, capability: the distance of the mean from the nearer limit over three short-term standard deviations. Normal values
    /// of a stable process only.
    pub cpk: Finding<Index>,
    /// Pp, potential performance: the width between both limits over the width that holds 99.73 % of the values (ISO 22514-2).
    pub pp: Finding<Index>,
    /// Ppk, performance: the distance of the median from the nearer limit over the distance of the median from the quantile
    /// (0.135 % or 99.865 %) on that side (ISO 22514-2). 1.33 and more is usually asked for.
    pub ppk: Finding<Index>,
    /// The distribution that the indices are of.
    pub distribution: Finding<Shape>,
}

impl Capability {
    fn absent(reason: &str) -> Self {
        let absent = || Finding::absent(reason);
        Self { cp: absent(), cpk: absent(), pp: absent(), ppk: absent(), distribution: Finding::absent(reason) }
    }
}

/// The indices of `values`, as far as they and the chart allow them.
pub fn capability(values: &[f64], tolerance: Tolerance, chart: &Finding<ControlChart>) -> Capability {
    if tolerance.min.is_none() && tolerance.max.is_none() {
        return Capability::absent("no limit");
    }
    if values.len() < FEWEST {
        return Capability::absent(&format!("{} value(s); a capability needs {FEWEST}", values.len()));
    }
    let (mean, overall) = mean_deviation(values);
    if overall == 0.0 {
        return Capability::absent("all values are equal");
    }
    let weighed = match weigh(values) {
        Finding { value: Some(weighed), .. } => weighed,
        Finding { absent, .. } => return Capability::absent(&absent.unwrap_or_default()),
    };
    let (pp, ppk) = performance(tolerance, &weighed);
    let (cp, cpk) = if weighed.shape.family == "normal" {
        short_term(values, tolerance, mean, chart)
    } else {
        let reason = format!("the values are not normal ({} fits better): Pp and Ppk stand for them", weighed.shape.family);
        (Finding::absent(reason.clone()), Finding::absent(reason))
    };
    Capability { cp, cpk, pp, ppk, distribution: Finding::of(weighed.shape) }
}

fn short_term(values: &[f64], tolerance: Tolerance, mean: f64, chart: &Finding<ControlChart>) -> (Finding<Index>, Finding<Index>) {
    match &chart.value {
        Some(c) if c.stable => indices(tolerance, mean, c.within_deviation, values.len() as f64, moving_range_freedom(values.len())),
        Some(_) => {
            let reason = "the process is not stable (more points beyond 3 sigma than chance gives)";
            (Finding::absent(reason), Finding::absent(reason))
        }
        None => {
            let reason = chart.absent.clone().unwrap_or_default();
            (Finding::absent(reason.clone()), Finding::absent(reason))
        }
    }
}

/// Pp and Ppk of a distribution.
fn performance(tolerance: Tolerance, weighed: &Weighed) -> (Finding<Index>, Finding<Index>) {
    let index = |figure: &dyn Fn(&Quantiles) -> f64| {
        let (value, interval) = (figure(&weighed.quantiles), weighed.interval(figure));
        Finding::of(Index { value, interval, method: weighed.shape.family.clone() })
    };
    let pp = match tolerance.width() {
        Some(width) => index(&|q| width / (q.high - q.low)),
        None => Finding::absent("needs both limits"),
    };
    let ppk = index(&|q| {
        let upper = tolerance.max.map_or(f64::INFINITY, |max| (max - q.middle) / (q.high - q.middle));
        let lower = tolerance.min.map_or(f64::INFINITY, |min| (q.middle - min) / (q.middle - q.low));
        upper.min(lower)
    });
    (pp, ppk)
}

/// Index of the spread and index of the nearer limit, for a spread known with `freedom` degrees of freedom.
fn indices(tolerance: Tolerance, mean: f64, deviation: f64, n: f64, freedom: f64) -> (Finding<Index>, Finding<Index>) {
    let tail = (1.0 - CONFIDENCE) / 2.0;
    let both = match tolerance.width() {
        Some(width) => {
            let value = width / (6.0 * deviation);
            let scaled = |p| value * (chi_squared_quantile(p, freedom) / freedom).sqrt();
            Finding::of(Index { value, interval: Interval { low: scaled(tail), high: scaled(1.0 - tail) }, method: "normal".into() })
        }
        None => Finding::absent("needs both limits"),
    };
    let upper = tolerance.max.map_or(f64::INFINITY, |max| (max - mean) / (3.0 * deviation));
    let lower = tolerance.min.map_or(f64::INFINITY, |min| (mean - min) / (3.0 * deviation));
    let value = upper.min(lower);
    let half = bissell_half(value, n, freedom, 1.0 - tail);
    (both, Finding::of(Index { value, interval: Interval { low: value - half, high: value + half }, method: "normal".into() }))
}

/// Half the width of Bissell's interval.
fn bissell_half(index: f64, n: f64, freedom: f64, quantile: f64) -> f64 {
    normal_quantile(quantile) * (1.0 / (9.0 * n) + index * index / (2.0 * freedom)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::control_chart;
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Exp, Normal};

    fn of(values: &[f64], min: Option<f64>, max: Option<f64>) -> Capability {
        let positions: Vec<usize> = (0..values.len()).collect();
        capability(values, Tolerance { min, max }, &control_chart(values, &positions))
    }

    /// NIST/SEMATECH e-Handbook 6.1.6: limits 8 and 20, mean 16, deviation 2: Cp 1.0, Cpk 0.6667.
    #[test]
    fn the_handbook_example() {
        let (cp, cpk) = indices(Tolerance { min: Some(8.0), max: Some(20.0) }, 16.0, 2.0, 50.0, 49.0);
        assert!((cp.value.unwrap().value - 1.0).abs() < 1e-12);
        assert!((cpk.value.unwrap().value - 0.6667).abs() < 5e-5);
    }

    /// SAS/QC User's Guide, CAPABILITY procedure, Example 5.3 (75 telephone amplifiers, limits 4 and 6 dB): 90 % interval of
    /// Cpk by Bissell 0.328 to 0.496. Data: sample library CAPSPEC3.
    #[test]
    fn bissell_interval_of_the_sas_example() {
        let amps = [
            4.54, 4.87, 4.66, 4.90, 4.68, 5.22, 4.43, 5.14, 3.07, 4.22, 5.09, 3.41, 5.75, 5.16, 3.96, 5.37, 5.70, 4.11, 4.83, 4.51, 4.57,
            4.16, 5.73, 3.64, 5.48, 4.95, 4.57, 4.46, 4.75, 5.38, 5.19, 4.35, 4.98, 4.87, 3.53, 4.46, 4.57, 4.69, 5.27, 4.67, 5.03, 4.50,
            5.35, 4.55, 4.05, 6.63, 5.32, 5.24, 5.73, 5.08, 5.07, 5.42, 5.05, 5.70, 4.79, 4.34, 5.06, 4.64, 4.82, 3.24, 4.79, 4.46, 3.84,
            5.05, 5.46, 4.64, 6.13, 4.31, 4.81, 4.98, 4.95, 5.57, 4.11, 4.15, 5.95,
        ];
        let (mean, deviation) = mean_deviation(&amps);
        let index = indices(Tolerance { min: Some(4.0), max: Some(6.0) }, mean, deviation, 75.0, 74.0).1.value.unwrap().value;
        let half = bissell_half(index, 75.0, 74.0, 0.95);
        assert!((index - half - 0.328).abs() < 5e-4, "{}", index - half);
        assert!((index + half - 0.496).abs() < 5e-4, "{}", index + half);
    }

    /// By hand: 1.96 sqrt(1 / (9 n Cpk^2) + 1 / (2 (n - 1))) = 1.96 * 0.17163 of Cpk 1.33 with n = 20; one limit has no Cp.
    #[test]
    fn interval_of_cpk_with_one_limit() {
        for (min, max) in [(None, Some(3.99)), (Some(-3.99), None)] {
            let (cp, cpk) = indices(Tolerance { min, max }, 0.0, 1.0, 20.0, 19.0);
            let Index { value, interval, .. } = cpk.value.unwrap();
            assert!((value - 1.33).abs() < 1e-12 && cp.value.is_none());
            assert!((interval.low - 0.882_60).abs() < 5e-5 && (interval.high - 1.777_40).abs() < 5e-5, "{interval:?}");
        }
    }

    /// The limits n = 100, Cp = 1: sqrt(chi2(0.025, 99) / 99) = 0.861 and sqrt(chi2(0.975, 99) / 99) = 1.139, from the
    /// handbook's chi-squared table 1.3.6.7.4 (73.361 and 128.422).
    #[test]
    fn chi_squared_interval_of_cp() {
        let (cp, _) = indices(Tolerance { min: Some(-3.0), max: Some(3.0) }, 0.0, 1.0, 100.0, 99.0);
        let i = cp.value.unwrap().interval;
        assert!((i.low - (73.361f64 / 99.0).sqrt()).abs() < 1e-5 && (i.high - (128.422f64 / 99.0).sqrt()).abs() < 1e-5, "{i:?}");
    }

    #[test]
    fn the_moving_range_knows_the_spread_with_about_0_605_n() {
        assert!((moving_range_freedom(1000) / 1000.0 - 0.605).abs() < 0.001);
    }

    /// Known Cpk = 1: the 95 % interval covers it in about 95 % of the batches.
    #[test]
    fn intervals_cover() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(11);
        let normal = Normal::new(0.0, 1.0).unwrap();
        let (mut cpk, mut pp, batches) = (0, 0, 400);
        for _ in 0..batches {
            let values: Vec<f64> = (0..60).map(|_| normal.sample(&mut rng)).collect();
            let (c, k) =
                indices(Tolerance { min: Some(-3.0), max: None }, mean_deviation(&values).0, mean_deviation(&values).1, 60.0, 59.0);
            assert!(c.value.is_none());
            let i = k.value.unwrap().interval;
            cpk += usize::from(i.low <= 1.0 && 1.0 <= i.high);
            let chart = control_chart(&values, &(0..60).collect::<Vec<_>>()).value.unwrap();
            let within =
                indices(Tolerance { min: Some(-3.0), max: Some(3.0) }, 0.0, chart.within_deviation, 60.0, moving_range_freedom(60));
            let i = within.0.value.unwrap().interval;
            pp += usize::from(i.low <= 1.0 && 1.0 <= i.high);
        }
        assert!((368..=392).contains(&cpk), "{cpk} of {batches}");
        assert!((368..=392).contains(&pp), "{pp} of {batches}");
    }

    #[test]
    fn no_index_where_the_data_cannot_carry_one() {
        let few: Vec<f64> = (0..24).map(|i| (i as f64).sin()).collect();
        assert!(of(&few, Some(-5.0), None).ppk.absent.unwrap().contains("needs 25"));
        assert_eq!(of(&few, None, None).cp.absent.unwrap(), "no limit");
        assert!(of(&[1.0; 40], Some(0.0), Some(2.0)).cp.absent.unwrap().contains("equal"));
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let skew: Vec<f64> = (0..300).map(|_| Exp::new(1.0).unwrap().sample(&mut rng)).collect();
        let c = of(&skew, Some(0.0), Some(9.0));
        assert!(c.cpk.absent.as_ref().unwrap().contains("not normal") && c.ppk.value.is_some());
        // Two kinds of valves in one batch are no distribution of one process.
        let two: Vec<f64> = (0..300).map(|k| f64::from(k % 2) + 0.001 * f64::from(k % 17)).collect();
        assert!(of(&two, Some(-1.0), Some(9.0)).ppk.absent.unwrap().contains("no distribution fits"));
        // Neighbours alike, as when the oil warms up: normal as a whole, but not stable, so only the overall indices stand.
        let values: Vec<f64> = (0..300).map(|k| normal_quantile((f64::from(k) + 0.5) / 300.0)).collect();
        let c = of(&values, Some(-20.0), Some(20.0));
        assert!(c.cp.absent.unwrap().contains("not stable") && c.cpk.value.is_none());
        assert!(c.pp.value.is_some() && c.ppk.value.is_some());
    }

    /// Of normal values the method of quantiles gives the textbook's Pp and Ppk, on either side.
    #[test]
    fn performance_of_normal_values_is_the_textbooks() {
        let values: Vec<f64> = (0..300).map(|k| 10.0 + 2.0 * normal_quantile((f64::from(k) + 0.5) / 300.0)).collect();
        let (mean, deviation) = mean_deviation(&values);
        for (min, max, nearer) in [(4.0, 22.0, mean - 4.0), (-2.0, 16.0, 16.0 - mean)] {
            let c = of(&values, Some(min), Some(max));
            let (pp, ppk) = (c.pp.value.unwrap(), c.ppk.value.unwrap());
            assert_eq!((pp.method.as_str(), ppk.method.as_str()), ("normal", "normal"));
            assert!((pp.value - (max - min) / (6.0 * deviation)).abs() < 1e-3, "{pp:?}");
            assert!((ppk.value - nearer / (3.0 * deviation)).abs() < 1e-3, "{ppk:?}");
        }
        // With one limit there is no width.
        let c = of(&values, Some(4.0), None);
        assert_eq!(c.pp.absent.unwrap(), "needs both limits");
        assert!((c.ppk.value.unwrap().value - (mean - 4.0) / (3.0 * deviation)).abs() < 1e-3);
    }

    #[test]
    fn a_stable_process_has_the_indices_of_its_moving_range_from_25_values_on() {
        // The quantiles of a normal distribution, one beside the other as chance would have it.
        let values: Vec<f64> = (0..25).map(|k| 10.0 + 2.0 * normal_quantile((f64::from(k * 7 % 25) + 0.5) / 25.0)).collect();
        let chart = control_chart(&values, &(0..25).collect::<Vec<_>>()).value.unwrap();
        let c = of(&values, Some(0.0), Some(22.0));
        let (cp, cpk) = (c.cp.value.unwrap().value, c.cpk.value.unwrap().value);
        let (mean, spread) = (mean_deviation(&values).0, chart.within_deviation);
        assert!(chart.stable && (cp - 22.0 / (6.0 * spread)).abs() < 1e-12, "{cp}");
        assert!((cpk - (mean / (3.0 * spread)).min((22.0 - mean) / (3.0 * spread))).abs() < 1e-12, "{cpk}");
    }

    /// Exponential values: the true quantiles are -ln(0.99865), ln 2 and -ln(0.00135).
    #[test]
    fn a_skewed_metric_has_the_index_of_its_own_distribution() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(7);
        let skew: Vec<f64> = (0..5000).map(|_| Exp::new(1.0).unwrap().sample(&mut rng)).collect();
        let c = of(&skew, None, Some(9.0));
        let ppk = c.ppk.value.unwrap();
        let truth = (9.0 - 2f64.ln()) / (-(0.00135f64).ln() - 2f64.ln());
        assert!(["gamma", "Weibull"].contains(&ppk.method.as_str()), "{ppk:?}");
        assert!(ppk.interval.low < truth && truth < ppk.interval.high, "{ppk:?} {truth}");
        assert!((ppk.value - truth).abs() < 0.1 && ppk.interval.high - ppk.interval.low < 0.2, "{ppk:?}");
        assert_eq!(c.distribution.value.unwrap().candidates.len(), super::super::family::FAMILIES.len());
    }

    /// Half of the valves 3 above the others: no family holds that, but thousands of values have quantiles of their own.
    #[test]
    fn thousands_of_values_need_no_family() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
        let normal = Normal::new(0.0, 0.3).unwrap();
        let values: Vec<f64> = (0..4000).map(|k| 3.0 * f64::from(k % 2) + normal.sample(&mut rng)).collect();
        let ppk = of(&values, None, Some(6.0)).ppk.value.unwrap();
        assert_eq!(ppk.method, "quantiles of the values");
        assert!(ppk.interval.low < ppk.value && ppk.value < ppk.interval.high, "{ppk:?}");
    }
}
