//! # Sensor quantization
//!
//! What it is: the reading comes in coarse steps.
//!
//! Model: y = step * round(P / step).
//!
//! Signature: only multiples of one step occur, and the difference of neighbouring readings is a comb; against a
//! fine reading the error is uniform within +/- half a step.
//!
//! What to check on the bench: range and bits of the converter, scaling of the message.
//!
//! Source: Widrow and Kollar, Quantization Noise, Cambridge 2008, chapter 1.

use super::effect::{Block, Context, Effect, Kind, Parameter, Stage, Theta};
use crate::units::PRESSURE;

/// The effect `sensor_quantization`.
pub struct SensorQuantization;

impl Effect for SensorQuantization {
    fn id(&self) -> &'static str {
        "sensor_quantization"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_quantization.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "step",
            unit: &PRESSURE,
            range: (1e-4, 50.0),
            starts: &[0.1],
            default: None,
            meaning: "smallest difference of two readings",
        }];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Box<dyn Block> {
        Box::new(Steps { step: theta[0] })
    }
}

struct Steps {
    step: f64,
}

impl Block for Steps {
    fn start(&mut self, _: f64, _: f64) {}
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        (input / self.step).round() * self.step
    }
}
