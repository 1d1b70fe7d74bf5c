//! One definition per figure, with its id and source.
//!
//! A metric looks at a [`Segment`]: the samples of one phase, with what came before them (a delayed reference begins
//! before the phase does). What cannot be measured is [`NotMeasurable`] with a reason, never a number.

mod loop_width;
mod model_error;
mod passes;
mod pressure;
mod share;
mod steady;
mod step;
mod tracking;

use std::ops::Range;

use serde::{Deserialize, Serialize};

pub use loop_width::{HysteresisWidth, HysteresisWidthInput, Linearity, Repeatability};
pub use model_error::{ModelRmse, ModelRmseAverage};
pub use pressure::{MaxPressure, MinPressure};
pub use share::{FeedForwardShare, FeedbackShare};
pub use steady::SteadyOffset;
pub use step::{Overshoot, RiseTime, SettlingTime};
pub use tracking::{MaxError, Rmse, RmseBand};

use crate::units::Unit;

/// The samples of a whole run, column by column; NaN where a value is absent.
#[derive(Debug, Clone, Copy, Default)]
pub struct Signals<'a> {
    /// Time [s].
    pub time_s: &'a [f64],
    /// Target pressure [bar]; NaN in open loop.
    pub target_bar: &'a [f64],
    /// Commanded current [A].
    pub current_a: &'a [f64],
    /// Part of the feed-forward [A].
    pub feed_forward_a: &'a [f64],
    /// Part of the feedback [A].
    pub feedback_a: &'a [f64],
    /// Measured pressure [bar]; NaN where no usable sample came.
    pub pressure_bar: &'a [f64],
    /// Pressure that the hyperbolic model gives for the same current [bar]; empty where nobody asked for it.
    pub model_bar: &'a [f64],
    /// Pressure that the average model gives [bar]; empty where nobody asked for it.
    pub average_model_bar: &'a [f64],
}

/// One phase of a run.
#[derive(Debug, Clone)]
pub struct Segment<'a> {
    /// The whole run.
    pub signals: Signals<'a>,
    /// The samples of the phase.
    pub range: Range<usize>,
    /// The samples of each repetition.
    pub repetitions: Vec<Range<usize>>,
    /// Dead time of the valve model, by which the reference is delayed [s].
    pub delay_s: f64,
}

/// Why a figure has no value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotMeasurable {
    /// The phase has no target pressure.
    #[error("the phase has no target pressure")]
    NoTarget,
    /// Too few usable samples.
    #[error("{usable} of {samples} samples are usable; {needed} are needed")]
    TooFewSamples {
        /// Samples with a value.
        usable: usize,
        /// Samples in all.
        samples: usize,
        /// Needed.
        needed: usize,
    },
    /// The input is not one step.
    #[error("the input of the phase is not a single step")]
    NotAStep,
    /// The response is smaller than anything that could be timed.
    #[error("the pressure moved by {moved_bar:.3} bar only")]
    NoResponse {
        /// How far the pressure moved.
        moved_bar: f64,
    },
    /// The response had not settled when the phase ended.
    #[error("the pressure had not settled in its band when the phase ended")]
    NotSettled,
    /// The current did not sweep its range up and down often enough.
    #[error("the current swept its range {rising} times up and {falling} times down; {needed}")]
    TooFewSweeps {
        /// Full rising passes.
        rising: usize,
        /// Full falling passes.
        falling: usize,
        /// What is needed.
        needed: &'static str,
    },
    /// The target never was in the band.
    #[error("the target was never between {low_bar} bar and {high_bar} bar")]
    OutsideBand {
        /// Lower end.
        low_bar: f64,
        /// Upper end.
        high_bar: f64,
    },
    /// The phase is shorter than the metric's window.
    #[error("the phase is shorter than the window of {window_s} s")]
    TooShort {
        /// The window.
        window_s: f64,
    },
    /// No model pressure.
    #[error("the model could not be simulated")]
    NoModel,
}

