//! # Reference shift
//!
//! What it is: the curves are not where the identification found them: another temperature, another valve of the
//! batch, a changed spring.
//!
//! Model: P = P0 (1 + gain) + offset + 4 bend z (1 - z), z = P0 / (span of the curves), from the time `from` on. The
//! bend is what a shift of the current (a spring seat that has set) adds where the curves are no straight lines.
//!
//! Signature: the error is nearly a straight line over the pressure and does not depend on rate, direction or time (or
//! only on whether it is before or after one instant).
//!
//! What to check on the bench: oil temperature against that of the identification; repeat the sweep.
//!
//! Source: paper, "error due to oil temperature" of the two clutches.

use super::block::{Block, Point, Pointwise};
use super::effect::{Context, Effect, Hint, Parameter, Stage, Theta};
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
        static PARAMETERS: [Parameter; 4] = [
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
            Parameter {
                name: "bend",
                unit: &PRESSURE,
                range: (-0.5, 0.5),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "change in the middle of the pressures beyond the straight line",
            },
        ];
        &PARAMETERS
    }
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        // What a recalibration would stand in for.
        vec![vec![hint.recalibrated.0, hint.recalibrated.1, 0.0, 0.0]]
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let span_bar = (context.slope_bar_per_a * (context.range_a.1 - context.range_a.0)).abs().max(1e-9);
        Block::pointwise(Shift {
            gain: theta[0],
            offset: theta[1],
            wait: ((theta[2] - context.start_s) / context.dt_s).ceil() as i64,
            bend: 4.0 * theta[3],
            per_span: 1.0 / span_bar,
        })
    }
}

struct Shift {
    gain: f64,
    offset: f64,
    wait: i64,
    bend: f64,
    per_span: f64,
}

impl Pointwise for Shift {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        if self.wait > 0 {
            self.wait -= 1;
            return input;
        }
        let level = input * self.per_span;
        input + self.gain * input + self.offset + self.bend * level * (1.0 - level)
    }
}
