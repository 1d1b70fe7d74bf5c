//! Valves that are entered one by one, and what is known of a serial number from before.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use super::batch_args::BatchArgs;
use super::lock::lock;
use crate::batch::campaign::Job;
use crate::batch::index::{Index, Query};
use crate::batch::store::Loaded;
use crate::batch::{BatchError, duts};
use crate::plan::{LimitsFile, SerialForm};
use crate::record::{Dut, Outcome};

/// What an earlier batch says of a serial number, where it has passed.
pub fn passed_before(dir: &Path, serial: &str) -> Result<Option<String>, BatchError> {
    let (_, found, _) = Index::answers(dir, &Query { serial: Some(serial.into()), limit: 1000, ..Query::default() })?;
    let passed = found.iter().rfind(|a| a.outcome == "PASS" || a.outcome == "MARGINAL");
    Ok(passed.map(|a| format!("has passed before ({} in {}, {})", a.outcome, a.batch, a.at)))
}

/// What is known of each serial number of the batch: place, last attempt, its outcome; NOT_RUN while it is being tested.
pub type Seen = Arc<Mutex<BTreeMap<String, (usize, u32, Outcome)>>>;

/// What becomes a job of what somebody enters: one valve after another, each with its place and the number of its attempt.
pub struct Entries {
    common: Dut,
    form: SerialForm,
    known: Option<PathBuf>,
    seen: Seen,
    next: usize,
}

impl Entries {
    /// Valves after those that the batch holds.
    pub fn new(args: &BatchArgs, loaded: &Loaded, limits: Option<&LimitsFile>, seen: Seen) -> Self {
        let common =
            Dut { serial: String::new(), part_number: args.part_number.clone(), revision: args.revision.clone(), lot: args.lot.clone() };
        let form = limits.map_or_else(SerialForm::default, |l| l.serial.clone());
        let before = loaded.tally.attempts().iter().map(|a| (a.dut.serial.clone(), (a.position, a.number, a.outcome)));
        lock(&seen).extend(before);
        let next = loaded.tally.attempts().iter().map(|a| a.position + 1).max().unwrap_or(0);
        Self { common, form, known: args.known.clone(), seen, next }
    }

    /// What an entry comes to; nothing is begun yet.
    pub fn entry(&self, typed: &str) -> duts::Entry {
        duts::entry(typed, &self.common, &self.form, |serial| self.known(serial))
    }

    /// What an earlier attempt of this batch on a valve came to.
    pub fn before(&self, serial: &str) -> Option<(u32, Outcome)> {
        lock(&self.seen).get(serial).map(|(_, attempt, outcome)| (*attempt, *outcome))
    }

    /// The job of a valve that [`Entries::entry`] let through; it counts as being tested from now on.
    pub fn begin(&mut self, dut: Dut) -> Job {
        let before = lock(&self.seen).get(&dut.serial).map(|(position, attempt, _)| (*position, *attempt));
        let (position, attempt) = before.map_or((self.next, 1), |(position, attempt)| (position, attempt + 1));
        self.next = self.next.max(position + 1);
        lock(&self.seen).insert(dut.serial.clone(), (position, attempt, Outcome::NotRun));
        Job { position, attempt, dut }
    }

    fn known(&self, serial: &str) -> Option<String> {
        let before = lock(&self.seen).get(serial).map(|(_, _, outcome)| *outcome);
        match before {
            Some(Outcome::Pass | Outcome::Marginal) => return Some("has passed in this batch already".into()),
            Some(Outcome::NotRun) => return Some("is being tested".into()),
            _ => {}
        }
        let dir = self.known.as_ref()?;
        passed_before(dir, serial).unwrap_or_else(|e| Some(format!("cannot be looked up: {e}")))
    }
}

/// The jobs of a batch whose valves are entered one by one at the terminal.
pub struct Prompted {
    entries: Entries,
    stop: Arc<AtomicBool>,
}

impl Prompted {
    /// Asks for valves.
    pub fn new(entries: Entries, stop: Arc<AtomicBool>) -> Self {
        Self { entries, stop }
    }
}

impl Iterator for Prompted {
    type Item = Job;

    fn next(&mut self) -> Option<Job> {
        let mut input = std::io::stdin().lock();
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return None;
            }
            let _ = write!(anstream::stderr(), "serial (. ends): ");
            let _ = anstream::stderr().flush();
            match duts::prompt(&mut input, |typed| self.entries.entry(typed)) {
                Ok(duts::Entry::Dut(dut)) => {
                    if let Some((_, outcome)) = self.entries.before(&dut.serial) {
                        let what = outcome.text();
                        super::note(&format!("{} was tested before: {what}; this is a further attempt", dut.serial));
                    }
                    return Some(self.entries.begin(dut));
                }
                Ok(duts::Entry::Refused(why)) => super::note(&format!("not accepted: {why}")),
                Ok(duts::Entry::End) => return None,
                Err(e) => {
                    super::note(&format!("stdin: {e}"));
                    return None;
                }
            }
        }
    }
}
