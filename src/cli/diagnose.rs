//! `hil diagnose`: where a simulation and a recording differ, what is missing, and how sure that is.

use std::io::Write;
use std::path::Path;

use super::diagnose_args::{DiagnoseArgs, Format};
use super::diagnose_foreign::{self, Named};
use super::good_data::GoodData;
use super::next_plan::NextPlan;
use super::outputs::{ATTACHED, PLAN, VALVE};
use super::progress::Searching;
use super::reading::distinct;
use super::valves::{checked_valve, name_apart};
use super::{CliError, CliResult, exit};
use crate::diagnose::{Diagnosed, Verdict, diagnose_by, diagnose_foreign as against_foreign, story, tell_of_candidates};
use crate::exchange::{Attached, BaseFile};
use crate::output::{Mark, Outputs};
use crate::physics::effect;
use crate::recording::{Reading, Recording, RecordingError, Selection, replace_file};
use crate::report;
use crate::valve::{Hysteresis, Valve};

/// Diagnoses, writes what was asked for, prints.
pub fn run(args: &DiagnoseArgs) -> CliResult {
    if args.many.jobs.is_some() {
        let reading = args.reading.reading()?;
        let map = reading.map.clone();
        return super::jobs::run(&super::jobs::Diagnose { reading, foreign: args.foreign.clone() }, &map, &args.many);
    }
    let usage = || CliError::usage("a RECORDING and --model VALVE|FMU or --simulated COLUMN|FILE, or --jobs LIST");
    if args.recordings.is_empty() {
        return Err(usage());
    }
    distinct(&args.recordings)?;
    if let Some(named) = diagnose_foreign::base(args)? {
        return foreign(args, named);
    }
    let model = args.model.as_ref().ok_or_else(usage)?;
    let model = Valve::find(model).map_err(CliError::input)?;
    let inputs = Outputs::new(args.force.force).reads(&args.recordings).reads([&model]).reads(&args.reference).reads(args.reading.files());
    let outputs = inputs.file(args.output.as_ref(), VALVE).file(args.report.as_ref(), Mark::Page);
    // A plan drives the augmented model where it is stored, otherwise the one that was diagnosed.
    let next = args.next_plan.as_ref().map(|path| NextPlan::of(path, args.output.as_ref().unwrap_or(&model)));
    let plan = next.as_ref().map(|next| &next.path);
    let _claim = outputs.file(plan, PLAN).file(next.as_ref().and_then(NextPlan::copy), VALVE).claim()?;
    let mut valve = checked_valve(&model)?;
    for part in &args.without {
        take_out(&mut valve, part)?;
    }
    let good = references(args, (&model, &valve))?;
    let recording = Recording::together(args.recordings.iter().map(|path| args.reading.read(path)).collect::<Result<_, _>>()?);
    if args.watch {
        tell_of_candidates(|tried| super::note(&serde_json::to_string(tried).unwrap_or_default()));
    }
    let working = (!args.watch).then(Searching::show);
    let mut diagnosed = diagnose_by(&args.criteria()?, None, &recording, &valve, &good).map_err(CliError::input)?;
    drop(working);
    name_apart(&mut diagnosed.augmented, &valve);
    say(args, &diagnosed, next.as_ref(), &|diagnosed| diagnosed.augmented.to_toml())
}

/// Diagnoses against a model that is not ours.
fn foreign(args: &DiagnoseArgs, named: Named) -> CliResult {
    // What a simulation gave for the record says nothing of another drive.
    let no_reference = args.foreign.simulated.is_some() && !args.reference.is_empty();
    let refused = [
        (no_reference, "--reference"),
        (!args.without.is_empty(), "--without"),
        (args.next_plan.is_some(), "--next-plan"),
        (!args.criterion.is_empty(), "--criterion"),
    ];
    if let Some((_, option)) = refused.iter().find(|(given, _)| *given) {
        return Err(CliError::usage(format!(
            "{option}: is not had with this base: a foreign model is taken as it is, and a simulated pressure is known for its own drive only"
        )));
    }
    let inputs =
        Outputs::new(args.force.force).reads(&args.recordings).reads(&named.path).reads(&args.reference).reads(args.reading.files());
    let _claim = inputs.file(args.output.as_ref(), ATTACHED).file(args.report.as_ref(), Mark::Page).claim()?;
    let (base, file) = named.ready(args)?;
    let good = named_references(args)?;
    let recording = Recording::together(args.recordings.iter().map(|path| args.reading.read(path)).collect::<Result<_, _>>()?);
    let working = Searching::show();
    let mut diagnosed = against_foreign(&recording, &base, &good).map_err(CliError::input)?;
    drop(working);
    let added: Vec<&str> = diagnosed.augmented.effects.iter().skip(base.effects.len()).map(|e| e.id.as_str()).collect();
    if !added.is_empty() {
        diagnosed.augmented.name = format!("{}+{}", base.name, added.join("+"));
    }
    let file = args.output.as_ref().map_or_else(BaseFile::default, |path| diagnose_foreign::named_from(file.clone(), path));
    say(args, &diagnosed, None, &|found| Attached::of(found, file.clone()).map(|a| a.to_toml()).unwrap_or_default())
}

