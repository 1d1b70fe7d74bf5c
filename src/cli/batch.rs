//! `hil batch`: a plan on many valves, every attempt kept, statistics and a page at the end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::answers::Answers;
use super::batch_args::{BatchArgs, Format, ValveReports};
use super::batch_bench::Bench;
use super::batch_error::failed;
use super::batch_folder;
use super::batch_open::{self, Opened};
use super::batch_prompt::{Entries, Prompted, Seen};
use super::clock::now;
use super::lock::lock;
use super::run::{exit_code, stop_on_signals};
use super::seat::Alone;
use super::{CliError, CliResult, exit};
use crate::batch::campaign::{self, Confirmed, Job, Retry, Rules};
use crate::batch::store::Loaded;
use crate::record::{Dut, Outcome};
use crate::report;

/// Runs the command.
pub fn run(args: &BatchArgs) -> CliResult {
    if args.duts.is_none() && args.count.is_none() && !args.prompt {
        return Err(CliError::usage("give the valves: --duts FILE, --count N (simulated) or --prompt"));
    }
    let ready = batch_open::prepare(args)?;
    let answers = Answers::to(&ready.setup.plan, args.answers.as_deref())?;
    let dir = batch_open::folder(args, &ready.setup.plan.name)?;
    conduct(args, ready.open(args, &dir)?, answers)
}

/// Everything between the open store and the exit code.
fn conduct(args: &BatchArgs, mut opened: Opened, answers: Answers) -> CliResult {
    let stop = stop_on_signals()?;
    let journal = opened.journal()?;
    let Opened { setup, store, mut loaded, valves, limits, claim: _claim } = opened;
    let (setup, store, limits) = (&setup, &store, limits.as_ref());
    let retry = batch_open::retry(&setup.plan);
    let total = valves.as_ref().map(Vec::len);
    let done = loaded.last.len();
    if done > 0 {
        super::note(&format!("going on after {done} valve(s)"));
    }
    let reports = args.valve_reports.unwrap_or(match total {
        Some(n) if setup.simulated() && n > 1000 => ValveReports::None,
        Some(n) if setup.simulated() && n > 100 => ValveReports::Failed,
        _ => ValveReports::All,
    });
    let company = Alone(answers);
    let bench = Bench {
        setup,
        dir: store.dir(),
        reports,
        threads: args.threads,
        retry: &retry,
        station: store.header().station.as_ref(),
        mounted_by_hand: valves.is_some(),
        stop: &stop,
        down: AtomicBool::new(false),
        company: &company,
        attended: false,
    };
    let seen = Seen::default();
    let jobs: Box<dyn Iterator<Item = Job> + Send> = match valves {
        Some(valves) => Box::new(remaining(valves, &loaded, &retry, args.retest).into_iter()),
        None => Box::new(Prompted::new(Entries::new(args, &loaded, limits, Arc::clone(&seen)), Arc::clone(&stop))),
    };
    let mut told = Told::new(total, done);
    let rules = Rules { retry: &retry, stop: &stop, clock: &now, synced: !setup.simulated() };
    let result = campaign::run(journal, jobs, bench.workers(), rules, &mut loaded.tally, |one| {
        lock(&seen).insert(one.job.dut.serial.clone(), (one.job.position, one.job.attempt, one.record.outcome));
        told.one(one);
    });
    told.finish();
    if let Err(e) = result {
        super::note(&format!("what was confirmed is kept in {}; go on with --resume", store.dir().display()));
        return Err(failed(e));
    }
    let summary = batch_open::summary(store.header(), store.dir(), &loaded.tally, loaded.damage, limits);
    batch_folder::write(store.dir(), &summary, &loaded.tally).map_err(failed)?;
    let printed = match args.format {
        Format::Text => report::batch::text(&summary),
        Format::Json => batch_folder::json(&summary),
        Format::Markdown => report::batch::markdown(&summary),
        Format::Html => report::batch::html(&summary, &batch_folder::report_id(&summary)),
        Format::Junit => batch_folder::junit(&summary, &loaded.tally),
    };
    super::print(&printed)?;
    if args.format == Format::Text {
        super::say(&format!("stored in {}", store.dir().display()));
    }
    if bench.down.load(Ordering::Relaxed) {
        super::note("the station failed, so the batch stopped; put it right and go on with --resume --retest");
        return Ok(exit::RIG);
    }
    if stop.load(Ordering::Relaxed) {
        super::note("stopped; go on with --resume");
        return Ok(exit::ABORTED);
    }
    Ok(exit_code(summary.outcome))
}

/// The valves that are still to be tested, each with the number of its next attempt.
fn remaining(valves: Vec<Dut>, loaded: &Loaded, retry: &Retry, retest: bool) -> Vec<Job> {
    let job = |(position, dut): (usize, Dut)| match loaded.last.get(&position) {
        None => Some(Job { position, attempt: 1, dut }),
        Some((attempt, outcome)) => {
            let judged = matches!(outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail);
            let again = (retest && !judged) || (*attempt < retry.most && retry.after.contains(outcome));
            again.then_some(Job { position, attempt: attempt + 1, dut })
        }
    };
    valves.into_iter().enumerate().filter_map(job).collect()
}

/// Tells on stderr what is confirmed: a bar for many valves, a line each for few.
struct Told {
    bar: Option<indicatif::ProgressBar>,
    counts: [usize; 3],
}

impl Told {
    fn new(total: Option<usize>, done: usize) -> Self {
        let bar = total.filter(|n| *n > 40).map(|n| {
            let bar = indicatif::ProgressBar::new(n as u64);
            if let Ok(style) = indicatif::ProgressStyle::with_template("{bar:30} {pos}/{len} valves, {per_sec}, {eta} left{msg}") {
                bar.set_style(style);
            }
            bar.set_position(done as u64);
            bar.reset_eta();
            bar
        });
        Self { bar, counts: [0; 3] }
    }

    fn one(&mut self, one: &Confirmed) {
        let outcome = one.record.outcome;
        let k = match outcome {
            Outcome::Pass | Outcome::Marginal => 0,
            Outcome::Fail => 1,
            _ => 2,
        };
        self.counts[k] += 1;
        match &self.bar {
            Some(bar) => {
                bar.inc(u64::from(one.job.attempt == 1));
                let [passed, failed, other] = self.counts;
                bar.set_message(format!(", {passed} passed, {failed} failed, {other} without a verdict"));
            }
            None => {
                let attempt = if one.job.attempt > 1 { format!(" (attempt {})", one.job.attempt) } else { String::new() };
                let reason = one.record.reasons.first().map_or_else(String::new, |r| format!(": {r}"));
                super::note(&format!("{:<24} {}{attempt}{reason}", one.job.dut.serial, outcome.text()));
            }
        }
    }

    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
