//! `hil diagnose` against a model that is not ours: an FMU, or a pressure that was simulated for the recorded current.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::diagnose_args::{DiagnoseArgs, ForeignArgs};
use super::{CliError, note};
use crate::diagnose::{Foreign, Plant, Recalibration, Simulated};
use crate::exchange::{Attached, BaseFile};
use crate::recording::{Mapping, Reading, Recording, RecordingError};
use crate::units::Time;

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
    if model.to_ascii_lowercase().ends_with(".fmu") {
        return Ok(Some(Named { path: Some(path), kind: Kind::Fmu }));
    }
    // What is no readable text of that kind is a valve's affair, whose reader says what is wrong.
    let attached = path.is_file() && std::fs::read_to_string(&path).is_ok_and(|text| Attached::is(&text));
    if !attached {
        return Ok(None);
    }
    Ok(Some(Named { kind: Kind::Attached(Attached::load(&path).map_err(CliError::input)?), path: Some(path) }))
}

/// A foreign base as the command line names it.
pub struct Named {
    /// The file that is read.
    pub path: Option<PathBuf>,
    kind: Kind,
}

enum Kind {
    Simulated(String),
    Fmu,
    Attached(Attached),
}

impl Named {
    /// The base made ready, and how an answer names it.
    pub fn ready(self, args: &DiagnoseArgs) -> Result<(Foreign, BaseFile), CliError> {
        let path = self.path.unwrap_or_default();
        match self.kind {
            Kind::Simulated(text) => simulated(args, &text),
            Kind::Fmu => fmu(args, &path, None),
            Kind::Attached(attached) => {
                let Some(fmu_file) = &attached.base.fmu else {
                    let what = "was found about a simulated pressure; give that of this recording with --simulated";
                    return Err(CliError::input(format!("{}: {what}", attached.name)));
                };
                let path = path.with_file_name("").join(fmu_file);
                fmu(args, &path, Some(&attached))
            }
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
        let read = |path: &PathBuf| Recording::read_as(path, &reading).map_err(|e| CliError::input(format!("--simulated {text}: {e}")));
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

#[cfg(all(unix, feature = "fmi"))]
fn fmu(args: &DiagnoseArgs, path: &Path, attached: Option<&Attached>) -> Result<(Foreign, BaseFile), CliError> {
    use crate::exchange::foreign::{ForeignFmu, Trust};
    let ForeignArgs { trust_fmu, fmu_current, fmu_pressure, fmu_step, fmu_time_limit, .. } = &args.foreign;
    let fmu = ForeignFmu::read(path).map_err(CliError::input)?;
    let base = attached.map(|a| &a.base);
    if let Some(wanted) = base.and_then(|b| b.sha256.as_ref()).filter(|wanted| **wanted != fmu.sha256) {
        return Err(CliError::input(format!("{}: is another file than the effects were found about (SHA-256 {wanted})", path.display())));
    }
    let named = |typed: &Option<String>, kept: Option<&String>| typed.clone().or(kept.cloned());
    let current = named(fmu_current, base.and_then(|b| b.current.as_ref()));
    let pressure = named(fmu_pressure, base.and_then(|b| b.pressure.as_ref()));
    let ports = fmu.description.ports(current.as_deref(), pressure.as_deref());
    let ports = ports.map_err(|e| CliError::input(format!("{}: {e} (--fmu-current NAME, --fmu-pressure NAME)", path.display())))?;
    let trust = Trust::of_user();
    let (step_s, limit) = (fmu_step.map(Time::value), fmu_time_limit.value());
    if step_s.is_some_and(|s| s <= 0.0) || limit <= 0.0 {
        return Err(CliError::usage("--fmu-step and --fmu-time-limit: a time above 0 s is allowed"));
    }
    let trust = if *trust_fmu { trust.and_now(&fmu.sha256) } else { trust };
    let unpacked = fmu.unpacked(&ports, &trust, step_s, std::time::Duration::from_secs_f64(limit)).map_err(CliError::input)?;
    if *trust_fmu && let Err(e) = trust.add(&fmu.sha256, &fmu.file) {
        note(&format!("note: that {} is trusted could not be remembered: {e}", fmu.file));
    }
    let given = &fmu.description.name;
    let name = attached.map_or_else(|| if given.is_empty() { fmu.file.clone() } else { given.clone() }, |a| a.name.clone());
    let file = BaseFile {
        fmu: Some(path.into()),
        sha256: Some(fmu.sha256.clone()),
        current: Some(ports.current.name.clone()),
        pressure: Some(ports.pressure.name.clone()),
        simulated: None,
    };
    let plant: Arc<dyn Plant> = Arc::new(unpacked);
    let recalibration = attached.map_or_else(Recalibration::default, |a| a.recalibration);
    let effects = attached.map_or_else(Vec::new, |a| a.effects.clone());
    Ok((Foreign { name, plant, recalibration, effects }, file))
}

#[cfg(not(all(unix, feature = "fmi")))]
fn fmu(_: &DiagnoseArgs, path: &Path, _: Option<&Attached>) -> Result<(Foreign, BaseFile), CliError> {
    Err(CliError::usage(format!("{}: this build runs no FMU; --simulated takes the pressure that it gives", path.display())))
}

/// How the answer names its base: relative to the answer's own folder where it lies below it, in full otherwise.
pub fn named_from(base: BaseFile, answer: &Path) -> BaseFile {
    let full = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let folder = full(answer.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")));
    let fmu = base.fmu.as_deref().map(full).map(|path| path.strip_prefix(&folder).map(Path::to_path_buf).unwrap_or(path));
    BaseFile { fmu, ..base }
}
