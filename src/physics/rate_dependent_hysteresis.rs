//! # Rate-dependent hysteresis
//!
//! What it is: the loop widens with the speed of the current.
//!
//! Model: P = P0 - q. While the current moves, the lost pressure q goes to slow + width r^exponent in the direction of the
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

use super::block::{Arrival, Block, Dynamic, Point, Step};
use super::effect::{Context, Effect, Hint, Parameter, Stage, Theta};
use super::power::Power;
use super::rate_clearance::RateClearance;
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
        static PARAMETERS: [Parameter; 6] = [
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
                name: "slow",
                unit: &PRESSURE,
                range: (0.0, 8.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "widening of each branch however slowly the current moves",
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
    /// Plays of several sizes that grow with the rate.
    fn propose(&self, _: &Hint<'_>) -> Vec<Vec<f64>> {
        [0.1, 0.3, 1.0].map(|slow| vec![2.0 * slow, 1.0, 0.0, 0.02, slow, 1.0]).to_vec()
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let ratio = context.dt_s / theta[3];
        Block::dynamic(Widening {
            size: Size { width: theta[0], power: Power::new(theta[1]), per_rest: REST_A_S.powf(theta[1] - 1.0), slow: theta[4] },
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
            clearance: (theta[5] > 0.0).then(|| (theta[5], RateClearance::before(context.curves, context.arrival))),
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

/// The widening over the rate.
struct Size {
    /// At 1 A/s, beyond what is there at a slow rate [bar].
    width: f64,
    power: Power,
    /// Growth of the power from no rate to the rate of rest.
    per_rest: f64,
    /// At a slow rate [bar].
    slow: f64,
}

impl Size {
    /// What the rate adds [bar].
    #[inline]
    fn added(&self, rate: f64) -> f64 {
        let size = rate.abs();
        self.width * if size < REST_A_S { size * self.per_rest } else { self.power.of(size) }
    }

    /// The lost pressure towards which friction goes at this rate [bar], in two parts: what the rate adds, and what is there at a slow one.
    #[inline]
    fn level(&self, rate: f64) -> (f64, f64) {
        (self.added(rate).copysign(rate), self.slow * (rate / REST_A_S).clamp(-1.0, 1.0))
    }
}

struct Widening {
    size: Size,
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
    /// The play, and the part of the widening that it is.
    clearance: Option<(f64, RateClearance)>,
    /// Smoothed rate [A/s].
    rate: f64,
    last: f64,
    /// Pressure that friction takes [bar].
    lost: f64,
}

impl Widening {
    /// Mean of a loss that has died out from `from` to `to` over a time of `ratio` memories.
    fn dying_mean(&self, from: (f64, f64), to: (f64, f64), ratio: f64) -> f64 {
        let times = self.exponent * ratio;
        let added = if times < 1e-6 || from.0 == to.0 { 0.5 * (from.0 + to.0) } else { (from.0 - to.0) / times };
        added + 0.5 * (from.1 + to.1)
    }

    /// The friction after a travel [A] during which the rate goes from one value to the other.
    fn travelled(&self, lost: f64, travel: f64, (from, to): (f64, f64)) -> f64 {
        let left = (-travel.abs() * self.per_length / f64::from(PARTS)).exp();
        (0..PARTS).fold(lost, |lost, k| {
            let rate = from + (to - from) * (f64::from(k) + 0.5) / f64::from(PARTS);
            let goal = sum(self.size.level(rate)).abs().copysign(travel);
            goal + (lost - goal) * left
        })
    }

    /// The smoothed rate during a step with this travel [A].
    #[inline]
    fn felt(&mut self, travel: f64) -> Rates {
        let before = self.rate;
        let (arriving, gone) = match self.arrival {
            Arrival::Held { .. } => {
                let arriving = before * self.decay[0];
                let gone = arriving + travel * self.per_memory;
                self.rate = gone * self.decay[1];
                (arriving, gone)
            }
            Arrival::Ramp => {
                self.rate = before * self.decay[0] + travel * self.per_step * (1.0 - self.decay[0]);
                (before, self.rate)
            }
        };
        Rates { before, arriving, gone, to: self.rate }
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
        let to = self.size.level(rates.to);
        self.lost = sum(to);
        let Arrival::Held { left } = self.arrival else { return Step::arriving(before, self.lost, self.arrival) };
        let [from, ends, begins] = [rates.before, rates.arriving, rates.gone].map(|rate| self.size.level(rate));
        let mean =
            (1.0 - left) * self.dying_mean(from, ends, (1.0 - left) * self.ratio) + left * self.dying_mean(begins, to, left * self.ratio);
        Step { to: self.lost, mean, jump: sum(begins) - sum(ends) }
    }
}

/// The smoothed rate at the sample before, before and behind the jump of a held command, and at the sample [A/s].
#[derive(Clone, Copy)]
struct Rates {
    before: f64,
    arriving: f64,
    gone: f64,
    to: f64,
}

fn sum((added, slow): (f64, f64)) -> f64 {
    added + slow
}

impl Dynamic for Widening {
    fn start(&mut self, at: &Point, _: f64) {
        (self.last, self.rate, self.lost) = (at.current_a, 0.0, 0.0);
        if let Some((_, clearance)) = &mut self.clearance {
            clearance.start(at.current_a);
        }
    }
    #[inline]
    fn step(&mut self, at: &Point, _: f64, input: Step) -> Step {
        let travel = at.current_a - self.last;
        self.last = at.current_a;
        let rates = self.felt(travel);
        let is_all_clearance = self.clearance.as_ref().is_some_and(|(part, _)| *part >= 1.0);
        let mut lost = if is_all_clearance { Step::rest(0.0) } else { self.rubbed(travel, rates) };
        if let Some((part, clearance)) = &mut self.clearance {
            let size = |rate: f64| self.size.slow + self.size.added(rate);
            let crossed = clearance.step(at.current_a, [rates.arriving, rates.gone, rates.to].map(size));
            lost = lost.times(1.0 - *part).plus(crossed.times(*part));
        }
        input.plus(lost.times(-1.0))
    }
}
