//! Two batches side by side: which metrics moved, by how much, and whether that is more than noise.
//!
//! Means by Welch's test (B. L. Welch, Biometrika 34 (1947) 28-35), all metrics together held at 5 % by Holm's procedure
//! (S. Holm, Scand. J. Statist. 6 (1979) 65-70); yields by Fisher's exact test.

use serde::{Deserialize, Serialize};

use super::statistics::{CONFIDENCE, Finding, Interval, mean_deviation, t_quantile, t_two_sided};
use super::summary::BatchSummary;
use crate::record::Outcome;

/// Level at which a movement is claimed, over all metrics together.
const LEVEL: f64 = 0.05;

/// Two batches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// What keeps the two from being comparable without a second thought: another plan, a simulation beside real valves.
    pub warnings: Vec<String>,
    /// Final yield of each, and the probability of such a difference without one.
    pub yields: Finding<YieldChange>,
    /// Metrics in both, in the order of the first.
    pub metrics: Vec<Movement>,
    /// Metrics in one of the two only.
    pub only_in_one: Vec<String>,
    /// Whether anything moved by more than noise.
    pub moved: bool,
}

/// Change of the final yield.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct YieldChange {
    /// Passed and judged of the first.
    pub first: (usize, usize),
    /// Passed and judged of the second.
    pub second: (usize, usize),
    /// Fisher's exact test, two-sided.
    pub p_value: f64,
}

/// Movement of one metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Movement {
    /// Phase and metric.
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// Means of the first and the second batch.
    pub means: Option<(f64, f64)>,
    /// Standard deviations of the first and the second batch.
    pub deviations: Option<(f64, f64)>,
    /// Second mean minus first, with its interval; or why there is none.
    pub change: Finding<Change>,
}

/// A difference of means.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Second minus first.
    pub difference: f64,
    /// Its interval.
    pub interval: Interval,
    /// Probability of such a difference without one.
    pub p_value: f64,
    /// Whether it is more than noise, all metrics taken together.
    pub significant: bool,
}

/// Compares `second` with `first`.
pub fn compare(first: &BatchSummary, second: &BatchSummary) -> Comparison {
    let mut warnings = Vec::new();
    if first.batch.plan_sha256 != second.batch.plan_sha256 {
        warnings.push(format!("the plans differ: `{}` and `{}`, or another content", first.batch.plan, second.batch.plan));
    }
    if first.origin != second.origin {
        warnings.push("one batch is a simulation or emulated, the other is not: their figures say nothing of each other".into());
    }
    let mut metrics = Vec::new();
    let mut only_in_one = Vec::new();
    for (k, m) in first.metrics.iter().enumerate() {
        match second.metrics.iter().position(|other| other.name == m.name && other.unit == m.unit) {
            Some(j) => metrics.push(movement(&m.name, &m.unit, &column(first, k), &column(second, j))),
            None => only_in_one.push(m.name.clone()),
        }
    }
    only_in_one.extend(second.metrics.iter().filter(|m| !first.metrics.iter().any(|o| o.name == m.name)).map(|m| m.name.clone()));
    hold_the_level(&mut metrics);
    let yields = match (&first.final_yield.value, &second.final_yield.value) {
        (Some(a), Some(b)) => {
            let p_value = fisher(a.passed, a.count, b.passed, b.count);
            Finding::of(YieldChange { first: (a.passed, a.count), second: (b.passed, b.count), p_value })
        }
        _ => Finding::absent("a batch has no judged valve"),
    };
    let moved = metrics.iter().any(|m| m.change.value.as_ref().is_some_and(|c| c.significant))
        || yields.value.as_ref().is_some_and(|y| y.p_value < LEVEL);
    Comparison { warnings, yields, metrics, only_in_one, moved }
}

fn column(summary: &BatchSummary, k: usize) -> Vec<f64> {
    let judged = summary.valves.iter().filter(|v| matches!(v.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail));
    judged.filter_map(|v| v.values.get(k).copied()).filter(|v| v.is_finite()).collect()
}

fn movement(name: &str, unit: &str, first: &[f64], second: &[f64]) -> Movement {
    let (name, unit) = (name.to_string(), unit.to_string());
    if first.len() < 2 || second.len() < 2 {
        let change = Finding::absent(format!("{} and {} value(s); two of each are needed", first.len(), second.len()));
        return Movement { name, unit, means: None, deviations: None, change };
    }
    let ((ma, sa), (mb, sb)) = (mean_deviation(first), mean_deviation(second));
    let change = welch((ma, sa, first.len()), (mb, sb, second.len()));
    Movement { name, unit, means: Some((ma, mb)), deviations: Some((sa, sb)), change }
}

