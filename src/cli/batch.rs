//! `hil batch`: a plan on many valves, every attempt kept, statistics and a page at the end.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use sha2::{Digest, Sha256};

use super::batch_bench::{Bench, Setup};
use super::batch_folder;
use super::batch_prompt::{Seen, lock};
use super::outputs::Force;
use super::run::{exit_code, key_value, sha256, stop_on_signals};
use super::{CliError, CliResult, exit, files};
use crate::batch::campaign::{self, Confirmed, Job, Retry, Rules};
use crate::batch::journal::{Kind, Line, encode};
use crate::batch::population::Population;
use crate::batch::station::Station;
use crate::batch::store::{Header, Loaded, SCHEMA, Store};
use crate::batch::{BatchError, duts, master, summary};
use crate::output::Outputs;
use crate::plan::{LimitsFile, Override, Plan, RetryOn, SerialForm};
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
    let mut plan = files::plan(&args.plan, &args.set)?;
    let limits_path = files::limits(args.limits.as_deref(), &plan.name)?;
    let limits = limits_path.as_deref().map(LimitsFile::load).transpose().map_err(CliError::input)?;
    if let Some(limits) = &limits {
        plan.apply_limits(limits).map_err(CliError::input)?;
    }
    let (station, station_block) = station(args, &plan)?;
    let population = match &args.population {
        Some(path) => Some(Population::load(&files::batch_file(path)?).map_err(failed)?),
        None => args.count.map(|_| Population::standard()),
    };
    let form = |_: &Dut| limits.as_ref().map_or_else(SerialForm::default, |l| l.serial.clone());
    let valves = valves(args, form)?;
    let setup = Setup::new(&args.rig, plan, population.clone(), args.seed, station.as_ref())?;
    let header = header(args, &setup, population, limits_path.as_deref().zip(limits.as_ref()), station_block, valves.as_deref())?;
    let dir = folder(args, &setup.plan.name)?;
    let begins = !dir.join("batch.json").exists() && !dir.join("journal").exists();
    let inputs = [Some(&args.plan), args.duts.as_ref(), args.limits.as_ref(), args.station.as_ref(), args.population.as_ref()];
    let outputs = Outputs::new(args.force.force).reads(inputs.into_iter().flatten()).folder(begins.then_some(&dir), &batch_folder::FILES);
    let _claim = outputs.claim()?;
    let store = Store::open(&dir, header, args.resume).map_err(failed)?;
    let loaded = store.load().map_err(failed)?;
    refuse_known(args, valves.as_deref())?;
    conduct(args, &setup, &store, loaded, valves, limits.as_ref())
}

