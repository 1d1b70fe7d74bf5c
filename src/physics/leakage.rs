//! # Leakage
//!
//! What it is: oil leaks from the clutch line, so that the pressure reached is lower, the more the higher it is.
//!
//! Model: P = P0 - loss (P0 / 10 bar)^exponent.
//!
//! Signature: a droop that grows with the pressure, from zero at zero, alike up and down and in holds; an exponent
//! near 1 is laminar (a worn seal), towards 2 an orifice against the valve's own flow gain.
//!
//! What to check on the bench: pressure decay with the valve closed; seals and screw joints.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, sections 3.2 and 3.3 (laminar and orifice flow).

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{PRESSURE, RATIO};

/// The effect `leakage`.
pub struct Leakage;

impl Effect for Leakage {
    fn id(&self) -> &'static str {
        "leakage"
    }
    fn source_text(&self) -> &'static str {
        include_str!("leakage.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Curve
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "loss",
                unit: &PRESSURE,
                range: (0.0, 8.0),
                starts: &[0.2],
                default: None,
                meaning: "pressure lost at 10 bar",
            },
            Parameter {
                name: "exponent",
                unit: &RATIO,
                range: (0.3, 3.0),
                starts: &[1.0, 2.0],
                default: Some(1.0),
                meaning: "growth of the loss with the pressure",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Box<dyn Block> {
        Box::new(Leak { loss: theta[0], exponent: theta[1] })
    }
}

struct Leak {
    loss: f64,
    exponent: f64,
}

impl Block for Leak {
    fn start(&mut self, _: f64, _: f64) {}
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        if input > 0.0 { input - self.loss * (input * 0.1).powf(self.exponent) } else { input }
    }
}
