//! # Spool friction
//!
//! What it is: friction between spool and bore that builds up over a small way (presliding), and that is larger at rest
//! than in motion (Stribeck).
//!
//! Model: i = x + f, x what the spool follows, f the friction as a current: df/dx = (s F - f) / length, s the direction of x;
//! F = level (1 + rise exp(-(v / speed)^2)), v the speed of the current felt over 30 ms.
//!
//! Signature: after each reversal the error grows over `length` and then stays at `level` either way, as a play whose flanks
//! are round; with a rise, slow movements lose more than fast ones, and break loose.
//!
//! What to check on the bench: small triangles of several rates about one current; dither, contamination, bore.
//!
//! Source: Dahl, AIAA Journal 14 (1976) 1675; Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky, Eur. J. Control 4 (1998)
//! 176 (presliding, Stribeck).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Nested, Parameter, Stage, Theta};
use super::signal::{Arrival, Point};
use super::stiction::FELT_S;
use crate::units::{CURRENT, CURRENT_RATE, RATIO};

/// The effect `spool_friction`.
pub struct SpoolFriction;

impl Effect for SpoolFriction {
    fn id(&self) -> &'static str {
        "spool_friction"
    }
    fn source_text(&self) -> &'static str {
        include_str!("spool_friction.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Spool
    }
    fn searched(&self) -> bool {
        false
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter {
                name: "level",
                unit: &CURRENT,
                range: (0.0005, 0.2),
                starts: &[0.005, 0.02],
                default: None,
                meaning: "friction in motion",
            },
            Parameter {
                name: "length",
                unit: &CURRENT,
                range: (LEAST_LENGTH_A, 0.1),
                starts: &[0.002, 0.015],
                default: None,
                meaning: "way over which it builds up",
            },
            Parameter {
                name: "rise",
                unit: &RATIO,
                range: (0.0, 3.0),
                starts: &[0.0, 0.5],
                default: Some(0.0),
                meaning: "by how much it is larger at rest",
            },
            Parameter {
                name: "speed",
                unit: &CURRENT_RATE,
                range: (0.001, 10.0),
                starts: &[0.05],
                default: Some(0.05),
                meaning: "speed of the current at which the rise is gone",
            },
        ];
        &PARAMETERS
    }
    fn nested(&self) -> Option<Nested> {
        Some(Nested { id: "reversal_dead_band", same: |plain| vec![0.5 * plain[0], LEAST_LENGTH_A, 0.0, 0.05] })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let ratio = context.dt_s / FELT_S;
        let held = matches!(context.arrival, Arrival::Held { .. });
        Block::pointwise(Friction {
            level: theta[0],
            length: theta[1],
            rise: theta[2],
            per_speed: 1.0 / theta[3],
            decay: (-ratio).exp(),
            per_travel: if held { 1.0 / FELT_S } else { -(-ratio).exp_m1() / context.dt_s },
            pace: 0.0,
            position: 0.0,
            friction: 0.0,
        })
    }
}

/// Least way over which friction builds up [A].
const LEAST_LENGTH_A: f64 = 0.0002;
/// Most iterations of Newton's method; it ends after three to six.
const ITERATIONS: usize = 40;

struct Friction {
    level: f64,
    length: f64,
    rise: f64,
    per_speed: f64,
    /// What is left of the pace after a step, and what a travel adds to it [1/s].
    decay: f64,
    per_travel: f64,
    /// Smoothed pace of the current [A/s].
    pace: f64,
    position: f64,
    friction: f64,
}

impl Friction {
    /// The way u with u + gap (1 - exp(-u / length)) = travel: the largest, for a friction that falls lets the spool jump.
    fn way(&self, gap: f64, travel: f64) -> f64 {
        let mut u = if gap > 0.0 { 0.0 } else { travel - gap };
        for _ in 0..ITERATIONS {
            let left = (-u / self.length).exp();
            let change = (u + gap * (1.0 - left) - travel) / (1.0 + gap / self.length * left);
            u -= change;
            if change.abs() < 1e-12 {
                break;
            }
        }
        u.max(0.0)
    }
}

impl Pointwise for Friction {
    fn start(&mut self, _: &Point, input: f64) {
        (self.position, self.friction, self.pace) = (input, 0.0, 0.0);
    }
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        let travel = input - self.position - self.friction;
        self.pace = self.pace * self.decay + travel * self.per_travel;
        if travel == 0.0 {
            return self.position;
        }
        let direction = travel.signum();
        let stribeck = if self.rise > 0.0 { self.rise * (-(self.pace * self.per_speed).powi(2)).exp() } else { 0.0 };
        let full = self.level * (1.0 + stribeck);
        let way = self.way(full - direction * self.friction, travel.abs());
        self.position += direction * way;
        self.friction = input - self.position;
        self.position
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn friction(level: f64, length: f64) -> Friction {
        Friction { level, length, rise: 0.0, per_speed: 1.0, decay: 0.7, per_travel: 33.0, pace: 0.0, position: 0.0, friction: 0.0 }
    }

    #[test]
    fn after_a_long_way_the_level_is_lost_and_after_a_turn_twice_the_level() {
        let at = Point::current(0.0);
        let mut spool = friction(0.01, 0.002);
        spool.start(&at, 0.3);
        assert!((spool.step(&at, 0.4) - 0.39).abs() < 1e-9);
        assert!((spool.step(&at, 0.3) - 0.31).abs() < 1e-9);
    }

    #[test]
    fn the_way_does_not_depend_on_the_steps() {
        let at = Point::current(0.0);
        let (mut once, mut often) = (friction(0.01, 0.01), friction(0.01, 0.01));
        once.start(&at, 0.3);
        often.start(&at, 0.3);
        let mut end = 0.0;
        for k in 1..=100 {
            end = often.step(&at, 0.3 + 0.02 * f64::from(k) / 100.0);
        }
        assert!((once.step(&at, 0.32) - end).abs() < 1e-9);
    }

    #[test]
    fn a_friction_that_falls_lets_the_spool_jump() {
        let at = Point::current(0.0);
        let mut spool = friction(0.01, 0.001);
        spool.start(&at, 0.3);
        (spool.position, spool.friction) = (0.3, 0.02);
        assert!((spool.step(&at, 0.321) - 0.311).abs() < 1e-6);
    }
}
