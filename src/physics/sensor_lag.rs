//! # Sensor lag
//!
//! What it is: the pressure sensor, its line or its filter follows late.
//!
//! Model: tau y' = u - y, at the end of the signal's way, and once more with tau `second`: a filter of two stages, or the
//! line before a sensor that is slow itself. Beyond critical damping the two are what a second-order instrument is.
//!
//! Signature: that of a first-order lag of the valve; from current and pressure alone the two cannot be told apart.
//!
//! What to check on the bench: a second sensor close to the valve; the filter of the amplifier.
//!
//! Source: Doebelin, Measurement Systems, 5th ed., section 3.3 (first- and second-order instruments).

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, LinearForm, Nested, Parameter, Stage, Theta};
use super::linear::FirstOrder;
use super::signal::{Point, Step};
use crate::units::{RATIO, TIME};

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
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "tau",
                unit: &TIME,
                range: (0.001, 5.0),
                starts: &[0.015, 0.04, 0.1],
                default: None,
                meaning: "time constant of the sensor",
            },
            Parameter {
                name: "second",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0, 0.8],
                default: Some(0.0),
                meaning: "time constant of a second stage, as a part of the first; 0: there is none",
            },
        ];
        &PARAMETERS
    }
    fn is_linear(&self, _: Theta<'_>) -> bool {
        true
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        theta[0]
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        // A second lag as a delay, which takes more of the phase and none of the gain: the cautious side.
        Some(LinearForm { lag_s: theta[0], delay_s: theta[0] * theta[1], ..LinearForm::NEUTRAL })
    }
    fn nested(&self) -> Option<Nested> {
        Some(Nested { id: "first_order_lag", same: |plain| vec![plain[0], 0.0] })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let stage = |tau_s: f64| FirstOrder::new(tau_s, context.dt_s, context.arrival);
        if theta[1] == 0.0 {
            return Block::dynamic(stage(theta[0]));
        }
        Block::dynamic(TwoStages { first: stage(theta[0]), second: stage(theta[0] * theta[1]) })
    }
}

struct TwoStages {
    first: FirstOrder,
    second: FirstOrder,
}

impl Dynamic for TwoStages {
    fn start(&mut self, at: &Point, input: f64) {
        self.first.start(at, input);
        self.second.start(at, input);
    }
    #[inline]
    fn step(&mut self, at: &Point, from: f64, input: Step) -> Step {
        let between = self.first.output();
        let input = self.first.step(at, from, input);
        self.second.step(at, between, input)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::signal::Arrival;

    /// Of two like stages: 1 - (1 + t / tau) exp(-t / tau), however finely it is read.
    #[test]
    fn two_like_stages_answer_a_step_as_a_critically_damped_instrument() {
        let tau_s = 0.05;
        for dt_s in [0.001, 0.01] {
            let stage = || FirstOrder::new(tau_s, dt_s, Arrival::Held { left: 1.0 });
            let mut lag = TwoStages { first: stage(), second: stage() };
            lag.start(&Point::current(0.0), 0.0);
            let mut from = 0.0;
            for k in 1..=(0.4 / dt_s) as u32 {
                let step = Step::arriving(from, 1.0, Arrival::Held { left: 1.0 });
                from = 1.0;
                let to = lag.step(&Point::current(0.0), if k == 1 { 0.0 } else { 1.0 }, step).to;
                let t = f64::from(k) * dt_s / tau_s;
                assert!((to - (1.0 - (1.0 + t) * (-t).exp())).abs() < 2e-3, "{dt_s} {k}: {to}");
            }
        }
    }
}
