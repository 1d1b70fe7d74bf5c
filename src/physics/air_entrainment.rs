//! # Air entrainment
//!
//! What it is: air in the oil makes the chamber soft at low pressure, where its bulk modulus is small.
//!
//! Model: tau(p) y' = sgn(u - y) |u - y|^feed with tau(p) = tau_5 (6 bar / (p + 1 bar))^exponent, p the gauge pressure y:
//! isothermal air has an exponent of 2, less where the liquid carries a part; feed is 1 through a laminar restrictor and
//! 1/2 through an orifice.
//!
//! Signature: slow at low pressure, fast at high pressure.
//!
//! What to check on the bench: bleed the line and repeat; steps of one size at several pressures.
//!
//! Source: bulk modulus of a liquid with entrained air, Merritt, Hydraulic Control Systems, Wiley 1967, section 2.3.

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use super::power::Power;
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
        static PARAMETERS: [Parameter; 3] = [
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
            Parameter {
                name: "feed",
                unit: &RATIO,
                range: (0.5, 1.0),
                starts: &[1.0, 0.6],
                default: Some(1.0),
                meaning: "exponent of the feeding flow over its pressure drop",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        let softness = Softness { ratio: context.dt_s / theta[0], exponent: theta[1] };
        if theta[2] > 0.999 {
            let table = softness.table(|steps| (-steps).exp());
            return Box::new(Laminar { softness, table, input: 0.0, output: 0.0 });
        }
        let loss = 1.0 - theta[2];
        let table = softness.table(|steps| loss * steps);
        let (less, back) = (Power::new(loss), Power::new(1.0 / loss));
        Box::new(Orifice { softness, loss, less, back, table, input: 0.0, output: 0.0 })
    }
}

/// A chamber that is this near to its target is there [bar].
const SETTLED_BAR: f64 = 1e-7;
/// Below this share of the way the chamber is at its target at the end of the step, not half a step behind.
const STIFF: f64 = 1e-13;
/// What a step does is tabulated up to this pressure [bar],
const TABLE_BAR: usize = 32;
/// at so many places per bar.
const PER_BAR: usize = 16;

/// How many time constants a sample lasts, over the pressure.
struct Softness {
    ratio: f64,
    exponent: f64,
}

impl Softness {
    /// Samples over the time constant at this pressure [bar].
    fn steps(&self, pressure_bar: f64) -> f64 {
        self.ratio * ((pressure_bar + 1.0) / 6.0).powf(self.exponent)
    }
    /// `of` the steps, over the pressure.
    fn table(&self, of: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..=TABLE_BAR * PER_BAR).map(|k| of(self.steps(k as f64 / PER_BAR as f64))).collect()
    }
}

/// What a table made by [`Softness::table`] holds at a pressure [bar]; nothing beyond its end.
#[inline]
fn look_up(table: &[f64], pressure_bar: f64) -> Option<f64> {
    let place = pressure_bar.max(0.0) * PER_BAR as f64;
    let k = place as usize;
    table.get(k..k + 2).map(|pair| pair[0] + (pair[1] - pair[0]) * (place - k as f64))
}

struct Laminar {
    softness: Softness,
    /// Share of the way left after one step.
    table: Vec<f64>,
    input: f64,
    output: f64,
}

impl Block for Laminar {
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
        let left = look_up(&self.table, self.output).unwrap_or_else(|| (-self.softness.steps(self.output)).exp());
        self.output = if left < STIFF { input } else { target + (self.output - target) * left };
        self.output
    }
}

struct Orifice {
    softness: Softness,
    loss: f64,
    less: Power,
    back: Power,
    /// What one step takes from |u - y|^(1 - feed).
    table: Vec<f64>,
    input: f64,
    output: f64,
}

impl Block for Orifice {
    fn start(&mut self, _: f64, input: f64) {
        (self.input, self.output) = (input, input);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let target = 0.5 * (self.input + input);
        self.input = input;
        let away = self.output - target;
        if away.abs() < SETTLED_BAR {
            self.output = target;
            return target;
        }
        let step = look_up(&self.table, self.output).unwrap_or_else(|| self.loss * self.softness.steps(self.output));
        let way = self.less.of(away.abs());
        self.output = if step > 4.0 * way { input } else { target + self.back.of((way - step).max(0.0)).copysign(away) };
        self.output
    }
}
