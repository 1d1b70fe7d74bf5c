//! Who sits with a run: the way to stop it, its samples, and what is said to those who wait.

use std::sync::Arc;

use super::answers::Answers;
use crate::batch::campaign::Job;
use crate::rig::loop_thread::LoopControl;
use crate::runner::{Attendant, Feed};

/// What joins one attempt with those who watch it.
pub struct Seat<'a> {
    /// The way to stop it, shared with the loop.
    pub control: Arc<LoopControl>,
    /// Its samples, where anybody looks; pushed by the loop, which never waits.
    pub feed: Option<Feed>,
    /// Looks at the samples; called some fifty times a second, and never by the thread of a real loop.
    pub look: Box<dyn FnMut() + 'a>,
    /// The attempt waits for the supply that several sites share.
    pub waits: Box<dyn FnMut() + 'a>,
    /// The attempt begins.
    pub begins: Box<dyn FnMut() + 'a>,
    /// Whether a simulation goes by the clock, so that somebody can watch it.
    pub paced: bool,
    /// Who answers the questions of the plan.
    pub attendant: Option<Arc<dyn Attendant>>,
}

impl Seat<'_> {
    /// Nobody is there.
    pub fn empty() -> Self {
        Self {
            control: Arc::new(LoopControl::default()),
            feed: None,
            look: Box::new(|| ()),
            waits: Box::new(|| ()),
            begins: Box::new(|| ()),
            paced: false,
            attendant: None,
        }
    }
}

/// Who sits at the sites of a bench.
pub trait Company: Sync {
    /// Takes the seat at a site for one attempt.
    fn seat(&self, site: usize, job: &Job) -> Seat<'_>;

    /// Who tests at a site, where it is not the same person all along.
    fn operator(&self, _site: usize) -> Option<String> {
        None
    }
}

/// Nobody but whoever answers the plan: a batch that a list or a prompt feeds.
pub struct Alone(pub Answers);

impl Company for Alone {
    fn seat(&self, _site: usize, _job: &Job) -> Seat<'_> {
        Seat { attendant: self.0.attendant(), ..Seat::empty() }
    }
}
