//! Individuals and moving-range chart with run rules.
//!
//! Limits: NIST/SEMATECH e-Handbook of Statistical Methods 6.3.2.2, <https://www.itl.nist.gov/div898/handbook/pmc/section3/pmc322.htm>.
//! Rules: L. S. Nelson, "The Shewhart Control Chart - Tests for Special Causes", J. Quality Technology 16 (1984) 237-239.

use serde::{Deserialize, Serialize};

use super::Finding;

/// d2 for a moving range of two, as the tables give it.
pub const WITHIN_D2: f64 = 1.128;
/// D4 for a moving range of two.
const D4: f64 = 3.267;
/// Fewer values than this give limits that mean nothing.
const FEWEST: usize = 10;

/// Nelson's tests for special causes, by his numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// 1: a point beyond three sigma.
    BeyondThreeSigma,
    /// 2: nine points in a row on one side of the centre.
    NineOnOneSide,
    /// 3: six points in a row steadily rising or falling.
    SixRisingOrFalling,
    /// 4: fourteen points in a row alternating up and down.
    FourteenAlternating,
    /// 5: two of three points in a row beyond two sigma on one side.
    TwoOfThreeBeyondTwoSigma,
    /// 6: four of five points in a row beyond one sigma on one side.
    FourOfFiveBeyondOneSigma,
    /// 7: fifteen points in a row within one sigma.
    FifteenWithinOneSigma,
    /// 8: eight points in a row with none within one sigma.
    EightBeyondOneSigma,
    /// A moving range above its limit.
    MovingRange,
}

impl Rule {
    /// The rule in words.
    pub fn text(self) -> &'static str {
        match self {
            Rule::BeyondThreeSigma => "1: a point beyond 3 sigma",
            Rule::NineOnOneSide => "2: 9 points in a row on one side of the centre",
            Rule::SixRisingOrFalling => "3: 6 points in a row rising or falling",
            Rule::FourteenAlternating => "4: 14 points in a row alternating",
            Rule::TwoOfThreeBeyondTwoSigma => "5: 2 of 3 points beyond 2 sigma on one side",
            Rule::FourOfFiveBeyondOneSigma => "6: 4 of 5 points beyond 1 sigma on one side",
            Rule::FifteenWithinOneSigma => "7: 15 points in a row within 1 sigma",
            Rule::EightBeyondOneSigma => "8: 8 points in a row with none within 1 sigma",
            Rule::MovingRange => "moving range above its limit",
        }
    }
}