/// A figure of a phase.
pub trait Metric {
    /// Id, for instance `rmse`.
    fn id(&self) -> &'static str;
    /// Its unit.
    fn unit(&self) -> &'static Unit;
    /// Id and version of the definition with its parameters, for instance `rmse.delayed.v1(delay=0.02 s)`.
    fn definition(&self, segment: &Segment<'_>) -> String;
    /// The figure in the canonical unit.
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable>;
}

/// A metric as a plan names it, with its parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MetricSpec {
    /// Root mean square of the tracking error against the delayed reference.
    Rmse(Rmse),
    /// The same over the samples whose delayed reference lies in a pressure band.
    RmseBand(RmseBand),
    /// Largest tracking error against the delayed reference.
    MaxError(MaxError),
    /// Mean error at the end of a hold.
    SteadyOffset(SteadyOffset),
    /// Time from 10 % to 90 % of a step response.
    RiseTime(RiseTime),
    /// Time from a step until the response stays in a band.
    SettlingTime(SettlingTime),
    /// How far a step response exceeds its final value.
    Overshoot(Overshoot),
    /// Width of the loop in pressure.
    HysteresisWidth(HysteresisWidth),
    /// Width of the loop in current.
    HysteresisWidthInput(HysteresisWidthInput),
    /// Largest deviation of the mean characteristic from a straight line.
    Linearity(Linearity),
    /// Spread of the pressure between repeated sweeps.
    Repeatability(Repeatability),
    /// RMSE of the hyperbolic model.
    ModelRmse(ModelRmse),
    /// RMSE of the average model.
    ModelRmseAverage(ModelRmseAverage),
    /// Share of the feed-forward in the input.
    FeedForwardShare(FeedForwardShare),
    /// Share of the feedback in the input.
    FeedbackShare(FeedbackShare),
    /// Largest measured pressure.
    MaxPressure(MaxPressure),
    /// Smallest measured pressure.
    MinPressure(MinPressure),
}

impl MetricSpec {
    /// The metric behind the name.
    pub fn metric(&self) -> &dyn Metric {
        match self {
            Self::Rmse(m) => m,
            Self::RmseBand(m) => m,
            Self::MaxError(m) => m,
            Self::SteadyOffset(m) => m,
            Self::RiseTime(m) => m,
            Self::SettlingTime(m) => m,
            Self::Overshoot(m) => m,
            Self::HysteresisWidth(m) => m,
            Self::HysteresisWidthInput(m) => m,
            Self::Linearity(m) => m,
            Self::Repeatability(m) => m,
            Self::ModelRmse(m) => m,
            Self::ModelRmseAverage(m) => m,
            Self::FeedForwardShare(m) => m,
            Self::FeedbackShare(m) => m,
            Self::MaxPressure(m) => m,
            Self::MinPressure(m) => m,
        }
    }

    /// Whether the parameters make sense; the message says what is allowed.
    pub fn check(&self) -> Result<(), String> {
        let positive = |name: &str, value: f64, text: String| match value > 0.0 {
            true => Ok(()),
            false => Err(format!("`{name}` is {text}; it must be positive")),
        };
        match self {
            Self::RmseBand(m) if m.from >= m.to => Err(format!("`from` ({}) must lie below `to` ({})", m.from, m.to)),
            Self::SteadyOffset(m) => positive("window", m.window.value(), m.window.to_string()),
            Self::SettlingTime(m) => positive("band", m.band.value(), m.band.to_string()),
            _ => Ok(()),
        }
    }

    /// Whether the metric needs the model's pressure.
    pub fn needs_model(&self) -> bool {
        matches!(self, Self::ModelRmse(_) | Self::ModelRmseAverage(_))
    }

    /// Whether the metric needs a target pressure.
    pub fn needs_target(&self) -> bool {
        matches!(
            self,
            Self::Rmse(_)
                | Self::RmseBand(_)
                | Self::MaxError(_)
                | Self::SteadyOffset(_)
                | Self::FeedForwardShare(_)
                | Self::FeedbackShare(_)
        )
    }
}

/// Share of the samples that must be usable for a figure to be given.
const NEEDED_SHARE: f64 = 0.9;

