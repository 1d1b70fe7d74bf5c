//! # Reference drift
//!
//! What it is: the curves change slowly while the valve works, for instance as the oil warms up.
//!
//! Model: P = P0 (1 + gain s(t)) + offset s(t), s(t) = (1 - exp(-t/tau)) / (1 - exp(-60 s/tau)): the change after
//! one minute; a large tau is a straight line.
//!
//! Signature: the error at equal current grows with time; at tank pressure it stays zero, unlike a sensor drift.
//!
//! What to check on the bench: oil temperature; the same sweep at the begin and the end of the session.
//!
//! Source: paper, discussion of the error due to oil temperature; Merritt, Hydraulic Control Systems, Wiley 1967,
//! section 2.2 (viscosity and temperature).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::{PRESSURE, RATIO, TIME};

/// The effect `reference_drift`.
pub struct ReferenceDrift;

impl Effect for ReferenceDrift {
    fn id(&self) -> &'static str {
        "reference_drift"
    }
    fn source_text(&self) -> &'static str {
        include_str!("reference_drift.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Curve
    }
    fn memory_s(&self, _: Theta<'_>) -> f64 {
        f64::INFINITY
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "gain",
                unit: &RATIO,
                range: (-0.3, 0.3),
                starts: &[0.01],
                default: Some(0.0),
                meaning: "change of the gain after one minute",
            },
            Parameter {
                name: "offset",
                unit: &PRESSURE,
                range: (-5.0, 5.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "change of the offset after one minute",
            },
            Parameter {
                name: "tau",
                unit: &TIME,
                range: (12.0, 2000.0),
                starts: &[1000.0, 30.0],
                default: Some(2000.0),
                meaning: "time constant of the change",
            },
        ];
        &PARAMETERS
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::pointwise(Drift { gain: theta[0], offset: theta[1], change: SlowChange::new(theta[2], context) })
    }
}

/// A change that starts with the recording and levels off; 1 after one minute.
pub(super) struct SlowChange {
    decay: f64,
    scale: f64,
    left: f64,
}

impl SlowChange {
    /// With the time constant `tau_s`.
    pub fn new(tau_s: f64, context: &Context) -> Self {
        let scale = -1.0 / (-60.0 / tau_s).exp_m1();
        Self { decay: (-context.dt_s / tau_s).exp(), scale, left: (-context.start_s / tau_s).exp() }
    }
    /// The change at this sample, then one step on.
    #[inline]
    pub fn step(&mut self) -> f64 {
        let now = self.scale * (1.0 - self.left);
        self.left *= self.decay;
        now
    }
}

struct Drift {
    gain: f64,
    offset: f64,
    change: SlowChange,
}

impl Pointwise for Drift {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        let s = self.change.step();
        input + s * (self.gain * input + self.offset)
    }
}
