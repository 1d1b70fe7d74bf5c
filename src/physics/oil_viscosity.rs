//! # Oil viscosity
//!
//! What it is: cold oil is thick, so that the chamber follows its valve later than it does with warm oil.
//!
//! Model: tau y' = u - y, tau = `tau` exp(-fall (T - 60 degC) / 10 K), T the recorded oil temperature; without a record of it
//! that of 60 degC.
//!
//! Signature: a lag that grows as the oil cools; at one temperature it is a lag like any other.
//!
//! What to check on the bench: the same steps with cold and with warm oil.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, section 2.2 (viscosity falls exponentially with temperature) and
//! 3.2 (laminar restrictors).

use super::block::{Block, Dynamic};
use super::effect::{Channel, Context, Effect, LinearForm, Nested, Parameter, Stage, Theta};
use super::flow::{RESOLUTION_BAR, along_line};
use super::signal::{Point, Step};
use crate::units::{RATIO, TIME};

/// The effect `oil_viscosity`.
pub struct OilViscosity;

impl Effect for OilViscosity {
    fn id(&self) -> &'static str {
        "oil_viscosity"
    }
    fn source_text(&self) -> &'static str {
        include_str!("oil_viscosity.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "tau",
                unit: &TIME,
                range: (0.001, 2.0),
                starts: &[0.02, 0.08],
                default: None,
                meaning: "time constant at 60 degC",
            },
            Parameter {
                name: "fall",
                unit: &RATIO,
                range: (0.0, 1.5),
                starts: &[0.3],
                default: Some(0.3),
                meaning: "by how much the logarithm of the time constant falls per 10 K",
            },
        ];
        &PARAMETERS
    }
    fn needs(&self) -> Option<Channel> {
        Some(Channel::OilTemperature)
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        theta[0]
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        Some(LinearForm { lag_s: theta[0], ..LinearForm::NEUTRAL })
    }
    fn nested(&self) -> Option<Nested> {
        Some(Nested { id: "first_order_lag", same: |plain| vec![plain[0], 0.0] })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::dynamic(Thick { ratio: context.dt_s / theta[0], per_k: 0.1 * theta[1], left: context.arrival.left(), output: 0.0 })
    }
}

/// Temperature at which the time constant is given [degC].
pub const REFERENCE_C: f64 = 60.0;

struct Thick {
    /// Step over time constant at the reference.
    ratio: f64,
    per_k: f64,
    left: f64,
    output: f64,
}

impl Dynamic for Thick {
    fn start(&mut self, _: &Point, input: f64) {
        self.output = input;
    }
    #[inline]
    fn step(&mut self, at: &Point, from: f64, input: Step) -> Step {
        let warmer_k = if at.oil_temp_c.is_nan() { 0.0 } else { at.oil_temp_c - REFERENCE_C };
        let ratio = self.ratio * (self.per_k * warmer_k).exp();
        let mut mean = 0.0;
        input.pieces(from, self.left, RESOLUTION_BAR, |share, a, b| {
            let (output, on_the_way) = along_line(self.output, share * ratio, a, b);
            self.output = output;
            mean += share * on_the_way;
        });
        Step { to: self.output, mean, jump: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::signal::Arrival;

    #[test]
    fn cold_oil_is_slower_by_the_exponential_of_its_temperature() {
        let answer = |oil_temp_c: f64| {
            let mut thick = Thick { ratio: 0.1, per_k: 0.03, left: 1.0, output: 0.0 };
            let at = Point { oil_temp_c, ..Point::current(0.5) };
            thick.step(&at, 0.0, Step::arriving(0.0, 1.0, Arrival::Held { left: 1.0 })).to
        };
        assert!((answer(60.0) - (1.0 - (-0.1f64).exp())).abs() < 1e-12);
        assert!((answer(30.0) - (1.0 - (-0.1 * (-0.9f64).exp()).exp())).abs() < 1e-12);
        assert_eq!(answer(f64::NAN), answer(60.0));
    }
}
