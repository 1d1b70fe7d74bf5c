//! Runs the attempts of a batch on one or more workers and brings every record safely to the disk.
//!
//! Each worker writes that an attempt begins, tests, and writes the record; the records of all workers are confirmed in groups
//! (flushed, read back, checked), because one flush costs more than a simulated valve. Only what is confirmed is counted and told.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::BatchError;
use super::journal::{Journal, Kind, Line, encode};
use super::tally::Tally;
use crate::record::{Dut, Outcome, TestRecord};

/// Records that wait for the same flush at most.
const GROUP: usize = 256;
/// How long a record waits for others at most.
const WAIT: Duration = Duration::from_millis(200);

/// One valve to be tested.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// Place in the batch, from 0.
    pub position: usize,
    /// Number of the next attempt, from 1.
    pub attempt: u32,
    /// The valve.
    pub dut: Dut,
}

/// When a further attempt is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Retry {
    /// Attempts per valve in all.
    pub most: u32,
    /// Outcomes after which a further one is made.
    pub after: Vec<Outcome>,
}

/// Tests one valve once: a bench, or a thread of a simulation.
pub type Worker<'a> = Box<dyn FnMut(&Job) -> Result<TestRecord, BatchError> + Send + 'a>;

/// Where a worker's jobs come from; it may wait for the next one.
pub type Jobs<'a> = Box<dyn Iterator<Item = Job> + Send + 'a>;

/// A record that is on the disk and was read back.
#[derive(Debug)]
pub struct Confirmed {
    /// Its valve and attempt.
    pub job: Job,
    /// The record.
    pub record: TestRecord,
}

/// The clock of the journal: the present as RFC 3339.
pub type Clock<'a> = &'a (dyn Fn() -> String + Sync);

/// What all workers of a campaign follow.
#[derive(Clone, Copy)]
pub struct Rules<'a> {
    /// When a further attempt is made.
    pub retry: &'a Retry,
    /// Set to let running attempts end and begin no other.
    pub stop: &'a AtomicBool,
    /// The clock of the journal.
    pub clock: Clock<'a>,
    /// Whether the line that opens an attempt is on the disk before the valve moves: where a current flows, it must be.
    pub synced: bool,
}

/// Tests every job. The result is what was confirmed, added to `tally`; `told` hears of each confirmed record in the order of its
/// confirmation.
///
/// # Errors
/// The first error of a worker or of the disk; what was confirmed before stays.
pub fn run(
    journal: Journal,
    jobs: impl Iterator<Item = Job> + Send,
    workers: Vec<Worker<'_>>,
    rules: Rules<'_>,
    tally: &mut Tally,
    told: impl FnMut(&Confirmed),
) -> Result<(), BatchError> {
    let jobs = Mutex::new(jobs);
    let shared = || Box::new(std::iter::from_fn(|| lock(&jobs).next())) as Jobs<'_>;
    let workers = workers.into_iter().map(|worker| (shared(), worker)).collect();
    run_each(journal, workers, rules, tally, told)
}

/// As [`run`], where every worker has jobs of its own: the sites of a station, each with the operator who stands there.
///
/// # Errors
/// As [`run`].
pub fn run_each<'a>(
    journal: Journal,
    workers: Vec<(Jobs<'a>, Worker<'a>)>,
    rules: Rules<'_>,
    tally: &mut Tally,
    mut told: impl FnMut(&Confirmed),
) -> Result<(), BatchError> {
    let journal = Mutex::new(journal);
    let failed: Mutex<Option<BatchError>> = Mutex::new(None);
    let halt = AtomicBool::new(false);
    let (sender, receiver) = sync_channel::<Confirmed>(GROUP);
    let mut confirmed = |group: &mut Vec<Confirmed>| {
        // A record is in the channel after its line was appended, so everything in the group is part of what is pending here.
        let pending = lock(&journal).pending()?;
        let to = pending.confirm()?;
        lock(&journal).confirmed(to);
        for one in group.drain(..) {
            tally.add(one.job.position, one.job.attempt, &one.record);
            told(&one);
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        for (mut jobs, mut worker) in workers {
            let (sender, journal, failed, halt) = (sender.clone(), &journal, &failed, &halt);
            scope.spawn(move || {
                let _halt = HaltOnPanic(halt);
                while !rules.stop.load(Ordering::Relaxed) && !halt.load(Ordering::Relaxed) {
                    let Some(job) = jobs.next() else { break };
                    if let Err(e) = attempts(&mut worker, job, journal, &sender, rules) {
                        halt.store(true, Ordering::Relaxed);
                        lock(failed).get_or_insert(e);
                    }
                }
            });
        }
        drop(sender);
        // Where each attempt is on the disk before it begins, valves are real and few: nobody waits for others' records.
        let wait = if rules.synced { Duration::ZERO } else { WAIT };
        collect(&receiver, wait, &mut confirmed).unwrap_or_else(|e| {
            halt.store(true, Ordering::Relaxed);
            lock(&failed).get_or_insert(e);
            // Let workers that wait at the full channel go.
            receiver.iter().for_each(drop);
        });
    });
    tally.sort();
    match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

/// A worker that panics lets no other begin a further valve: what is wrong with the program is wrong for all.
struct HaltOnPanic<'a>(&'a AtomicBool);

