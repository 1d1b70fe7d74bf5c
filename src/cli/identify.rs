//! `hil identify`: from a recording to a valve model.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use sha2::{Digest, Sha256};

use super::jobs::JobsArgs;
use super::outputs::{Force, VALVE};
use super::{CliError, CliResult, exit};
use crate::course::{Course, Preparation};
use crate::identify::{HysteresisChoice, Options, identify_course};
use crate::output::{Mark, Outputs};
use crate::recording::{Mapping, Recording, replace_file};
use crate::report;

/// Arguments of `hil identify`.
#[derive(Debug, Args)]
pub struct IdentifyArgs {
    /// The recording: time, current and measured pressure.
    #[arg(required_unless_present = "jobs", conflicts_with = "jobs")]
    recording: Option<PathBuf>,
    /// Write the valve model here.
    #[arg(short, long, value_name = "VALVE")]
    output: Option<PathBuf>,
    /// Whether the model has a hysteresis; found from the data where it is not given.
    #[arg(long, value_enum)]
    hysteresis: Option<HysteresisArg>,
    /// Order of the curves; found by held-out error where it is not given.
    #[arg(long, value_name = "N")]
    order: Option<usize>,
    /// Name of the valve; the recording's name where it is not given.
    #[arg(long)]
    name: Option<String>,
    /// Take a channel from a foreign column: current_a="I_cmd [mA]", current_a="0.01 * duty_pct".
    #[arg(long, value_name = "CH=EXPR")]
    map: Vec<String>,
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
    None,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Identifies, writes the model, prints what was found.
pub fn run(args: &IdentifyArgs) -> CliResult {
    let map = args.map.iter().map(|m| Mapping::parse(m)).collect::<Result<Vec<_>, _>>().map_err(CliError::usage)?;
    let options = Options {
        name: args.name.clone(),
        order: args.order,
        hysteresis: match args.hysteresis {
            None => HysteresisChoice::Auto,
            Some(HysteresisArg::Hyperbolic) => HysteresisChoice::Hyperbolic,
            Some(HysteresisArg::None) => HysteresisChoice::None,
        },
        sha256: None,
    };
    if args.many.jobs.is_some() {
        return super::jobs::run(&super::jobs::Identify { map, options }, &args.many);
    }
    let Some(path) = &args.recording else {
        return Err(CliError::usage("a RECORDING, or --jobs LIST"));
    };
    let outputs = Outputs::new(args.force.force).reads([path]);
    let _claim = outputs.file(args.output.as_ref(), VALVE).file(args.report.as_ref(), Mark::Page).claim()?;
    let recording = Recording::read(path, &map).map_err(CliError::input)?;
    let options = Options { sha256: Some(sha256(path)?), ..options };
    let course = Course::take(recording, &Preparation::default()).map_err(CliError::input)?;
    let found = identify_course(&course, &options).map_err(|e| match e {
        crate::identify::IdentifyError::Option { .. } => CliError::usage(e),
        other => CliError::input(other),
    })?;
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
    let wrong = |e: std::io::Error| CliError::input(format!("{}: {e}", path.display()));
    let mut file = std::fs::File::open(path).map_err(wrong)?;
    let mut hash = Sha256::new();
    let mut block = vec![0; 1 << 18];
    loop {
        match file.read(&mut block).map_err(wrong)? {
            0 => break,
            n => hash.update(&block[..n]),
        }
    }
    Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
}
