//! The arguments of `hil diagnose`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::jobs::JobsArgs;
use super::outputs::Force;
use super::reading::ReadArgs;
use crate::units::Time;

/// The options of a foreign base.
#[derive(Debug, Args)]
#[command(next_help_heading = "Foreign model (--model plant.fmu, or --simulated)")]
pub struct ForeignArgs {
    /// Instead of a model, the pressure that your own simulation gave for this very current: a column of the recording, or a
    /// file with time_s and pressure_bar
    #[arg(long, value_name = "COLUMN|FILE", conflicts_with_all = ["model", "jobs", "without"])]
    pub simulated: Option<String>,
    /// Run the native code inside this FMU with your rights; remembered for this very file
    #[arg(long)]
    pub(super) trust_fmu: bool,
    /// The input of the FMU that takes the current, where its units do not tell
    #[arg(long, value_name = "NAME")]
    pub(super) fmu_current: Option<String>,
    /// The output of the FMU that gives the pressure, where its units do not tell
    #[arg(long, value_name = "NAME")]
    pub(super) fmu_pressure: Option<String>,
    /// Step of the FMU, where it is not what the FMU and the recording say
    #[arg(long, value_name = "TIME")]
    pub(super) fmu_step: Option<Time>,
    /// Longest time that one run of the FMU may take
    #[arg(long, value_name = "TIME", default_value = "60 s")]
    pub(super) fmu_time_limit: Time,
}

/// What to diagnose.
#[derive(Debug, Args)]
pub struct DiagnoseArgs {
    /// The recording: .csv, .parquet or .mf4; several of one valve share what they show
    #[arg(required_unless_present = "jobs", conflicts_with = "jobs", value_name = "RECORDING")]
    pub(super) recordings: Vec<PathBuf>,
    /// The valve model: a file, or the bare name of one in valves/; or a foreign model, an FMU for co-simulation
    #[arg(long, value_name = "VALVE|FMU", required_unless_present_any = ["jobs", "simulated"], conflicts_with = "jobs")]
    pub(super) model: Option<String>,
    /// A foreign base.
    #[command(flatten)]
    pub(super) foreign: ForeignArgs,
    /// A drive of the good valve, which decides what has changed and what the model never had; several may be given.
    /// Without it, the recordings that the model was identified from, where they still lie beside it
    #[arg(long, value_name = "GOOD.csv")]
    pub(super) reference: Vec<PathBuf>,
    /// Writes the model with the effects that were found; every other command takes it
    #[arg(short = 'o', long, value_name = "AUGMENTED")]
    pub(super) output: Option<PathBuf>,
    /// Writes a page that tells the story
    #[arg(long, value_name = "FILE.html")]
    pub(super) report: Option<PathBuf>,
    /// Writes the plan of the experiment that would separate what cannot be told apart
    #[arg(long, value_name = "PLAN")]
    pub(super) next_plan: Option<PathBuf>,
    /// Takes a part out of the model first: an effect's id, `hysteresis` or `delay`
    #[arg(long, value_name = "PART")]
    pub(super) without: Vec<String>,
    /// Exit with 1 where the verdict is not `match`
    #[arg(long, value_enum, value_name = "mismatch")]
    pub(super) fail_on: Option<FailOn>,
    /// How the recording is read.
    #[command(flatten)]
    pub(super) reading: ReadArgs,
    /// Many recordings.
    #[command(flatten)]
    pub(super) many: JobsArgs,
    /// Existing files.
    #[command(flatten)]
    pub(super) force: Force,
    /// Format of what is printed
    #[arg(long, value_enum, default_value = "text")]
    pub(super) format: Format,
    /// Show every candidate when its fit has ended: one JSON object a line on stderr.
    #[arg(long)]
    pub(super) watch: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum FailOn {
    Mismatch,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum Format {
    Text,
    Json,
}
