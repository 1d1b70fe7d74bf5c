//! # Rate-dependent hysteresis
//!
//! What it is: the loop widens with the speed of the current.
//!
//! Model: P = P0 - q. While the current moves, the lost pressure q goes to width r^exponent in the direction of the
//! movement, r = |i'| / (1 A/s) with i' smoothed over `memory`; it gets there within a travel of `length` and stays
//! at rest (Dahl), or with `length` 0 it is there at once, and gone at rest.
//!
//! Signature: loop width over rate at constant amplitude; unlike a lag, the error does not depend on how long the
//! ramp has lasted, and it is gone once the current rests.
//!
//! What to check on the bench: triangles of one amplitude at three rates, and a stop-and-hold after a ramp.
//!
//! Source: Al Janaideh, Krejci and Monteiro, Appl. Math. 68 (2023), rate-dependent Prandtl-Ishlinskii operators.

use super::block::{Arrival, Block, Dynamic, Point, Step};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::power::Power;
use crate::units::{CURRENT, PRESSURE, RATIO, TIME};

/// The effect `rate_dependent_hysteresis`.
pub struct RateDependentHysteresis;

impl Effect for RateDependentHysteresis {
    fn id(&self) -> &'static str {
        "rate_dependent_hysteresis"
    }
    fn source_text(&self) -> &'static str {
        include_str!("rate_dependent_hysteresis.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Static
    }
    fn imitates_form(&self) -> bool {
        true
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter {
                name: "width",
                unit: &PRESSURE,
                range: (0.0, 8.0),
                starts: &[0.4],
                default: None,
                meaning: "widening of each branch at 1 A/s",
            },
            Parameter {
                name: "exponent",
                unit: &RATIO,
                range: (0.05, 1.2),
                starts: &[0.2, 0.6],
                default: Some(1.0),
                meaning: "growth of the widening with the rate",
            },
            Parameter {
                name: "length",
                unit: &CURRENT,
                range: (0.0, 0.1),
                starts: &[0.0, 0.008],
                default: Some(0.0),
                meaning: "travel over which the friction builds up and that it keeps at rest; 0: at once, and none at rest",
            },
            Parameter {
                name: "memory",
                unit: &TIME,
                range: (0.002, 0.5),
                starts: &[0.02, 0.1],
                default: Some(0.02),
                meaning: "time over which the rate is felt",
            },
        ];
        &PARAMETERS
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        // With a steep exponent the widening changes faster than the rate that is felt.
        0.6 * theta[3]
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let ratio = context.dt_s / theta[3];
        Block::dynamic(Widening {
            width: theta[0],
            power: Power::new(theta[1]),
            slow: REST_A_S.powf(theta[1] - 1.0),
            exponent: theta[1],
            per_length: 1.0 / theta[2].max(1e-6),
            at_once: theta[2] < 1e-5,
            arrival: context.arrival,
            ratio,
            per_memory: 1.0 / theta[3],
            per_step: 1.0 / context.dt_s,
            decay: match context.arrival {
                Arrival::Held { left } => [(-(1.0 - left) * ratio).exp(), (-left * ratio).exp()],
                Arrival::Ramp => [(-ratio).exp(), 1.0],
            },
            rate: 0.0,
            last: 0.0,
            lost: 0.0,
        })
    }
}

/// Below this rate the current rests, and the widening is in proportion to it [A/s].
const REST_A_S: f64 = 1e-3;
/// Parts of a travel over which the friction builds up.
const PARTS: u32 = 4;

struct Widening {
    width: f64,
    power: Power,
    slow: f64,
    exponent: f64,
    per_length: f64,
    at_once: bool,
    arrival: Arrival,
    /// Step over memory.
    ratio: f64,
    per_memory: f64,
    per_step: f64,
    /// What is left of the rate at the jump of what was there before the step, and at the sample of what the jump left.
    decay: [f64; 2],
    /// Smoothed rate [A/s].
    rate: f64,
    last: f64,
    lost: f64,
}

impl Widening {
    /// The lost pressure towards which friction goes at this rate [bar].
    #[inline]
    fn level(&self, rate: f64) -> f64 {
        let size = rate.abs();
        (self.width * if size < REST_A_S { size * self.slow } else { self.power.of(size) }).copysign(rate)
    }

    /// Mean of a loss that has died out from `from` to `to` over a time of `ratio` memories.
    fn dying_mean(&self, from: f64, to: f64, ratio: f64) -> f64 {
        let times = self.exponent * ratio;
        if times < 1e-6 || from == to { 0.5 * (from + to) } else { (from - to) / times }
    }

    /// The friction after a travel [A] during which the rate goes from one value to the other.
    fn travelled(&self, lost: f64, travel: f64, (from, to): (f64, f64)) -> f64 {
        let left = (-travel.abs() * self.per_length / f64::from(PARTS)).exp();
        (0..PARTS).fold(lost, |lost, k| {
            let rate = from + (to - from) * (f64::from(k) + 0.5) / f64::from(PARTS);
            let goal = self.level(rate).abs().copysign(travel);
            goal + (lost - goal) * left
        })
    }
}

impl Dynamic for Widening {
    fn start(&mut self, at: &Point, _: f64) {
        (self.last, self.rate, self.lost) = (at.current_a, 0.0, 0.0);
    }
    #[inline]
    fn step(&mut self, at: &Point, _: f64, input: Step) -> Step {
        let travel = at.current_a - self.last;
        self.last = at.current_a;
        let before = self.lost;
        let Arrival::Held { left } = self.arrival else {
            let from = self.rate;
            self.rate = from * self.decay[0] + travel * self.per_step * (1.0 - self.decay[0]);
            if self.at_once {
                self.lost = self.level(self.rate);
            } else if travel != 0.0 {
                self.lost = self.travelled(before, travel, (from, self.rate));
            }
            return Step { to: input.to - self.lost, mean: input.mean - 0.5 * (before + self.lost), jump: input.jump };
        };
        let arriving = self.rate * self.decay[0];
        let gone = arriving + travel * self.per_memory;
        self.rate = gone * self.decay[1];
        if self.at_once {
            let (ends, begins) = (self.level(arriving), self.level(gone));
            self.lost = self.level(self.rate);
            let mean = (1.0 - left) * self.dying_mean(before, ends, (1.0 - left) * self.ratio)
                + left * self.dying_mean(begins, self.lost, left * self.ratio);
            return Step { to: input.to - self.lost, mean: input.mean - mean, jump: input.jump - (begins - ends) };
        }
        if travel != 0.0 {
            self.lost = self.travelled(before, travel, (arriving, gone));
        }
        let jump = self.lost - before;
        Step { to: input.to - self.lost, mean: input.mean - before - left * jump, jump: input.jump - jump }
    }
}
