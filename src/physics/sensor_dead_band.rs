//! # Sensor dead band
//!
//! What it is: play in the pressure sensor or its linkage, or an amplifier that passes a change only when it is large enough:
//! the reading stays until the pressure has crossed the band.
//!
//! Model: the play operator of width w on the pressure, y = clamp(y, P - w/2, P + w/2), at the end of the signal's way.
//!
//! Signature: after each reversal of the pressure the reading rests for the same change of pressure, alike at every pressure;
//! a dead band of the valve rests for the same change of current, which is less pressure where the curve is flat.
//!
//! What to check on the bench: the reading against a second sensor on small triangles at several pressures.
//!
//! Source: IEC 61298-2 (dead band); play operator, Brokate and Sprekels, Hysteresis and Phase Transitions, Springer 1996,
//! section 2.3.

use super::block::{Block, Dynamic, Pointwise};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::reversal_dead_band::Play;
use super::signal::{Point, Step};
use crate::units::PRESSURE;

/// The effect `sensor_dead_band`.
pub struct SensorDeadBand;

impl Effect for SensorDeadBand {
    fn id(&self) -> &'static str {
        "sensor_dead_band"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_dead_band.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn searched(&self) -> bool {
        false
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "width",
            unit: &PRESSURE,
            range: (0.01, 6.0),
            starts: &[0.2, 0.8],
            default: None,
            meaning: "change of the pressure that the reading does not show after a reversal",
        }];
        &PARAMETERS
    }
    fn shortest_s(&self, _: Theta<'_>) -> f64 {
        // What the pressure reaches between two samples moves the reading.
        0.003
    }
    fn block(&self, theta: Theta<'_>, _: &Context) -> Block {
        Block::dynamic(Linkage { play: Play { radius: 0.5 * theta[0], position: 0.0 } })
    }
}

struct Linkage {
    play: Play,
}

impl Dynamic for Linkage {
    fn start(&mut self, at: &Point, input: f64) {
        self.play.start(at, input);
    }
    #[inline]
    fn step(&mut self, at: &Point, _: f64, input: Step) -> Step {
        let before = self.play.position;
        let to = self.play.step(at, input.to);
        Step { to, mean: 0.5 * (before + to), jump: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reading_rests_for_the_width_after_a_turn() {
        let mut play = Play { radius: 0.25, position: 0.0 };
        play.start(&Point::current(0.0), 10.0);
        let read = [10.2, 11.0, 10.8, 10.5, 10.0].map(|p| play.step(&Point::current(0.0), p));
        assert_eq!(read, [10.0, 10.75, 10.75, 10.75, 10.25]);
    }
}
