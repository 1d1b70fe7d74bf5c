//! # Rate-dependent hysteresis
//!
//! What it is: the loop widens with the speed of the current.
//!
//! Model: P = P0 - q. While the current moves, the lost pressure q goes to width r^exponent in the direction of the
//! movement, r = |i'| / (1 A/s) with i' smoothed over `memory`; it gets there within a travel of `length` and stays
//! at rest (Dahl), or with `length` 0 it is there at once, and gone at rest. A part `clearance` of it is what a play of that
//! size takes before the curve: the pressure stands while it is crossed, and is drawn on as it closes.
//!
//! Signature: loop width over rate at constant amplitude; unlike a lag, the error does not depend on how long the
//! ramp has lasted, and it is gone once the current rests.
//!
//! What to check on the bench: triangles of one amplitude at three rates, and a stop-and-hold after a ramp.
//!
//! Source: Al Janaideh, Krejci and Monteiro, Appl. Math. 68 (2023), rate-dependent Prandtl-Ishlinskii operators.

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::power::Power;
use super::rate_clearance::RateClearance;
use super::signal::{Arrival, Point, Step};
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
        static PARAMETERS: [Parameter; 5] = [
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
            Parameter {
                name: "clearance",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "part of the widening that is a play before the curve",
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
        let friction = Friction {
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
        };
        let part = theta[4];
        if part == 0.0 {
            return Block::dynamic(friction);
        }
        Block::dynamic(PartlyPlay { part, friction, play: RateClearance::before(context.curves, context.arrival) })
    }
}

/// Below this rate the current rests, and the widening is in proportion to it [A/s].
const REST_A_S: f64 = 1e-3;
/// Parts of a travel over which the friction builds up.
const PARTS: u32 = 4;

/// All of the widening is friction.
struct Friction {
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
    /// Pressure that friction takes [bar].
    lost: f64,
}

impl Friction {
    /// Size of the lost pressure towards which friction goes at this rate [bar].
    #[inline]
    fn size(&self, rate: f64) -> f64 {
        let size = rate.abs();
        self.width * if size < REST_A_S { size * self.slow } else { self.power.of(size) }
    }

    /// The same with the sign of the rate [bar].
    #[inline]
    fn level(&self, rate: f64) -> f64 {
        self.size(rate).copysign(rate)
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
            let goal = self.size(rate).copysign(travel);
            goal + (lost - goal) * left
        })
    }

    /// The travel [A] of a step to this current, and the smoothed rate meanwhile.
    #[inline]
    fn felt(&mut self, current_a: f64) -> (f64, Rates) {
        let travel = current_a - self.last;
        self.last = current_a;
        let arriving = self.rate * self.decay[0];
        let rates = match self.arrival {
            Arrival::Held { .. } => {
                let gone = arriving + travel * self.per_memory;
                Rates { arriving, gone, to: gone * self.decay[1] }
            }
            Arrival::Ramp => {
                let to = arriving + travel * self.per_step * (1.0 - self.decay[0]);
                Rates { arriving: self.rate, gone: to, to }
            }
        };
        self.rate = rates.to;
        (travel, rates)
    }

    /// What friction takes of the pressure during a step with this travel [A].
    #[inline]
    fn rubbed(&mut self, travel: f64, rates: Rates) -> Step {
        let before = self.lost;
        if !self.at_once {
            if travel != 0.0 {
                self.lost = self.travelled(before, travel, (rates.arriving, rates.gone));
            }
            return Step::arriving(before, self.lost, self.arrival);
        }
        self.lost = self.level(rates.to);
        let Arrival::Held { left } = self.arrival else { return Step::arriving(before, self.lost, self.arrival) };
        let (ends, begins) = (self.level(rates.arriving), self.level(rates.gone));
        let mean = (1.0 - left) * self.dying_mean(before, ends, (1.0 - left) * self.ratio)
            + left * self.dying_mean(begins, self.lost, left * self.ratio);
        Step { to: self.lost, mean, jump: begins - ends }
    }
}

/// The smoothed rate before and behind the jump of a held command, or at both ends of a ramp, and at the sample [A/s].
#[derive(Clone, Copy)]
struct Rates {
    arriving: f64,
    gone: f64,
    to: f64,
}

impl Dynamic for Friction {
    fn start(&mut self, at: &Point, _: f64) {
        (self.last, self.rate, self.lost) = (at.current_a, 0.0, 0.0);
    }
    #[inline]
    fn step(&mut self, at: &Point, _: f64, input: Step) -> Step {
        let (travel, rates) = self.felt(at.current_a);
        input.minus(self.rubbed(travel, rates))
    }
}

/// A part of the widening is a play before the curve, the rest is friction.
struct PartlyPlay {
    part: f64,
    friction: Friction,
    play: RateClearance,
}

impl Dynamic for PartlyPlay {
    fn start(&mut self, at: &Point, input: f64) {
        self.friction.start(at, input);
        self.play.start(at.current_a);
    }
    #[inline]
    fn step(&mut self, at: &Point, _: f64, input: Step) -> Step {
        let (travel, rates) = self.friction.felt(at.current_a);
        let rubbed = self.friction.rubbed(travel, rates);
        let crossed = self.play.step(at.current_a, [rates.arriving, rates.gone, rates.to].map(|rate| self.friction.size(rate)));
        input.minus(rubbed.times(1.0 - self.part).plus(crossed.times(self.part)))
    }
}
