//! # Leakage
//!
//! What it is: oil leaks from the clutch line, so that the pressure reached is lower, the more the higher it is.
//!
//! Model: P = P0 - q, where q follows loss (P0 / 10 bar)^exponent with the time constant `build` of the volume behind
//! the valve's own resistance.
//!
//! Signature: a droop that grows with the pressure, from zero at zero, alike up and down and in holds; an exponent
//! near 1 is laminar (a worn seal), towards 2 an orifice against the valve's own flow gain.
//!
//! What to check on the bench: pressure decay with the valve closed; seals and screw joints.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, sections 3.2 and 3.3 (laminar and orifice flow).

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use super::linear::FirstOrder;
use super::power::Power;
use crate::units::{PRESSURE, RATIO, TIME};

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
        static PARAMETERS: [Parameter; 3] = [
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
            Parameter {
                name: "build",
                unit: &TIME,
                range: (0.0, 2.0),
                starts: &[0.02, 0.2],
                default: Some(0.0),
                meaning: "time constant with which the loss follows",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Leak { loss: theta[0], power: Power::new(theta[1]), lost: FirstOrder::new(theta[2], context.dt_s) })
    }
}

struct Leak {
    loss: f64,
    power: Power,
    lost: FirstOrder,
}

impl Leak {
    fn at(&self, pressure: f64) -> f64 {
        if pressure > 0.0 { self.loss * self.power.of(pressure * 0.1) } else { 0.0 }
    }
}

impl Block for Leak {
    fn start(&mut self, _: f64, input: f64) {
        let settled = self.at(input);
        self.lost.start(settled);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let now = self.at(input);
        input - self.lost.step(now)
    }
}
