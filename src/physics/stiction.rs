//! # Stiction
//!
//! What it is: the spool sticks until the force exceeds the static friction, then jumps.
//!
//! Model: the spool x rests while |i - x| <= band; then it breaks away to x = i -/+ slip * band and slides on with that
//! offset for as long as it moves faster than `speed`; slower, or turning round, it sticks again. A high `speed` is
//! the stick-slip staircase of He et al., a low one the sliding of Choudhury et al.
//!
//! Signature: the pressure rests while the current creeps, then jumps by the slope times band (1 - slip); the error is
//! a sawtooth.
//!
//! What to check on the bench: a micro-ramp of some 20 mA at high resolution; dither amplitude, contamination.
//!
//! Source: He, Wang, Pottmann and Qin, Ind. Eng. Chem. Res. 46 (2007) 4549; Choudhury, Thornhill and Shah, Control
//! Eng. Practice 13 (2005) 641.

use super::effect::{Block, Context, Effect, Hint, Parameter, Stage, Theta};
use super::staircase::staircase;
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
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Stick {
            band: theta[0],
            offset: theta[1] * theta[0],
            speed: theta[2] * context.dt_s,
            position: 0.0,
            sliding: 0.0,
            pace: 0.0,
        })
    }
}

/// Share of the newest sample in the smoothed pace.
const PACE: f64 = 0.3;

struct Stick {
    band: f64,
    offset: f64,
    /// Slowest pace of sliding [A per sample].
    speed: f64,
    position: f64,
    /// Direction of sliding; 0 at rest.
    sliding: f64,
    /// Smoothed pace in that direction [A per sample].
    pace: f64,
}

impl Block for Stick {
    fn start(&mut self, _: f64, input: f64) {
        (self.position, self.sliding, self.pace) = (input, 0.0, 0.0);
    }
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        if self.sliding == 0.0 {
            let away = input - self.position;
            if away.abs() <= self.band {
                return self.position;
            }
            self.sliding = away.signum();
            self.position = input - self.sliding * self.offset;
            // The jump itself does not count as motion: a staircase sticks at once.
            self.pace = 1.5 * self.speed;
            return self.position;
        }
        let target = input - self.sliding * self.offset;
        let moved = (target - self.position) * self.sliding;
        self.pace += PACE * (moved - self.pace);
        if moved > 0.0 {
            self.position = target;
        }
        if self.pace < self.speed {
            self.sliding = 0.0;
        }
        self.position
    }
}
