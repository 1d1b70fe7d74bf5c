//! `hil export`: a batch or a model in the formats of other trades.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::outputs::{Force, VALVE};
use super::{CliError, CliResult, exit, note};
use crate::exchange::aqdef::Lot;
use crate::exchange::fmu::{Export, Part, Version, find_library};
use crate::exchange::{Attached, Side};
use crate::output::{Mark, Outputs};
use crate::recording::replace_file;
use crate::units::Time;
use crate::valve::Valve;

/// What goes where.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// The folder of a batch, a valve model (a file, or the bare name of one that ships), or what a diagnosis found about a
    /// foreign model
    source: PathBuf,
    /// The file to write: .fmu and .json of a model, .dfq (AQDEF) of a batch
    #[arg(short = 'o', long, value_name = "FILE")]
    output: PathBuf,
    /// Version of FMI
    #[arg(long, value_name = "2|3", default_value = "2", value_parser = clap::value_parser!(u8).range(2..=3))]
    fmi: u8,
    /// Step of the model inside an FMU; a master's steps are whole multiples of it
    #[arg(long, value_name = "TIME", default_value = "10 ms")]
    step: Time,
    /// The library that goes into an FMU, where it does not lie beside the program
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
    /// Which effects about a foreign model go into the FMU, where some act ahead of it and others behind
    #[arg(long, value_enum)]
    side: Option<SideArg>,
    /// The part number to hand over, where a batch holds several
    #[arg(long, value_name = "NUMBER")]
    part: Option<String>,
    /// Whether an existing file may be replaced.
    #[command(flatten)]
    force: Force,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SideArg {
    Ahead,
    Behind,
}

/// Writes the file.
pub fn run(args: &ExportArgs) -> CliResult {
    let ending = args.output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if !matches!(ending.as_str(), "dfq" | "fmu" | "json") {
        return Err(CliError::usage(format!("{}: the ending says what to write: .fmu, .json or .dfq", args.output.display())));
    }
    let mark = if ending == "json" { VALVE } else { Mark::None };
    let _claim = Outputs::new(args.force.force).reads([&args.source]).file(Some(&args.output), mark).claim()?;
    match ending.as_str() {
        "dfq" => lot(args),
        "fmu" => fmu(args),
        _ => json(args),
    }
}

fn lot(args: &ExportArgs) -> CliResult {
    let lot = Lot::read(&args.source, args.part.as_deref()).map_err(CliError::input)?;
    store(&args.output, &lot.to_dfq())?;
    if lot.not_judged > 0 {
        note(&format!("note: {} valve(s) without a verdict are not in the file", lot.not_judged));
    }
    note(&format!("{}: {} valves, {} characteristics", args.output.display(), lot.len(), lot.characteristics()));
    Ok(exit::DONE)
}

/// The model's file: its path and its text.
fn model(args: &ExportArgs) -> Result<(PathBuf, String), CliError> {
    let path = Valve::find(&args.source.to_string_lossy()).map_err(CliError::input)?;
    let text = crate::document::read(&path).map_err(|e| CliError::input(e.to_string()))?;
    Ok((path, text))
}

/// The text of a valve, and what of it goes into the FMU.
fn part(args: &ExportArgs, path: &Path, text: String) -> Result<(String, Part), CliError> {
    if !Attached::is(&text) {
        return match args.side {
            Some(_) => Err(CliError::usage("--side: is for what a diagnosis found about a foreign model")),
            None => Ok((text, Part::Whole)),
        };
    }
    let attached = Attached::load(path).map_err(CliError::input)?;
    let of = |side| attached.side(side).map_err(CliError::input);
    let (valve, part) = match args.side {
        Some(SideArg::Ahead) => (of(Side::Ahead)?, Part::Ahead),
        Some(SideArg::Behind) => (of(Side::Behind)?, Part::Behind),
        None => match (of(Side::Ahead), of(Side::Behind)) {
            (Ok(_), Ok(_)) => {
                let what = "holds effects on both sides of the model; --side ahead and --side behind export one FMU each";
                return Err(CliError::usage(format!("{}: {what}", path.display())));
            }
            (Ok(ahead), Err(_)) => (ahead, Part::Ahead),
            (Err(_), Ok(behind)) => (behind, Part::Behind),
            (Err(_), Err(e)) => return Err(e),
        },
    };
    Ok((valve.to_toml(), part))
}

fn fmu(args: &ExportArgs) -> CliResult {
    let (path, text) = model(args)?;
    let (text, part) = part(args, &path, text)?;
    let export = Export::new(&text, &path.display().to_string(), part, args.step).map_err(CliError::input)?;
    let library = args.library.clone().map_or_else(find_library, Ok).map_err(CliError::usage)?;
    let bytes = std::fs::read(&library).map_err(|e| CliError::usage(format!("{}: {e}", library.display())))?;
    let version = if args.fmi == 2 { Version::Two } else { Version::Three };
    let archive = export.archive(version, &bytes).map_err(CliError::not_stored)?;
    store(&args.output, &archive)?;
    for text in export.notes() {
        note(&format!("note: {text}"));
    }
    note(&format!("{}: FMI {}.0 for co-simulation, linux64 only, {} kB", args.output.display(), args.fmi, archive.len() / 1000));
    Ok(exit::DONE)
}

/// The model as JSON: the valve file, key by key; `hil schema valve` describes it.
fn json(args: &ExportArgs) -> CliResult {
    let (path, text) = model(args)?;
    let valve = Valve::from_toml(&text, &path.display().to_string()).map_err(CliError::input)?;
    let table: toml::Table = toml::from_str(&valve.to_toml()).map_err(|e| CliError { code: exit::INTERNAL, message: e.to_string() })?;
    store(&args.output, super::to_json(&table)?.as_bytes())?;
    note(&format!("{}: the model, described by `hil schema valve`", args.output.display()));
    Ok(exit::DONE)
}

fn store(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    replace_file(path, |file| file.write_all(bytes)).map_err(CliError::not_stored)
}
