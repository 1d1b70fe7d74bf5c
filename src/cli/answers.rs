//! Who answers the questions of a plan from the command line: a file (`schema = "hil.answers/1"`), or a person at the terminal.

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::CliError;
use super::lock::lock;
use crate::document;
use crate::plan::{Answer, Phase, Plan, Prompt};
use crate::runner::{Attendant, Reply};

/// The schema key of a file with answers.
pub const SCHEMA: &str = "hil.answers/1";

/// Answers to the questions of a plan, by the names of the phases that ask.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnswersFile {
    /// `hil.answers/1`.
    pub schema: String,
    /// An answer each: `"yes"`, `"40 degC"`, an option, a remark.
    pub answers: BTreeMap<String, Given>,
}

/// An answer as it is written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Given {
    /// Yes or no.
    Switch(bool),
    /// A number in the unit of the question.
    Number(f64),
    /// Anything as a person would type it.
    Text(String),
}

impl AnswersFile {
    /// Reads a file with answers.
    pub fn load(path: &Path) -> Result<Self, CliError> {
        let text = document::read(path).map_err(CliError::input)?;
        let name = path.display().to_string();
        document::expect_schema(&text, &name, SCHEMA, "a file with answers").map_err(CliError::input)?;
        document::parse(&text, &name).map_err(CliError::input)
    }
}

/// Who answers a plan.
#[derive(Clone)]
pub enum Answers {
    /// It asks nothing.
    Nothing,
    /// A file; every answer fits its question.
    File(Arc<BTreeMap<String, Answer>>),
    /// A person at the terminal.
    Terminal,
}

impl Answers {
    /// Who answers `plan`: the file, or the terminal where there is one.
    ///
    /// # Errors
    /// A question without an answer, an answer without a question, an answer that does not fit; and a plan that asks where nobody is
    /// there. All of it before anything moves.
    pub fn to(plan: &Plan, file: Option<&Path>) -> Result<Self, CliError> {
        let Some(path) = file else {
            let Some((phase, prompt)) = plan.prompts().next() else { return Ok(Self::Nothing) };
            if std::io::stdin().is_terminal() {
                return Ok(Self::Terminal);
            }
            return Err(CliError::usage(format!(
                "plan `{}`: phase `{}` asks \u{201c}{}\u{201d}, and nobody is there to answer: give --answers FILE",
                plan.name, phase.name, prompt.text
            )));
        };
        let written = AnswersFile::load(path)?;
        let wrong = |problem: String| CliError::input(format!("{}: {problem}", path.display()));
        let mut answers = BTreeMap::new();
        for (phase, prompt) in plan.prompts() {
            let Some(given) = written.answers.get(&phase.name) else {
                return Err(wrong(format!(
                    "no answer to \u{201c}{}\u{201d} of the phase `{}`: {} is wanted",
                    prompt.text,
                    phase.name,
                    prompt.kind.allowed()
                )));
            };
            let typed = match given {
                Given::Switch(yes) => if *yes { "yes" } else { "no" }.to_string(),
                Given::Number(value) => value.to_string(),
                Given::Text(text) => text.clone(),
            };
            let answer = prompt.kind.answer(&typed).map_err(|e| wrong(format!("answers.{}: {e}", phase.name)))?;
            answers.insert(phase.name.clone(), answer);
        }
        if let Some(stranger) = written.answers.keys().find(|k| !answers.contains_key(*k)) {
            return Err(wrong(format!("answers.{stranger}: the plan `{}` asks nothing in a phase of this name", plan.name)));
        }
        Ok(Self::File(Arc::new(answers)))
    }

    /// Whoever answers one run.
    pub fn attendant(&self) -> Option<Arc<dyn Attendant>> {
        match self {
            Self::Nothing => None,
            Self::File(answers) => Some(Arc::new(Scripted { answers: Arc::clone(answers), next: Mutex::default() })),
            Self::Terminal => Some(Arc::new(Terminal::default())),
        }
    }
}

/// Answers from a file, at once.
struct Scripted {
    answers: Arc<BTreeMap<String, Answer>>,
    next: Mutex<Option<Answer>>,
}

impl Attendant for Scripted {
    fn ask(&self, _index: usize, phase: &Phase, _prompt: &Prompt) {
        *lock(&self.next) = self.answers.get(&phase.name).cloned();
    }

    fn reply(&self) -> Option<Reply> {
        lock(&self.next).take().map(|answer| Reply { answer, by: "file" })
    }
}

/// A person at the terminal. A thread reads, so that the loop never waits for a line.
#[derive(Default)]
struct Terminal {
    asked: Mutex<Option<Prompt>>,
}

/// The line that is being read. One that nobody waits for any more answers the next question's reader, which asks again.
static LINE: Mutex<Option<Receiver<String>>> = Mutex::new(None);

impl Attendant for Terminal {
    fn ask(&self, _index: usize, phase: &Phase, prompt: &Prompt) {
        super::note(&format!("\n{}: {}", phase.name, prompt.text));
        invite(prompt);
        *lock(&self.asked) = Some(prompt.clone());
        read_a_line();
    }

    fn reply(&self) -> Option<Reply> {
        let asked = lock(&self.asked);
        let prompt = asked.as_ref()?;
        let line = match lock(&LINE).as_ref()?.try_recv() {
            Ok(line) => line,
            Err(TryRecvError::Empty) => return None,
            // Nobody will ever answer: the question ends by its timeout, or by a stop.
            Err(TryRecvError::Disconnected) => return None,
        };
        match prompt.kind.answer(&line) {
            Ok(answer) => Some(Reply { answer, by: "terminal" }),
            Err(why) => {
                super::note(&why);
                invite(prompt);
                *lock(&LINE) = None;
                read_a_line();
                None
            }
        }
    }

    fn done(&self) {
        *lock(&self.asked) = None;
    }
}

fn invite(prompt: &Prompt) {
    let _ = write!(anstream::stderr(), "  ({}): ", prompt.kind.allowed());
    let _ = anstream::stderr().flush();
}

/// Begins to read a line, where none is being read.
fn read_a_line() {
    let mut line = lock(&LINE);
    if line.as_ref().is_some_and(|reading| matches!(reading.try_recv(), Err(TryRecvError::Empty))) {
        return;
    }
    let (send, receive) = channel();
    *line = Some(receive);
    std::thread::spawn(move || {
        let mut text = String::new();
        if std::io::stdin().read_line(&mut text).is_ok_and(|n| n > 0) {
            let _ = send.send(text);
        }
    });
}
