//! The offset that remains at the end of a hold.

use serde::{Deserialize, Serialize};

use super::{Metric, Needs, NotMeasurable, Segment, enough};
use crate::units::{self, Time, Unit};

/// Mean of pressure minus target over the last `window` of each repetition; of several, the one that is largest in
/// magnitude, with its sign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SteadyOffset {
    /// Length of the window at the end; 0.5 s where it is not given.
    #[serde(default = "half_a_second")]
    pub window: Time,
}

fn half_a_second() -> Time {
    Time::new(0.5)
}

impl Default for SteadyOffset {
    fn default() -> Self {
        Self { window: half_a_second() }
    }
}

impl Metric for SteadyOffset {
    fn id(&self) -> &'static str {
        "steady_offset"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::TARGET
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        format!("steady_offset.mean.v1(window={})", self.window)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let s = &segment.signals;
        let mut worst: f64 = 0.0;
        for repetition in &segment.repetitions {
            let window_s = self.window.value();
            let end = repetition.end.saturating_sub(1);
            if repetition.is_empty() || s.time_s[end] - s.time_s[repetition.start] < window_s {
                return Err(NotMeasurable::TooShort { window_s });
            }
            let inside: Vec<usize> = repetition.clone().filter(|k| s.time_s[*k] > s.time_s[end] - window_s).collect();
            if inside.iter().all(|k| s.target_bar[*k].is_nan()) {
                return Err(NotMeasurable::NoTarget);
            }
            let errors: Vec<f64> = inside.iter().map(|k| s.pressure_bar[*k] - s.target_bar[*k]).filter(|e| e.is_finite()).collect();
            enough(errors.len(), inside.len())?;
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            if mean.abs() > worst.abs() {
                worst = mean;
            }
        }
        Ok(worst)
    }
    fn check(&self) -> Result<(), String> {
        super::positive("window", self.window.value(), &self.window)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Columns;
    use super::*;

    #[test]
    fn only_the_end_counts() {
        let columns = Columns::new(300, |_| 20.0, |_| 0.0, |t| if t < 2.0 { 5.0 } else { 19.8 });
        assert!((SteadyOffset::default().compute(&columns.segment(0.02)).unwrap() + 0.2).abs() < 1e-12);
        // The whole phase is 2.99 s long; a window of that length is the longest, and begins behind its first sample.
        let whole = SteadyOffset { window: Time::new(columns.time_s[299]) };
        assert!((whole.compute(&columns.segment(0.02)).unwrap() - (199.0 * -15.0 + 100.0 * -0.2) / 299.0).abs() < 1e-9);
        let mut late = columns.segment(0.02);
        late.repetitions[0] = 100..300;
        let of = |window| SteadyOffset { window: Time::new(window) }.compute(&late);
        assert_eq!((of(1.9).is_ok(), of(2.5)), (true, Err(NotMeasurable::TooShort { window_s: 2.5 })));
        let long = SteadyOffset { window: Time::new(5.0) };
        assert_eq!(long.compute(&columns.segment(0.02)), Err(NotMeasurable::TooShort { window_s: 5.0 }));
    }

    #[test]
    fn of_several_repetitions_the_worst_counts_with_its_sign() {
        let columns = Columns::new(400, |_| 20.0, |_| 0.0, |t| if t < 2.0 { 19.5 } else { 20.3 });
        let mut segment = columns.segment(0.02);
        segment.repetitions = vec![0..200, 200..400];
        assert!((SteadyOffset::default().compute(&segment).unwrap() + 0.5).abs() < 1e-12);
        // Of two as large the first.
        let even = Columns::new(400, |_| 20.0, |_| 0.0, |t| if t < 2.0 { 20.5 } else { 19.5 });
        let mut segment = even.segment(0.02);
        segment.repetitions = vec![0..200, 200..400];
        assert_eq!(SteadyOffset::default().compute(&segment), Ok(0.5));
    }
}
