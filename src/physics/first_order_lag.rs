//! # First-order lag
//!
//! What it is: the chamber follows the valve through a restriction.
//!
//! Model: tau y' = sgn(u - y) |u - y|^m (1 bar)^(1-m); m = 1 is laminar (a linear lag), m = 1/2 an orifice.
//!
//! Signature: the error is -tau dP/dt with a roll-off of the gain; against a delay the amplitude falls.
//!
//! What to check on the bench: a fast small sine; oil viscosity, orifice in the line. A lag of the pressure sensor
//! in series cannot be told apart from it without a second pressure tap.
//!
//! Source: paper, Eq. (12), k e^(-T_d s) / (tau s + 1); orifice: Merritt, Wiley 1967, section 3.3.

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, LinearForm, Parameter, Stage, Theta};
use super::flow::{Flow, RESOLUTION_BAR};
use super::linear::FirstOrder;
use super::signal::{Point, Step};
use crate::units::{RATIO, TIME};
use crate::valve::Valve;

/// The effect `first_order_lag`.
pub struct FirstOrderLag;

impl Effect for FirstOrderLag {
    fn id(&self) -> &'static str {
        "first_order_lag"
    }
    fn source_text(&self) -> &'static str {
        include_str!("first_order_lag.rs")
    }
    fn leave_base(&self, valve: &mut Valve) -> bool {
        std::mem::replace(&mut valve.lag_s, 0.0) > 0.0
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "tau",
                unit: &TIME,
                range: (0.001, 5.0),
                starts: &[0.005, 0.015, 0.04, 0.1],
                default: None,
                meaning: "time constant (at 1 bar where it is not linear)",
            },
            Parameter {
                name: "exponent",
                unit: &RATIO,
                range: (0.4, 1.0),
                starts: &[1.0, 0.5],
                default: Some(1.0),
                meaning: "1 laminar, 1/2 orifice",
            },
        ];
        &PARAMETERS
    }
    fn is_linear(&self, theta: Theta<'_>) -> bool {
        theta[1] > LINEAR
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        theta[0]
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        Some(LinearForm { lag_s: theta[0], ..LinearForm::NEUTRAL })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        if theta[1] > LINEAR {
            Block::dynamic(FirstOrder::new(theta[0], context.dt_s, context.arrival))
        } else {
            let step = context.dt_s / theta[0];
            Block::dynamic(Restricted { flow: Flow::new(theta[1]), step, left: context.arrival.left(), output: 0.0 })
        }
    }
}

/// An exponent from here on is 1.
pub(super) const LINEAR: f64 = 0.999;

/// A chamber behind a restriction that is not laminar.
struct Restricted {
    flow: Flow,
    step: f64,
    left: f64,
    output: f64,
}

impl Dynamic for Restricted {
    fn start(&mut self, _: &Point, input: f64) {
        self.output = input;
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let mut mean = 0.0;
        input.pieces(from, self.left, RESOLUTION_BAR, |share, a, b| {
            let target = 0.5 * (a + b);
            let (output, sum) = self.flow.towards(target, self.output, share * self.step);
            self.output = output;
            mean += share * target + sum / self.step;
        });
        Step { to: self.output, mean, jump: 0.0 }
    }
}