/// Everything between the open store and the exit code.
fn conduct(
    args: &BatchArgs,
    setup: &Setup,
    store: &Store,
    mut loaded: Loaded,
    valves: Option<Vec<Dut>>,
    limits: Option<&LimitsFile>,
) -> CliResult {
    let stop = stop_on_signals()?;
    let mut journal = store.journal().map_err(failed)?;
    for interrupted in std::mem::take(&mut loaded.interrupted) {
        let why = format!("interrupted: begun at {}, and the process ended before the record was stored", interrupted.at);
        let record = setup.without_run(&interrupted.dut, Outcome::Aborted, why);
        let (position, attempt) = (interrupted.position, interrupted.attempt);
        let line = Line { event: Kind::Finished, position, attempt, at: now(), dut: None, record: Some(record.clone()) };
        journal.append(&encode(&line)).map_err(failed)?;
        loaded.tally.add(position, attempt, &record);
        loaded.last.insert(position, (attempt, Outcome::Aborted));
        super::note(&format!("valve {}: attempt {attempt} was interrupted; closed as ABORTED", record.dut.serial));
    }
    journal.confirm().map_err(failed)?;
    let retry = retry(&setup.plan);
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
    };
    let seen = Seen::default();
    let jobs: Box<dyn Iterator<Item = Job> + Send> = match valves {
        Some(valves) => Box::new(remaining(valves, &loaded, &retry, args.retest).into_iter()),
        None => Box::new(super::batch_prompt::Prompted::new(args, &loaded, limits, Arc::clone(&stop), Arc::clone(&seen))),
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
    let tolerance = |m: &crate::batch::tally::MetricKey| {
        limits?.tolerance(&m.phase, &m.metric, &m.unit).map(|(min, max)| crate::batch::statistics::Tolerance { min, max })
    };
    let dir = store.dir().to_path_buf();
    let link = |a: &crate::batch::tally::Attempt| batch_folder::report_link(&dir, a);
    let summary = summary::summarise(store.header(), &loaded.tally, loaded.damage, tolerance, link);
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

/// The station with its gate and its calibration, as the block of the header.
fn station(args: &BatchArgs, plan: &Plan) -> Result<(Option<Station>, Option<serde_json::Value>), CliError> {
    let Some(path) = &args.station else {
        return Ok((None, args.operator.as_ref().map(|operator| serde_json::json!({ "operator": operator }))));
    };
    let station = Station::load(path).map_err(failed)?;
    let mut overrides = Vec::new();
    let expired = station.expired(jiff::Zoned::now().date());
    match (&args.override_calibration, expired.is_empty()) {
        (_, true) => {}
        (Some(reason), false) if !reason.trim().is_empty() => {
            overrides = expired.iter().map(|e| format!("{e}; tested nevertheless: {reason}")).collect();
        }
        _ => {
            let text = format!(
                "{}: {}. Calibrate, or give --override-calibration REASON, which goes into every record",
                path.display(),
                expired.join("; ")
            );
            return Err(CliError::input(text));
        }
    }
    let checks = master::read(&master::log_path(path)).map_err(failed)?;
    let driver = args.rig.wire.driver.as_deref().map(super::on_wire::load_profile).transpose()?;
    let unreal = args.rig.sim || driver.is_some_and(|p| p.device.emulated);
    master::open(&station, &checks, &plan.sha256, unreal, jiff::Timestamp::now()).map_err(failed)?;
    let block = station.provenance(args.operator.as_deref(), &overrides);
    Ok((Some(station), Some(block)))
}

/// The valves of the batch; `None` where they are entered one by one.
fn valves(args: &BatchArgs, form: impl Fn(&Dut) -> SerialForm) -> Result<Option<Vec<Dut>>, CliError> {
    let mut valves = match (&args.duts, args.count) {
        (Some(path), _) => duts::read_csv(path, form).map_err(failed)?,
        (None, Some(count)) => duts::counted(count).map_err(failed)?,
        (None, None) => return Ok(None),
    };
    for dut in &mut valves {
        let fill = |own: &mut Option<String>, given: &Option<String>| {
            if own.is_none() {
                own.clone_from(given);
            }
        };
        fill(&mut dut.part_number, &args.part_number);
        fill(&mut dut.revision, &args.revision);
        fill(&mut dut.lot, &args.lot);
    }
    Ok(Some(valves))
}

fn header(
    args: &BatchArgs,
    setup: &Setup,
    population: Option<Population>,
    limits: Option<(&Path, &LimitsFile)>,
    station: Option<serde_json::Value>,
    valves: Option<&[Dut]>,
) -> Result<Header, CliError> {
    let plan = &setup.plan;
    let limits_of = match limits {
        Some((path, file)) => {
            let part = [file.part_number.as_deref(), file.revision.as_deref()].into_iter().flatten().collect::<Vec<_>>().join(" ");
            Some((part, sha256(path)?))
        }
        None => None,
    };
    let retry = retry(plan);
    Ok(Header {
        schema: SCHEMA.into(),
        plan: plan.name.clone(),
        plan_sha256: plan.sha256.clone(),
        parameters: plan.parameters.clone(),
        overridden: plan.overridden.clone(),
        simulated: setup.simulated(),
        seed: args.seed,
        rig: setup.identity(),
        valves: valves.map(<[Dut]>::len),
        valves_sha256: valves.map(|v| hex(&serde_json::to_vec(v).unwrap_or_default())),
        population,
        limits: limits_of,
        decision_rule: limits.map_or(crate::limits::DecisionRule::Simple, |l| l.1.decision_rule).text().into(),
        attempts: (retry.most, retry.after.iter().map(|o| o.text().to_string()).collect()),
        station,
        version: env!("CARGO_PKG_VERSION").into(),
    })
}

fn retry(plan: &Plan) -> Retry {
    let outcome = |on: &RetryOn| match on {
        RetryOn::Fail => Outcome::Fail,
        RetryOn::Error => Outcome::Error,
        RetryOn::Invalid => Outcome::Invalid,
    };
    Retry { most: plan.attempts.max.max(1), after: plan.attempts.retry_on.iter().map(outcome).collect() }
}

/// The folder of the batch: `reports/runs/batch-<plan>-<n>`, the last one with --resume, a new one without.
fn folder(args: &BatchArgs, plan: &str) -> Result<PathBuf, CliError> {
    if let Some(dir) = &args.out {
        return Ok(dir.clone());
    }
    let runs = Path::new("reports/runs");
    let name = |n: u32| runs.join(format!("batch-{plan}-{n}"));
    let first_free = (1u32..).find(|n| !name(*n).exists()).unwrap_or(1);
    match (args.resume, first_free) {
        (false, n) => Ok(name(n)),
        (true, 1) => Err(CliError::usage(format!("no batch of `{plan}` under {}; give its folder with --out", runs.display()))),
        (true, n) => Ok(name(n - 1)),
    }
}

/// Refuses valves that have passed in an earlier batch.
fn refuse_known(args: &BatchArgs, valves: Option<&[Dut]>) -> Result<(), CliError> {
    let (Some(dir), Some(valves)) = (&args.known, valves) else { return Ok(()) };
    for dut in valves {
        if let Some(what) = super::batch_prompt::passed_before(dir, &dut.serial).map_err(failed)? {
            return Err(CliError::input(format!("valve `{}` {what}", dut.serial)));
        }
    }
    Ok(())
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

/// SHA-256, hex.
pub fn hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
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
