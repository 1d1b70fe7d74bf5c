//! `hil identify`: from recordings of a valve to its model.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::jobs::JobsArgs;
use super::outputs::{Force, VALVE};
use super::progress::Working;
use super::reading::{ReadArgs, distinct};
use super::{CliError, CliResult, exit};
use crate::course::{Course, Preparation};
use crate::digest;
use crate::identify::{HysteresisChoice, Options, identify_courses};
use crate::output::{Mark, Outputs};
use crate::recording::replace_file;
use crate::report;

/// Arguments of `hil identify`.
#[derive(Debug, Args)]
pub struct IdentifyArgs {
    /// The recordings of the good valve: time, current and measured pressure; several are fitted together, a sweep and a
    /// commissioning drive, say.
    #[arg(required_unless_present = "jobs", conflicts_with = "jobs", value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Write the valve model here.
    #[arg(short, long, value_name = "VALVE")]
    output: Option<PathBuf>,
    /// Whether the model has a hysteresis; found from the data where it is not given.
    #[arg(long, value_enum)]
    hysteresis: Option<HysteresisArg>,
    /// A pressure that falls while the current rises is meant, and no turned sign.
    #[arg(long)]
    falling: bool,
    /// Order of the curves; found by held-out error where it is not given.
    #[arg(long, value_name = "N")]
    order: Option<usize>,
    /// Name of the valve; the recording's name where it is not given.
    #[arg(long)]
    name: Option<String>,
    /// How the recording is read.
    #[command(flatten)]
    reading: ReadArgs,
    /// Write a page with loop, residuals and parameters here.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Many recordings.
    #[command(flatten)]
    many: JobsArgs,
    /// Existing files.
    #[command(flatten)]
    force: Force,
    /// Format of what is printed.
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum HysteresisArg {
    Hyperbolic,
    Free,
    None,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Identifies, writes the model, prints what was found.
pub fn run(args: &IdentifyArgs) -> CliResult {
    let reading = args.reading.reading()?;
    let options = Options {
        name: args.name.clone(),
        order: args.order,
        hysteresis: match args.hysteresis {
            None => HysteresisChoice::Auto,
            Some(HysteresisArg::Hyperbolic) => HysteresisChoice::Hyperbolic,
            Some(HysteresisArg::Free) => HysteresisChoice::Free,
            Some(HysteresisArg::None) => HysteresisChoice::None,
        },
        input: reading.input,
        falling: args.falling,
        sha256: Vec::new(),
    };
    if args.many.jobs.is_some() {
        let map = reading.map.clone();
        return super::jobs::run(&super::jobs::Identify { reading, options }, &map, &args.many);
    }
    distinct(&args.recordings)?;
    let outputs = Outputs::new(args.force.force).reads(&args.recordings).reads(args.reading.files());
    let _claim = outputs.file(args.output.as_ref(), VALVE).file(args.report.as_ref(), Mark::Page).claim()?;
    let preparation = Preparation { input: options.input, ..Preparation::default() };
    let course = |path: &PathBuf| {
        let recording = args.reading.read(path)?;
        Course::take(recording, &preparation).map_err(CliError::input)
    };
    let courses = args.recordings.iter().map(course).collect::<Result<Vec<_>, CliError>>()?;
    let options = Options { sha256: args.recordings.iter().map(|path| sha256(path)).collect::<Result<_, _>>()?, ..options };
    let working = Working::on("identifying");
    let found = identify_courses(&courses, &options).map_err(|e| match e {
        crate::identify::IdentifyError::Option { .. } => CliError::usage(e),
        other => CliError::input(other),
    })?;
    drop(working);
    if let Some(path) = &args.output {
        store(path, &found.valve.to_toml())?;
    }
    if let Some(path) = &args.report {
        store(path, &report::identify::html(&found))?;
    }
    match args.format {
        Format::Json => super::print(&report::identify::json(&found))?,
        Format::Text => super::print(&report::identify::text(&found))?,
    }
    Ok(exit::DONE)
}

fn store(path: &Path, text: &str) -> Result<(), CliError> {
    replace_file(path, |file| file.write_all(text.as_bytes())).map_err(CliError::not_stored)
}

/// SHA-256 of a file's bytes, hex.
pub(super) fn sha256(path: &Path) -> Result<String, CliError> {
    digest::sha256_of_file(path).map_err(|e| CliError::input(format!("{}: {e}", path.display())))
}
