//! `hil simulate`: a recorded current through a model, run by run.

use std::io::{BufWriter, Write};
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::outputs::Force;
use super::reading::ReadArgs;
use super::valves::checked_valve;
use super::{CliError, CliResult, exit};
use crate::course::{Course, Preparation};
use crate::output::{Mark, Outputs};
use crate::physics::{Misfit, simulate_course};
use crate::recording::{Format, Recording, Run};
use crate::units::{CURRENT, PRESSURE};
use crate::valve::{Hysteresis, Valve};

/// What to simulate.
#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// The recording: .csv, .parquet or .mf4
    recording: PathBuf,
    /// The valve model: a file, or the bare name of one in valves/
    #[arg(long, value_name = "VALVE")]
    model: String,
    /// Where the simulated pressure goes: .csv, .parquet or .mf4; without it CSV goes to stdout
    #[arg(short = 'o', long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// How the recording is read.
    #[command(flatten)]
    reading: ReadArgs,
    /// Existing files.
    #[command(flatten)]
    force: Force,
    /// How to print the summary; `json` prints it alone, and the pressure only goes to -o
    #[arg(long, value_enum, default_value = "text")]
    format: SummaryFormat,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SummaryFormat {
    Text,
    Json,
}

/// Errors of the model and of its average model over one run.
struct RunError {
    name: Option<String>,
    model: Misfit,
    average: Misfit,
}

/// Simulates, writes and sums up.
pub fn run(args: &SimulateArgs) -> CliResult {
    if let Some(path) = &args.output {
        Format::of(path).map_err(CliError::usage)?;
    }
    let model = Valve::find(&args.model).map_err(CliError::input)?;
    let _claim = Outputs::new(args.force.force)
        .reads([&args.recording, &model])
        .reads(args.reading.files())
        .file(args.output.as_ref(), Mark::None)
        .claim()?;
    let valve = checked_valve(&model)?;
    let recording = args.reading.read(&args.recording)?;
    let mut messages = anstream::stderr();
    for note in recording.notes.iter().map(|n| format!("note: {}: {n}", recording.source)) {
        let _ = writeln!(messages, "{note}");
    }
    if let Some(note) = beyond(&valve, &recording) {
        let _ = writeln!(messages, "note: {}: {note}", recording.source);
    }

    let average = Valve { hysteresis: Hysteresis::None, ..valve.clone() };
    let course = Course::of(&recording, &Preparation::for_model(&recording, &valve)).map_err(CliError::input)?;
    for note in course.notes.iter().skip(recording.notes.len()) {
        let _ = writeln!(messages, "note: {}: {note}", recording.source);
    }
    let refused = |e: crate::physics::PhysicsError| CliError::input(format!("{}: {e}", course.source));
    let of_model = simulate_course(&valve, &course).map_err(refused)?;
    let of_average = if course.readings() > 0 { simulate_course(&average, &course).map_err(refused)? } else { Vec::new() };
    // In text a microbar is finer than any sensor, and the same on every machine; a binary file holds the numbers as they are.
    let as_text = args.output.as_deref().is_none_or(|path| matches!(Format::of(path), Ok(Format::Csv)));
    let (mut errors, mut runs) = (Vec::new(), Vec::new());
    for (number, run) in recording.runs.into_iter().enumerate() {
        let pressure = course.on_recorded(number, &run.time_s, &of_model);
        if pressure.len() != run.len() {
            let name = run.name.as_deref().unwrap_or("(nameless)");
            return Err(CliError::input(format!("{}: run {name} holds no `current_a` to simulate", course.source)));
        }
        let misfit = |simulated: &[Vec<f64>]| {
            let parts = course.runs.iter().zip(simulated).filter(|(part, _)| part.origin.run == number);
            parts.map(|(part, values)| Misfit::of(part, values)).fold(Misfit::default(), Misfit::and)
        };
        if run.pressure_bar.is_some() {
            errors.push(RunError { name: run.name.clone(), model: misfit(&of_model), average: misfit(&of_average) });
        }
        let pressure = pressure.into_iter().map(|p| if as_text { (p * 1e6).round() / 1e6 } else { p }).collect();
        runs.push(Run { name: run.name, time_s: run.time_s, current_a: run.current_a, pressure_bar: Some(pressure), ..Run::default() });
    }
    let simulated = Recording { source: recording.source, runs, notes: Vec::new(), input: Some(course.input) };

    if let Some(path) = &args.output {
        simulated.write(path).map_err(CliError::not_stored)?;
    } else if args.format == SummaryFormat::Text {
        let mut out = BufWriter::with_capacity(1 << 18, std::io::stdout().lock());
        match simulated.write_csv(&mut out).and_then(|()| out.flush()) {
            Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => return Err(CliError::not_stored(format!("stdout: {e}"))),
            _ => {}
        }
    }
    match args.format {
        SummaryFormat::Json => super::print(&format!("{:#}\n", summary_json(&simulated, &valve, &errors, &course)))?,
        SummaryFormat::Text if args.output.is_some() => super::print(&summary(&simulated, &valve, &errors))?,
        SummaryFormat::Text => drop(messages.write_all(summary(&simulated, &valve, &errors).as_bytes())),
    }
    Ok(exit::DONE)
}

