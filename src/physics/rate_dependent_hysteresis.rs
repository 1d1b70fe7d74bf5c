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

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use super::linear::FirstOrder;
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
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Widening {
            width: theta[0],
            power: Power::new(theta[1]),
            slow: REST_A_S.powf(theta[1] - 1.0),
            per_length: 1.0 / theta[2].max(1e-6),
            at_once: theta[2] < 1e-5,
            per_step: 1.0 / context.dt_s,
            rate: FirstOrder::new(theta[3], context.dt_s),
            last: 0.0,
            lost: 0.0,
        })
    }
}

/// Below this rate the current rests, and the widening is in proportion to it [A/s].
const REST_A_S: f64 = 1e-3;

struct Widening {
    width: f64,
    power: Power,
    slow: f64,
    per_length: f64,
    at_once: bool,
    per_step: f64,
    rate: FirstOrder,
    last: f64,
    lost: f64,
}

impl Block for Widening {
    fn start(&mut self, current_a: f64, _: f64) {
        (self.last, self.lost) = (current_a, 0.0);
        self.rate.start(0.0);
    }
    #[inline]
    fn step(&mut self, current_a: f64, input: f64) -> f64 {
        let travel = current_a - self.last;
        let rate = self.rate.step(travel * self.per_step);
        self.last = current_a;
        let size = rate.abs();
        let level = self.width * if size < REST_A_S { size * self.slow } else { self.power.of(size) };
        if self.at_once {
            self.lost = level.copysign(rate);
        } else if travel != 0.0 {
            let goal = level.copysign(travel);
            self.lost = goal + (self.lost - goal) * (-travel.abs() * self.per_length).exp();
        }
        input - self.lost
    }
}
