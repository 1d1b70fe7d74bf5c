//! # Sensor lag
//!
//! What it is: the pressure sensor, its line or its filter follows late.
//!
//! Model: tau y' = u - y, at the end of the signal's way.
//!
//! Signature: that of a first-order lag of the valve; from current and pressure alone the two cannot be told apart.
//!
//! What to check on the bench: a second sensor close to the valve; the filter of the amplifier.
//!
//! Source: Doebelin, Measurement Systems, 5th ed., section 3.3 (first-order instruments).

use super::block::Block;
use super::effect::{Context, Effect, LinearForm, Nested, Parameter, Stage, Theta};
use super::linear::FirstOrder;
use crate::units::TIME;

/// The effect `sensor_lag`.
pub struct SensorLag;

impl Effect for SensorLag {
    fn id(&self) -> &'static str {
        "sensor_lag"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_lag.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "tau",
            unit: &TIME,
            range: (0.001, 5.0),
            starts: &[0.015, 0.04, 0.1],
            default: None,
            meaning: "time constant of the sensor",
        }];
        &PARAMETERS
    }
    fn is_linear(&self, _: Theta<'_>) -> bool {
        true
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        theta[0]
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        Some(LinearForm { lag_s: theta[0], ..LinearForm::NEUTRAL })
    }
    fn nested(&self) -> Option<Nested> {
        Some(Nested { id: "first_order_lag", same: |plain| vec![plain[0]] })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::dynamic(FirstOrder::new(theta[0], context.dt_s, context.arrival))
    }
}
