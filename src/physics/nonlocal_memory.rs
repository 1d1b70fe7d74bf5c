//! # Non-local memory
//!
//! What it is: minor loops that remember more than the last reversal, as a sum of elementary plays does.
//!
//! Model: P = P0 + weight * sum_j q_j (x_j - i), x_j the play operator of radius r 2^j, j = 0..3, on the current
//! at the curve, q_j = decay^j / sum decay^j.
//!
//! Signature: the large loop fits, the small loops are wrong; the error depends on the reversals before the last.
//!
//! What to check on the bench: nested minor loops (wiping-out and congruency).
//!
//! Source: Krejci and Kuhnen, IEE Proc. Control Theory Appl. 148 (2001) 185 (Prandtl-Ishlinskii operator).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::reversal_dead_band::Play;
use super::signal::Point;
use crate::units::{CURRENT, PRESSURE_PER_CURRENT, RATIO};

/// The effect `nonlocal_memory`.
pub struct NonlocalMemory;

/// Number of plays.
const PLAYS: usize = 4;

impl Effect for NonlocalMemory {
    fn id(&self) -> &'static str {
        "nonlocal_memory"
    }
    fn source_text(&self) -> &'static str {
        include_str!("nonlocal_memory.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Static
    }
    fn imitates_form(&self) -> bool {
        true
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "weight",
                unit: &PRESSURE_PER_CURRENT,
                range: (-60.0, 60.0),
                starts: &[5.0],
                default: None,
                meaning: "slope that the plays carry together",
            },
            Parameter {
                name: "radius",
                unit: &CURRENT,
                range: (0.001, 0.2),
                starts: &[0.006, 0.012, 0.025, 0.05, 0.1],
                default: None,
                meaning: "radius of the smallest play",
            },
            Parameter {
                name: "decay",
                unit: &RATIO,
                range: (0.02, 3.0),
                starts: &[0.5, 1.2],
                default: Some(0.5),
                meaning: "weight of each play over that of the next smaller one",
            },
        ];
        &PARAMETERS
    }
    fn amplitude(&self) -> Option<usize> {
        Some(0)
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Block {
        let share: f64 = (0..PLAYS as i32).map(|j| theta[2].powi(j)).sum();
        let plays = std::array::from_fn(|j| {
            let (scale, weight) = (f64::from(1u32 << j), theta[0] * theta[2].powi(j as i32) / share);
            (weight, Play { radius: theta[1] * scale, position: 0.0 })
        });
        Block::pointwise(Memory { plays })
    }
}

struct Memory {
    plays: [(f64, Play); PLAYS],
}

impl Pointwise for Memory {
    fn start(&mut self, at: &Point, _: f64) {
        for (_, play) in &mut self.plays {
            play.start(at, at.current_a);
        }
    }
    #[inline]
    fn step(&mut self, at: &Point, input: f64) -> f64 {
        self.plays.iter_mut().fold(input, |sum, (weight, play)| sum + *weight * (play.step(at, at.current_a) - at.current_a))
    }
}
