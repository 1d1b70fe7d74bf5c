//! Which part of the input comes from the feed-forward, and which from the feedback.

use serde::{Deserialize, Serialize};

use super::{Metric, Needs, NotMeasurable, Segment};
use crate::units::{self, Unit};

/// Mean |i_ff| over the mean of |i_ff| + |i_fb|. With [`FeedbackShare`] it adds up to one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FeedForwardShare {}

/// Mean |i_fb| over the mean of |i_ff| + |i_fb|.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FeedbackShare {}

fn sums(segment: &Segment<'_>) -> Result<(f64, f64), NotMeasurable> {
    let sum = |column: &[f64]| column[segment.range.clone()].iter().filter(|v| v.is_finite()).map(|v| v.abs()).sum::<f64>();
    let (forward, back) = (sum(segment.signals.feed_forward_a), sum(segment.signals.feedback_a));
    if forward + back > 0.0 { Ok((forward, back)) } else { Err(NotMeasurable::NoTarget) }
}

impl Metric for FeedForwardShare {
    fn id(&self) -> &'static str {
        "feed_forward_share"
    }
    fn unit(&self) -> &'static Unit {
        &units::RATIO
    }
    fn needs(&self) -> Needs {
        Needs::TARGET
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "feed_forward_share.mean_abs.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        sums(segment).map(|(forward, back)| forward / (forward + back))
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for FeedbackShare {
    fn id(&self) -> &'static str {
        "feedback_share"
    }
    fn unit(&self) -> &'static Unit {
        &units::RATIO
    }
    fn needs(&self) -> Needs {
        Needs::TARGET
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "feedback_share.mean_abs.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        sums(segment).map(|(forward, back)| back / (forward + back))
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Columns;
    use super::*;

    #[test]
    fn the_shares_add_up() {
        let mut columns = Columns::new(100, |_| 10.0, |_| 0.5, |_| 10.0);
        columns.feed_forward = vec![0.45; 100];
        columns.feedback = (0..100).map(|k| if k % 2 == 0 { 0.05 } else { -0.05 }).collect();
        let segment = columns.segment(0.0);
        assert!((FeedForwardShare {}.compute(&segment).unwrap() - 0.9).abs() < 1e-12);
        assert!((FeedbackShare {}.compute(&segment).unwrap() - 0.1).abs() < 1e-12);
        // All of it from one side; nothing at all has no shares.
        columns.feedback = vec![0.0; 100];
        assert_eq!(FeedForwardShare {}.compute(&columns.segment(0.0)), Ok(1.0));
        columns.feed_forward = vec![0.0; 100];
        assert_eq!(FeedForwardShare {}.compute(&columns.segment(0.0)), Err(NotMeasurable::NoTarget));
        columns.feedback = vec![-0.1; 100];
        assert_eq!(FeedbackShare {}.compute(&columns.segment(0.0)), Ok(1.0));
    }
}
