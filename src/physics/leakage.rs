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

use super::block::{Block, Dynamic, Pointwise};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::linear::FirstOrder;
use super::power::Power;
use super::signal::{Point, Step};
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
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        if theta[2] > AT_ONCE_S { theta[2] } else { f64::INFINITY }
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let loss = Loss { loss: theta[0], power: Power::new(theta[1]) };
        if theta[2] <= AT_ONCE_S {
            return Block::pointwise(AtOnce(loss));
        }
        Block::dynamic(Late {
            loss,
            left: context.arrival.left(),
            lost: FirstOrder::new(theta[2], context.dt_s, context.arrival),
            last: 0.0,
        })
    }
}

/// A loss that builds up faster than this is there at once [s].
const AT_ONCE_S: f64 = 1e-4;

struct Loss {
    loss: f64,
    power: Power,
}

impl Loss {
    #[inline]
    fn at(&self, pressure: f64) -> f64 {
        if pressure > 0.0 { self.loss * self.power.of(pressure * 0.1) } else { 0.0 }
    }
}

struct AtOnce(Loss);

impl Pointwise for AtOnce {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        input - self.0.at(input)
    }
}

struct Late {
    loss: Loss,
    left: f64,
    lost: FirstOrder,
    /// The loss that the pressure before asked for.
    last: f64,
}

impl Dynamic for Late {
    fn start(&mut self, _: &Point, input: f64) {
        self.last = self.loss.at(input);
        self.lost.settle(self.last);
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let asked = self.loss.at(input.to);
        // The loss follows the pressure through its jump; what is smooth is taken as a straight line.
        let jump = if input.jump == 0.0 { 0.0 } else { self.loss.at(from + input.jump) - self.last };
        let mean = 0.5 * (self.last + asked - jump) + self.left * jump;
        let (to, lost) = self.lost.advance(self.last, Step { to: asked, mean, jump });
        self.last = asked;
        Step { to: input.to - to, mean: input.mean - lost, jump: input.jump }
    }
}
