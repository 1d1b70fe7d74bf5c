//! # Supply accumulator
//!
//! What it is: the supply is an accumulator that a small pump charges: each rise of the pressure draws oil from it, so that
//! the supply sags and recovers.
//!
//! Model: P = min(P0, S); S falls by `draw` times each rise of P and goes back to `limit` with the time constant `recovery`.
//!
//! Signature: the pressure is clipped after fast or repeated rises, lower the more rises came before, and creeps up to the
//! level that was asked for; after a pause the same rise is not clipped.
//!
//! What to check on the bench: supply pressure during the run; precharge of the accumulator, flow of the pump, other consumers.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, chapter 7 (hydraulic power elements, accumulators).

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, Nested, Parameter, Stage, Theta};
use super::signal::{Arrival, Point, Step};
use crate::units::{PRESSURE, RATIO, TIME};

/// The effect `supply_accumulator`.
pub struct SupplyAccumulator;

impl Effect for SupplyAccumulator {
    fn id(&self) -> &'static str {
        "supply_accumulator"
    }
    fn source_text(&self) -> &'static str {
        include_str!("supply_accumulator.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Supply
    }
    fn searched(&self) -> bool {
        false
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "limit",
                unit: &PRESSURE,
                range: (1.0, 400.0),
                starts: &[18.0, 24.0, 30.0],
                default: None,
                meaning: "pressure of the charged accumulator",
            },
            Parameter {
                name: "draw",
                unit: &RATIO,
                range: (0.0, 3.0),
                starts: &[0.2],
                default: None,
                meaning: "fall of the supply over the rise of the pressure",
            },
            Parameter {
                name: "recovery",
                unit: &TIME,
                range: (0.05, 60.0),
                starts: &[0.5, 3.0],
                default: None,
                meaning: "time constant of charging",
            },
        ];
        &PARAMETERS
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        0.3 * theta[2]
    }
    fn nested(&self) -> Option<Nested> {
        Some(Nested { id: "supply_saturation", same: |plain| vec![plain[0], 0.0, 1.0] })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::dynamic(Accumulator {
            limit: theta[0],
            draw: theta[1],
            ratio: context.dt_s / theta[2],
            left: context.arrival.left(),
            held: matches!(context.arrival, Arrival::Held { .. }),
            supply: theta[0],
            output: 0.0,
        })
    }
}

/// Input that changes by more than this within a step is taken in parts [bar].
const RESOLUTION_BAR: f64 = 0.05;

struct Accumulator {
    limit: f64,
    draw: f64,
    /// Step over time constant.
    ratio: f64,
    left: f64,
    held: bool,
    supply: f64,
    output: f64,
}

impl Accumulator {
    /// The pressure goes at once to what is asked for, as far as the supply lets it, which it draws on.
    fn go(&mut self, asked: f64) {
        if asked > self.output {
            let both = (self.supply + self.draw * self.output) / (1.0 + self.draw);
            let reached = asked.min(both.max(self.output.min(self.supply)));
            self.supply -= self.draw * (reached - self.output).max(0.0);
            self.output = reached;
        } else {
            self.output = asked;
        }
    }

    /// What is asked for stands for a time of `q` recoveries; returns the mean of the pressure.
    fn stand(&mut self, asked: f64, q: f64) -> f64 {
        if q <= 0.0 {
            return self.output;
        }
        if asked <= self.output {
            self.supply = self.limit + (self.supply - self.limit) * (-q).exp();
            return self.output;
        }
        // The pressure rises with the supply, which it slows down.
        let slow = 1.0 + self.draw;
        let before = self.output;
        let reaches = if asked < self.limit { -slow * ((self.limit - asked) / (self.limit - before)).ln() } else { f64::INFINITY };
        let time = q.min(reaches.max(0.0));
        let left = (-time / slow).exp();
        self.output = if time < q { asked } else { self.limit + (before - self.limit) * left };
        let on_the_way = self.limit * time + (before - self.limit) * slow * (1.0 - left);
        self.supply = self.limit + (self.output - self.limit) * (-(q - time)).exp();
        (on_the_way + (q - time) * self.output) / q
    }
}

impl Dynamic for Accumulator {
    fn start(&mut self, _: &Point, input: f64) {
        self.supply = self.limit;
        self.output = input.min(self.limit);
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        if input.jump == 0.0 && from == input.to && self.output == from && self.supply == self.limit {
            return input;
        }
        let (mut mean, mut jump, mut last, mut passed) = (0.0, 0.0, from, 0.0);
        input.pieces(from, self.left, RESOLUTION_BAR, |share, a, b| {
            if self.held && passed >= 1.0 - self.left - 1e-12 && last != a {
                let before = self.output;
                self.go(a);
                jump = self.output - before;
            }
            let middle = 0.5 * (a + b);
            self.go(middle);
            mean += share * self.stand(middle, share * self.ratio);
            self.go(b);
            (last, passed) = (b, passed + share);
        });
        if last != input.to {
            // It comes at the sample itself.
            let before = self.output;
            self.go(input.to);
            jump = self.output - before;
        }
        Step { to: self.output, mean, jump }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_rise_is_clipped_and_recovers() {
        let mut supply = Accumulator { limit: 25.0, draw: 0.3, ratio: 0.01, left: 1.0, held: true, supply: 25.0, output: 0.0 };
        let arrival = Arrival::Held { left: 1.0 };
        let mut to = |from: f64, to: f64| supply.step(&Point::current(0.0), from, Step::arriving(from, to, arrival)).to;
        assert_eq!(to(0.0, 18.0), 18.0);
        assert_eq!(to(18.0, 2.0), 2.0);
        // 25 - 0.3 * 18 = 19.6, a little recharged, less 0.3 of the second rise.
        let clipped = to(2.0, 22.0);
        assert!((clipped - (19.7 + 0.6) / 1.3).abs() < 0.1, "{clipped}");
        let recovered = (0..1000).map(|_| to(22.0, 22.0)).fold(0.0, |_, p| p);
        assert_eq!(recovered, 22.0);
    }
}
