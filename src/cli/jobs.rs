//! `--jobs LIST`: the same command over many recordings, in parts, with rows that survive every kill.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use clap::Args;

use super::foreign_base::{ForeignArgs, InFile};
use super::lock::lock;
use super::shard::Shard;
use super::valves::checked_valve;
use super::{CliError, CliResult, exit};
use crate::course::{Course, Preparation};
use crate::diagnose::{Foreign, diagnose, diagnose_foreign as against_foreign};
use crate::exchange::{Attached, BaseFile};
use crate::fleet::FleetError;
use crate::fleet::list::{Job, ModelSource, read, read_groups};
use crate::fleet::store::Store;
use crate::fleet::work::{Progress, Task, work};
use crate::identify::{Identified, Options, identify_course};
use crate::recording::{Mapping, Reading, Recording, Selection};
use crate::report;
use crate::valve::Valve;

/// Many recordings at once.
#[derive(Debug, Clone, Args)]
pub struct JobsArgs {
    /// Many recordings: a list (CSV, JSON lines, Parquet; `-`: standard input) with the columns id, recording, model and
    /// free ones such as serial, lot, date, mileage. `model` is a path, `identify:SWEEP`, or empty for the part number's
    /// file in --models
    #[arg(long, value_name = "LIST", requires = "out", conflicts_with = "output", conflicts_with = "report")]
    pub jobs: Option<String>,
    /// LIST is a Parquet file with many recordings in it: each value of this column, such as a serial number, is one; columns
    /// that do not change within it are its free columns
    #[arg(long, value_name = "COLUMN", requires = "jobs")]
    pub group_by: Option<String>,
    /// Folder of the rows and answers; what is there and agrees in recording, model and version is not done again
    #[arg(long, value_name = "DIR", requires = "jobs")]
    pub out: Option<PathBuf>,
    /// Folder of valve models, one file a part number
    #[arg(long, value_name = "DIR", requires = "jobs")]
    pub models: Option<PathBuf>,
    /// Only part I of N, such as 3/8
    #[arg(long, value_name = "I/N", requires = "jobs")]
    pub shard: Option<Shard>,
    /// Jobs at a time; all cores where it is not given
    #[arg(long, value_name = "N", requires = "jobs", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

/// `hil diagnose` of a job.
pub struct Diagnose {
    /// How the recordings are read.
    pub reading: Reading,
    /// How models that are not ours are run.
    pub foreign: ForeignArgs,
}

/// What a recording is diagnosed against.
pub enum Base {
    /// A valve model of ours.
    Valve(Box<Valve>),
    /// A foreign model, and how an answer names it.
    Foreign(Foreign, BaseFile),
}

impl Diagnose {
    fn base(&self, path: &Path) -> Result<Base, CliError> {
        let Some(file) = InFile::of(path)? else { return Ok(Base::Valve(Box::new(checked_valve(path)?))) };
        let (foreign, file) = file.ready(&self.foreign, path)?;
        // An answer lies elsewhere than its list: the base is named in full.
        Ok(Base::Foreign(foreign, BaseFile { fmu: file.fmu.map(|p| p.canonicalize().unwrap_or(p)), ..file }))
    }
}

impl Task for Diagnose {
    type Model = Base;

    fn name(&self) -> &'static str {
        "diagnose"
    }
    fn needs_model(&self) -> bool {
        true
    }
    fn model(&self, source: &ModelSource) -> Result<Base, String> {
        match source {
            ModelSource::File(path) => self.base(path).map_err(|e| e.message),
            ModelSource::Identify(path) => {
                // What is selected is selected of the job's own recording.
                let reading = Reading { select: Selection::default(), ..self.reading.clone() };
                let sweep = Recording::read_as(path, &reading).map_err(|e| e.to_string());
                sweep
                    .and_then(|sweep| identified(sweep, &Options::default()))
                    .map(|found| Base::Valve(Box::new(found.valve)))
                    .map_err(|e| format!("identify: {e}"))
            }
            ModelSource::Missing(why) => Err(why.clone()),
        }
    }
    fn answer(&self, job: &Job, model: Option<&Base>) -> Result<Vec<(&'static str, String)>, String> {
        let base = model.ok_or("no model")?;
        let recording = job.read(&self.reading)?;
        let (model, diagnosed) = match base {
            Base::Valve(valve) => {
                let mut found = diagnose(&recording, valve).map_err(|e| e.to_string())?;
                super::valves::name_apart(&mut found.augmented, valve);
                (Some(found.augmented.to_toml()), found)
            }
            Base::Foreign(foreign, file) => {
                let found = against_foreign(&recording, foreign, &[]).map_err(|e| e.to_string())?;
                (Attached::of(&found, file.clone()).map(|a| a.to_toml()), found)
            }
        };
        Ok(model.map(|text| ("toml", text)).into_iter().chain([("json", report::diagnosis::json(&diagnosed.diagnosis))]).collect())
    }
}

