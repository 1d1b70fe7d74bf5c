//! # Reversal dead band
//!
//! What it is: play between coil and spool; after each reversal the current must cross it before the spool moves.
//!
//! Model: the play operator of width w on the current, x = clamp(x, i - w/2, i + w/2).
//!
//! Signature: after each reversal the error over |i - i_rev| rises and stays once w is crossed; small movements
//! vanish; the rate does not matter.
//!
//! What to check on the bench: small triangles about a set-point, clearance of the armature, dither amplitude.
//!
//! Source: play operator, Brokate and Sprekels, Hysteresis and Phase Transitions, Springer 1996, section 2.3.

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::CURRENT;

/// The effect `reversal_dead_band`.
pub struct ReversalDeadBand;

impl Effect for ReversalDeadBand {
    fn id(&self) -> &'static str {
        "reversal_dead_band"
    }
    fn source_text(&self) -> &'static str {
        include_str!("reversal_dead_band.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Spool
    }
    fn imitates_form(&self) -> bool {
        true
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "width",
            unit: &CURRENT,
            range: (0.0005, 0.3),
            starts: &[0.008, 0.02, 0.05],
            default: None,
            meaning: "current between the flanks of the play",
        }];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Block {
        Block::pointwise(Play { radius: 0.5 * theta[0], position: 0.0 })
    }
}

/// The play operator.
pub(super) struct Play {
    /// Half of its width, in the unit of its input.
    pub radius: f64,
    /// Its present output.
    pub position: f64,
}

impl Play {
    /// Where an input draws it.
    #[inline]
    pub fn follow(&mut self, input: f64) -> f64 {
        self.position = self.position.max(input - self.radius).min(input + self.radius);
        self.position
    }
}

impl Pointwise for Play {
    fn start(&mut self, _: &Point, input: f64) {
        self.position = input;
    }
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        self.follow(input)
    }
}
