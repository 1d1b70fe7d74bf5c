//! # Coil heating
//!
//! What it is: the coil warms up with the square of the current; where the driver does not hold the current against
//! the rising resistance, the force droops.
//!
//! Model: tau h' = (i / 1 A)^2 - h; the current at the spool is i (1 - droop h). The coil starts at the heat
//! `initial` (0: cold).
//!
//! Signature: the pressure droops after minutes at high current and recovers at low current; the error follows the
//! integral of i^2, not the time.
//!
//! What to check on the bench: measured coil current and resistance, cold and hot; a driver that controls the
//! current shows no droop.
//!
//! Source: copper 0.0039 1/K; thermal RC as in Incropera, Fundamentals of Heat and Mass Transfer, 6th ed., section
//! 5.1 (lumped capacitance).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::signal::{Arrival, Point};
use crate::units::{RATIO, TIME};

/// The effect `coil_heating`.
pub struct CoilHeating;

impl Effect for CoilHeating {
    fn id(&self) -> &'static str {
        "coil_heating"
    }
    fn source_text(&self) -> &'static str {
        include_str!("coil_heating.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Coil
    }
    fn memory_s(&self, theta: Theta<'_>) -> f64 {
        theta[1]
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "droop",
                unit: &RATIO,
                range: (0.0, 0.6),
                starts: &[0.05],
                default: None,
                meaning: "share of the current lost after long at 1 A",
            },
            Parameter {
                name: "tau",
                unit: &TIME,
                range: (3.0, 600.0),
                starts: &[15.0, 60.0, 200.0],
                default: None,
                meaning: "thermal time constant of the coil",
            },
            Parameter {
                name: "initial",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0, 0.4],
                default: Some(0.0),
                meaning: "heat at the start, 1 is long at 1 A",
            },
        ];
        &PARAMETERS
    }
    fn longest_step_s(&self, _: Theta<'_>) -> f64 {
        // While a command is held the current droops on, which a hysteresis sees as a reversal of its own.
        0.01
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::pointwise(Coil {
            droop: theta[0],
            shares: {
                let left = context.arrival.left();
                [1.0 - left, left].map(|part| -(-part * context.dt_s / theta[1]).exp_m1())
            },
            held: matches!(context.arrival, Arrival::Held { .. }),
            initial: theta[2],
            heat: theta[2],
            last: 0.0,
        })
    }
}

struct Coil {
    droop: f64,
    /// What of the way to its end the heat goes until the command changes, and from then to the sample.
    shares: [f64; 2],
    held: bool,
    initial: f64,
    heat: f64,
    last: f64,
}

impl Pointwise for Coil {
    fn start(&mut self, _: &Point, input: f64) {
        (self.heat, self.last) = (self.initial, input);
    }
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        // What the current was up to here has made the heat.
        let square = if self.held { self.last * self.last } else { (self.last * (self.last + input) + input * input) / 3.0 };
        self.heat += self.shares[0] * (square - self.heat);
        self.heat += self.shares[1] * (input * input - self.heat);
        self.last = input;
        input * (1.0 - self.droop * self.heat)
    }
}
