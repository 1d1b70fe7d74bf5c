//! # Lost messages
//!
//! What it is: commands that do not arrive, so that the driver holds the last one for a message or more.
//!
//! Model: each message is lost with the chance `share`; the driver then holds what it has. Without a seed the mean course.
//!
//! Signature: single flat spots of one message in steep movements, the pressure then catches up at once; holds are untouched.
//!
//! What to check on the bench: counters and error frames of the bus, priority and timing of the sender.
//!
//! Source: Nilsson, Real-Time Control Systems with Delays, Lund 1998, chapter 3 (vacant and lost samples).

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::block::{Block, Pointwise, Through};
use super::effect::{Context, Effect, Kind, Parameter, Stage, Theta};
use super::signal::Point;
use crate::units::RATIO;

/// The effect `lost_messages`.
pub struct LostMessages;

impl Effect for LostMessages {
    fn id(&self) -> &'static str {
        "lost_messages"
    }
    fn source_text(&self) -> &'static str {
        include_str!("lost_messages.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Delay
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "share",
            unit: &RATIO,
            range: (0.0, 0.9),
            starts: &[0.05],
            default: None,
            meaning: "share of the messages that do not arrive",
        }];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        match context.seed {
            None => Block::pointwise(Through),
            Some(seed) => Block::pointwise(Held { share: theta[0], last: 0.0, random: Pcg64::seed_from_u64(seed ^ 0x6c6f_7374) }),
        }
    }
}

struct Held {
    share: f64,
    last: f64,
    random: Pcg64,
}

impl Pointwise for Held {
    fn start(&mut self, _: &Point, input: f64) {
        self.last = input;
    }
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        if self.random.random::<f64>() >= self.share {
            self.last = input;
        }
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_messages_are_lost_and_none_comes_twice() {
        let mut held = Held { share: 0.2, last: 0.0, random: Pcg64::seed_from_u64(3) };
        let passed: Vec<f64> = (1..=5000).map(|k| held.step(&Point::current(0.0), f64::from(k))).collect();
        let lost = passed.windows(2).filter(|w| w[0] == w[1]).count();
        assert!((850..1150).contains(&lost), "{lost}");
        assert!(passed.windows(2).all(|w| w[1] >= w[0]) && passed.iter().zip(1..).all(|(p, k)| *p <= f64::from(k)));
    }
}
