//! # Sensor outliers
//!
//! What it is: single readings that are far off: a loose contact, a disturbed message.
//!
//! Model: with the probability `share` a reading is off by a normal deviate of the standard deviation `size`; without
//! a seed the mean course.
//!
//! Signature: isolated readings many times the noise away from both neighbours, at times of their own. Judged by
//! likelihood, since no simulation can follow it.
//!
//! What to check on the bench: connector, shield, ground of the sensor.
//!
//! Source: Huber, Robust Statistics, Wiley 1981, section 1.2 (contaminated normal distribution).

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::effect::{Block, Context, Effect, Kind, Parameter, Stage, Theta};
use super::transport_delay::Through;
use crate::units::{PRESSURE, RATIO};

/// The effect `sensor_outliers`.
pub struct SensorOutliers;

impl Effect for SensorOutliers {
    fn id(&self) -> &'static str {
        "sensor_outliers"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_outliers.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "share",
                unit: &RATIO,
                range: (0.0, 0.5),
                starts: &[0.01],
                default: None,
                meaning: "share of the readings that are off",
            },
            Parameter {
                name: "size",
                unit: &PRESSURE,
                range: (0.0, 100.0),
                starts: &[1.0],
                default: None,
                meaning: "standard deviation of those readings",
            },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        match context.seed {
            None => Box::new(Through),
            Some(seed) => Box::new(Spikes { share: theta[0], size: theta[1], random: Pcg64::seed_from_u64(seed ^ 0x6f75_746c) }),
        }
    }
}

struct Spikes {
    share: f64,
    size: f64,
    random: Pcg64,
}

impl Block for Spikes {
    fn start(&mut self, _: f64, _: f64) {}
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let off: f64 = StandardNormal.sample(&mut self.random);
        if self.random.random::<f64>() < self.share { input + self.size * off } else { input }
    }
}
