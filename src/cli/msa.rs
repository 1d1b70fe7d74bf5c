//! `hil msa`: gauge R&R from readings, or by running a plan on parts, appraisers and trials.

use std::io::BufRead;
use std::path::PathBuf;

use clap::Args;
use rand::SeedableRng;
use rand::seq::SliceRandom;

use super::batch_args::RigArgs;
use super::batch_bench::Setup;
use super::batch_error::failed;
use super::outputs::Force;
use super::progress::Counted;
use super::run::{exit_code, key_value};
use super::{CliError, CliResult, exit, files};
use crate::batch::measuring::{Instrument, MeasuringCapability, measuring_capability};
use crate::batch::msa::{GaugeStudy, Study, gauge_study};
use crate::batch::population::Population;
use crate::batch::store::write_whole;
use crate::batch::tally::measurements;
use crate::batch::{BatchError, readings};
use crate::output::{Mark, Outputs};
use crate::plan::Override;
use crate::record::{Dut, TestRecord};
use crate::report::batch::{msa_markdown, msa_text};
use crate::units::Unit;

/// Arguments of `hil msa`.
#[derive(Debug, Args)]
pub struct MsaArgs {
    /// Readings (.csv: part, appraiser, trial, value), or a plan (.toml) that is run.
    pub source: PathBuf,
    /// With a plan: the metric that is studied, `phase/metric`.
    #[arg(long)]
    pub metric: Option<String>,
    /// Width between the limits, with its unit; from the plan's limit where that has both sides.
    #[arg(long, value_name = "VALUE")]
    pub tolerance: Option<String>,
    /// Expanded uncertainty (k = 2) of the instrument's calibration, with its unit: for %Q_MS and %Q_MP
    #[arg(long, value_name = "VALUE")]
    pub calibration_uncertainty: Option<String>,
    /// Smallest step of the instrument's reading, with its unit
    #[arg(long, value_name = "VALUE")]
    pub resolution: Option<String>,
    /// Difference of the mean reading from a reference, with its unit
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true)]
    pub bias: Option<String>,
    /// Standard deviation of repeated readings of a reference, with its unit
    #[arg(long, value_name = "VALUE")]
    pub reference_deviation: Option<String>,
    /// Largest deviation of the instrument from linearity, with its unit
    #[arg(long, value_name = "VALUE")]
    pub linearity: Option<String>,
    /// Number of parts.
    #[arg(long, default_value_t = 10)]
    pub parts: usize,
    /// Number of appraisers: operators, days, mountings, sites.
    #[arg(long, default_value_t = 3)]
    pub appraisers: usize,
    /// Readings of each appraiser on each part.
    #[arg(long, default_value_t = 3)]
    pub trials: usize,
    /// Where and on what is tested.
    #[command(flatten)]
    pub rig: RigArgs,
    /// Simulated population that the parts are drawn from.
    #[arg(long, value_name = "FILE")]
    pub population: Option<PathBuf>,
    /// Change a parameter of the plan.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub set: Vec<Override>,
    /// Seed of everything random, also of the order of the readings.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the readings and the study to files in this folder.
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
    /// Tables for a terminal.
    #[default]
    Text,
    /// The study.
    Json,
    /// For a mail or a pull request.
    Markdown,
}

/// Readings with what is known of their metric.
struct Readings {
    name: String,
    unit: String,
    tolerance: Option<f64>,
    study: Study,
    simulated: bool,
}

/// Runs the command.
pub fn run(args: &MsaArgs) -> CliResult {
    let names = [("readings.csv", Mark::None), ("msa.json", Mark::Schema("hil.msa/1"))];
    let _claim = Outputs::new(args.force.force).reads([&args.source]).folder(args.out.as_ref(), &names).claim()?;
    // A name without an ending is that of a plan, unless a file of readings has it.
    let is_plan = args.source.extension().map_or_else(|| !args.source.is_file(), |e| e == "toml");
    let taken = if is_plan { take(args)? } else { read(args)? };
    let study = gauge_study(&taken.study, taken.tolerance).map_err(CliError::input)?;
    let capability = measuring_capability(&study, &instrument(args, &taken.unit)?, taken.tolerance);
    let json = json(&taken, &study, &capability);
    if let Some(dir) = &args.out {
        write_whole(&dir.join("readings.csv"), readings::write(&taken.study).as_bytes()).map_err(failed)?;
        write_whole(&dir.join("msa.json"), json.as_bytes()).map_err(failed)?;
    }
    let mark = if taken.simulated { "SIMULATION or EMULATED - this says nothing of a real gauge\n" } else { "" };
    super::print(&match args.format {
        Format::Text => format!("{mark}{}", msa_text(&taken.name, &taken.unit, &study, &capability)),
        Format::Markdown => format!("{mark}{}", msa_markdown(&taken.name, &taken.unit, &study, &capability)),
        Format::Json => json,
    })?;
    Ok(if study.verdict == "unacceptable" { exit::NEGATIVE } else { exit::DONE })
}

/// What the options say of the instrument, in the metric's unit.
fn instrument(args: &MsaArgs, unit: &str) -> Result<Instrument, CliError> {
    let of = |option: &str, text: &Option<String>| {
        let Some(text) = text else { return Ok(None) };
        let wrong = |problem: String| CliError::usage(format!("--{option} {text}: {problem}"));
        match Unit::by_symbol(unit).or_else(|| Unit::of_text(text)) {
            Some(unit) => unit.parse(text).map(Some).map_err(|e| wrong(e.to_string())),
            None => Err(wrong("a number with its unit is wanted, for instance \"5 mbar\"".into())),
        }
    };
    Ok(Instrument {
        calibration_uncertainty: of("calibration-uncertainty", &args.calibration_uncertainty)?,
        resolution: of("resolution", &args.resolution)?,
        bias: of("bias", &args.bias)?,
        reference_deviation: of("reference-deviation", &args.reference_deviation)?,
        linearity: of("linearity", &args.linearity)?,
    })
}

