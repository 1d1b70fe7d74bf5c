//! # Thermal gain
//!
//! What it is: the gain of the valve changes with the temperature of the oil, as its viscosity and the magnet do.
//!
//! Model: P = P0 (1 + gain (T - reference) / 10 K), T the recorded oil temperature; without a record of it, nothing.
//!
//! Signature: the error in proportion to the pressure follows the oil temperature, up and down; a drift goes one way with time.
//!
//! What to check on the bench: the same sweep at two oil temperatures.
//!
//! Source: Doebelin, Measurement Systems, 5th ed., section 3.2 (temperature drift of zero and sensitivity); paper, on the
//! change of the curves with the oil temperature.

use super::block::{Block, Pointwise};
use super::effect::{Channel, Context, Effect, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::{RATIO, TEMPERATURE};

/// The effect `thermal_gain`.
pub struct ThermalGain;

impl Effect for ThermalGain {
    fn id(&self) -> &'static str {
        "thermal_gain"
    }
    fn source_text(&self) -> &'static str {
        include_str!("thermal_gain.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Curve
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "gain",
                unit: &RATIO,
                range: (-0.2, 0.2),
                starts: &[0.01],
                default: None,
                meaning: "change of the gain per 10 K",
            },
            Parameter {
                name: "reference",
                unit: &TEMPERATURE,
                range: (-40.0, 150.0),
                starts: &[60.0],
                default: Some(60.0),
                meaning: "oil temperature at which the curves hold",
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
        input * (1.0 + self.per_10_k * 0.1 * (at.oil_temp_c - self.reference_c))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_follows_the_recorded_temperature_and_does_nothing_without() {
        let mut thermal = Thermal { per_10_k: 0.02, reference_c: 60.0 };
        let hot = Point { oil_temp_c: 80.0, ..Point::current(0.5) };
        assert!((thermal.step(&hot, 10.0) - 10.4).abs() < 1e-12);
        assert_eq!(thermal.step(&Point::current(0.5), 10.0), 10.0);
    }
}