impl Drop for HaltOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

/// A poisoned lock means that a thread panicked; what the lock guards is still whole, since lines are appended as one.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes that an attempt begins; where it is to be `synced`, it is on the disk and read back when this returns.
fn begin_attempt(journal: &Mutex<Journal>, line: &Line, synced: bool) -> Result<(), BatchError> {
    let json = encode(line);
    let mut journal_held = lock(journal);
    journal_held.append(&json)?;
    if !synced {
        return Ok(());
    }
    let pending = journal_held.pending()?;
    drop(journal_held);
    let to = pending.confirm()?;
    lock(journal).confirmed(to);
    Ok(())
}

fn attempts(
    worker: &mut Worker<'_>,
    mut job: Job,
    journal: &Mutex<Journal>,
    sender: &SyncSender<Confirmed>,
    rules: Rules<'_>,
) -> Result<(), BatchError> {
    let Rules { retry, stop, clock, synced } = rules;
    loop {
        let (position, attempt) = (job.position, job.attempt);
        let begin = Line { event: Kind::Started, position, attempt, at: clock(), dut: Some(job.dut.clone()), record: None };
        begin_attempt(journal, &begin, synced)?;
        let record = worker(&job)?;
        let outcome = record.outcome;
        let end = Line { event: Kind::Finished, position, attempt, at: clock(), dut: None, record: Some(record) };
        let line = encode(&end);
        lock(journal).append(&line)?;
        if let Some(record) = end.record {
            // The receiver is gone only after an error that is told already.
            let _ = sender.send(Confirmed { job: job.clone(), record });
        }
        if attempt >= retry.most || !retry.after.contains(&outcome) || stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        job.attempt += 1;
    }
}

