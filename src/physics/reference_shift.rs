//! # Reference shift
//!
//! What it is: the curves are not where the identification found them: another temperature, another valve of the
//! batch, a changed spring.
//!
//! Model: P = P0 (1 + gain) + offset, from the time `from` on.
//!
//! Signature: the error is a straight line over the pressure and does not depend on rate, direction or time (or
//! only on whether it is before or after one instant).
//!
//! What to check on the bench: oil temperature against that of the identification; repeat the sweep.
//!
//! Source: paper, "error due to oil temperature" of the two clutches.

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{PRESSURE, RATIO, TIME};

/// The effect `reference_shift`.
pub struct ReferenceShift;

impl Effect for ReferenceShift {
    fn id(&self) -> &'static str {
        "reference_shift"
    }
    fn source_text(&self) -> &'static str {
        include_str!("reference_shift.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Curve
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "gain",
                unit: &RATIO,
                range: (-0.4, 0.4),
                starts: &[-0.02],
                default: Some(0.0),
                meaning: "relative change of the pressure",
            },
            Parameter {
                name: "offset",
                unit: &PRESSURE,
                range: (-6.0, 6.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "change of the pressure",
            },
            Parameter {
                name: "from",
                unit: &TIME,
                range: (0.0, 1e6),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "time of the change since the start of the recording",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Shift { gain: theta[0], offset: theta[1], wait: ((theta[2] - context.start_s) / context.dt_s).ceil() as i64 })
    }
}

struct Shift {
    gain: f64,
    offset: f64,
    wait: i64,
}

impl Block for Shift {
    fn start(&mut self, _: f64, _: f64) {}
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        if self.wait > 0 {
            self.wait -= 1;
            return input;
        }
        input + self.gain * input + self.offset
    }
}