fn json(taken: &Readings, study: &GaugeStudy, capability: &MeasuringCapability) -> String {
    let value = serde_json::json!({
        "schema": "hil.msa/1", "metric": taken.name, "unit": taken.unit, "simulated": taken.simulated, "tolerance": taken.tolerance, "study": study, "capability": capability,
    });
    format!("{}\n", serde_json::to_string_pretty(&value).unwrap_or_default())
}

fn read(args: &MsaArgs) -> Result<Readings, CliError> {
    let study = readings::read(&args.source).map_err(failed)?;
    let unit = args.tolerance.as_deref().and_then(Unit::of_text);
    let tolerance = match (&args.tolerance, unit) {
        (None, _) => None,
        (Some(text), Some(unit)) => Some(width(text, unit)?),
        (Some(text), None) => {
            return Err(CliError::usage(format!("--tolerance {text}: a number with its unit is wanted, for instance \"0.6 bar\"")));
        }
    };
    let name = args.metric.clone().unwrap_or_else(|| args.source.display().to_string());
    Ok(Readings { name, unit: unit.map_or("", |u| u.symbol).into(), tolerance, study, simulated: false })
}

fn width(text: &str, unit: &'static Unit) -> Result<f64, CliError> {
    let value = unit.parse(text).map_err(|e| CliError::usage(format!("--tolerance {text}: {e}")))?;
    if value > 0.0 { Ok(value) } else { Err(CliError::usage(format!("--tolerance {text}: must be positive"))) }
}

/// Runs the plan for every part, appraiser and trial, in a random order within each trial, as the method wants it.
fn take(args: &MsaArgs) -> Result<Readings, CliError> {
    let Some(metric) = &args.metric else {
        return Err(CliError::usage("--metric is needed with a plan: phase/metric, for instance tip-in/rmse"));
    };
    let plan = files::plan(&args.source, &args.set)?;
    let population = match &args.population {
        Some(path) => Population::load(&files::population(path)?).map_err(failed)?,
        None => Population::standard(),
    };
    let setup = Setup::new(&args.rig, plan, Some(population), args.seed, None)?;
    let names = |prefix: &str, count: usize| (1..=count).map(|i| format!("{prefix}{i}")).collect::<Vec<_>>();
    let (parts, appraisers) = (names("part ", args.parts), names("appraiser ", args.appraisers));
    let mut values = vec![vec![Vec::with_capacity(args.trials); args.appraisers]; args.parts];
    let mut order: Vec<(usize, usize)> = (0..args.parts).flat_map(|i| (0..args.appraisers).map(move |j| (i, j))).collect();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(args.seed);
    let mut facts: Option<(String, Option<f64>)> = None;
    let mut emulated = false;
    let mut input = std::io::stdin().lock();
    let progress = setup.simulated().then(|| Counted::new("runs", args.trials * order.len()));
    for trial in 0..args.trials {
        order.shuffle(&mut rng);
        for &(i, j) in &order {
            if !setup.simulated() {
                super::note(&format!("{}, {}, trial {}: mount it and press Enter", parts[i], appraisers[j], trial + 1));
                input.read_line(&mut String::new()).map_err(|e| CliError::rig(format!("stdin: {e}")))?;
            }
            let dut = Dut { serial: parts[i].replace(' ', "-"), ..Dut::default() };
            let attempt = (1 + trial * args.appraisers + j) as u32;
            let (record, _) = setup.attempt(0, i, attempt, &dut).map_err(failed)?;
            if record.ended_unsafe() {
                return Err(CliError::rig(format!("{}: {}", record.dut.serial, record.reasons.join("; "))));
            }
            // What was measured under a broken condition is no reading.
            if record.outcome.is_broken() {
                let message = format!("{}: {}", record.dut.serial, record.reasons.join("; "));
                return Err(CliError { code: exit_code(record.outcome), message });
            }
            emulated |= record.rig.emulated;
            let found = reading(&record, metric)?;
            facts.get_or_insert((found.1, found.2));
            values[i][j].push(found.0);
            progress.iter().for_each(Counted::step);
        }
    }
    let (unit, of_plan) = facts.unwrap_or_default();
    let tolerance = match (&args.tolerance, Unit::by_symbol(&unit)) {
        (Some(text), Some(unit)) => Some(width(text, unit)?),
        _ => of_plan,
    };
    Ok(Readings {
        name: metric.clone(),
        unit,
        tolerance,
        study: Study { parts, appraisers, values },
        simulated: setup.simulated() || emulated,
    })
}

/// Value, unit and width between the limits of the metric in a record.
fn reading(record: &TestRecord, wanted: &str) -> Result<(f64, String, Option<f64>), CliError> {
    let found = measurements(record).find(|(phase, name, _)| format!("{phase}/{name}") == wanted);
    let Some((_, _, m)) = found else {
        let known: Vec<String> = measurements(record).map(|(phase, name, _)| format!("{phase}/{name}")).collect();
        return Err(CliError::usage(format!("--metric {wanted}: the plan measures: {}", known.join(", "))));
    };
    let why = || record.reasons.first().or(m.reason.as_ref()).cloned().unwrap_or_default();
    let value =
        m.value.ok_or_else(|| failed(BatchError::Rig(format!("{wanted} could not be measured on {}: {}", record.dut.serial, why()))))?;
    let width = m.limit.as_ref().and_then(|l| Some(l.max? - l.min?));
    Ok((value, m.unit.clone(), width))
}
