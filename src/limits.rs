//! Pass, marginal or fail: decided here and nowhere else.
//!
//! A limit has a smallest and a largest accepted value, a warning band inside them, and a kind of bound. What could
//! not be measured fails its limit.

use serde::{Deserialize, Serialize};

/// Whether a value on the bound itself is accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// A value on the bound is accepted.
    #[default]
    Inclusive,
    /// A value on the bound is refused.
    Exclusive,
}

/// How a measured value is compared with its limit. ISO/IEC 17025:2017, 7.8.6 asks to state it with every conformity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
#[doc(alias("ISO 14253-1", "decision rule", "guard band"))]
pub enum DecisionRule {
    /// The measured value against the limit; its uncertainty is not taken into account.
    #[default]
    Simple,
    /// The measured value against the limit drawn in by the expanded uncertainty (ILAC-G8:09/2019; JCGM 106:2012).
    GuardBand,
    /// The limit drawn in by 1.65 standard uncertainties: a value is accepted where it conforms with a probability of at least 95 %
    /// (ISO 14253-1:2017, its default rule, for an uncertainty that is small against the tolerance).
    ConformanceProbability,
}

/// 95 % of the normal distribution lie below this many standard deviations above its mean.
const ONE_SIDED_95: f64 = 1.65;

impl DecisionRule {
    /// By how much the rule draws a limit in, for an expanded uncertainty with k = 2.
    pub fn guard(self, expanded_uncertainty: f64) -> f64 {
        match self {
            DecisionRule::Simple => 0.0,
            DecisionRule::GuardBand => expanded_uncertainty,
            DecisionRule::ConformanceProbability => 0.5 * ONE_SIDED_95 * expanded_uncertainty,
        }
    }

    /// The rule in words, for a report.
    pub fn text(self) -> &'static str {
        match self {
            DecisionRule::Simple => "simple acceptance: the measured value against the limit, its uncertainty not taken into account",
            DecisionRule::GuardBand => "guarded acceptance: every limit is drawn in by the expanded uncertainty of its metric",
            DecisionRule::ConformanceProbability => {
                "ISO 14253-1:2017: every limit is drawn in by 1.65 standard uncertainties, so that what passes conforms with 95 %"
            }
        }
    }
}

/// What a figure is judged by, in the canonical unit of its metric.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limit {
    /// Smallest accepted value.
    pub min: Option<f64>,
    /// Largest accepted value.
    pub max: Option<f64>,
    /// Below this the verdict is MARGINAL.
    pub marginal_min: Option<f64>,
    /// Above this the verdict is MARGINAL.
    pub marginal_max: Option<f64>,
    /// Kind of the outer bounds.
    pub bound: Bound,
}

/// The verdict on one figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Within the limit.
    Pass,
    /// Within the limit, inside the warning band.
    Marginal,
    /// Outside the limit, or not measured.
    Fail,
}

/// Why a limit makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LimitError {
    /// Nothing to judge by.
    #[error("the limit has neither `min` nor `max`")]
    Empty,
    /// No value could pass.
    #[error("`{low}` ({low_value}) is larger than `{high}` ({high_value})")]
    Crossed {
        /// Key of the lower bound.
        low: &'static str,
        /// Its value in the metric's unit.
        low_value: f64,
        /// Key of the upper bound.
        high: &'static str,
        /// Its value in the metric's unit.
        high_value: f64,
    },
    /// The guard band takes everything.
    #[error("an uncertainty of {uncertainty} leaves nothing between `min` and `max`")]
    NothingLeft {
        /// Expanded uncertainty in the metric's unit.
        uncertainty: f64,
    },
    /// A warning bound without the bound that it warns of.
    #[error("`{warning}` needs `{bound}`")]
    WarningAlone {
        /// Key of the warning bound.
        warning: &'static str,
        /// Key of the missing bound.
        bound: &'static str,
    },
}

