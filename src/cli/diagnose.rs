//! `hil diagnose`: where a simulation and a recording differ, what is missing, and how sure that is.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::jobs::JobsArgs;
use super::outputs::{Force, PLAN, VALVE};
use super::run::checked_valve;
use super::{CliError, CliResult, exit};
use crate::diagnose::{Diagnosed, Verdict, diagnose, story};
use crate::output::{Mark, Outputs};
use crate::physics::EFFECTS;
use crate::recording::{Mapping, Recording, replace_file};
use crate::report;
use crate::valve::{Hysteresis, Valve};

/// What to diagnose.
#[derive(Debug, Args)]
pub struct DiagnoseArgs {
    /// The recording: .csv, .parquet or .mf4
    #[arg(required_unless_present = "jobs", conflicts_with = "jobs")]
    recording: Option<PathBuf>,
    /// The valve model: a file, or the bare name of one in valves/
    #[arg(long, value_name = "VALVE", required_unless_present = "jobs", conflicts_with = "jobs")]
    model: Option<String>,
    /// Writes the model with the effects that were found; every other command takes it
    #[arg(short = 'o', long, value_name = "AUGMENTED")]
    output: Option<PathBuf>,
    /// Writes a page that tells the story
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Writes the plan of the experiment that would separate what cannot be told apart
    #[arg(long, value_name = "PLAN")]
    next_plan: Option<PathBuf>,
    /// Takes a part out of the model first: an effect's id, `hysteresis` or `delay`
    #[arg(long, value_name = "PART")]
    without: Vec<String>,
    /// Exit with 1 where the verdict is not `match`
    #[arg(long, value_enum, value_name = "mismatch")]
    fail_on: Option<FailOn>,
    /// Takes a foreign channel, for instance current_a="I_cmd [mA]" or current_a="0.01 * duty_pct"
    #[arg(long, value_name = "CH=EXPR")]
    map: Vec<String>,
    /// Many recordings.
    #[command(flatten)]
    many: JobsArgs,
    /// Existing files.
    #[command(flatten)]
    force: Force,
    /// Format of what is printed
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FailOn {
    Mismatch,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Diagnoses, writes what was asked for, prints.
pub fn run(args: &DiagnoseArgs) -> CliResult {
    let map = args.map.iter().map(|m| Mapping::parse(m)).collect::<Result<Vec<_>, _>>().map_err(CliError::usage)?;
    if args.many.jobs.is_some() {
        return super::jobs::run(&super::jobs::Diagnose { map }, &args.many);
    }
    let (Some(recording), Some(model)) = (&args.recording, &args.model) else {
        return Err(CliError::usage("a RECORDING and --model VALVE, or --jobs LIST"));
    };
    let model = Valve::find(model).map_err(CliError::input)?;
    let outputs = Outputs::new(args.force.force).reads([recording, &model]).file(args.output.as_ref(), VALVE);
    let _claim = outputs.file(args.report.as_ref(), Mark::Page).file(args.next_plan.as_ref(), PLAN).claim()?;
    let mut valve = checked_valve(&model)?;
    for part in &args.without {
        take_out(&mut valve, part)?;
    }
    let recording = Recording::read(recording, &map).map_err(CliError::input)?;
    let diagnosed = diagnose(&recording, &valve).map_err(CliError::input)?;
    if let Some(path) = &args.output {
        store(path, &diagnosed.augmented.to_toml())?;
    }
    if let Some(path) = &args.report {
        store(path, &report::diagnosis::page(&diagnosed, &story(&diagnosed)))?;
    }
    if let Some(path) = &args.next_plan {
        next_plan(path, args, &diagnosed)?;
    }
    match args.format {
        Format::Json => super::print(&report::diagnosis::json(&diagnosed.diagnosis))?,
        Format::Text => super::print(&report::diagnosis::text(&diagnosed.diagnosis))?,
    }
    let mismatch = args.fail_on.is_some() && diagnosed.diagnosis.verdict != Verdict::Match;
    Ok(if mismatch { exit::NEGATIVE } else { exit::DONE })
}

/// Removes a part of a model, as if it had never been there.
fn take_out(valve: &mut Valve, part: &str) -> Result<(), CliError> {
    match part {
        "hysteresis" => valve.hysteresis = Hysteresis::None,
        "delay" => (valve.delay_s, valve.delay_range_s) = (0.0, (0.0, 0.0)),
        id => {
            let before = valve.effects.len();
            valve.effects.retain(|e| e.id != id);
            if id == "first_order_lag" && valve.lag_s > 0.0 {
                valve.lag_s = 0.0;
            } else if valve.effects.len() == before {
                let parts: Vec<&str> = valve.effects.iter().map(|e| e.id.as_str()).collect();
                let known = if EFFECTS.iter().any(|e| e.id() == id) { "is not in this model" } else { "is no part" };
                return Err(CliError::usage(format!(
                    "--without {id}: {known}; the model has: hysteresis, delay{}{}",
                    if parts.is_empty() { "" } else { ", " },
                    parts.join(", ")
                )));
            }
        }
    }
    Ok(())
}

/// Writes the plan of the next experiment, or says why there is none.
fn next_plan(path: &Path, args: &DiagnoseArgs, diagnosed: &Diagnosed) -> Result<(), CliError> {
    let Some(next) = &diagnosed.diagnosis.next_experiment else {
        super::note(&format!(
            "nothing was found that a rival could explain, so there is no experiment to plan; {} is not written",
            path.display()
        ));
        return Ok(());
    };
    // A plan names its valve: the augmented model where it is stored, otherwise the one that was diagnosed.
    let model = args.output.as_ref().map_or_else(|| args.model.clone().unwrap_or_default(), |p| p.display().to_string());
    store(path, &next.plan(&model, &diagnosed.augmented))
}

fn store(path: &Path, text: &str) -> Result<(), CliError> {
    replace_file(path, |file| file.write_all(text.as_bytes())).map_err(CliError::not_stored)
}
