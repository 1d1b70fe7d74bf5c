//! `hil batch`: a plan on many valves, every attempt kept, statistics and a page at the end.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;

use super::answers::Answers;
use super::batch_bench::Bench;
use super::batch_folder;
use super::batch_open::{self, Opened};
use super::batch_prompt::{Entries, Prompted, Seen, lock};
use super::outputs::Force;
use super::run::{exit_code, key_value, stop_on_signals};
use super::seat::Alone;
use super::{CliError, CliResult, exit};
use crate::batch::BatchError;
use crate::batch::campaign::{self, Confirmed, Job, Retry, Rules};
use crate::batch::store::Loaded;
use crate::plan::Override;
use crate::record::{Dut, Outcome};
use crate::report;

/// Arguments of `hil batch`.
#[derive(Debug, Args)]
pub struct BatchArgs {
    /// Plan file, or a bare name.
    pub plan: PathBuf,
    /// CSV file with the valves: serial, part_number, revision, lot.
    #[arg(long, value_name = "FILE", group = "valves")]
    pub duts: Option<PathBuf>,
    /// So many valves of a simulated population.
    #[arg(long, value_name = "N", group = "valves", requires = "sim")]
    pub count: Option<usize>,
    /// Enter the valves one by one, with a scanner or a keyboard; `.` ends the batch.
    #[arg(long, group = "valves")]
    pub prompt: bool,
    /// Part number of valves that come without one.
    #[arg(long)]
    pub part_number: Option<String>,
    /// Revision of valves that come without one.
    #[arg(long)]
    pub revision: Option<String>,
    /// Lot of valves that come without one.
    #[arg(long)]
    pub lot: Option<String>,
    /// Where and on what is tested.
    #[command(flatten)]
    pub rig: super::batch_bench::RigArgs,
    /// Simulated population: declared spread around the valve.
    #[arg(long, value_name = "FILE", requires = "sim")]
    pub population: Option<PathBuf>,
    /// Change a parameter of the plan.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub set: Vec<Override>,
    /// Limits file of the part, replacing the plan's limits.
    #[arg(long, value_name = "FILE")]
    pub limits: Option<PathBuf>,
    /// Station file: instruments, calibration, oil, supply, master valves.
    #[arg(long, value_name = "FILE")]
    pub station: Option<PathBuf>,
    /// Who tests.
    #[arg(long)]
    pub operator: Option<String>,
    /// Test although a calibration has run out; the reason goes into the records.
    #[arg(long, value_name = "REASON")]
    pub override_calibration: Option<String>,
    /// File with the answers to the questions of the plan; without it they are asked at the terminal.
    #[arg(long, value_name = "FILE")]
    pub answers: Option<PathBuf>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Go on with the batch in the folder after a crash or a stop; interrupted attempts are closed as ABORTED.
    #[arg(long)]
    pub resume: bool,
    /// With --resume: test valves that have no verdict (ABORTED, ERROR, INVALID) again, as a further attempt.
    #[arg(long, requires = "resume")]
    pub retest: bool,
    /// Simulated valves at once; both cores by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Folder of the batch; by default a new one under reports/runs/, with --resume the last one there.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// A folder of earlier batches: valves that have passed there are refused.
    #[arg(long, value_name = "DIR")]
    pub known: Option<PathBuf>,
    /// Which valves get a folder with report and trace of their own; of simulated ones all up to 100, `failed` up to 1000, else none.
    #[arg(long, value_enum)]
    pub valve_reports: Option<ValveReports>,
    /// Existing files.
    #[command(flatten)]
    pub force: Force,
    /// What is printed on stdout.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Which valves get a folder of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ValveReports {
    /// Every attempt.
    All,
    /// Attempts that were not accepted.
    Failed,
    /// None.
    None,
}

/// What is printed on stdout.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// A report for a terminal.
    #[default]
    Text,
    /// The batch with its statistics.
    Json,
    /// A report for a mail or a pull request.
    Markdown,
    /// JUnit XML.
    Junit,
    /// The page.
    Html,
}

/// What can end a batch, as an exit code.
pub fn failed(error: BatchError) -> CliError {
    match error {
        BatchError::Input(_) | BatchError::Exists { .. } | BatchError::Mismatch { .. } => CliError::input(error),
        BatchError::Store { .. } | BatchError::NotReadBack { .. } | BatchError::Busy { .. } | BatchError::Index { .. } => {
            CliError::not_stored(error)
        }
        BatchError::Rig(_) | BatchError::Gate(_) => CliError::rig(error),
    }
}

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

/// The present, as the journal writes it.
pub fn now() -> String {
    jiff::Timestamp::now().to_string()
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
            if let Ok(style) = indicatif::ProgressStyle::with_template("{bar:30} {pos}/{len} valves, {per_sec}, {eta} left, {msg}") {
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
                bar.set_message(format!("{passed} passed, {failed} failed, {other} without a verdict"));
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
