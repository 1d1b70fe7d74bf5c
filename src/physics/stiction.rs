//! # Stiction
//!
//! What it is: the spool sticks until the force exceeds the static friction, then jumps.
//!
//! Model: the spool x rests while |i - x| <= band; there it breaks away and slips on until |i - x| = slip * band, what the
//! friction of motion holds. It sticks at once, or slides on with that offset for as long as the current, felt over 30 ms,
//! moves on faster than `speed`; slower, or turning round, it sticks again. A high `speed` is the stick-slip staircase of
//! He et al., a low one the sliding of Choudhury et al.
//!
//! Signature: the pressure rests while the current creeps, then jumps by the slope times band (1 - slip); the error is
//! a sawtooth. Where no simulation keeps step with it, it is told by these rests and jumps alone.
//!
//! What to check on the bench: a micro-ramp of some 20 mA at high resolution; dither amplitude, contamination.
//!
//! In a control loop: dead band and stick band are S = band (1 + slip), the slip jump is J = band (1 - slip), in the unit of the
//! controller's output. Output and pressure go round: the one travels while the other rests, then that jumps. What to check:
//! the controller in manual; a loop that then stands still is one whose valve sticks. Packing, actuator, positioner.
//!
//! Source: He, Wang, Pottmann and Qin, Ind. Eng. Chem. Res. 46 (2007) 4549; Choudhury, Thornhill and Shah, Control
//! Eng. Practice 13 (2005) 641.

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Hint, Parameter, Scatter, ScatterFinding, Stage, Theta};
use super::signal::{Arrival, Point};
use super::staircase::staircase;
use super::stick_slip::{stick_slip, stick_slip_elsewhere};
use crate::units::{CURRENT, CURRENT_RATE, RATIO};

/// The effect `stiction`.
pub struct Stiction;

impl Effect for Stiction {
    fn id(&self) -> &'static str {
        "stiction"
    }
    fn source_text(&self) -> &'static str {
        include_str!("stiction.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Spool
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "band",
                unit: &CURRENT,
                range: (0.0005, 0.3),
                starts: &[0.005, 0.012, 0.025, 0.045],
                default: None,
                meaning: "current that breaks the spool away from rest",
            },
            Parameter {
                name: "slip",
                unit: &RATIO,
                range: (0.0, 0.95),
                starts: &[0.1, 0.4, 0.7],
                default: Some(0.0),
                meaning: "share of the band that is left after a slip",
            },
            Parameter {
                name: "speed",
                unit: &CURRENT_RATE,
                range: (0.001, 100.0),
                starts: &[0.003, 0.03, 20.0],
                default: Some(100.0),
                meaning: "speed below which it sticks again",
            },
        ];
        &PARAMETERS
    }
    /// The period of the staircase over the current is the band less what is left of it.
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        let left = [0.03, 0.15, 0.3, 0.45, 0.6];
        staircase(hint).into_iter().flat_map(|stair| left.map(|l| vec![stair.slip_a / (1.0 - l), l, 100.0])).collect()
    }
    /// Where the spool slips on a fast ramp is chance, and a free simulation loses step with it; the staircase stays.
    fn signature_nats(&self, hint: &Hint<'_>) -> f64 {
        staircase(hint).map_or(0.0, |stair| stair.nats)
    }
    fn scatter(&self, of: &Scatter<'_>) -> Option<ScatterFinding> {
        let (least_a, most_a) = self.parameters()[0].range;
        stick_slip(of).filter(|found| (least_a..most_a).contains(&found.theta[0]))
    }
    fn scatter_nats(&self, found: &ScatterFinding, of: &Scatter<'_>) -> Option<f64> {
        Some(stick_slip_elsewhere(found, of))
    }
    fn stick_slip(&self, (resting, moving): (f64, f64)) -> Option<Vec<f64>> {
        let [_, slip, speed] = self.parameters() else { return None };
        Some(vec![resting, (moving / resting).clamp(slip.range.0, slip.range.1), speed.default?])
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let ratio = context.dt_s / FELT_S;
        Block::pointwise(Stick {
            band: theta[0],
            offset: theta[1] * theta[0],
            speed: theta[2],
            held: matches!(context.arrival, Arrival::Held { .. }),
            decay: (-ratio).exp(),
            per_travel: if matches!(context.arrival, Arrival::Held { .. }) { 1.0 / FELT_S } else { -(-ratio).exp_m1() / context.dt_s },
            position: 0.0,
            sliding: 0.0,
            pace: 0.0,
            last: 0.0,
        })
    }
}

/// Time over which the speed of the current is felt: what the spool's mass and its film of oil smooth [s].
pub(super) const FELT_S: f64 = 0.03;

struct Stick {
    band: f64,
    offset: f64,
    /// Slowest pace of sliding [A/s].
    speed: f64,
    held: bool,
    /// What is left of the pace after a step, and what a travel adds to it [1/s].
    decay: f64,
    per_travel: f64,
    position: f64,
    /// Direction of sliding; 0 at rest.
    sliding: f64,
    /// Smoothed pace of the current [A/s].
    pace: f64,
    last: f64,
}

impl Stick {
    fn rest_when_slow(&mut self) {
        if self.pace * self.sliding < self.speed {
            self.sliding = 0.0;
        }
    }
}

impl Pointwise for Stick {
    fn start(&mut self, _: &Point, input: f64) {
        (self.position, self.last, self.sliding, self.pace) = (input, input, 0.0, 0.0);
    }
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        let travel = input - self.last;
        self.last = input;
        self.pace *= self.decay;
        if self.held {
            // It has slowed down all the time until the command came.
            self.rest_when_slow();
        }
        self.pace += travel * self.per_travel;
        if travel * self.sliding < 0.0 {
            self.sliding = 0.0;
        }
        if self.sliding == 0.0 {
            let away = input - self.position;
            let beyond = away.abs() - self.band;
            if beyond <= 0.0 {
                return self.position;
            }
            let direction = away.signum();
            if self.pace * direction < self.speed {
                // However fast the current has come here, it passed every place at which the spool breaks away.
                let slip = self.band - self.offset;
                self.position += direction * slip * ((beyond / slip).floor() + 1.0);
                return self.position;
            }
            self.sliding = direction;
        }
        let target = input - self.sliding * self.offset;
        if (target - self.position) * self.sliding > 0.0 {
            self.position = target;
        }
        if !self.held {
            self.rest_when_slow();
        }
        self.position
    }
}
