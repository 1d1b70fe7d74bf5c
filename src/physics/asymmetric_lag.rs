//! # Asymmetric lag
//!
//! What it is: the chamber fills through one restriction and empties through another, so that it follows slower one way.
//!
//! Model: tau y' = u - y with tau = `rise` while u is above y and `fall` while it is below.
//!
//! Signature: the error over dP/dt has one slope going up and another going down; a lag has one.
//!
//! What to check on the bench: equal steps up and down; check valves and orifices between valve and clutch.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, section 3.2 (laminar restrictors); check valves, section 7.

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, LinearForm, Nested, Parameter, Stage, Theta};
use super::flow::{RESOLUTION_BAR, along_line};
use super::signal::{Point, Step};
use crate::units::TIME;

/// The effect `asymmetric_lag`.
pub struct AsymmetricLag;

impl Effect for AsymmetricLag {
    fn id(&self) -> &'static str {
        "asymmetric_lag"
    }
    fn source_text(&self) -> &'static str {
        include_str!("asymmetric_lag.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn searched(&self) -> bool {
        false
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "rise",
                unit: &TIME,
                range: (0.001, 5.0),
                starts: &[0.015, 0.06],
                default: None,
                meaning: "time constant while the pressure rises",
            },
            Parameter {
                name: "fall",
                unit: &TIME,
                range: (0.001, 5.0),
                starts: &[0.015, 0.06],
                default: None,
                meaning: "time constant while the pressure falls",
            },
        ];
        &PARAMETERS
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        theta[0].min(theta[1])
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        // The slower way, which is the cautious one at the frequencies of the loop.
        Some(LinearForm { lag_s: theta[0].max(theta[1]), ..LinearForm::NEUTRAL })
    }
    fn nested(&self) -> Option<Nested> {
        Some(Nested { id: "first_order_lag", same: |plain| vec![plain[0], plain[0]] })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let steps = |tau_s: f64| context.dt_s / tau_s;
        Block::dynamic(OneWay { rise: steps(theta[0]), fall: steps(theta[1]), left: context.arrival.left(), output: 0.0 })
    }
}

struct OneWay {
    /// Step over time constant.
    rise: f64,
    fall: f64,
    left: f64,
    output: f64,
}

impl OneWay {
    #[inline]
    fn follow(&mut self, share: f64, a: f64, b: f64) -> f64 {
        let ratio = if 0.5 * (a + b) > self.output { self.rise } else { self.fall };
        let (output, integral) = along_line(self.output, share * ratio, a, b);
        self.output = output;
        share * integral
    }
}

impl Dynamic for OneWay {
    fn start(&mut self, _: &Point, input: f64) {
        self.output = input;
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let mut mean = 0.0;
        input.pieces(from, self.left, RESOLUTION_BAR, |share, a, b| mean += self.follow(share, a, b));
        Step { to: self.output, mean, jump: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::signal::Arrival;

    #[test]
    fn steps_up_and_down_have_time_constants_of_their_own() {
        let arrival = Arrival::Held { left: 1.0 };
        let mut lag = OneWay { rise: 0.5, fall: 0.1, left: 1.0, output: 0.0 };
        let up = lag.step(&Point::current(0.0), 0.0, Step::arriving(0.0, 10.0, arrival)).to;
        assert!((up - 10.0 * (1.0 - (-0.5f64).exp())).abs() < 1e-9, "{up}");
        let down = lag.step(&Point::current(0.0), 10.0, Step::arriving(10.0, 0.0, arrival)).to;
        assert!((down - up * (-0.1f64).exp()).abs() < 1e-9, "{down}");
    }
}
