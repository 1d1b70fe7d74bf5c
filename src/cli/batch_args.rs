//! The arguments of `hil batch`, which the station fills in for its batches.

use std::path::PathBuf;

use clap::Args;

use super::on_wire::WireArgs;
use super::outputs::Force;
use super::run::key_value;
use crate::plan::Override;

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
    pub rig: RigArgs,
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

/// Where and on what is tested.
#[derive(Debug, Clone, Args)]
pub struct RigArgs {
    /// Run on simulated valves.
    #[arg(long)]
    pub sim: bool,
    /// Driver and line.
    #[command(flatten)]
    pub wire: WireArgs,
    /// A further site with the same driver: its serial port or HOST:PORT. Sites test at once, unless the station's supply is shared.
    #[arg(long = "site", value_name = "PLACE", requires = "driver", help_heading = "Hardware")]
    pub sites: Vec<String>,
    /// Valve file, or the bare name of one in valves/: what is simulated, the middle of the population, what the controller believes in.
    #[arg(long)]
    pub valve: Option<String>,
}
