//! A model that is not ours, found in a file and made ready to run: an FMU, or what was found about one.

use std::path::Path;
use std::sync::Arc;

use clap::Args;

use super::{CliError, note};
use crate::diagnose::{Foreign, Plant, Recalibration};
use crate::exchange::{Attached, BaseFile};
use crate::units::Time;

/// The options of a foreign base.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Foreign model (--model plant.fmu, or --simulated)")]
pub struct ForeignArgs {
    /// Instead of a model, the pressure that your own simulation gave for this very current: a column of the recording, or a
    /// file with time_s and pressure_bar
    #[arg(long, value_name = "COLUMN|FILE", conflicts_with = "without")]
    pub simulated: Option<String>,
    /// Run the native code inside this FMU with your rights; remembered for this very file
    #[arg(long)]
    trust_fmu: bool,
    /// The input of the FMU that takes the current, where its units do not tell
    #[arg(long, value_name = "NAME")]
    fmu_current: Option<String>,
    /// The output of the FMU that gives the pressure, where its units do not tell
    #[arg(long, value_name = "NAME")]
    fmu_pressure: Option<String>,
    /// Step of the FMU, where it is not what the FMU and the recording say
    #[arg(long, value_name = "TIME")]
    fmu_step: Option<Time>,
    /// Longest time that one run of the FMU may take
    #[arg(long, value_name = "TIME", default_value = "60 s")]
    fmu_time_limit: Time,
}

/// What kind of foreign base a file is.
pub enum InFile {
    /// A functional mock-up unit.
    Fmu,
    /// What was found about one.
    Attached(Box<Attached>),
}

impl InFile {
    /// What a file is, if it is one of these.
    pub fn of(path: &Path) -> Result<Option<Self>, CliError> {
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("fmu")) {
            return Ok(Some(Self::Fmu));
        }
        // What is no readable text of that kind is a valve's affair, whose reader says what is wrong.
        let attached = path.is_file() && std::fs::read_to_string(path).is_ok_and(|text| Attached::is(&text));
        if attached { Attached::load(path).map(|a| Some(Self::Attached(Box::new(a)))).map_err(CliError::input) } else { Ok(None) }
    }

    /// The base made ready, and how an answer names it.
    pub fn ready(&self, options: &ForeignArgs, path: &Path) -> Result<(Foreign, BaseFile), CliError> {
        match self {
            Self::Fmu => fmu(options, path, None),
            Self::Attached(attached) => about_fmu(options, path, attached),
        }
    }
}

fn about_fmu(options: &ForeignArgs, path: &Path, attached: &Attached) -> Result<(Foreign, BaseFile), CliError> {
    let Some(fmu_file) = &attached.base.fmu else {
        let what = "was found about a simulated pressure; give that of this recording with --simulated";
        return Err(CliError::input(format!("{}: {what}", attached.name)));
    };
    fmu(options, &path.with_file_name("").join(fmu_file), Some(attached))
}

#[cfg(all(unix, feature = "fmi"))]
fn fmu(options: &ForeignArgs, path: &Path, attached: Option<&Attached>) -> Result<(Foreign, BaseFile), CliError> {
    use crate::exchange::foreign::{ForeignFmu, Trust};
    let ForeignArgs { trust_fmu, fmu_current, fmu_pressure, fmu_step, fmu_time_limit, .. } = options;
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
fn fmu(_: &ForeignArgs, path: &Path, _: Option<&Attached>) -> Result<(Foreign, BaseFile), CliError> {
    Err(CliError::usage(format!("{}: this build runs no FMU; --simulated takes the pressure that it gives", path.display())))
}
