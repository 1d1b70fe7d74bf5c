//! The rig behind a guard that makes it safe on every way out, a panic included.

use crate::rig::{Rig, RigError, SafeState, Sample};

/// Holds the rig while a plan runs.
pub struct Guard<'a> {
    rig: &'a mut dyn Rig,
    safe: bool,
}

impl<'a> Guard<'a> {
    /// Takes the rig over.
    pub fn new(rig: &'a mut dyn Rig) -> Self {
        Self { rig, safe: false }
    }

    /// One slot.
    pub fn step(&mut self, command_a: f64, until_s: f64) -> Result<Sample, RigError> {
        self.rig.step(command_a, until_s)
    }

    /// Makes the rig safe and reads that back; what was seen.
    pub fn make_safe(&mut self) -> SafeState {
        self.safe = true;
        self.rig.make_safe().unwrap_or_else(|error| SafeState::of(false, error.to_string()))
    }
}

impl Drop for Guard<'_> {
    fn drop(&mut self) {
        if !self.safe {
            // Only a panic gets here; its message is the one to show, so the result of this attempt is let go.
            let _ = self.rig.make_safe();
        }
    }
}
