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

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use super::linear::FirstOrder;
use super::power::Power;
use crate::units::{RATIO, TIME};

/// The effect `first_order_lag`.
pub struct FirstOrderLag;

impl Effect for FirstOrderLag {
    fn id(&self) -> &'static str {
        "first_order_lag"
    }
    fn source_text(&self) -> &'static str {
        include_str!("first_order_lag.rs")
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
                starts: &[0.015, 0.04, 0.1],
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
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        if theta[1] > 0.999 {
            Box::new(Linear(FirstOrder::new(theta[0], context.dt_s)))
        } else {
            let loss = 1.0 - theta[1];
            let (less, back) = (Power::new(loss), Power::new(1.0 / loss));
            Box::new(Orifice { less, back, step: loss * context.dt_s / theta[0], input: 0.0, output: 0.0 })
        }
    }
}

/// A linear lag as a block.
pub(super) struct Linear(pub FirstOrder);

impl Block for Linear {
    fn start(&mut self, _: f64, input: f64) {
        self.0.start(input);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        self.0.step(input)
    }
}

/// The lag of an orifice: solved exactly for the mean input of the step, it reaches its target in finite time.
struct Orifice {
    less: Power,
    back: Power,
    step: f64,
    input: f64,
    output: f64,
}

impl Block for Orifice {
    fn start(&mut self, _: f64, input: f64) {
        (self.input, self.output) = (input, input);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let target = 0.5 * (self.input + input);
        self.input = input;
        let away = self.output - target;
        let left = (self.less.of(away.abs()) - self.step).max(0.0);
        self.output = target + self.back.of(left).copysign(away);
        self.output
    }
}
