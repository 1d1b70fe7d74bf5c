//! # Fill phase
//!
//! What it is: an empty clutch must be filled before its pressure can rise above that of the return spring.
//!
//! Model: while the piston moves (0 < x < 1) the pressure is plateau + spring x (or less, where less is asked for);
//! it moves with x' = sgn(d) (|d| / 1 bar)^(1/2) / time, d = P0 - pressure, and falls back likewise when P0 is
//! below the plateau: there the pressure is P0 + hold (plateau + spring x - P0), as the return spring pushes the oil
//! out. With the clutch full the pressure is P0. A run begins with the clutch empty.
//!
//! Signature: only from empty: a rise, a plateau at the kiss point, then a fast rise.
//!
//! What to check on the bench: a step from tank pressure with the clutch vented; fill volume and flow.
//!
//! Source: US patent 7,574,906 (fill volume); Merritt, Hydraulic Control Systems, Wiley 1967, section 3.3 (orifice).

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{PRESSURE, RATIO, TIME};

/// The effect `fill_phase`.
pub struct FillPhase;

impl Effect for FillPhase {
    fn id(&self) -> &'static str {
        "fill_phase"
    }
    fn source_text(&self) -> &'static str {
        include_str!("fill_phase.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 5] = [
            Parameter {
                name: "plateau",
                unit: &PRESSURE,
                range: (0.2, 20.0),
                starts: &[1.5, 3.0, 4.5],
                default: None,
                meaning: "pressure at which the piston moves",
            },
            Parameter {
                name: "time",
                unit: &TIME,
                range: (0.005, 10.0),
                starts: &[0.2, 0.8],
                default: None,
                meaning: "fill time at an excess of 1 bar",
            },
            Parameter {
                name: "spring",
                unit: &PRESSURE,
                range: (0.0, 5.0),
                starts: &[0.2],
                default: Some(0.0),
                meaning: "rise of the pressure over the stroke",
            },
            Parameter {
                name: "drain",
                unit: &RATIO,
                range: (0.02, 20.0),
                starts: &[1.0],
                default: Some(1.0),
                meaning: "speed of draining over that of filling",
            },
            Parameter {
                name: "hold",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "share of the return spring's pressure that shows while the clutch drains",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Fill {
            plateau: theta[0],
            rate: context.dt_s / theta[1] / SUBSTEPS as f64,
            spring: theta[2],
            drain: theta[3],
            hold: theta[4],
            stroke: 0.0,
            before: 0.0,
        })
    }
}

/// Steps of the piston within one sample.
const SUBSTEPS: usize = 4;

struct Fill {
    plateau: f64,
    rate: f64,
    spring: f64,
    drain: f64,
    hold: f64,
    stroke: f64,
    before: f64,
}

impl Block for Fill {
    fn start(&mut self, _: f64, input: f64) {
        (self.stroke, self.before) = (0.0, input);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        if self.stroke >= 1.0 && input >= self.plateau + self.spring {
            self.before = input;
            return input;
        }
        for k in 1..=SUBSTEPS {
            let drive = self.before + (input - self.before) * k as f64 / SUBSTEPS as f64;
            let excess = drive - (self.plateau + self.spring * self.stroke);
            let speed = excess.abs().sqrt().copysign(excess) * if excess < 0.0 { self.drain } else { 1.0 };
            self.stroke = (self.stroke + self.rate * speed).clamp(0.0, 1.0);
        }
        self.before = input;
        let inside = self.plateau + self.spring * self.stroke;
        match self.stroke {
            full if full >= 1.0 && input >= inside => input,
            empty if empty <= 0.0 => input.min(inside),
            _ => inside.min(input + self.hold * (inside - input).max(0.0)),
        }
    }
}
