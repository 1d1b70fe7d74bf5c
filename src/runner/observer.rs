//! Who watches a run: a progress bar, a live view, a journal. Nothing here can change the run, but for the answers of whoever the plan
//! asks.

use super::Attendant;
use crate::plan::Phase;
use crate::rig::Sample;

/// Where a run stands.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// Samples so far.
    pub sample: usize,
    /// Planned samples.
    pub samples: usize,
    /// Present phase.
    pub phase: &'a str,
    /// Target pressure [bar]; NaN in open loop.
    pub target_bar: f64,
    /// Commanded current [A].
    pub current_a: f64,
    /// What the rig gave.
    pub measured: &'a Sample,
}

/// A watcher; every method does nothing unless it is given.
pub trait Observer {
    /// A phase begins.
    fn phase(&mut self, _index: usize, _phase: &Phase) {}
    /// A sample was taken.
    fn sample(&mut self, _progress: &Progress<'_>) {}
    /// Who answers the questions of the plan; a run whose plan asks ends as ERROR without.
    fn attendant(&self) -> Option<&dyn Attendant> {
        None
    }
}

impl Observer for () {}
