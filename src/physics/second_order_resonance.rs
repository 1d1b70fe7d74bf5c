//! # Second-order resonance
//!
//! What it is: spool and spring, or oil column and line, swing.
//!
//! Model: y'' + 2 zeta w y' + w^2 y = w^2 u, w = 2 pi frequency.
//!
//! Signature: ringing after steps with an overshoot of exp(-pi zeta / sqrt(1 - zeta^2)); a peak in the spectrum of
//! the error.
//!
//! What to check on the bench: a small step at high sample rate; damping orifice of the spool.
//!
//! Source: Ogata, Modern Control Engineering, 5th ed., section 5-3; Merritt, Wiley 1967, chapter 6.

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use super::linear::SecondOrder;
use crate::units::{FREQUENCY, RATIO};

/// The effect `second_order_resonance`.
pub struct SecondOrderResonance;

impl Effect for SecondOrderResonance {
    fn id(&self) -> &'static str {
        "second_order_resonance"
    }
    fn source_text(&self) -> &'static str {
        include_str!("second_order_resonance.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "frequency",
                unit: &FREQUENCY,
                range: (0.3, 200.0),
                starts: &[2.0, 4.0, 6.0, 9.0, 13.0, 18.0, 25.0],
                default: None,
                meaning: "undamped natural frequency",
            },
            Parameter {
                name: "damping",
                unit: &RATIO,
                range: (0.04, 0.8),
                starts: &[0.1, 0.35],
                default: None,
                meaning: "damping ratio zeta",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Swing(SecondOrder::new(theta[0], theta[1], context.dt_s)))
    }
}

struct Swing(SecondOrder);

impl Block for Swing {
    fn start(&mut self, _: f64, input: f64) {
        self.0.start(input);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        self.0.step(input)
    }
}
