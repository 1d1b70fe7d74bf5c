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

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::first_order_lag::LINEAR;
use super::flow::{Flow, RESOLUTION_BAR, towards};
use super::power::Power;
use super::signal::{Point, Step};
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
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        // At the pressures of a clutch; above them the chamber is as good as stiff.
        theta[0] * (6.0_f64 / 16.0).powf(theta[1])
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let softness = Softness::new(context.dt_s / theta[0], theta[1]);
        let flow = (theta[2] <= LINEAR).then(|| Flow::new(theta[2]));
        Block::dynamic(Soft { softness, flow, left: context.arrival.left(), output: 0.0 })
    }
}

/// What one step taken with the softness at its begin may be off before it is taken in two halves [bar].
const TOLERANCE_BAR: f64 = 0.01;
/// Most halvings.
const HALVINGS: u32 = 10;

/// How many time constants a sample lasts, over the pressure.
struct Softness {
    ratio: f64,
    power: Power,
}

impl Softness {
    fn new(ratio: f64, exponent: f64) -> Self {
        Self { ratio, power: Power::new(exponent) }
    }
    /// Samples over the time constant at this pressure [bar].
    #[inline]
    fn steps(&self, pressure_bar: f64) -> f64 {
        self.ratio * self.power.of((pressure_bar.max(0.0) + 1.0) / 6.0)
    }
}

struct Soft {
    softness: Softness,
    /// `None` through a laminar restrictor.
    flow: Option<Flow>,
    left: f64,
    output: f64,
}

impl Soft {
    /// Where a chamber of one softness comes to, and its mean distance from the target on the way.
    #[inline]
    fn frozen(&self, target: f64, output: f64, steps: f64) -> (f64, f64) {
        match &self.flow {
            Some(flow) => {
                let (end, sum) = flow.towards(target, output, steps);
                (end, sum / steps)
            }
            None => towards(target, output, steps),
        }
    }

    /// The pressure after `share` of a step towards `target`, and the integral of its distance from it.
    #[inline]
    fn towards(&self, target: f64, output: f64, share: f64, halvings: u32) -> (f64, f64) {
        let begin = self.softness.steps(output);
        // With the softness half-way: of second order, and what it changes says how much there is to correct.
        let (half, _) = self.frozen(target, output, 0.5 * share * begin);
        let middle = self.softness.steps(half);
        let fine = self.frozen(target, output, share * middle);
        let at_most = |change: f64| change.abs() < TOLERANCE_BAR;
        // Through a laminar restrictor at most as much of the distance as the time constants differ.
        let is_near = self.flow.is_none() && at_most((target - output) * share * (middle - begin));
        if is_near || halvings == 0 || at_most(fine.0 - self.frozen(target, output, share * begin).0) {
            return (fine.0, share * fine.1);
        }
        self.in_halves(target, output, share, halvings)
    }

    fn in_halves(&self, target: f64, output: f64, share: f64, halvings: u32) -> (f64, f64) {
        let first = self.towards(target, output, 0.5 * share, halvings - 1);
        let second = self.towards(target, first.0, 0.5 * share, halvings - 1);
        (second.0, first.1 + second.1)
    }
}

impl Dynamic for Soft {
    fn start(&mut self, _: &Point, input: f64) {
        self.output = input;
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let mut mean = 0.0;
        input.pieces(from, self.left, RESOLUTION_BAR, |share, a, b| {
            let target = 0.5 * (a + b);
            let (output, sum) = if (self.output - target).abs() < CLOSE_BAR {
                let (end, away) = self.frozen(target, self.output, share * self.softness.steps(target));
                (end, share * away)
            } else {
                self.towards(target, self.output, share, HALVINGS)
            };
            self.output = output;
            mean += share * target + sum;
        });
        Step { to: self.output, mean, jump: 0.0 }
    }
}

/// So near to its target the softness does not change on the way [bar].
const CLOSE_BAR: f64 = 0.02;