/// Says where the recording leaves the range on which the model's curves hold.
fn beyond(valve: &Valve, recording: &Recording) -> Option<String> {
    let (low, high) = valve.curves.range_a;
    let outside = |i: &f64| *i < low || *i > high;
    let count: usize = recording.runs.iter().map(|r| r.current_a.iter().filter(|i| outside(i)).count()).sum();
    let all = recording.runs.iter().flat_map(|r| &r.current_a).filter(|i| i.is_finite());
    let (least, most) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), i| (a.min(*i), b.max(*i)));
    (count > 0).then(|| {
        let [low, high, least, most] = [low, high, least, most].map(|i| CURRENT.print(i));
        format!(
            "{count} sample{} with a current outside of the model's {low} to {high} ({least} to {most}): extrapolated along a straight line",
            if count == 1 { "" } else { "s" }
        )
    })
}

const START: &str = "each run starts on the average curve at its first current";

/// What the model is made of.
fn described(valve: &Valve) -> String {
    let hysteresis = match valve.hysteresis {
        Hysteresis::None => "average",
        Hysteresis::Hyperbolic { .. } => "hyperbolic",
        Hysteresis::Free(_) => "free",
    };
    std::iter::once(hysteresis).chain(valve.effects.iter().map(|e| e.id.as_str())).collect::<Vec<_>>().join(" + ")
}

fn totals(errors: &[RunError]) -> (Option<f64>, Option<f64>) {
    let (model, average) = errors.iter().fold((Misfit::default(), Misfit::default()), |t, e| (t.0.and(e.model), t.1.and(e.average)));
    (model.rmse_bar(), average.rmse_bar())
}

fn summary(simulated: &Recording, valve: &Valve, errors: &[RunError]) -> String {
    let samples: usize = simulated.runs.iter().map(Run::len).sum();
    let runs = if simulated.runs.len() == 1 { "1 run".into() } else { format!("{} runs", simulated.runs.len()) };
    let mut text = format!("{}: {runs}, {samples} samples; {START}\n", valve.name);
    let (Some(model), Some(average)) = totals(errors) else {
        return text + "no measured pressure_bar to compare with\n";
    };
    text += &format!(
        "RMSE against pressure_bar: {} ({} model), {} (average model)\n",
        PRESSURE.print(model),
        described(valve),
        PRESSURE.print(average)
    );
    if errors.len() > 1 {
        for error in errors {
            let (Some(model), Some(average)) = (error.model.rmse_bar(), error.average.rmse_bar()) else { continue };
            let name = error.name.as_deref().unwrap_or("-");
            text += &format!("  {name}: {}, {}\n", PRESSURE.print(model), PRESSURE.print(average));
        }
    }
    text
}

fn summary_json(simulated: &Recording, valve: &Valve, errors: &[RunError], course: &Course) -> serde_json::Value {
    let (model, average) = totals(errors);
    let round = |v: Option<f64>| v.map(|v| (v * 1e6).round() / 1e6);
    let runs: Vec<_> = errors
        .iter()
        .map(|e| json!({ "run": e.name, "rmse_bar": round(e.model.rmse_bar()), "rmse_average_model_bar": round(e.average.rmse_bar()) }))
        .collect();
    json!({
        "schema": "hil.simulation/1",
        "model": { "name": valve.name, "kind": described(valve) },
        "start": START,
        "samples": simulated.runs.iter().map(Run::len).sum::<usize>(),
        "readings": course.readings(),
        "noise_bar": round(Some(course.noise.bar).filter(|_| course.readings() > 0)),
        "rmse_bar": round(model),
        "rmse_average_model_bar": round(average),
        "runs": runs,
    })
}
