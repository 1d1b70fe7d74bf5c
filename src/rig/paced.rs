//! A rig without a clock, held to real time: for somebody who watches it.

use std::time::{Duration, Instant};

use super::{Rig, RigError, RigIdentity, SafeState, Sample};

/// A step that comes later than this comes after a pause.
const PAUSE: Duration = Duration::from_millis(200);

/// Gives each sample at the time that it is of, and not before.
pub struct Paced<'a> {
    rig: &'a mut dyn Rig,
    start: Instant,
}

impl<'a> Paced<'a> {
    /// Holds `rig` to the clock from now on.
    pub fn new(rig: &'a mut dyn Rig) -> Self {
        Self { rig, start: Instant::now() }
    }
}

impl Rig for Paced<'_> {
    fn identity(&self) -> RigIdentity {
        self.rig.identity()
    }

    fn step(&mut self, command_a: f64, until_s: f64) -> Result<Sample, RigError> {
        let (due, now) = (self.start + Duration::from_secs_f64(until_s.max(0.0)), Instant::now());
        // After a pause, in which a person was asked, the clock goes on from where it stood.
        self.start += now.saturating_duration_since(due + PAUSE);
        std::thread::sleep(due.saturating_duration_since(now));
        self.rig.step(command_a, until_s)
    }

    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        self.rig.make_safe()
    }
}
