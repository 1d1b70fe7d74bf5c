//! Capability indices with confidence intervals.
//!
//! Definitions: NIST/SEMATECH e-Handbook 6.1.6, <https://www.itl.nist.gov/div898/handbook/pmc/section1/pmc16.htm>.
//! Cp and Cpk use the short-term spread (moving range) and belong to a stable process; Pp and Ppk use the overall
//! spread. Interval of Cp and Pp: chi-squared. Interval of Cpk and Ppk: A. F. Bissell, "How reliable is your
//! capability index?", Applied Statistics 39 (1990) 331-340. Not normal: ISO 22514-2 quantiles, from the data
//! alone, where there are enough of them.

use serde::{Deserialize, Serialize};

use super::chart::ControlChart;
use super::distribution::{chi_squared_quantile, normal_quantile};
use super::normality::Normality;
use super::sample::mean_deviation;
use super::{CONFIDENCE, Finding, Interval};

/// Fewer values than this carry no capability: at 25 the interval of Cp is still +-28 %.
const FEWEST: usize = 25;
/// Fewer values than this do not reach the 0.135 % quantiles.
const FEWEST_QUANTILES: usize = 2000;

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
    /// `normal` or `quantile`.
    pub method: String,
}

/// The four indices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Capability {
    /// Potential capability, short-term spread, both limits.
    pub cp: Finding<Index>,
    /// Capability with the centring, short-term spread.
    pub cpk: Finding<Index>,
    /// Potential performance, overall spread, both limits.
    pub pp: Finding<Index>,
    /// Performance with the centring, overall spread.
    pub ppk: Finding<Index>,
}

impl Capability {
    fn absent(reason: &str) -> Self {
        let absent = || Finding::absent(reason);
        Self { cp: absent(), cpk: absent(), pp: absent(), ppk: absent() }
    }
}

