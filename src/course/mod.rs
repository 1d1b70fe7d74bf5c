//! A recording made ready to be compared with a model, once for every command.
//!
//! A [`Course`] holds runs on even time grids of their own, the noise of the readings, and what was noticed on the way.
//! Identification, simulation, diagnosis and their pages look at a recording through it alone, so that all of them speak
//! of the same samples. The rules, each in one place: what a gap is (`split`), which grid (`grid`), how large the noise is
//! (`noise`), what carries nothing (`refuse`). docs/recordings.md tells them to users.

mod error;
mod grid;
mod noise;
mod prepare;
mod prepared;
mod refuse;
mod run;
mod split;

pub use crate::recording::Selection;
pub use error::CourseError;
pub use noise::Noise;
pub use prepared::{Course, Preparation};
pub use run::{Origin, Run};

use crate::recording::Recording;
pub use crate::valve::Input;

impl Course {
    /// Makes a recording ready.
    ///
    /// Nothing is refused here that a simulation can use; what a comparison needs is asked for by [`Course::carries`].
    ///
    /// # Errors
    /// [`CourseError`] where the command is never recorded, or the selection leaves nothing.
    pub fn of(recording: &Recording, preparation: &Preparation) -> Result<Self, CourseError> {
        prepare::course(recording.clone(), preparation)
    }

    /// As [`Course::of`], for a recording that nobody needs any more: its samples are moved, not copied.
    ///
    /// # Errors
    /// As [`Course::of`].
    pub fn take(recording: Recording, preparation: &Preparation) -> Result<Self, CourseError> {
        prepare::course(recording, preparation)
    }

    /// Refuses what no model can be compared with: no pressure, nothing in common, a current or a pressure that stands
    /// still, fewer than `fewest` readings.
    ///
    /// # Errors
    /// [`CourseError`] with the first of these that holds.
    pub fn carries(&self, fewest: usize) -> Result<(), CourseError> {
        refuse::carries(self, fewest)
    }
}

#[cfg(test)]
mod tests;
