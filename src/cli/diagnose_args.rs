//! The arguments of `hil diagnose`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use super::CliError;
use super::foreign_base::ForeignArgs;
use super::jobs::JobsArgs;
use super::outputs::Force;
use super::reading::ReadArgs;
use crate::diagnose::Criteria;

/// What to diagnose.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("base").args(["model", "simulated", "jobs"]).required(true)))]
pub struct DiagnoseArgs {
    /// The recording: .csv, .parquet or .mf4; several of one valve share what they show
    #[arg(required_unless_present = "jobs", conflicts_with = "jobs", value_name = "RECORDING")]
    pub(super) recordings: Vec<PathBuf>,
    /// The valve model: a file, or the bare name of one in valves/; or a foreign model, an FMU for co-simulation
    #[arg(long, value_name = "VALVE|FMU")]
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
    /// Decides by another threshold than the usual one, as `hil challenge --criteria` does to find what each is worth
    #[arg(long, value_name = "NAME=VALUE", conflicts_with_all = ["jobs", "simulated"])]
    pub(super) criterion: Vec<Criterion>,
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

/// A threshold of a diagnosis with another value than the usual one.
#[derive(Debug, Clone)]
pub(super) struct Criterion {
    name: String,
    value: f64,
}

impl FromStr for Criterion {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |value: &str| value.trim().parse::<f64>().ok();
        let (name, value) = text
            .split_once('=')
            .and_then(|(name, value)| Some((name.trim(), number(value)?)))
            .ok_or_else(|| format!("`{text}` is no NAME=VALUE, such as name_share=0.6"))?;
        Criteria::default().with(name, value)?;
        Ok(Self { name: name.to_owned(), value })
    }
}

impl DiagnoseArgs {
    /// The thresholds: the usual ones, less those that were given.
    pub(super) fn criteria(&self) -> Result<Criteria, CliError> {
        self.criterion.iter().try_fold(Criteria::default(), |all, c| all.with(&c.name, c.value)).map_err(CliError::usage)
    }
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