/// Welch's test of (mean, deviation, count) against another.
fn welch(first: (f64, f64, usize), second: (f64, f64, usize)) -> Finding<Change> {
    let (va, vb) = (first.1.powi(2) / first.2 as f64, second.1.powi(2) / second.2 as f64);
    let difference = second.0 - first.0;
    let error = (va + vb).sqrt();
    if error == 0.0 {
        // Without any scatter, as in a simulation without spread, every difference is real.
        let p_value = if difference == 0.0 { 1.0 } else { 0.0 };
        return Finding::of(Change { difference, interval: Interval { low: difference, high: difference }, p_value, significant: false });
    }
    let freedom = (va + vb).powi(2) / (va.powi(2) / (first.2 - 1) as f64 + vb.powi(2) / (second.2 - 1) as f64);
    let half = t_quantile(0.5 + CONFIDENCE / 2.0, freedom) * error;
    let interval = Interval { low: difference - half, high: difference + half };
    Finding::of(Change { difference, interval, p_value: t_two_sided(difference / error, freedom), significant: false })
}

/// Holm: the smallest p against level / n, the next against level / (n - 1), and so on, until one does not hold.
fn hold_the_level(metrics: &mut [Movement]) {
    let mut changes: Vec<&mut Change> = metrics.iter_mut().filter_map(|m| m.change.value.as_mut()).collect();
    changes.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let n = changes.len();
    for (k, change) in changes.into_iter().enumerate() {
        if change.p_value > LEVEL / (n - k) as f64 {
            break;
        }
        change.significant = true;
    }
}

/// Fisher's exact test, two-sided: the tables with the same margins that are no more likely than this one.
fn fisher(passed_a: usize, count_a: usize, passed_b: usize, count_b: usize) -> f64 {
    let (all, passed) = (count_a + count_b, passed_a + passed_b);
    let ln_factorial: Vec<f64> = std::iter::once(0.0)
        .chain((1..=all).scan(0.0, |sum, k| {
            *sum += (k as f64).ln();
            Some(*sum)
        }))
        .collect();
    let choose = |n: usize, k: usize| ln_factorial[n] - ln_factorial[k] - ln_factorial[n - k];
    let log_p = |k: usize| choose(count_a, k) + choose(count_b, passed - k) - choose(all, passed);
    let observed = log_p(passed_a);
    let range = passed.saturating_sub(count_b)..=passed.min(count_a);
    // Equal tables differ by rounding only.
    range.map(log_p).filter(|p| *p <= observed + 1e-7).map(f64::exp).sum::<f64>().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NIST/SEMATECH e-Handbook 1.3.5.3, AUTO83B.DAT (miles per gallon of U.S. and Japanese cars): unequal variances
    /// T = -12.94627 with 136.8750 degrees of freedom.
    #[test]
    fn welch_of_the_handbook_example() {
        let c = welch((30.48101, 6.107710, 79), (20.14458, 6.414700, 249)).value.unwrap();
        let half = (c.interval.high - c.interval.low) / 2.0;
        let error = half / t_quantile(0.975, 136.8750);
        assert!((c.difference / error + 12.94627).abs() < 1e-4, "{}", c.difference / error);
        assert!(c.p_value < 1e-20);
    }

    /// R. A. Fisher, "The Design of Experiments" (1935), the lady tasting tea: 3 of 4 and 1 of 4; two-sided p = 34/70.
    #[test]
    fn fisher_of_the_tea() {
        assert!((fisher(3, 4, 1, 4) - 34.0 / 70.0).abs() < 1e-12);
        assert!((fisher(0, 10, 10, 10) - 2.0 / 184_756.0).abs() < 1e-12);
        assert_eq!(fisher(5, 5, 7, 7), 1.0);
    }

    #[test]
    fn holm_claims_no_more_than_the_level_allows() {
        let metric = |p_value| Movement {
            name: String::new(),
            unit: String::new(),
            means: None,
            deviations: None,
            change: Finding::of(Change { difference: 1.0, interval: Interval { low: 0.0, high: 2.0 }, p_value, significant: false }),
        };
        let mut metrics: Vec<Movement> = [0.04, 0.01, 0.001, 0.02].map(metric).into();
        hold_the_level(&mut metrics);
        let claimed: Vec<bool> = metrics.iter().map(|m| m.change.value.as_ref().unwrap().significant).collect();
        // 0.001 <= 0.05/4, 0.01 <= 0.05/3, 0.02 <= 0.05/2, 0.04 <= 0.05/1.
        assert_eq!(claimed, [true, true, true, true]);
        let mut metrics: Vec<Movement> = [0.04, 0.03, 0.001].map(metric).into();
        hold_the_level(&mut metrics);
        let claimed: Vec<bool> = metrics.iter().map(|m| m.change.value.as_ref().unwrap().significant).collect();
        assert_eq!(claimed, [false, false, true], "0.03 > 0.05/2 ends it");
    }
}
