//! `hil compare`: records, recordings and models over each other, on one page.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::outputs::Force;
use super::reading::ReadArgs;
use super::valves::checked_valve;
use super::{CliError, CliResult, exit, run_folder};
use crate::course::{Course, Preparation};
use crate::output::{Mark, Outputs};
use crate::physics::simulate_course;
use crate::record::TestRecord;
use crate::recording::{Format as FileFormat, Recording, Run, replace_file};
use crate::report::compare::{Comparison, Item, Kind, Track, page, text};
use crate::valve::{Input, Valve};

/// What to compare.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Records (record.json or a run's folder), recordings (.csv, .parquet, .mf4) and valve models (a file, or a bare name); the others are compared with the first
    #[arg(required = true, num_args = 2..)]
    items: Vec<PathBuf>,
    /// How recordings are read.
    #[command(flatten)]
    reading: ReadArgs,
    /// The page
    #[arg(short = 'o', long, value_name = "FILE.html", default_value = "compare.html")]
    output: PathBuf,
    /// Existing files.
    #[command(flatten)]
    force: Force,
    /// What is printed
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// What a name on the command line stands for.
enum Source {
    Record(Box<TestRecord>, Vec<Run>),
    Recording(Recording),
    Model(Box<Valve>),
}

/// Loads, simulates the models on the first current, writes the page, prints the figures.
pub fn run(args: &CompareArgs) -> CliResult {
    let outputs = Outputs::new(args.force.force).reads(&args.items).reads(args.reading.files());
    let _claim = outputs.file(Some(&args.output), Mark::Page).claim()?;
    let sources = args.items.iter().map(|path| load(path, &args.reading)).collect::<Result<Vec<_>, _>>()?;
    let names = unique(&args.items);
    // Models see the current of the first item that has one, or a sweep where all are models.
    let made = |name: &str, runs: Vec<Run>| Recording { source: name.into(), runs, notes: Vec::new(), input: Some(Input::Held) };
    let driven = sources
        .iter()
        .zip(&names)
        .find_map(|(source, name)| match source {
            Source::Record(_, runs) if !runs.is_empty() => Some(made(name, runs.clone())),
            Source::Recording(recording) => Some(recording.clone()),
            _ => None,
        })
        .unwrap_or_else(|| match &sources[0] {
            Source::Model(valve) => made("a sweep", vec![sweep(valve)]),
            _ => made("no run", Vec::new()),
        });
    let items = names.iter().zip(sources).map(|(name, source)| item(name, source, &driven)).collect::<Result<Vec<_>, _>>()?;
    let comparison = Comparison::new(items);
    let html = page(&comparison);
    replace_file(&args.output, |file| file.write_all(html.as_bytes())).map_err(CliError::not_stored)?;
    match args.format {
        Format::Json => super::print(&super::to_json(&comparison.figures())?)?,
        Format::Text => super::print(&text(&comparison))?,
    }
    super::say(&format!("drawn in {}", args.output.display()));
    Ok(exit::DONE)
}

fn load(path: &Path, reading: &ReadArgs) -> Result<Source, CliError> {
    if path.join(crate::record::RECORD_FILE).is_file() || path.extension().is_some_and(|e| e == "json") {
        let record = TestRecord::load(path).map_err(CliError::input)?;
        let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
        let runs = run_folder::read_trace(folder, &record)?.map(|trace| trace.run());
        return Ok(Source::Record(Box::new(record), runs.into_iter().collect()));
    }
    if FileFormat::of(path).is_ok() {
        return Ok(Source::Recording(reading.read(path)?));
    }
    let name = path.to_str().ok_or_else(|| CliError::input(format!("{}: is no name", path.display())))?;
    if path.is_dir() {
        return Err(CliError::input(format!(
            "{}: is a folder without a {}; a run's folder is wanted",
            path.display(),
            crate::record::RECORD_FILE
        )));
    }
    let found = Valve::find(name).map_err(CliError::input)?;
    checked_valve(&found).map(|valve| Source::Model(Box::new(valve)))
}

/// What each is called: its file name, with more of its path where two would have the same.
fn unique(paths: &[PathBuf]) -> Vec<String> {
    let name = |path: &Path, parts: usize| {
        let all: Vec<String> = path.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
        all[all.len().saturating_sub(parts)..].join("/")
    };
    (0..paths.len())
        .map(|at| {
            let parts = (1..8).find(|parts| paths.iter().enumerate().all(|(k, p)| k == at || name(p, *parts) != name(&paths[at], *parts)));
            match parts {
                Some(parts) => name(&paths[at], parts),
                None => format!("{} ({})", name(&paths[at], 1), at + 1),
            }
        })
        .collect()
}

/// Two slow triangles over the whole range of a model's curves.
fn sweep(valve: &Valve) -> Run {
    let (low, high) = valve.curves.range_a;
    let time_s: Vec<f64> = (0..4000).map(|n| f64::from(n) * 0.01).collect();
    let current_a = time_s.iter().map(|t| low + (high - low) * (1.0 - (2.0 * (t / 20.0).fract() - 1.0).abs())).collect();
    Run { name: Some("sweep".into()), time_s, current_a, ..Run::default() }
}

fn item(name: &str, source: Source, driven: &Recording) -> Result<Item, CliError> {
    let track = |run: Run| {
        let start = run.time_s.first().copied().unwrap_or(0.0);
        Track {
            name: run.name.unwrap_or_default(),
            time_s: run.time_s.iter().map(|t| t - start).collect(),
            current_a: run.current_a,
            pressure_bar: run.pressure_bar.unwrap_or_default(),
        }
    };
    Ok(match source {
        Source::Record(record, runs) => {
            Item { name: name.into(), kind: Kind::Record, tracks: runs.into_iter().map(track).collect(), record: Some(record) }
        }
        Source::Recording(recording) => {
            Item { name: name.into(), kind: Kind::Recording, tracks: recording.runs.into_iter().map(track).collect(), record: None }
        }
        Source::Model(valve) => {
            let simulated = if driven.runs.is_empty() {
                Vec::new()
            } else {
                let course = Course::of(driven, &Preparation::for_model(driven, &valve)).map_err(CliError::input)?;
                let on_grids = simulate_course(&valve, &course).map_err(|e| CliError::input(format!("{name}: {e}")))?;
                (0..).zip(&driven.runs).map(|(number, run)| course.on_recorded(number, &run.time_s, &on_grids)).collect()
            };
            let runs = driven.runs.iter().zip(simulated);
            let tracks = runs.map(|(run, pressure_bar)| track(Run { pressure_bar: Some(pressure_bar), ..run.clone() })).collect();
            Item { name: name.into(), kind: Kind::Model, tracks, record: None }
        }
    })
}
