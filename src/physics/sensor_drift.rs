//! # Sensor drift
//!
//! What it is: the zero of the pressure sensor moves while the valve works.
//!
//! Model: y = P + offset s(t), s(t) = (1 - exp(-t/tau)) / (1 - exp(-60 s/tau)): the drift after one minute.
//!
//! Signature: the error grows with time, alike at every pressure, also at tank pressure, where the valve cannot err.
//!
//! What to check on the bench: the reading with the line vented, before and after.
//!
//! Source: Doebelin, Measurement Systems, 5th ed., section 3.2 (zero drift).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::reference_drift::SlowChange;
use super::signal::Point;
use crate::units::{PRESSURE, TIME};

/// The effect `sensor_drift`.
pub struct SensorDrift;

impl Effect for SensorDrift {
    fn id(&self) -> &'static str {
        "sensor_drift"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_drift.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn memory_s(&self, _: Theta<'_>) -> f64 {
        f64::INFINITY
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "offset",
                unit: &PRESSURE,
                range: (-5.0, 5.0),
                starts: &[0.1],
                default: None,
                meaning: "drift after one minute",
            },
            Parameter {
                name: "tau",
                unit: &TIME,
                range: (12.0, 2000.0),
                starts: &[1000.0, 30.0],
                default: Some(2000.0),
                meaning: "time constant of the drift",
            },
        ];
        &PARAMETERS
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::pointwise(Zero { offset: theta[0], change: SlowChange::new(theta[1], context) })
    }
}

struct Zero {
    offset: f64,
    change: SlowChange,
}

impl Pointwise for Zero {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        input + self.offset * self.change.step()
    }
}