/// `hil identify` of a job.
pub struct Identify {
    /// How the recordings are read.
    pub reading: Reading,
    /// As on the command line.
    pub options: Options,
}

impl Task for Identify {
    type Model = ();

    fn name(&self) -> &'static str {
        "identify"
    }
    fn needs_model(&self) -> bool {
        false
    }
    fn model(&self, _: &ModelSource) -> Result<(), String> {
        Ok(())
    }
    fn answer(&self, job: &Job, _: Option<&()>) -> Result<Vec<(&'static str, String)>, String> {
        let found = identified(job.read(&self.reading)?, &self.options)?;
        Ok(vec![("toml", found.valve.to_toml()), ("json", report::identify::json(&found))])
    }
}

fn identified(recording: Recording, options: &Options) -> Result<Identified, String> {
    let course = Course::take(recording, &Preparation::default()).map_err(|e| e.to_string())?;
    identify_course(&course, options).map_err(|e| e.to_string())
}

/// Works the list off. Exit code 0: all done; 3: some inputs are unusable, their rows say why; 5: stopped, or the folder
/// cannot be written: call it again.
pub fn run<T: Task>(task: &T, map: &[Mapping], args: &JobsArgs) -> CliResult {
    let (Some(list), Some(out)) = (&args.jobs, &args.out) else {
        return Err(CliError::usage("--jobs LIST needs --out DIR"));
    };
    let failed = |e: FleetError| match e {
        FleetError::Store { .. } => CliError { code: exit::ABORTED, message: e.to_string() },
        FleetError::List(_) | FleetError::Table { .. } => CliError::input(e),
    };
    let shard = args.shard.unwrap_or(Shard { index: 1, of: 1 });
    let models = args.models.as_deref();
    let all = match &args.group_by {
        None => read(list, models),
        Some(column) => read_groups(list, column, map, models),
    };
    let all = all.map_err(failed)?;
    let jobs: Vec<Job> = all.into_iter().enumerate().filter(|(k, _)| shard.holds(*k)).map(|(_, job)| job).collect();
    let store = Store::open(out, &segment_name(shard)).map_err(failed)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|e| CliError::rig(format!("signal handler: {e}")))?;
    }
    let threads = args.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    let teller = Teller::new();
    let progress = work(task, &jobs, &store, threads, &stop, &|p| teller.tell(p)).map_err(failed)?;
    let Progress { jobs, done, skipped, unusable } = progress;
    super::note(&format!("{jobs} jobs: {done} done, {skipped} were done before, {unusable} unusable"));
    let left = jobs - done - skipped - unusable;
    if left > 0 {
        return Err(CliError { code: exit::ABORTED, message: format!("stopped with {left} jobs left; the same call goes on with them") });
    }
    // what was unusable before still is
    let before = if skipped > 0 { unusable_before(out) } else { false };
    Ok(if unusable > 0 || before { exit::INPUT } else { exit::DONE })
}

/// Whether any row of the folder stands for an input that could not be used.
fn unusable_before(out: &std::path::Path) -> bool {
    crate::fleet::collected::last_rows([out]).is_ok_and(|rows| rows.iter().any(|r| r.status == crate::fleet::row::Status::Unusable))
}

/// No other process, here or on another node, has this name.
fn segment_name(shard: Shard) -> String {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    format!("{}-of-{}-{:x}-{:x}", shard.index, shard.of, now.as_nanos(), std::process::id())
}

/// Says every few seconds how far the work is and how long it will take.
struct Teller {
    started: Instant,
    told: std::sync::Mutex<Instant>,
}

impl Teller {
    fn new() -> Self {
        Self { started: Instant::now(), told: std::sync::Mutex::new(Instant::now()) }
    }

    fn tell(&self, p: Progress) {
        let mut told = lock(&self.told);
        if told.elapsed() < Duration::from_secs(5) {
            return;
        }
        *told = Instant::now();
        let worked = p.done + p.unusable;
        let left = p.jobs - worked - p.skipped;
        // what was done before costs nothing worth counting, unless there is nothing else
        let paced = if worked > 0 { worked } else { p.skipped.max(1) };
        let seconds = self.started.elapsed().as_secs_f64() * left as f64 / paced as f64;
        anstream::eprintln!(
            "{} of {} jobs, {} unusable, about {:.0} min left",
            worked + p.skipped,
            p.jobs,
            p.unusable,
            (seconds / 60.0).ceil()
        );
    }
}
