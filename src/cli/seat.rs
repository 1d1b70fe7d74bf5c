//! Who sits with a run: the way to stop it, its samples, and what is said to those who wait.

use std::sync::Arc;

use super::answers::Answers;
use crate::batch::campaign::Job;
use crate::rig::loop_thread::LoopControl;
use crate::runner::{Attendant, Feed, Observer, Progress};

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

/// The samples of a simulation, which has no thread of its own to spare: fed and looked at in turn.
pub struct InTurn<'s, 'a>(pub &'s mut Seat<'a>);

impl Observer for InTurn<'_, '_> {
    fn phase(&mut self, index: usize, phase: &crate::plan::Phase) {
        if let Some(feed) = &mut self.0.feed {
            feed.phase(index, phase);
        }
    }

    fn sample(&mut self, progress: &Progress<'_>) {
        if let Some(feed) = &mut self.0.feed {
            feed.sample(progress);
            (self.0.look)();
        }
    }

    fn attendant(&self) -> Option<&dyn Attendant> {
        self.0.attendant.as_deref()
    }
}