impl Segment<'_> {
    /// The reference at sample `k`, delayed by `delay_s` and interpolated; NaN where there was no target then.
    fn delayed_reference(&self, k: usize, delay_s: f64) -> f64 {
        let (time, target) = (self.signals.time_s, self.signals.target_bar);
        let wanted = time[k] - delay_s;
        // The delay is short: walk back from k.
        let mut i = k;
        while i > 0 && time[i] > wanted {
            i -= 1;
        }
        if i == k || time[i] > wanted {
            return target[i];
        }
        let part = (wanted - time[i]) / (time[i + 1] - time[i]);
        let (a, b) = (target[i], target[i + 1]);
        // Where the loop was open before, the first target stands.
        if a.is_nan() {
            b
        } else if b.is_nan() {
            a
        } else {
            a + part * (b - a)
        }
    }

    /// Measured pressure minus delayed reference of every sample that has both.
    fn errors(&self, delay_s: f64) -> Result<Vec<(f64, f64)>, NotMeasurable> {
        if self.range.clone().all(|k| self.signals.target_bar[k].is_nan()) {
            return Err(NotMeasurable::NoTarget);
        }
        let pairs = self.range.clone().map(|k| (self.delayed_reference(k, delay_s), self.signals.pressure_bar[k]));
        let errors: Vec<(f64, f64)> = pairs.filter(|(r, p)| r.is_finite() && p.is_finite()).map(|(r, p)| (r, p - r)).collect();
        enough(errors.len(), self.range.len())?;
        Ok(errors)
    }
}

/// Refuses a figure on too few usable samples.
fn enough(usable: usize, samples: usize) -> Result<(), NotMeasurable> {
    let needed = ((NEEDED_SHARE * samples as f64).ceil() as usize).max(1);
    if usable >= needed { Ok(()) } else { Err(NotMeasurable::TooFewSamples { usable, samples, needed }) }
}

/// A time as a definition prints it.
fn milliseconds(time_s: f64) -> String {
    format!("{} ms", (time_s * 1e6).round() / 1e3)
}

/// Root mean square; the iterator must not be empty.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u64), |(s, n), v| (s + v * v, n + 1));
    (sum / count as f64).sqrt()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Owned columns for the tests of the metrics.
    #[derive(Default)]
    pub struct Columns {
        pub time_s: Vec<f64>,
        pub target: Vec<f64>,
        pub current: Vec<f64>,
        pub feed_forward: Vec<f64>,
        pub feedback: Vec<f64>,
        pub pressure: Vec<f64>,
    }

    impl Columns {
        /// 100 Hz columns from functions of the time.
        pub fn new(samples: usize, target: impl Fn(f64) -> f64, current: impl Fn(f64) -> f64, pressure: impl Fn(f64) -> f64) -> Self {
            let time_s: Vec<f64> = (0..samples).map(|k| k as f64 * 0.01).collect();
            let of = |f: &dyn Fn(f64) -> f64| time_s.iter().map(|t| f(*t)).collect::<Vec<f64>>();
            let (target, current, pressure) = (of(&target), of(&current), of(&pressure));
            Self { feed_forward: current.clone(), feedback: vec![0.0; samples], time_s, target, current, pressure }
        }

        pub fn segment(&self, delay_s: f64) -> Segment<'_> {
            let all = 0..self.time_s.len();
            Segment {
                signals: Signals {
                    time_s: &self.time_s,
                    target_bar: &self.target,
                    current_a: &self.current,
                    feed_forward_a: &self.feed_forward,
                    feedback_a: &self.feedback,
                    pressure_bar: &self.pressure,
                    ..Signals::default()
                },
                range: all.clone(),
                repetitions: vec![all],
                delay_s,
            }
        }
    }

    #[test]
    fn a_delayed_reference_is_interpolated() {
        let columns = Columns::new(50, |t| 10.0 * t, |_| 0.0, |_| 0.0);
        let segment = columns.segment(0.0);
        assert!((segment.delayed_reference(30, 0.025) - 2.75).abs() < 1e-12);
        assert!((segment.delayed_reference(30, 0.03) - 2.7).abs() < 1e-12);
        assert_eq!(segment.delayed_reference(1, 0.05), 0.0);
    }
}