impl Limit {
    /// Whether some value could pass, and the warning band lies inside the bounds.
    pub fn check(&self) -> Result<(), LimitError> {
        if self.min.is_none() && self.max.is_none() {
            return Err(LimitError::Empty);
        }
        if self.marginal_min.is_some() && self.min.is_none() {
            return Err(LimitError::WarningAlone { warning: "marginal_min", bound: "min" });
        }
        if self.marginal_max.is_some() && self.max.is_none() {
            return Err(LimitError::WarningAlone { warning: "marginal_max", bound: "max" });
        }
        let rising = [("min", self.min), ("marginal_min", self.marginal_min), ("marginal_max", self.marginal_max), ("max", self.max)];
        let given: Vec<(&'static str, f64)> = rising.into_iter().filter_map(|(key, value)| value.map(|v| (key, v))).collect();
        // The outer bounds first: they are the mistake where everything is crossed.
        let outer = self.min.zip(self.max).map(|(min, max)| [("min", min), ("max", max)]);
        match outer.iter().map(|w| w.as_slice()).chain(given.windows(2)).find(|w| w[0].1 > w[1].1) {
            Some(w) => Err(LimitError::Crossed { low: w[0].0, low_value: w[0].1, high: w[1].0, high_value: w[1].1 }),
            None => Ok(()),
        }
    }

    /// The limit drawn in by an expanded uncertainty on both sides; a warning bound that it swallows warns of nothing more.
    pub fn drawn_in(&self, uncertainty: f64) -> Result<Limit, LimitError> {
        let (min, max) = (self.min.map(|m| m + uncertainty), self.max.map(|m| m - uncertainty));
        if uncertainty < 0.0 || min.zip(max).is_some_and(|(min, max)| min > max) {
            return Err(LimitError::NothingLeft { uncertainty });
        }
        let marginal_min = self.marginal_min.map(|w| min.map_or(w, |m| w.max(m)));
        let marginal_max = self.marginal_max.map(|w| max.map_or(w, |m| w.min(m)));
        Ok(Limit { min, max, marginal_min, marginal_max, bound: self.bound })
    }

    /// `value` with the fewest decimals, `decimals` at least, at which a reader who compares it with the limit reads the verdict that it
    /// has: 0.14695 against 0.1469 is not printed as 0.147.
    pub fn shown(&self, value: f64, decimals: usize) -> f64 {
        let rounded = |d: usize| format!("{value:.d$}").parse().unwrap_or(value);
        let verdict = self.judge(Some(value));
        (decimals..=15).map(rounded).find(|v| self.judge(Some(*v)) == verdict).unwrap_or(value)
    }

    /// The verdict on `value`; an absent value and one that is not a number fail.
    pub fn judge(&self, value: Option<f64>) -> Verdict {
        let Some(value) = value.filter(|v| !v.is_nan()) else { return Verdict::Fail };
        let refused = |bound: f64| self.bound == Bound::Exclusive && value == bound;
        if self.min.is_some_and(|min| value < min || refused(min)) || self.max.is_some_and(|max| value > max || refused(max)) {
            return Verdict::Fail;
        }
        if self.marginal_min.is_some_and(|m| value < m) || self.marginal_max.is_some_and(|m| value > m) {
            return Verdict::Marginal;
        }
        Verdict::Pass
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMIT: Limit =
        Limit { min: Some(0.0), max: Some(1.0), marginal_min: Some(0.1), marginal_max: Some(0.8), bound: Bound::Inclusive };

    #[test]
    fn verdicts_on_and_around_the_bounds() {
        let judge = |v: f64| LIMIT.judge(Some(v));
        assert_eq!([judge(-0.001), judge(0.0), judge(0.1), judge(0.8), judge(0.9), judge(1.0), judge(1.001)], {
            use Verdict::*;
            [Fail, Marginal, Pass, Pass, Marginal, Marginal, Fail]
        });
        let exclusive = Limit { bound: Bound::Exclusive, ..LIMIT };
        assert_eq!((exclusive.judge(Some(1.0)), exclusive.judge(Some(0.0))), (Verdict::Fail, Verdict::Fail));
        assert_eq!((exclusive.judge(Some(0.5)), exclusive.judge(Some(0.99))), (Verdict::Pass, Verdict::Marginal));
    }

    #[test]
    fn what_was_not_measured_fails() {
        assert_eq!(LIMIT.judge(None), Verdict::Fail);
        assert_eq!(LIMIT.judge(Some(f64::NAN)), Verdict::Fail);
    }

    #[test]
    fn senseless_limits_are_refused() {
        assert_eq!(Limit::default().check(), Err(LimitError::Empty));
        insta::assert_snapshot!(Limit { min: Some(2.0), max: Some(1.0), ..Limit::default() }.check().unwrap_err(), @"`min` (2) is larger than `max` (1)");
        insta::assert_snapshot!(Limit { max: Some(1.0), marginal_max: Some(1.5), ..Limit::default() }.check().unwrap_err(), @"`marginal_max` (1.5) is larger than `max` (1)");
        insta::assert_snapshot!(Limit { max: Some(1.0), marginal_min: Some(0.5), ..Limit::default() }.check().unwrap_err(), @"`marginal_min` needs `min`");
    }

    #[test]
    fn a_guard_band_keeps_the_uncertainty_away_from_the_limit() {
        let guarded = LIMIT.drawn_in(0.15).unwrap();
        let judge = |v: f64| guarded.judge(Some(v));
        assert_eq!([judge(0.14), judge(0.16), judge(0.5), judge(0.82), judge(0.86)], {
            use Verdict::*;
            [Fail, Pass, Pass, Marginal, Fail]
        });
        assert!(guarded.check().is_ok(), "a swallowed warning bound does not cross");
        // No uncertainty draws nothing in, one of half the width leaves the middle, and a negative one is none.
        assert_eq!(LIMIT.drawn_in(0.0), Ok(LIMIT));
        assert_eq!(LIMIT.drawn_in(0.5).unwrap().judge(Some(0.5)), Verdict::Pass);
        assert!(LIMIT.drawn_in(-0.1).is_err());
        insta::assert_snapshot!(LIMIT.drawn_in(0.6).unwrap_err(), @"an uncertainty of 0.6 leaves nothing between `min` and `max`");
    }

    #[test]
    fn the_default_rule_of_iso_14253_draws_in_by_1_65_standard_uncertainties() {
        // U = 0.2 with k = 2: u = 0.1.
        let guards = [DecisionRule::Simple, DecisionRule::GuardBand, DecisionRule::ConformanceProbability].map(|r| r.guard(0.2));
        assert_eq!(guards, [0.0, 0.2, 0.165]);
        let named = [(DecisionRule::Simple, "not taken into account"), (DecisionRule::GuardBand, "expanded uncertainty")];
        assert!(named.iter().all(|(rule, words)| rule.text().contains(words)));
        assert!(DecisionRule::ConformanceProbability.text().contains("1.65 standard uncertainties"));
    }

    #[test]
    fn as_many_decimals_as_the_verdict_needs() {
        let limit = Limit { max: Some(0.1469), ..Limit::default() };
        assert_eq!(limit.shown(0.14658, 3), 0.1466, "0.147 would read as beyond the limit");
        assert_eq!(limit.shown(0.14695, 3), 0.147);
        assert_eq!(limit.shown(0.14691, 3), 0.147);
        assert_eq!(limit.shown(0.2, 3), 0.2);
        let round = Limit { max: Some(0.147), ..Limit::default() };
        assert_eq!(round.shown(0.147_000_04, 3), 0.147_000_0 + 0.000_000_04);
        assert_eq!(round.shown(0.1467, 3), 0.147);
    }

    proptest! {
        #[test]
        fn what_is_shown_has_the_verdict_of_what_was_measured(v in -2.0..3.0f64, decimals in 0usize..5) {
            let shown = LIMIT.shown(v, decimals);
            prop_assert_eq!(LIMIT.judge(Some(shown)), LIMIT.judge(Some(v)));
            prop_assert!((shown - v).abs() <= 0.5 * 10f64.powi(-(decimals as i32)) + 1e-12);
        }

        #[test]
        fn moving_away_from_the_middle_never_improves_the_verdict(a in -2.0..3.0f64, b in -2.0..3.0f64) {
            let distance = |v: f64| (0.45 - v).abs();
            let (near, far) = if distance(a) <= distance(b) { (a, b) } else { (b, a) };
            prop_assume!((near - 0.45).signum() == (far - 0.45).signum());
            prop_assert!(LIMIT.judge(Some(near)) <= LIMIT.judge(Some(far)));
        }
    }
}
