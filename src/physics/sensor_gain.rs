//! # Sensor gain
//!
//! What it is: the span of the pressure sensor or of its amplifier is off.
//!
//! Model: y = P (1 + gain), at the end of the signal's way.
//!
//! Signature: an error in proportion to the reading, none at tank pressure, whatever the rate, the direction and the time; a
//! valve whose curves have another gain shows the same, so that only a second sensor tells the two apart.
//!
//! What to check on the bench: a reference gauge at two pressures; range and scaling of the amplifier.
//!
//! Source: Doebelin, Measurement Systems, 5th ed., section 3.2 (zero and sensitivity); IEC 61298-2 (span error).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, LinearForm, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::RATIO;

/// The effect `sensor_gain`.
pub struct SensorGain;

impl Effect for SensorGain {
    fn id(&self) -> &'static str {
        "sensor_gain"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_gain.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn recalibrates(&self) -> bool {
        true
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "gain",
            unit: &RATIO,
            range: (-0.4, 0.4),
            starts: &[0.02, -0.02],
            default: None,
            meaning: "relative error of the reading",
        }];
        &PARAMETERS
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        Some(LinearForm { gain: 1.0 + theta[0], ..LinearForm::NEUTRAL })
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Block {
        Block::pointwise(Span { factor: 1.0 + theta[0] })
    }
}

struct Span {
    factor: f64,
}

impl Pointwise for Span {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        self.factor * input
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reading_is_off_in_proportion_and_the_loop_feels_it() {
        let mut span = Span { factor: 1.05 };
        assert_eq!(span.step(&Point::current(0.5), 20.0), 21.0);
        assert_eq!(SensorGain.linear(&[0.05]).map(|f| f.gain), Some(1.05));
    }
}
