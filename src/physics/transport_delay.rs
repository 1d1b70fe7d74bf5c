//! # Transport delay
//!
//! What it is: dead time beyond that of the model, for instance of a slower message or a longer line.
//!
//! Model: P(t) = P0(t - extra).
//!
//! Signature: the error is a straight line over dP/dt with the same slope up and down; the phase grows with the
//! frequency while the gain stays 1.
//!
//! What to check on the bench: bus cycle and message priority, filters in the driver, length of the pressure line.
//!
//! Source: paper, section on the delay of the measured pressure (10 to 30 ms); Ljung, System Identification, 2nd
//! ed., section 3.2, for the dead time of a sampled system.

use super::block::{Block, Through};
use super::effect::{Context, Effect, LinearForm, Parameter, Stage, Theta};
use crate::units::TIME;

/// The effect `transport_delay`.
pub struct TransportDelay;

impl Effect for TransportDelay {
    fn id(&self) -> &'static str {
        "transport_delay"
    }
    fn source_text(&self) -> &'static str {
        include_str!("transport_delay.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Delay
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "extra",
            unit: &TIME,
            range: (0.0, 0.5),
            starts: &[0.02, 0.045, 0.08],
            default: None,
            meaning: "dead time beyond that of the model",
        }];
        &PARAMETERS
    }
    fn dead_time_s(&self, theta: Theta<'_>) -> f64 {
        theta[0]
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        Some(LinearForm { delay_s: theta[0], ..LinearForm::NEUTRAL })
    }
    fn block(&self, _: Theta<'_>, _: &Context) -> Block {
        // Its time is added to that of the valve, so that there is one fractional delay only.
        Block::pointwise(Through)
    }
}
