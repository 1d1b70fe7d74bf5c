//! # Thermal zero
//!
//! What it is: the zero of the pressure sensor, or of the valve, moves with the temperature of the oil.
//!
//! Model: y = P + offset (T - reference) / 10 K, T the recorded oil temperature; without a record of it, nothing.
//!
//! Signature: the error is alike at every pressure and follows the oil temperature, up and down; a drift goes one way with time.
//!
//! What to check on the bench: the reading with the line vented, at two oil temperatures.
//!
//! Source: Doebelin, Measurement Systems, 5th ed., section 3.2 (temperature drift of zero and sensitivity); paper, on the
//! change of the curves with the oil temperature.

use super::block::{Block, Pointwise};
use super::effect::{Channel, Context, Effect, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::{PRESSURE, TEMPERATURE};

/// The effect `thermal_zero`.
pub struct ThermalZero;

impl Effect for ThermalZero {
    fn id(&self) -> &'static str {
        "thermal_zero"
    }
    fn source_text(&self) -> &'static str {
        include_str!("thermal_zero.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "offset",
                unit: &PRESSURE,
                range: (-2.0, 2.0),
                starts: &[0.05],
                default: None,
                meaning: "change of the zero per 10 K",
            },
            Parameter {
                name: "reference",
                unit: &TEMPERATURE,
                range: (-40.0, 150.0),
                starts: &[60.0],
                default: Some(60.0),
                meaning: "oil temperature at which the zero is right",
            },
        ];
        &PARAMETERS
    }
    fn needs(&self) -> Option<Channel> {
        Some(Channel::OilTemperature)
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Block {
        Block::pointwise(Thermal { per_10_k: theta[0], reference_c: theta[1] })
    }
}

struct Thermal {
    per_10_k: f64,
    reference_c: f64,
}

impl Pointwise for Thermal {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, at: &Point, input: f64) -> f64 {
        if at.oil_temp_c.is_nan() {
            return input;
        }
        input + self.per_10_k * 0.1 * (at.oil_temp_c - self.reference_c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_follows_the_recorded_temperature_and_does_nothing_without() {
        let mut thermal = Thermal { per_10_k: 0.02, reference_c: 60.0 };
        let hot = Point { oil_temp_c: 80.0, ..Point::current(0.5) };
        assert!((thermal.step(&hot, 10.0) - 10.04).abs() < 1e-12);
        assert_eq!(thermal.step(&Point::current(0.5), 10.0), 10.0);
    }
}