/// Where a rule spoke.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Signal {
    /// Which rule.
    pub rule: Rule,
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
    pub within_deviation: f64,
    /// Lower limit of the individuals.
    pub lower: f64,
    /// Upper limit of the individuals.
    pub upper: f64,
    /// Upper limit of the moving range.
    pub range_upper: f64,
    /// The rules that spoke, in the order of [`Rule`].
    pub signals: Vec<Signal>,
    /// Whether the points beyond three sigma are no more than chance gives (1 % level, 0.27 % of the points expected).
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
    let mut signals = rules(&z, positions);
    let ranges: Vec<usize> = (1..values.len()).filter(|&i| (values[i] - values[i - 1]).abs() > range_upper).collect();
    push(&mut signals, Rule::MovingRange, &ranges, positions);
    let beyond = z.iter().filter(|z| z.abs() > 3.0).count();
    Finding::of(ControlChart {
        centre,
        mean_moving_range,
        within_deviation: sigma,
        lower: centre - 3.0 * sigma,
        upper: centre + 3.0 * sigma,
        range_upper,
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
    while sum < 0.99 && k < n {
        term *= (n - k) as f64 / (k + 1) as f64 * RATE / (1.0 - RATE);
        sum += term;
        k += 1;
    }
    k
}

fn push(signals: &mut Vec<Signal>, rule: Rule, at: &[usize], positions: &[usize]) {
    if !at.is_empty() {
        let at_positions = at.iter().take(20).map(|&i| positions.get(i).copied().unwrap_or(i)).collect();
        signals.push(Signal { rule, count: at.len(), at: at_positions });
    }
}

/// Nelson's tests on standardised points. A test speaks at each point that completes its pattern.
fn rules(z: &[f64], positions: &[usize]) -> Vec<Signal> {
    let mut signals = Vec::new();
    let ends = |length: usize, holds: &dyn Fn(&[f64]) -> bool| -> Vec<usize> {
        (length..=z.len()).filter(|&end| holds(&z[end - length..end])).map(|end| end - 1).collect()
    };
    let one_side = |w: &[f64]| w.iter().all(|&z| z > 0.0) || w.iter().all(|&z| z < 0.0);
    let monotone = |w: &[f64]| w.windows(2).all(|p| p[1] > p[0]) || w.windows(2).all(|p| p[1] < p[0]);
    let alternating = |w: &[f64]| w.windows(3).all(|p| (p[1] - p[0]) * (p[2] - p[1]) < 0.0);
    let beyond = |w: &[f64], wanted: usize, sigma: f64| {
        // The point that completes the pattern must be one of those beyond.
        let last = w[w.len() - 1];
        (last > sigma && w.iter().filter(|&&z| z > sigma).count() >= wanted)
            || (last < -sigma && w.iter().filter(|&&z| z < -sigma).count() >= wanted)
    };
    push(&mut signals, Rule::BeyondThreeSigma, &ends(1, &|w| w[0].abs() > 3.0), positions);
    push(&mut signals, Rule::NineOnOneSide, &ends(9, &one_side), positions);
    push(&mut signals, Rule::SixRisingOrFalling, &ends(6, &monotone), positions);
    push(&mut signals, Rule::FourteenAlternating, &ends(14, &alternating), positions);
    push(&mut signals, Rule::TwoOfThreeBeyondTwoSigma, &ends(3, &|w| beyond(w, 2, 2.0)), positions);
    push(&mut signals, Rule::FourOfFiveBeyondOneSigma, &ends(5, &|w| beyond(w, 4, 1.0)), positions);
    push(&mut signals, Rule::FifteenWithinOneSigma, &ends(15, &|w| w.iter().all(|z| z.abs() < 1.0)), positions);
    push(&mut signals, Rule::EightBeyondOneSigma, &ends(8, &|w| w.iter().all(|z| z.abs() > 1.0)), positions);
    signals
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
        assert!(c.stable && c.signals.is_empty(), "{:?}", c.signals);
    }

    fn spoken(z: &[f64]) -> Vec<Rule> {
        let positions: Vec<usize> = (0..z.len()).collect();
        rules(z, &positions).into_iter().map(|s| s.rule).collect()
    }

    /// Each of Nelson's patterns, and each one point short of it.
    #[test]
    fn each_rule_speaks_at_its_pattern_and_not_before() {
        let zigzag = |n: usize| -> Vec<f64> { (0..n).map(|i| if i % 2 == 0 { 0.5 } else { -0.5 }).collect() };
        assert_eq!(spoken(&[3.1]), [Rule::BeyondThreeSigma]);
        assert!(spoken(&[2.9]).is_empty());
        let nine = [0.1, 0.3, 0.2, 0.4, 0.2, 0.3, 0.1, 0.5, 0.2];
        assert_eq!(spoken(&nine), [Rule::NineOnOneSide]);
        assert!(spoken(&nine[..8]).is_empty());
        let rising = [-0.6, -0.4, -0.2, 0.0, 0.2, 0.4];
        assert_eq!(spoken(&rising), [Rule::SixRisingOrFalling]);
        assert!(spoken(&rising[..5]).is_empty());
        assert_eq!(spoken(&zigzag(14)), [Rule::FourteenAlternating]);
        assert!(spoken(&zigzag(13)).is_empty());
        assert_eq!(spoken(&[2.1, 0.0, 2.1]), [Rule::TwoOfThreeBeyondTwoSigma]);
        assert!(spoken(&[2.1, 0.0, -2.1]).is_empty());
        assert_eq!(spoken(&[1.1, 1.2, 0.0, 1.1, 1.2]), [Rule::FourOfFiveBeyondOneSigma]);
        assert!(spoken(&[1.1, 1.2, 0.0, 0.9, 1.2]).is_empty());
        let within: Vec<f64> = (0..15).map(|i| [0.3, -0.2, -0.4][i % 3]).collect();
        assert_eq!(spoken(&within), [Rule::FifteenWithinOneSigma]);
        assert!(spoken(&within[..14]).is_empty());
        let outside = [1.1, -1.1, 1.2, 1.3, -1.2, -1.1, 1.1, -1.3];
        assert_eq!(spoken(&outside), [Rule::EightBeyondOneSigma]);
        assert!(spoken(&outside[..7]).is_empty());
    }

    /// 0.27 % of 10 000 points is 27: that many are no sign of an unstable process, sixty are.
    #[test]
    fn chance_alone_is_not_called_unstable() {
        assert!((30..60).contains(&chance_limit(10_000)), "{}", chance_limit(10_000));
        assert_eq!(chance_limit(1), 0);
        assert_eq!(chance_limit(10), 1);
    }

    #[test]
    fn positions_name_the_place_in_the_batch() {
        let mut values: Vec<f64> = (0..30).map(|i| [0.0, 1.0, 0.4][i % 3]).collect();
        values[20] = 50.0;
        let positions: Vec<usize> = (0..30).map(|i| i + 100).collect();
        let c = control_chart(&values, &positions).value.unwrap();
        assert_eq!(c.signals[0].rule, Rule::BeyondThreeSigma);
        assert_eq!(c.signals[0].at, [120]);
    }
}
