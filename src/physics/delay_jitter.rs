//! # Delay jitter
//!
//! What it is: the dead time of each command varies by chance, for instance with the load of a bus.
//!
//! Model: d(t) = d0 + spread * |n(t)| with n a standard normal held for one message; without a seed the mean course.
//!
//! Signature: the scatter of the error grows with |dP/dt| and is as small as the sensor noise in holds; the mean
//! error stays small. Judged by likelihood, since no simulation can follow it.
//!
//! What to check on the bench: time stamps of the messages on the bus, task priorities of the controller.
//!
//! Source: Nilsson, Real-Time Control Systems with Delays, Lund 1998, chapter 3.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::effect::{Block, Context, Effect, Kind, Parameter, Stage, Theta};
use super::transport_delay::Through;
use crate::units::TIME;

/// The effect `delay_jitter`.
pub struct DelayJitter;

impl Effect for DelayJitter {
    fn id(&self) -> &'static str {
        "delay_jitter"
    }
    fn source_text(&self) -> &'static str {
        include_str!("delay_jitter.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Delay
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "spread",
            unit: &TIME,
            range: (0.0, 0.2),
            starts: &[0.01],
            default: None,
            meaning: "standard deviation of the dead time",
        }];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        match context.seed {
            None => Box::new(Through),
            Some(seed) => Box::new(Jitter {
                spread_steps: theta[0] / context.dt_s,
                random: Pcg64::seed_from_u64(seed ^ 0x6a69_7474),
                past: vec![0.0; (8.0 * theta[0] / context.dt_s).ceil() as usize + 2],
            }),
        }
    }
}

struct Jitter {
    spread_steps: f64,
    random: Pcg64,
    past: Vec<f64>,
}

impl Block for Jitter {
    fn start(&mut self, _: f64, input: f64) {
        self.past.fill(input);
    }
    fn step(&mut self, _: f64, input: f64) -> f64 {
        self.past.rotate_right(1);
        self.past[0] = input;
        let normal: f64 = StandardNormal.sample(&mut self.random);
        let steps = (self.spread_steps * normal.abs()).min((self.past.len() - 2) as f64);
        let (whole, part) = (steps.floor() as usize, steps - steps.floor());
        self.past[whole] + part * (self.past[whole + 1] - self.past[whole])
    }
}
