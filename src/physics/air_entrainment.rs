//! # Air entrainment
//!
//! What it is: air in the oil makes the chamber soft at low pressure, where its bulk modulus is small.
//!
//! Model: tau(p) y' = u - y with tau(p) = tau_5 (6 bar / (p + 1 bar))^exponent, p the gauge pressure y: isothermal air
//! has an exponent of 2, less where the liquid carries a part.
//!
//! Signature: slow at low pressure, fast at high pressure.
//!
//! What to check on the bench: bleed the line and repeat; steps of one size at several pressures.
//!
//! Source: bulk modulus of a liquid with entrained air, Merritt, Hydraulic Control Systems, Wiley 1967, section 2.3.

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{RATIO, TIME};

/// The effect `air_entrainment`.
pub struct AirEntrainment;

impl Effect for AirEntrainment {
    fn id(&self) -> &'static str {
        "air_entrainment"
    }
    fn source_text(&self) -> &'static str {
        include_str!("air_entrainment.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "tau_5",
                unit: &TIME,
                range: (0.002, 5.0),
                starts: &[0.03, 0.12, 0.4],
                default: None,
                meaning: "time constant at 5 bar",
            },
            Parameter {
                name: "exponent",
                unit: &RATIO,
                range: (0.5, 3.0),
                starts: &[1.0, 2.0],
                default: Some(2.0),
                meaning: "fall of the time constant with the pressure",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        let mut air = Air { table: Vec::new(), ratio: context.dt_s / theta[0], exponent: theta[1], input: 0.0, output: 0.0 };
        air.table = (0..=TABLE_BAR * PER_BAR).map(|k| air.left(k as f64 / PER_BAR as f64)).collect();
        Box::new(air)
    }
}

/// A chamber that is this near to its target is there [bar].
const SETTLED_BAR: f64 = 1e-7;

/// Below this share the chamber is at its target at the end of the step, not half a step behind.
const STIFF: f64 = 1e-13;
/// The share of the way that is left after one step is tabulated up to this pressure [bar],
const TABLE_BAR: usize = 32;
/// at so many places per bar.
const PER_BAR: usize = 16;

struct Air {
    /// Share of the way left after one step, over pressure.
    table: Vec<f64>,
    ratio: f64,
    exponent: f64,
    input: f64,
    output: f64,
}

impl Air {
    /// Share of the way to the target that is left after one step from this pressure [bar].
    fn left(&self, pressure_bar: f64) -> f64 {
        (-self.ratio * ((pressure_bar + 1.0) / 6.0).powf(self.exponent)).exp()
    }
}

impl Block for Air {
    fn start(&mut self, _: f64, input: f64) {
        (self.input, self.output) = (input, input);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let target = 0.5 * (self.input + input);
        self.input = input;
        if (self.output - target).abs() < SETTLED_BAR {
            self.output = target;
            return target;
        }
        let place = self.output.max(0.0) * PER_BAR as f64;
        let k = place as usize;
        let left = match self.table.get(k..k + 2) {
            Some(pair) => pair[0] + (pair[1] - pair[0]) * (place - k as f64),
            None => self.left(self.output),
        };
        // Far above 5 bar the chamber is stiff and follows within the sample.
        self.output = if left < STIFF { input } else { target + (self.output - target) * left };
        self.output
    }
}
