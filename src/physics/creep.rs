//! # Creep
//!
//! What it is: after a change the pressure goes on moving in the same direction for seconds or minutes.
//!
//! Model: P = P0 - gain (P0 - mean of three lags of P0), the lags at tau/spread, tau and tau spread: a spread of 1 is
//! one exponential, a large one the logarithmic creep of friction and seals.
//!
//! Signature: after a step an error that dies out like log t, in the direction of the step; none over fast cycles.
//!
//! What to check on the bench: a dwell of 30 s after a large step in both directions.
//!
//! Source: Krejci and Kuhnen, IEE Proc. Control Theory Appl. 148 (2001) 185 (creep operator, spectrum of lags).

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::linear::FirstOrder;
use super::signal::{Point, Step};
use crate::units::{RATIO, TIME};

/// The effect `creep`.
pub struct Creep;

impl Effect for Creep {
    fn id(&self) -> &'static str {
        "creep"
    }
    fn source_text(&self) -> &'static str {
        include_str!("creep.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Creep
    }
    fn memory_s(&self, theta: Theta<'_>) -> f64 {
        theta[1]
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "gain",
                unit: &RATIO,
                range: (0.0, 0.5),
                starts: &[0.05],
                default: None,
                meaning: "share of a change that comes late",
            },
            Parameter {
                name: "tau",
                unit: &TIME,
                range: (0.2, 200.0),
                starts: &[0.8, 3.0, 12.0],
                default: None,
                meaning: "middle time constant",
            },
            Parameter {
                name: "spread",
                unit: &RATIO,
                range: (1.0, 12.0),
                starts: &[1.5],
                default: Some(1.0),
                meaning: "ratio between neighbouring time constants",
            },
        ];
        &PARAMETERS
    }
    fn is_linear(&self, _: Theta<'_>) -> bool {
        true
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        theta[1] / theta[2]
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let lag = |tau_s: f64| FirstOrder::new(tau_s, context.dt_s, context.arrival);
        Block::dynamic(Late { gain: theta[0], lags: [lag(theta[1] / theta[2]), lag(theta[1]), lag(theta[1] * theta[2])] })
    }
}

struct Late {
    gain: f64,
    lags: [FirstOrder; 3],
}

impl Dynamic for Late {
    fn start(&mut self, _: &Point, input: f64) {
        for lag in &mut self.lags {
            lag.settle(input);
        }
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let [a, b, c] = &mut self.lags;
        let (a, b, c) = (a.advance(from, input), b.advance(from, input), c.advance(from, input));
        let late = |now: f64, lags: f64| now - self.gain * (now - lags * (1.0 / 3.0));
        Step { to: late(input.to, a.0 + b.0 + c.0), mean: late(input.mean, a.1 + b.1 + c.1), jump: (1.0 - self.gain) * input.jump }
    }
}
