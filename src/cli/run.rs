//! `hil run`: a plan on a rig, a record in a folder, the verdict on stdout.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Args;

use super::answers::Answers;
use super::on_wire::{self, WireArgs};
use super::outputs::{Force, RUN};
use super::progress::Bar;
use super::valves::believed;
use super::{CliError, CliResult, exit, files, run_folder};
use crate::digest;
use crate::document;
use crate::output::Outputs;
use crate::plan::{LimitsFile, Override};
use crate::record::{Dut, Outcome, Provenance, TestRecord, Trace};
use crate::report;
use crate::rig::simulated::SimulatedRig;
use crate::rig::{RigIdentity, signals};
use crate::runner::{self, Attended, RunOptions};
use crate::valve::Valve;

/// Arguments of `hil run`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("rig").required(true).args(["sim", "driver"])))]
pub struct RunArgs {
    /// Plan file, or the bare name of one in plans/ or of one that ships with the program.
    pub plan: PathBuf,
    /// Run on a simulated valve.
    #[arg(long)]
    pub sim: bool,
    /// Driver and line.
    #[command(flatten)]
    pub wire: WireArgs,
    /// Valve file, or the bare name of one in valves/ or of one that ships with the program: the valve that is simulated.
    #[arg(long)]
    pub valve: Option<String>,
    /// Serial number of the valve under test.
    #[arg(long)]
    pub serial: Option<String>,
    /// Change a parameter of the plan.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub set: Vec<Override>,
    /// Limits file of the part, replacing the plan's limits.
    #[arg(long, value_name = "FILE")]
    pub limits: Option<PathBuf>,
    /// File with the answers to the questions of the plan; without it they are asked at the terminal.
    #[arg(long, value_name = "FILE")]
    pub answers: Option<PathBuf>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder for record, reports and trace; a new one under reports/runs/ by default.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Existing files.
    #[command(flatten)]
    pub force: Force,
    /// What is printed on stdout.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// What is printed on stdout.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// A report for a terminal.
    #[default]
    Text,
    /// The record.
    Json,
    /// A report for a pull request.
    Markdown,
    /// JUnit XML.
    Junit,
    /// A page with plots.
    Html,
}

/// `KEY=VALUE` as typed.
pub fn key_value(text: &str) -> Result<Override, String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().into(), value.trim().into())),
        _ => Err("KEY=VALUE is wanted, for instance peak=\"20 bar\"".into()),
    }
}

/// Runs the command.
pub fn run(args: &RunArgs) -> CliResult {
    let mut plan = files::plan(&args.plan, &args.set)?;
    if let Some(path) = files::limits(args.limits.as_deref(), &plan.name)? {
        LimitsFile::load(&path).and_then(|limits| plan.apply_limits(&limits)).map_err(CliError::input)?;
    }
    let (valve, valve_path) = files::valve_under(&plan, args.valve.as_deref())?;
    let model = believed(&plan, &valve)?;
    plan.check_valve(&model).and_then(|()| plan.check_valve(&valve)).map_err(CliError::input)?;
    let answers = Answers::to(&plan, args.answers.as_deref())?;
    let dut = dut(args, &valve);
    let folder = match &args.out {
        Some(folder) => folder.clone(),
        None => run_folder::new_folder(&plan.name, &dut.serial)?,
    };
    let inputs =
        [&files::find_plan(&args.plan)?, &valve_path].into_iter().chain(&args.limits).chain(&args.answers).cloned().collect::<Vec<_>>();
    let _claim = Outputs::new(args.force.force).reads(inputs).folder(Some(&folder), &RUN).claim()?;
    let started = jiff::Timestamp::now();
    let (mut record, trace) = if args.wire.driver.is_some() {
        let run = on_wire::run(&plan, &model, &dut, args.seed, &args.wire, &answers).inspect_err(|_| {
            // A run that never began leaves no empty folder behind; one that holds anything stays.
            let _ = std::fs::remove_dir(&folder);
        })?;
        if !run.frames.is_empty() {
            run_folder::write_text(&folder.join("frames.txt"), &on_wire::frames_text(&run.frames)).map_err(CliError::not_stored)?;
        }
        (run.record, run.trace)
    } else {
        let identity = RigIdentity {
            name: valve_path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            sha256: sha256(&valve_path)?,
            ..RigIdentity::default()
        };
        let mut rig = SimulatedRig::new(&valve, plan.period_s, Some(args.seed), identity).map_err(CliError::input)?;
        let stop = stop_on_signals()?;
        let options = RunOptions { model: &model, dut: &dut, seed: args.seed, stop: Some(&stop), prepared: None };
        let mut bar = Attended { observer: Bar::new(), attendant: answers.attendant() };
        let result = runner::run(&plan, &mut rig, &options, &mut bar);
        bar.observer.finish();
        result
    };
    record.provenance = Some(Provenance { version: env!("CARGO_PKG_VERSION").into(), started: started.to_string(), station: None });
    // The verdict is said after the record is stored.
    run_folder::write(&folder, &record, &trace)?;
    super::print(&formatted(args.format, &record, &trace))?;
    if args.format == Format::Text {
        super::say(&format!("stored in {}", folder.display()));
    }
    Ok(exit_code(record.outcome))
}

/// The valve under test: a simulated one has the name of its file, a real one that nobody named is unknown.
fn dut(args: &RunArgs, valve: &Valve) -> Dut {
    let unnamed = if args.sim { valve.name.clone() } else { "unknown".into() };
    Dut { serial: args.serial.clone().unwrap_or(unnamed), ..Dut::default() }
}

/// The exit code of an outcome.
pub fn exit_code(outcome: Outcome) -> u8 {
    match outcome {
        Outcome::Pass | Outcome::Marginal | Outcome::NotRun => exit::DONE,
        Outcome::Fail => exit::NEGATIVE,
        Outcome::Invalid => exit::INVALID,
        Outcome::Error => exit::RIG,
        Outcome::Aborted => exit::ABORTED,
    }
}

fn formatted(format: Format, record: &TestRecord, trace: &Trace) -> String {
    match format {
        Format::Text => report::text(record),
        Format::Json => report::json(record),
        Format::Markdown => report::markdown(record),
        Format::Junit => report::junit(record),
        Format::Html => report::html(record, trace),
    }
}

/// SHA-256 of a document's bytes, hex.
pub fn sha256(path: &Path) -> Result<String, CliError> {
    let text = document::read(path).map_err(CliError::input)?;
    Ok(digest::sha256(text))
}

/// A flag that the first signal sets that would end or stop the program.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    for number in signals::numbers() {
        // A signal that this system does not let be caught ends the program as ever.
        let _ = signal_hook::flag::register(number, Arc::clone(&stop));
    }
    Ok(stop)
}
