//! A healthy valve of the finer plant on a bench: for a controller that believes in a model identified from its sweep.

use super::draw::placed;
use super::plant::Plant;
use super::session::record_session;
use crate::recording::Run;

/// Number of this recording of the valve: its noise is that of no other.
const RUN: u64 = 7;
/// Period of commands and samples [s].
const PERIOD_S: f64 = 0.01;

/// A valve to be controlled, sampled at 100 Hz.
pub struct Bench {
    plant: Plant,
    /// What the sensor and the chamber showed as the next command comes [bar].
    next: (f64, f64),
}

impl Bench {
    /// The healthy valve of `seed`, at rest without current.
    pub fn new(seed: u64) -> Self {
        let case = placed(seed, Vec::new());
        let mut plant = Plant::new(&case.specimen(), &[], seed, RUN, 0.0, PERIOD_S);
        let measured = plant.period(0.0);
        let next = (measured, plant.true_bar());
        Self { plant, next }
    }

    /// The sweep of this valve, to identify it from.
    pub fn sweep(seed: u64) -> Run {
        record_session(&placed(seed, Vec::new())).0.sweep
    }

    /// Measured and true pressure as the command comes, which is then held for one period [bar].
    pub fn step(&mut self, command_a: f64) -> (f64, f64) {
        let now = self.next;
        let measured = self.plant.period(command_a);
        self.next = (measured, self.plant.true_bar());
        now
    }
}
