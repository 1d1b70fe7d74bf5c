//! # Periodic disturbance
//!
//! What it is: a tone in the pressure that the current does not make: pump ripple, the alias of a PWM or of dither.
//!
//! Model: P = P0 + sine sin(2 pi f t) + cosine cos(2 pi f t), t the time of the recording.
//!
//! Signature: one narrow line in the spectrum of the error, the same in holds and in ramps.
//!
//! What to check on the bench: change the pump speed, the PWM frequency or the log rate and see whether the line moves.
//!
//! Source: Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., section 4.2 (aliasing).

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{FREQUENCY, PRESSURE};

/// The effect `periodic_disturbance`.
pub struct PeriodicDisturbance;

impl Effect for PeriodicDisturbance {
    fn id(&self) -> &'static str {
        "periodic_disturbance"
    }
    fn source_text(&self) -> &'static str {
        include_str!("periodic_disturbance.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "frequency",
                unit: &FREQUENCY,
                range: (0.05, 500.0),
                starts: &[5.0],
                default: None,
                meaning: "frequency of the tone",
            },
            Parameter {
                name: "sine",
                unit: &PRESSURE,
                range: (-10.0, 10.0),
                starts: &[0.05],
                default: Some(0.0),
                meaning: "amplitude of its sine",
            },
            Parameter {
                name: "cosine",
                unit: &PRESSURE,
                range: (-10.0, 10.0),
                starts: &[0.05],
                default: Some(0.0),
                meaning: "amplitude of its cosine",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        let w = std::f64::consts::TAU * theta[0];
        let turn = w * context.dt_s;
        let phase = w * context.start_s;
        Box::new(Tone { sine: theta[1], cosine: theta[2], turn: (turn.sin(), turn.cos()), now: (phase.sin(), phase.cos()) })
    }
}

struct Tone {
    sine: f64,
    cosine: f64,
    turn: (f64, f64),
    now: (f64, f64),
}

impl Block for Tone {
    fn start(&mut self, _: f64, _: f64) {}
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let (s, c) = self.now;
        self.now = (s * self.turn.1 + c * self.turn.0, c * self.turn.1 - s * self.turn.0);
        input + self.sine * s + self.cosine * c
    }
}
