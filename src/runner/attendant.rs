//! Who answers the questions of a plan: a file, a person at the terminal, or one at the page of the station.

use crate::plan::{Answer, Phase, Prompt};

/// An answer, and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// The answer; it fits the question.
    pub answer: Answer,
    /// `page`, `terminal` or `file`.
    pub by: &'static str,
}

/// Whoever answers. Neither call may wait: a loop holds the current meanwhile, and its interlocks watch.
pub trait Attendant: Send + Sync {
    /// A question is asked; `index` is the place of its phase in the plan.
    fn ask(&self, index: usize, phase: &Phase, prompt: &Prompt);
    /// The answer, once it is there.
    fn reply(&self) -> Option<Reply>;
    /// The question stands no longer: it was answered, or the run has ended.
    fn done(&self) {}
}
