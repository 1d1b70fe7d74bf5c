//! # Sensor zero
//!
//! What it is: the zero of the pressure sensor is off, by the same at every pressure and at all times.
//!
//! Model: y = P + offset, at the end of the signal's way.
//!
//! Signature: a constant error, also at tank pressure, where the valve cannot err; a shift of the curves is not seen there.
//!
//! What to check on the bench: the reading with the line vented.
//!
//! Source: Doebelin, Measurement Systems, 5th ed., section 3.2 (zero and sensitivity); IEC 61298-2 (zero error).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, LinearForm, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::PRESSURE;

/// The effect `sensor_zero`.
pub struct SensorZero;

impl Effect for SensorZero {
    fn id(&self) -> &'static str {
        "sensor_zero"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_zero.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn recalibrates(&self) -> bool {
        true
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "offset",
            unit: &PRESSURE,
            range: (-6.0, 6.0),
            starts: &[0.1, -0.1],
            default: None,
            meaning: "what the sensor reads at 0 bar",
        }];
        &PARAMETERS
    }
    fn linear(&self, _: Theta<'_>) -> Option<LinearForm> {
        Some(LinearForm::NEUTRAL)
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Block {
        Block::pointwise(Zero { offset: theta[0] })
    }
}

struct Zero {
    offset: f64,
}

impl Pointwise for Zero {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        input + self.offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reading_is_off_by_the_same_at_every_pressure() {
        let mut zero = Zero { offset: -0.3 };
        assert_eq!([0.0, 20.0].map(|p| zero.step(&Point::current(0.5), p)), [-0.3, 19.7]);
    }
}
