//! One definition per figure, with its id and source.
//!
//! A metric looks at a [`Segment`]: the samples of one phase, with what came before them (a delayed reference begins
//! before the phase does). What cannot be measured is [`NotMeasurable`] with a reason, never a number.

mod characteristic;
mod frequency_response;
mod influence;
mod line;
mod loop_width;
mod model_error;
mod passes;
mod pressure;
mod repeatability;
mod reversal;
mod share;
mod steady;
mod step;
mod tracking;

use std::ops::Range;

use serde::{Deserialize, Serialize};

pub use characteristic::{PressureGain, StartCurrent};
pub use frequency_response::{BandwidthGain, BandwidthPhase, Response, frequency_response};
pub use influence::{SupplySensitivity, TemperatureSensitivity};
pub use line::{Line, Linearity};
pub use loop_width::{HysteresisWidth, HysteresisWidthInput};
pub use model_error::{ModelRmse, ModelRmseAverage};
pub use pressure::{MaxPressure, MinPressure};
pub use repeatability::Repeatability;
pub use reversal::{DeadBand, ReversalError, Threshold};
pub use share::{FeedForwardShare, FeedbackShare};
pub use steady::SteadyOffset;
pub use step::{DeadTime, FallTime, Overshoot, RiseTime, SettlingTime};
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
    /// Oil temperature [degC]; empty where the rig has none.
    pub oil_temp_c: &'a [f64],
    /// Supply pressure [bar]; empty where the rig has none.
    pub supply_bar: &'a [f64],
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
    /// Lag of the valve model [s]; behind a slow ramp it is a further delay of its size.
    pub lag_s: f64,
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
    /// The current did not turn, or rest and go on, where that is needed.
    #[error("the current {wanted} nowhere in the phase")]
    NoSuchMove {
        /// What it should have done.
        wanted: &'static str,
    },
    /// The rig does not measure what the figure is about.
    #[error("the rig measures no {name}")]
    NoChannel {
        /// What is missing.
        name: &'static str,
    },
    /// What the figure is a slope over hardly changed.
    #[error("the {name} changed by {changed:.2} {unit}; {needed:.2} {unit} are needed")]
    TooLittleChange {
        /// What should have changed.
        name: &'static str,
        /// By how much it did.
        changed: f64,
        /// By how much it must.
        needed: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// The input does not excite the frequencies that are wanted.
    #[error("the input excites {from_hz:.2} to {to_hz:.2} Hz, and the response does not {wanted} there")]
    NotReached {
        /// Lowest excited frequency.
        from_hz: f64,
        /// Highest excited frequency.
        to_hz: f64,
        /// What was looked for.
        wanted: &'static str,
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

/// What a metric needs of a plan beside current and pressure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// A target pressure.
    pub target: bool,
    /// The model's pressure.
    pub model: bool,
}

impl Needs {
    /// Nothing more.
    pub const NOTHING: Self = Self { target: false, model: false };
    /// A target pressure.
    pub const TARGET: Self = Self { target: true, model: false };
    /// The model's pressure.
    pub const MODEL: Self = Self { target: false, model: true };
}

/// A figure of a phase.
pub trait Metric {
    /// Id, for instance `rmse`.
    fn id(&self) -> &'static str;
    /// Its unit.
    fn unit(&self) -> &'static Unit;
    /// What it needs of a plan beside current and pressure.
    fn needs(&self) -> Needs;
    /// Id and version of the definition with its parameters, for instance `rmse.delayed.v1(delay=0.02 s)`.
    fn definition(&self, segment: &Segment<'_>) -> String;
    /// The figure in the canonical unit.
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable>;
    /// Whether the parameters make sense; the message says what is allowed.
    fn check(&self) -> Result<(), String>;
}

/// The enum of all metrics, with the way from each name to its metric.
macro_rules! metric_list {
    ($(#[$attribute:meta])* pub enum $name:ident { $($(#[$doc:meta])* $metric:ident($type:ty),)+ }) => {
        $(#[$attribute])*
        pub enum $name { $($(#[$doc])* $metric($type),)+ }

        impl $name {
            /// The metric behind the name.
            pub fn metric(&self) -> &dyn Metric {
                match self { $(Self::$metric(m) => m,)+ }
            }
        }
    };
}

/// An error where a quantity that must be positive is not.
fn positive(name: &str, value: f64, text: &impl std::fmt::Display) -> Result<(), String> {
    if value > 0.0 { Ok(()) } else { Err(format!("`{name}` is {text}; it must be positive")) }
}

metric_list! {
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
    /// The same of a falling step.
    FallTime(FallTime),
    /// Time from a step until the response begins.
    DeadTime(DeadTime),
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
    /// Slope of the characteristic.
    PressureGain(PressureGain),
    /// Current at which the pressure begins to rise.
    StartCurrent(StartCurrent),
    /// Change of the current after a turn that the pressure does not follow.
    DeadBand(DeadBand),
    /// Change of the current after standstill, in the direction before it, that the pressure does not follow.
    Threshold(Threshold),
    /// Width of a small loop at a working point.
    ReversalError(ReversalError),
    /// Frequency at which the response has fallen by 3 dB.
    BandwidthGain(BandwidthGain),
    /// Frequency at which the response lags by 90 deg.
    BandwidthPhase(BandwidthPhase),
    /// Change of the pressure with the oil temperature.
    TemperatureSensitivity(TemperatureSensitivity),
    /// Change of the pressure with the supply.
    SupplySensitivity(SupplySensitivity),
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
}

impl MetricSpec {
    /// Whether the parameters make sense; the message says what is allowed.
    pub fn check(&self) -> Result<(), String> {
        self.metric().check()
    }

    /// What the metric needs of a plan beside current and pressure.
    pub fn needs(&self) -> Needs {
        self.metric().needs()
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
mod names;

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
                lag_s: 0.0,
            }
        }
    }

    /// A number between -1.7 and 1.7 for each time, of variance 1 and without pattern.
    pub fn scatter(t: f64) -> f64 {
        let mut x = ((t * 1e4).round() as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        12f64.sqrt() * (((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
    }

    #[test]
    fn a_delayed_reference_is_interpolated() {
        let columns = Columns::new(50, |t| 10.0 * t, |_| 0.0, |_| 0.0);
        let segment = columns.segment(0.0);
        assert!((segment.delayed_reference(30, 0.025) - 2.75).abs() < 1e-12);
        assert!((segment.delayed_reference(30, 0.03) - 2.7).abs() < 1e-12);
        assert_eq!(segment.delayed_reference(1, 0.05), 0.0);
        // Just where the loop is closed the first target stands.
        let mut columns = Columns::new(8, |t| if t < 0.035 { f64::NAN } else { 7.0 }, |_| 0.0, |_| 0.0);
        columns.time_s = (0..8).map(|k| 0.125 * f64::from(k)).collect();
        assert_eq!(columns.segment(0.0).delayed_reference(5, 0.25), 7.0);
    }
}
