//! # Stiction
//!
//! What it is: the spool sticks until the force exceeds the static friction, then jumps.
//!
//! Model: stuck while |i - x| <= band; then it slips to x = i -/+ slip * band. The break-away band grows with the
//! dwell time, band (1 + growth ln(1 + dwell / 1 s)).
//!
//! Signature: a slow ramp gives a staircase, the error is a sawtooth; steps of the size band (1 - slip).
//!
//! What to check on the bench: a micro-ramp of some 20 mA at high resolution; dither amplitude, contamination.
//!
//! Source: He, Wang, Pottmann and Qin, Ind. Eng. Chem. Res. 46 (2007) 4549; growth with dwell: Rabinowicz, Friction
//! and Wear of Materials, 2nd ed., section 4.

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{CURRENT, RATIO};

/// The effect `stiction`.
pub struct Stiction;

impl Effect for Stiction {
    fn id(&self) -> &'static str {
        "stiction"
    }
    fn source_text(&self) -> &'static str {
        include_str!("stiction.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Spool
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "band",
                unit: &CURRENT,
                range: (0.0, 0.2),
                starts: &[0.006, 0.012, 0.02, 0.03, 0.045],
                default: None,
                meaning: "current that breaks the spool away from rest",
            },
            Parameter {
                name: "slip",
                unit: &RATIO,
                range: (0.0, 0.95),
                starts: &[0.1, 0.5],
                default: Some(0.0),
                meaning: "share of the band that is left after a slip",
            },
            Parameter {
                name: "growth",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "growth of the band per e-fold of dwell time",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Stick { band: theta[0], slip: theta[1], growth: theta[2], dt_s: context.dt_s, position: 0.0, dwell_s: 0.0 })
    }
}

struct Stick {
    band: f64,
    slip: f64,
    growth: f64,
    dt_s: f64,
    position: f64,
    dwell_s: f64,
}

impl Block for Stick {
    fn start(&mut self, _: f64, input: f64) {
        self.position = input;
        self.dwell_s = 0.0;
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let away = input - self.position;
        let band = if self.growth > 0.0 { self.band * (1.0 + self.growth * self.dwell_s.ln_1p()) } else { self.band };
        if away.abs() > band {
            self.position = input - away.signum() * self.slip * self.band;
            self.dwell_s = 0.0;
        } else {
            self.dwell_s += self.dt_s;
        }
        self.position
    }
}
