//! The questions of a run, asked at the page. The loop's thread touches an atomic and a lock that it never waits for; what the page
//! shows is looked up by the thread beside it.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use super::super::lock::lock;
use crate::plan::{Phase, Picture, Prompt, PromptKind};
use crate::runner::{Attendant, Reply};
use crate::station::PromptCard;

/// No question stands.
const NONE: usize = usize::MAX;

/// The questions of one run.
pub struct AtPage {
    run: u64,
    prompts: Arc<Vec<Option<Prompt>>>,
    /// Place of the phase that asks.
    stands: AtomicUsize,
    given: Mutex<Option<Reply>>,
}

impl AtPage {
    /// Nothing is asked yet. `prompts` has a place for every phase of the plan.
    pub fn new(run: u64, prompts: Arc<Vec<Option<Prompt>>>) -> Self {
        Self { run, prompts, stands: AtomicUsize::new(NONE), given: Mutex::default() }
    }

    /// Place of the phase that asks.
    pub fn stands(&self) -> Option<usize> {
        Some(self.stands.load(Ordering::Acquire)).filter(|at| *at != NONE)
    }

    fn prompt(&self) -> Option<(usize, &Prompt)> {
        let at = self.stands()?;
        Some((at, self.prompts.get(at)?.as_ref()?))
    }

    /// A question of another run, or of another phase, has another id.
    fn id(&self, at: usize) -> u64 {
        self.run * 1000 + at as u64
    }

    /// What the page shows.
    pub fn card(&self) -> Option<PromptCard> {
        let (at, prompt) = self.prompt()?;
        let (unit, options) = match &prompt.kind {
            PromptKind::Number { read_in, .. } => (Some(read_in.0.to_string()), Vec::new()),
            PromptKind::Choice { options, .. } => (None, options.clone()),
            _ => (None, Vec::new()),
        };
        Some(PromptCard {
            id: self.id(at),
            phase: at.to_string(),
            text: prompt.text.clone(),
            kind: prompt.kind.name().into(),
            allowed: prompt.kind.allowed(),
            unit,
            options,
            picture: prompt.picture.is_some(),
        })
    }

    /// The picture of the question that stands.
    pub fn picture(&self) -> Option<Picture> {
        self.prompt()?.1.picture.clone()
    }

    /// Takes an answer.
    pub fn answer(&self, id: u64, typed: &str) -> Result<(), String> {
        let (at, prompt) = self.prompt().ok_or("nothing is asked at this site")?;
        if id != self.id(at) {
            return Err("this question stands no longer".into());
        }
        let answer = prompt.kind.answer(typed)?;
        *lock(&self.given) = Some(Reply { answer, by: "page" });
        Ok(())
    }
}

impl Attendant for AtPage {
    fn ask(&self, index: usize, _phase: &Phase, _prompt: &Prompt) {
        if let Ok(mut given) = self.given.try_lock() {
            *given = None;
        }
        self.stands.store(index, Ordering::Release);
    }

    fn reply(&self) -> Option<Reply> {
        self.given.try_lock().ok()?.take()
    }

    fn done(&self) {
        self.stands.store(NONE, Ordering::Release);
    }
}
