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

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
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
                starts: &[0.0],
                default: Some(0.0),
                meaning: "heat at the start, 1 is long at 1 A",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Coil { droop: theta[0], share: -(-context.dt_s / theta[1]).exp_m1(), initial: theta[2], heat: theta[2] })
    }
}

struct Coil {
    droop: f64,
    share: f64,
    initial: f64,
    heat: f64,
}

impl Block for Coil {
    fn start(&mut self, _: f64, _: f64) {
        self.heat = self.initial;
    }
    fn step(&mut self, _: f64, input: f64) -> f64 {
        self.heat += self.share * (input * input - self.heat);
        input * (1.0 - self.droop * self.heat)
    }
}
