//! # Flow limit
//!
//! What it is: the flow through the valve limits how fast the pressure can change.
//!
//! Model: |dy/dt| <= rise going up and <= fall going down. Flow from a supply S and to the tank through orifices falls
//! with the counter-pressure: rise scales with (1 - y / S)^shape, fall with (4 y / S)^shape, S = 1.5 times the pressures
//! that the curves span. A shape of 0 is a constant limit (a pump), 1/2 orifices, 1 laminar restrictors.
//!
//! Signature: large steps become ramps of one slope; small movements are untouched.
//!
//! What to check on the bench: steps of several sizes; pump flow, filters, line diameter.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, section 3.3 (orifice flow into a volume).

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{PRESSURE_RATE, RATIO};

/// The effect `flow_limit`.
pub struct FlowLimit;

impl Effect for FlowLimit {
    fn id(&self) -> &'static str {
        "flow_limit"
    }
    fn source_text(&self) -> &'static str {
        include_str!("flow_limit.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "rise",
                unit: &PRESSURE_RATE,
                range: (1.0, 5000.0),
                starts: &[40.0, 100.0, 250.0],
                default: None,
                meaning: "fastest rise",
            },
            Parameter {
                name: "fall",
                unit: &PRESSURE_RATE,
                range: (1.0, 5000.0),
                starts: &[40.0, 100.0, 250.0],
                default: None,
                meaning: "fastest fall",
            },
            Parameter {
                name: "shape",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "dependence of the limits on the counter-pressure",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        let span_bar = (context.slope_bar_per_a * (context.range_a.1 - context.range_a.0)).abs().max(1e-9);
        Box::new(Limit {
            rise: theta[0] * context.dt_s,
            fall: theta[1] * context.dt_s,
            shape: theta[2],
            per_supply: 1.0 / (1.5 * span_bar),
            free: theta[0].min(theta[1]) * context.dt_s * if theta[2] > 0.0 { LEAST_SHARE.powf(theta[2]) } else { 1.0 },
            output: 0.0,
        })
    }
}

/// Least share of the supply's pressure that still drives: a flow never ends before its target is reached.
const LEAST_SHARE: f64 = 0.02;

struct Limit {
    rise: f64,
    fall: f64,
    shape: f64,
    per_supply: f64,
    free: f64,
    output: f64,
}

impl Block for Limit {
    fn start(&mut self, _: f64, input: f64) {
        self.output = input;
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let wanted = input - self.output;
        let level = self.output * self.per_supply;
        // The limits never bind below this.
        if wanted.abs() <= self.free {
            self.output = input;
            return input;
        }
        let scale = |share: f64| if self.shape > 0.0 { share.max(LEAST_SHARE).powf(self.shape) } else { 1.0 };
        self.output += if wanted > 0.0 { wanted.min(self.rise * scale(1.0 - level)) } else { wanted.max(-self.fall * scale(4.0 * level)) };
        self.output
    }
}