/// The indices of `values`, as far as chart and normality allow them.
pub fn capability(values: &[f64], tolerance: Tolerance, chart: &Finding<ControlChart>, normality: &Finding<Normality>) -> Capability {
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
    let normal = match &normality.value {
        Some(n) => n,
        None => return Capability::absent(normality.absent.as_deref().unwrap_or("normality is unknown")),
    };
    if !normal.plausible {
        return not_normal(values, tolerance);
    }
    let n = values.len() as f64;
    let performance = indices(tolerance, mean, overall, n, n - 1.0);
    let (cp, cpk) = match &chart.value {
        Some(c) if c.stable => indices(tolerance, mean, c.within_deviation, n, moving_range_freedom(values.len())),
        Some(_) => {
            let reason = "the process is not stable (more points beyond 3 sigma than chance gives)";
            (Finding::absent(reason), Finding::absent(reason))
        }
        None => {
            let reason = chart.absent.clone().unwrap_or_default();
            (Finding::absent(reason.clone()), Finding::absent(reason))
        }
    };
    Capability { cp, cpk, pp: performance.0, ppk: performance.1 }
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

/// Degrees of freedom of a spread with the same relative variance as a mean moving range of `n` values.
///
/// With normal values, |x(i+1) - x(i)| / E has the variance pi/2 - 1 = 0.5708, and neighbours, which share a value,
/// the covariance (sqrt(3) + pi/6 - 2) / 2 = 0.12783; a standard deviation with f degrees of freedom has 1 / (2 f). So
/// f tends to 0.605 n (J. D. Cryer, T. P. Ryan, J. Quality Technology 22 (1990) 187-192).
fn moving_range_freedom(n: usize) -> f64 {
    use std::f64::consts::PI;
    let m = n as f64 - 1.0;
    let variance = (m * (PI / 2.0 - 1.0) + 2.0 * (m - 1.0) * ((3f64.sqrt() + PI / 6.0 - 2.0) / 2.0)) / (m * m);
    1.0 / (2.0 * variance)
}

/// Performance from the 0.135 %, 50 % and 99.865 % quantiles (ISO 22514-2), intervals from order statistics.
fn not_normal(values: &[f64], tolerance: Tolerance) -> Capability {
    let why = "the values are not normal".to_string();
    if values.len() < FEWEST_QUANTILES {
        return Capability::absent(&format!("{why}; quantiles need {FEWEST_QUANTILES} values"));
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    const LOW: f64 = 0.00135;
    let (low, middle, high) = (quantile(&sorted, LOW), quantile(&sorted, 0.5), quantile(&sorted, 1.0 - LOW));
    let (low_range, high_range) = (quantile_interval(&sorted, LOW), quantile_interval(&sorted, 1.0 - LOW));
    let index = |value: f64, low: f64, high: f64| {
        if !value.is_finite() {
            return Finding::absent("the tail has no spread");
        }
        Finding::of(Index { value, interval: Interval { low, high }, method: "quantile".into() })
    };
    let pp = match tolerance.width() {
        // Each tail at half the error, so that both together keep the level.
        Some(width) => {
            let of = |low: f64, high: f64| width / (high - low);
            index(of(low, high), of(low_range.low, high_range.high), of(low_range.high, high_range.low))
        }
        None => Finding::absent("needs both limits"),
    };
    let upper = |high: f64| tolerance.max.map_or(f64::INFINITY, |max| (max - middle) / (high - middle));
    let lower = |low: f64| tolerance.min.map_or(f64::INFINITY, |min| (middle - min) / (middle - low));
    let ends = [upper(high_range.low).min(lower(low_range.high)), upper(high_range.high).min(lower(low_range.low))];
    let ppk = index(upper(high).min(lower(low)), ends[0].min(ends[1]), ends[0].max(ends[1]));
    Capability { cp: Finding::absent(why.clone()), cpk: Finding::absent(why), pp, ppk }
}

/// Linear interpolation between order statistics.
fn quantile(sorted: &[f64], p: f64) -> f64 {
    let at = p * (sorted.len() - 1) as f64;
    let below = at.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (at - at.floor()) * (sorted[above] - sorted[below])
}

/// Order statistics that enclose the quantile: normal approximation of the binomial rank.
fn quantile_interval(sorted: &[f64], p: f64) -> Interval {
    let n = sorted.len() as f64;
    let z = normal_quantile(1.0 - (1.0 - CONFIDENCE) / 4.0);
    let half = z * (n * p * (1.0 - p)).sqrt();
    let rank = |r: f64| sorted[(r.max(0.0) as usize).min(sorted.len() - 1)];
    Interval { low: rank((n * p - half).floor() - 1.0), high: rank((n * p + half).ceil()) }
}

#[cfg(test)]
mod tests {
    use super::super::{control_chart, normality};
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Exp, Normal};

    fn of(values: &[f64], min: Option<f64>, max: Option<f64>) -> Capability {
        let positions: Vec<usize> = (0..values.len()).collect();
        capability(values, Tolerance { min, max }, &control_chart(values, &positions), &normality(values))
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
        let ppk = of(&amps, Some(4.0), Some(6.0)).ppk.value.unwrap();
        let half = bissell_half(ppk.value, 75.0, 74.0, 0.95);
        assert!((ppk.value - half - 0.328).abs() < 5e-4, "{}", ppk.value - half);
        assert!((ppk.value + half - 0.496).abs() < 5e-4, "{}", ppk.value + half);
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
        assert!(c.cpk.absent.as_ref().unwrap().contains("not normal") && c.ppk.value.is_none());
        // Neighbours alike, as when the oil warms up: normal as a whole, but not stable, so only the overall indices stand.
        let normal = Normal::new(0.0, 1.0).unwrap();
        let mut level = 0.0;
        let mut wander = || {
            level = 0.9 * level + normal.sample(&mut rng);
            level
        };
        let values: Vec<f64> = (0..300).map(|_| wander()).collect();
        let c = of(&values, Some(-20.0), Some(20.0));
        assert!(c.cp.absent.unwrap().contains("not stable") && c.cpk.value.is_none());
        assert!(c.pp.value.is_some() && c.ppk.value.is_some());
    }

    /// Exponential values: the true quantiles are -ln(0.99865), ln 2 and -ln(0.00135).
    #[test]
    fn quantiles_carry_what_is_not_normal() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        let skew: Vec<f64> = (0..20_000).map(|_| Exp::new(1.0).unwrap().sample(&mut rng)).collect();
        let ppk = of(&skew, None, Some(9.0)).ppk.value.unwrap();
        let truth = (9.0 - 2f64.ln()) / (-(0.00135f64).ln() - 2f64.ln());
        assert_eq!(ppk.method, "quantile");
        assert!(ppk.interval.low < truth && truth < ppk.interval.high, "{ppk:?} {truth}");
        assert!((ppk.value - truth).abs() < 0.1);
    }
}
