//! `hil check`: plans, valves, driver profiles, stations and limits, without a rig.

use std::path::{Path, PathBuf};

use clap::Args;

use super::valves::{believed, checked_valve};
use super::{CliError, CliResult, exit, files};
use crate::document::{self, nearest};
use crate::exchange::Attached;
use crate::plan::{LIMITS_SCHEMA, LimitsFile, Plan};
use crate::rig::profile::Profile;
use crate::runner::Prepared;

/// Arguments of `hil check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Files to check; the kind follows from the `schema` key.
    ///
    /// Shipped files go by their bare names. Without any, every file of the project is checked: `hil.toml`, stations and
    /// populations beside it, and what lies in its plans/, valves/, drivers/ and limits/.
    files: Vec<PathBuf>,
}

/// The kinds of file that are known, by their schema key.
const KINDS: [&str; 10] = [
    crate::plan::SCHEMA,
    "hil.valve/1",
    crate::exchange::ATTACHED_SCHEMA,
    "hil.driver/1",
    crate::batch::station::SCHEMA,
    crate::batch::population::SCHEMA,
    LIMITS_SCHEMA,
    super::answers::SCHEMA,
    crate::recording::MAPPING_SCHEMA,
    files::SCHEMA,
];

/// Runs the command: every file is checked, also after one that is wrong.
pub fn run(args: &CheckArgs) -> CliResult {
    let mut wrong = 0;
    let files = if args.files.is_empty() { files::of_project()? } else { args.files.clone() };
    for path in &files {
        let path = &files::any(path);
        match check(path) {
            Ok(said) => super::print(&format!("ok     {}: {said}\n", path.display()))?,
            Err(error) => {
                wrong += 1;
                super::note(&format!("error: {}", super::error::plain(&error.message)));
            }
        }
    }
    if wrong == 0 {
        return Ok(exit::DONE);
    }
    let verb = if wrong == 1 { "is" } else { "are" };
    Err(CliError::input(format!("{wrong} of {} files {verb} wrong", files.len())))
}

/// Checks one file; what it is in a few words.
fn check(path: &Path) -> Result<String, CliError> {
    if let Some(message) = files::nothing_of(path) {
        return Err(CliError::input(message));
    }
    let text = document::read(path).map_err(CliError::input)?;
    match schema(&text).as_deref() {
        Some(crate::plan::SCHEMA) => plan(path),
        Some("hil.valve/1") => valve(path),
        Some(crate::exchange::ATTACHED_SCHEMA) => {
            let attached = Attached::load(path).map_err(CliError::input)?;
            Ok(format!("foreign model `{}`, {} about it", attached.name, count(attached.effects.len(), "effect")))
        }
        Some(files::SCHEMA) => {
            let project = files::ProjectFile::load(path)?;
            Ok(format!("project `{}`", project.name))
        }
        Some("hil.driver/1") => {
            let profile = Profile::load(path).map_err(CliError::input)?;
            Ok(format!("driver profile `{}`", profile.name))
        }
        Some(crate::batch::station::SCHEMA) => {
            let station = crate::batch::station::Station::load(path).map_err(CliError::input)?;
            let expired = station.expired(jiff::Zoned::now().date());
            let calibration = if expired.is_empty() { "calibrated".to_string() } else { format!("EXPIRED: {}", expired.join("; ")) };
            let offer = match (station.products.len(), station.sites.len()) {
                (0, 0) => String::new(),
                (products, sites) => format!(", a page with {} and {}", count(products, "product"), count(sites, "site")),
            };
            Ok(format!("station `{}`, {}, {calibration}{offer}", station.id, count(station.instruments.len(), "instrument")))
        }
        Some(crate::batch::population::SCHEMA) => {
            crate::batch::population::Population::load(path).map_err(CliError::input)?;
            Ok("population".into())
        }
        Some(super::answers::SCHEMA) => {
            let answers = super::answers::AnswersFile::load(path)?;
            Ok(count(answers.answers.len(), "answer"))
        }
        Some(crate::recording::MAPPING_SCHEMA) => {
            let reading = crate::recording::Reading::load(path).map_err(CliError::input)?;
            Ok(format!("mapping of {}", count(reading.map.len(), "channel")))
        }
        Some(LIMITS_SCHEMA) => {
            let limits = LimitsFile::load(path).map_err(CliError::input)?;
            Ok(count(limits.limit.len(), "limit"))
        }
        Some(other) => {
            let hint = nearest(other, KINDS).map_or_else(String::new, |k| format!("; did you mean `{k}`?"));
            Err(CliError::input(format!("{}: schema: `{other}` is unknown{hint} (allowed: {})", path.display(), KINDS.join(", "))))
        }
        None => match document::parse::<toml::Table>(&text, &path.display().to_string()) {
            Err(error) => Err(CliError::input(error)),
            Ok(_) => Err(CliError::input(format!(
                "{}: has no key `schema`, so its kind is unknown (allowed: {})",
                path.display(),
                KINDS.join(", ")
            ))),
        },
    }
}

/// The schema key, where the text is TOML and has one.
fn schema(text: &str) -> Option<String> {
    text.parse::<toml::Table>().ok()?.get("schema")?.as_str().map(String::from)
}

fn plan(path: &Path) -> Result<String, CliError> {
    let plan = Plan::load(path, &[]).map_err(CliError::input)?;
    let (valve, _) = files::valve_under(&plan, None)?;
    let model = believed(&plan, &valve)?;
    plan.check_valve(&model).map_err(CliError::input)?;
    if let Some(stability) = Prepared::new(&plan, &model).stability
        && stability["stable"] != serde_json::Value::Bool(true)
    {
        return Err(CliError::input(format!("{}: controller: the loop is unstable on the valve `{}`", path.display(), model.name)));
    }
    let limits = plan.phases.iter().flat_map(|p| &p.measures).filter(|m| m.limit.is_some()).count();
    Ok(format!(
        "plan `{}`, {}, {:.1} s at {} Hz, {}",
        plan.name,
        count(plan.phases.len(), "phase"),
        plan.duration_s(),
        1.0 / plan.period_s,
        count(limits, "limit")
    ))
}

fn valve(path: &Path) -> Result<String, CliError> {
    let valve = checked_valve(path)?;
    let (low, high) = valve.curves.range_a;
    let (bottom, top) = valve.curves.pressure_range_bar();
    // The range is said once: by the warning, where there is one.
    let range = match valve.warnings().as_slice() {
        [] => format!("curves hold from {low:.3} A to {high:.3} A"),
        some => some.iter().map(|w| w.trim_start_matches(&format!("{}: ", valve.name)).to_string()).collect::<Vec<_>>().join("; "),
    };
    let effects = if valve.effects.is_empty() { String::new() } else { format!(", {}", count(valve.effects.len(), "effect")) };
    Ok(format!("valve `{}`{effects}, {bottom:.2} bar to {top:.2} bar; {range}", valve.name))
}

/// So many things, in the plural where there is not one.
fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}