fn collect(
    receiver: &Receiver<Confirmed>,
    wait: Duration,
    confirm: &mut dyn FnMut(&mut Vec<Confirmed>) -> Result<(), BatchError>,
) -> Result<(), BatchError> {
    let mut group = Vec::with_capacity(GROUP);
    loop {
        let next = if group.is_empty() { receiver.recv().map_err(|_| RecvTimeoutError::Disconnected) } else { receiver.recv_timeout(wait) };
        let flush = match next {
            Ok(one) => {
                group.push(one);
                group.len() >= GROUP
            }
            Err(RecvTimeoutError::Timeout) => true,
            Err(RecvTimeoutError::Disconnected) => {
                return if group.is_empty() { Ok(()) } else { confirm(&mut group) };
            }
        };
        if flush {
            confirm(&mut group)?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{example, journal, store};
    use std::sync::atomic::AtomicUsize;

    fn jobs(count: usize) -> impl Iterator<Item = Job> + Send {
        (0..count).map(|position| Job { position, attempt: 1, dut: Dut { serial: format!("V{position}"), ..Dut::default() } })
    }

    fn clock() -> String {
        "2026-01-01T00:00:00Z".into()
    }

    fn simulated<'a>() -> Worker<'a> {
        Box::new(|job: &Job| Ok(example::record(&job.dut.serial, job.position as u64)))
    }

    fn rules<'a>(retry: &'a Retry, stop: &'a AtomicBool) -> Rules<'a> {
        Rules { retry, stop, clock: &clock, synced: false }
    }

    const ONCE: Retry = Retry { most: 1, after: vec![] };

    #[test]
    fn every_valve_once_and_the_same_whatever_the_number_of_workers() {
        let batch = |workers: usize| {
            let dir = tempfile::tempdir().unwrap();
            let mut tally = Tally::default();
            let journal = Journal::begin(dir.path()).unwrap();
            let workers = (0..workers).map(|_| simulated()).collect();
            let mut told = 0;
            run(journal, jobs(700), workers, rules(&ONCE, &AtomicBool::new(false)), &mut tally, |_| told += 1).unwrap();
            assert_eq!(told, 700);
            let loaded = store::load(dir.path()).unwrap();
            assert!(loaded.interrupted.is_empty() && loaded.damage.is_empty());
            assert!(loaded.tally.attempts() == tally.attempts());
            tally.attempts().to_vec()
        };
        let one = batch(1);
        assert_eq!(one.len(), 700);
        assert!(one == batch(4));
    }

    #[test]
    fn a_record_is_told_only_after_it_reads_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().to_path_buf();
        let mut tally = Tally::default();
        let journal = Journal::begin(dir.path()).unwrap();
        run(journal, jobs(20), vec![simulated()], rules(&ONCE, &AtomicBool::new(false)), &mut tally, |one| {
            let mut found = false;
            journal::read(&path, |_, line| {
                found |= line.event == Kind::Finished && line.position == one.job.position;
                Ok(())
            })
            .unwrap();
            assert!(found);
        })
        .unwrap();
    }

    #[test]
    fn further_attempts_follow_the_rule_and_are_all_kept() {
        let dir = tempfile::tempdir().unwrap();
        let mut tally = Tally::default();
        let worker: Worker = Box::new(|job: &Job| {
            let mut record = example::record(&job.dut.serial, 1);
            record.outcome = match (job.position, job.attempt) {
                (0, 1) | (2, _) => Outcome::Invalid,
                (1, _) => Outcome::Fail,
                _ => Outcome::Pass,
            };
            Ok(record)
        });
        let retry = Retry { most: 3, after: vec![Outcome::Invalid] };
        let journal = Journal::begin(dir.path()).unwrap();
        run(journal, jobs(3), vec![worker], rules(&retry, &AtomicBool::new(false)), &mut tally, |_| {}).unwrap();
        let seen: Vec<Vec<Outcome>> = tally.valves().map(|v| v.iter().map(|a| a.outcome).collect()).collect();
        use Outcome::{Fail, Invalid, Pass};
        assert_eq!(seen, [vec![Invalid, Pass], vec![Fail], vec![Invalid, Invalid, Invalid]]);
    }

    #[test]
    fn a_stop_lets_the_running_attempt_end() {
        let dir = tempfile::tempdir().unwrap();
        let (stop, count) = (AtomicBool::new(false), AtomicUsize::new(0));
        let worker: Worker = Box::new(|job: &Job| {
            if count.fetch_add(1, Ordering::Relaxed) == 4 {
                stop.store(true, Ordering::Relaxed);
            }
            Ok(example::record(&job.dut.serial, 1))
        });
        let mut tally = Tally::default();
        run(Journal::begin(dir.path()).unwrap(), jobs(100), vec![worker], rules(&ONCE, &stop), &mut tally, |_| {}).unwrap();
        assert_eq!(tally.attempts().len(), 5);
        assert!(store::load(dir.path()).unwrap().interrupted.is_empty());
    }

    #[test]
    fn an_error_keeps_what_was_confirmed_and_leaves_the_attempt_open() {
        let dir = tempfile::tempdir().unwrap();
        let worker: Worker = Box::new(|job: &Job| match job.position {
            7 => Err(BatchError::Rig("the bench is gone".into())),
            _ => Ok(example::record(&job.dut.serial, 1)),
        });
        let mut tally = Tally::default();
        let journal = Journal::begin(dir.path()).unwrap();
        let error = run(journal, jobs(100), vec![worker], rules(&ONCE, &AtomicBool::new(false)), &mut tally, |_| {}).unwrap_err();
        assert_eq!(error.to_string(), "the bench is gone");
        assert_eq!(tally.attempts().len(), 7);
        let loaded = store::load(dir.path()).unwrap();
        assert_eq!((loaded.tally.attempts().len(), loaded.interrupted.len(), loaded.interrupted[0].position), (7, 1, 7));
    }
}
