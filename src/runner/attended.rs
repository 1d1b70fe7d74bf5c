//! A run that somebody watches, and whose questions somebody answers.

use std::sync::Arc;

use super::attendant::Attendant;
use super::observer::{Observer, Progress};
use crate::plan::Phase;

/// Somebody who watches, and somebody who answers.
pub struct Attended<O> {
    /// Who watches.
    pub observer: O,
    /// Who answers.
    pub attendant: Option<Arc<dyn Attendant>>,
}

impl<O: Observer> Observer for Attended<O> {
    fn phase(&mut self, index: usize, phase: &Phase) {
        self.observer.phase(index, phase);
    }

    fn sample(&mut self, progress: &Progress<'_>) {
        self.observer.sample(progress);
    }

    fn attendant(&self) -> Option<&dyn Attendant> {
        self.attendant.as_deref()
    }
}