/// Writes what was asked for and prints.
fn say(args: &DiagnoseArgs, diagnosed: &Diagnosed, next: Option<&NextPlan>, model: &dyn Fn(&Diagnosed) -> String) -> CliResult {
    let comparable = diagnosed.diagnosis.verdict != Verdict::NotComparable;
    if !comparable && (args.output.is_some() || next.is_some()) {
        super::note("model and recording do not belong together: no model and no plan is written");
    }
    if let Some(path) = args.output.as_ref().filter(|_| comparable) {
        store(path, &model(diagnosed))?;
    }
    if let Some(path) = &args.report {
        store(path, &report::diagnosis::page(diagnosed, &story(diagnosed)))?;
    }
    if let Some(next) = next.filter(|_| comparable) {
        next.write(diagnosed, store)?;
    }
    match args.format {
        Format::Json => super::print(&report::diagnosis::json(&diagnosed.diagnosis))?,
        Format::Text => super::print(&report::diagnosis::text(&diagnosed.diagnosis))?,
    }
    let mismatch = args.fail_on.is_some() && diagnosed.diagnosis.verdict != Verdict::Match;
    Ok(if mismatch { exit::NEGATIVE } else { exit::DONE })
}

/// Reads a drive of the good valve.
fn reader(args: &DiagnoseArgs) -> Result<impl Fn(&Path) -> Result<Recording, RecordingError>, CliError> {
    // What is selected is selected of the record; a reference may have the mapping of the record, or its own names.
    let reading = Reading { select: Selection::default(), ..args.reading.reading()? };
    Ok(move |path: &Path| Recording::read_as(path, &reading).or_else(|e| Recording::read(path, &[]).map_err(|_| e)))
}

/// The drives of the good valve that were named.
fn named_references(args: &DiagnoseArgs) -> Result<Vec<Recording>, CliError> {
    let read = reader(args)?;
    args.reference.iter().map(|path| read(path).map_err(CliError::input)).collect()
}

/// Data of the good valve: what was named, otherwise what the model was identified from, as long as it is the same file.
fn references(args: &DiagnoseArgs, (model, valve): (&Path, &Valve)) -> Result<Vec<Recording>, CliError> {
    if !args.reference.is_empty() {
        return named_references(args);
    }
    let good = GoodData::of((model, valve), &args.recordings, reader(args)?);
    for why in &good.missing {
        super::note(&format!("{}: identified from a recording that says nothing here: {why}; `--reference` gives it", model.display()));
    }
    Ok(good.recordings)
}

/// Removes a part of a model, as if it had never been there.
fn take_out(valve: &mut Valve, part: &str) -> Result<(), CliError> {
    match part {
        "hysteresis" => valve.hysteresis = Hysteresis::None,
        "delay" => (valve.delay_s, valve.delay_range_s) = (0.0, (0.0, 0.0)),
        id => {
            let before = valve.effects.len();
            valve.effects.retain(|e| e.id != id);
            let of_base = effect(id).is_some_and(|e| e.leave_base(valve));
            if !of_base && valve.effects.len() == before {
                let parts: Vec<&str> = valve.effects.iter().map(|e| e.id.as_str()).collect();
                let known = if effect(id).is_some() { "is not in this model" } else { "is no part" };
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

fn store(path: &Path, text: &str) -> Result<(), CliError> {
    replace_file(path, |file| file.write_all(text.as_bytes())).map_err(CliError::not_stored)
}
