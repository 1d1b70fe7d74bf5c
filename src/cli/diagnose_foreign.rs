//! `hil diagnose` against a model that is not ours: an FMU, or a pressure that was simulated for the recorded current.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::CliError;
use super::diagnose_args::DiagnoseArgs;
use super::foreign_base::InFile;
use crate::diagnose::{Foreign, Recalibration, Simulated};
use crate::exchange::BaseFile;
use crate::recording::{Mapping, Reading, Recording, RecordingError};

/// A foreign base, and the file in which it is named; nothing where the model is a valve.
pub fn base(args: &DiagnoseArgs) -> Result<Option<Named>, CliError> {
    if let Some(simulated) = &args.foreign.simulated {
        return Ok(Some(Named {
            path: Path::new(simulated).is_file().then(|| simulated.into()),
            kind: Kind::Simulated(simulated.clone()),
        }));
    }
    let Some(model) = args.model.as_deref().filter(|m| *m != "-") else { return Ok(None) };
    let path = PathBuf::from(model);
    Ok(InFile::of(&path)?.map(|file| Named { path: Some(path), kind: Kind::File(file) }))
}

/// A foreign base as the command line names it.
pub struct Named {
    /// The file that is read.
    pub path: Option<PathBuf>,
    kind: Kind,
}

enum Kind {
    Simulated(String),
    File(InFile),
}

impl Named {
    /// The base made ready, and how an answer names it.
    pub fn ready(self, args: &DiagnoseArgs) -> Result<(Foreign, BaseFile), CliError> {
        let path = self.path.unwrap_or_default();
        match self.kind {
            Kind::Simulated(text) => simulated(args, &text),
            Kind::File(file) => file.ready(&args.foreign, &path),
        }
    }
}

fn simulated(args: &DiagnoseArgs, text: &str) -> Result<(Foreign, BaseFile), CliError> {
    let reading = args.reading.reading()?;
    let simulated = if Path::new(text).is_file() {
        let own = Reading { select: reading.select.clone(), ..Reading::default() };
        let path = Path::new(text);
        let read = Recording::read_as(path, &own).or_else(|e| Recording::read_as(path, &reading).map_err(|_| e));
        read.or_else(|e| without_current(path, &own).map_err(|_| e)).map_err(CliError::input)?
    } else {
        let mut map = reading.map.clone();
        map.retain(|m| m.role.name() != "pressure_bar");
        map.push(Mapping::parse(&format!("pressure_bar={text}")).map_err(CliError::usage)?);
        let reading = Reading { map, ..reading };
        let wrong = |e: RecordingError| CliError::input(format!("--simulated {text}: there is no such file, and as a column: {e}"));
        let read = |path: &PathBuf| Recording::read_as(path, &reading).map_err(wrong);
        Recording::together(args.recordings.iter().map(read).collect::<Result<_, _>>()?)
    };
    let plant = Simulated::of(simulated).map_err(CliError::input)?;
    let foreign = Foreign { name: text.into(), plant: Arc::new(plant), recalibration: Recalibration::default(), effects: Vec::new() };
    Ok((foreign, BaseFile { simulated: Some(text.into()), ..BaseFile::default() }))
}

/// A file that holds the pressure alone: that it belongs to this current cannot be seen then.
fn without_current(path: &Path, own: &Reading) -> Result<Recording, RecordingError> {
    let map = vec![Mapping::parse("current_a=0.01 * pressure_bar")?];
    let mut simulated = Recording::read_as(path, &Reading { map, ..own.clone() })?;
    for run in &mut simulated.runs {
        run.current_a.fill(f64::NAN);
    }
    Ok(simulated)
}

/// How the answer names its base: relative to the answer's own folder where it lies below it, in full otherwise.
pub fn named_from(base: BaseFile, answer: &Path) -> BaseFile {
    let full = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let folder = full(answer.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")));
    let fmu = base.fmu.as_deref().map(full).map(|path| path.strip_prefix(&folder).map(Path::to_path_buf).unwrap_or(path));
    BaseFile { fmu, ..base }
}
