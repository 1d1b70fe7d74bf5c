//! # Reference shape
//!
//! What it is: the true curve is not quite the polynomial that was fitted: a knee, a bump, a step of the edge.
//!
//! Model: P = P0 + c(i), c piecewise linear over the current with eight equidistant knots on the valid range.
//!
//! Signature: the error depends on the current alone; rate, direction and time do not matter.
//!
//! What to check on the bench: a staircase with dwell over the range in question; a higher order of the curve.
//!
//! Source: de Boor, A Practical Guide to Splines, Springer 2001, chapter III (broken lines).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Kind, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::PRESSURE;

/// The effect `reference_shape`.
pub struct ReferenceShape;

/// Number of knots.
const KNOTS: usize = 8;

impl Effect for ReferenceShape {
    fn id(&self) -> &'static str {
        "reference_shape"
    }
    fn source_text(&self) -> &'static str {
        include_str!("reference_shape.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Curve
    }
    fn kind(&self) -> Kind {
        Kind::Form
    }
    fn parameters(&self) -> &'static [Parameter] {
        const fn knot(name: &'static str) -> Parameter {
            Parameter {
                name,
                unit: &PRESSURE,
                range: (-5.0, 5.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "correction at this knot of the range of current",
            }
        }
        static PARAMETERS: [Parameter; KNOTS] =
            [knot("k1"), knot("k2"), knot("k3"), knot("k4"), knot("k5"), knot("k6"), knot("k7"), knot("k8")];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let mut knots = [0.0; KNOTS];
        knots.copy_from_slice(theta);
        let (low, high) = context.curves.range_a;
        Block::pointwise(Shape { knots, low, per_a: (KNOTS - 1) as f64 / (high - low) })
    }
}

struct Shape {
    knots: [f64; KNOTS],
    low: f64,
    per_a: f64,
}

impl Pointwise for Shape {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, at: &Point, input: f64) -> f64 {
        let x = ((at.current_a - self.low) * self.per_a).clamp(0.0, (KNOTS - 1) as f64);
        let k = (x as usize).min(KNOTS - 2);
        let part = x - k as f64;
        input + self.knots[k] + part * (self.knots[k + 1] - self.knots[k])
    }
}
