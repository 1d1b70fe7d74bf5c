//! `hil inspect`: what is in a log, and the mapping to read it with.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::outputs::{Force, MAPPING};
use super::reading::ReadArgs;
use super::{CliError, CliResult, exit};
use crate::output::Outputs;
use crate::recording::{Channel, ChannelSurvey, MappingFile, Reading, Recording, Survey, inspect, replace_file};

/// What to look at.
#[derive(Debug, Args)]
pub struct InspectArgs {
    /// The log: .csv, .tsv, .txt, .parquet or .mf4
    log: PathBuf,
    /// How it is read.
    #[command(flatten)]
    reading: ReadArgs,
    /// Write the mapping here, for --mapping of other commands
    #[arg(short = 'o', long, value_name = "FILE.toml")]
    output: Option<PathBuf>,
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

/// Looks, prints, writes the mapping.
pub fn run(args: &InspectArgs) -> CliResult {
    // The mapping file may be the one that is written anew.
    let _claim = Outputs::new(args.force.force).reads([&args.log]).file(args.output.as_ref(), MAPPING).claim()?;
    let asked = args.reading.reading()?;
    let survey = inspect(&args.log, &asked).map_err(CliError::input)?;
    let mapping = survey.mapping(asked.encoding);
    // What the mapping gives is looked at with the reader that every command uses.
    let read = reading_of(&mapping, &asked).and_then(|reading| Recording::read_as(&args.log, &reading).map_err(|e| e.to_string()));
    let file = written(&survey, &mapping, read.as_ref().err().map(String::as_str))?;
    if let Some(path) = &args.output {
        replace_file(path, |out| out.write_all(file.as_bytes())).map_err(CliError::not_stored)?;
    }
    match args.format {
        Format::Json => {
            let (runs, problem, notes) = match &read {
                Ok(recording) => (recording.runs.iter().map(run_json).collect(), None, recording.notes.clone()),
                Err(problem) => (Vec::new(), Some(problem), Vec::new()),
            };
            let value = json!({
                "schema": "hil.survey/1", "survey": survey, "mapping": mapping, "runs": runs, "reading_notes": notes, "problem": problem,
            });
            super::print(&super::to_json(&value)?)?;
        }
        Format::Text => {
            super::print(&text(&survey, &read, &file))?;
            match &args.output {
                Some(path) => super::say(&format!("wrote {}: give it to other commands with --mapping", path.display())),
                None => super::say("-o FILE.toml writes this mapping, --mapping FILE.toml of other commands takes it"),
            }
        }
    }
    Ok(exit::DONE)
}

fn reading_of(mapping: &MappingFile, asked: &Reading) -> Result<Reading, String> {
    let mut map = asked.map.clone();
    for (channel, expr) in &mapping.map {
        let parsed = crate::recording::Mapping::parse(&format!("{channel}={expr}")).map_err(|e| e.to_string())?;
        if !map.iter().any(|m| m.role == parsed.role) {
            map.push(parsed);
        }
    }
    Ok(Reading { map, header_row: asked.header_row.or(mapping.read.header_row), ..asked.clone() })
}

/// The mapping as a file, each line with why it is so.
fn written(survey: &Survey, mapping: &MappingFile, problem: Option<&str>) -> Result<String, CliError> {
    let string = |text: &str| toml::Value::String(text.into()).to_string();
    let mut out = format!("# How {} is read; written by hil inspect.\nschema = {}\n\n[map]\n", survey.file, string(&mapping.schema));
    for proposal in &survey.proposals {
        let comment = if proposal.expr == proposal.channel { "# " } else { "" };
        if let Some(caution) = &proposal.caution {
            let _ = writeln!(out, "# look here: {caution}");
        }
        let _ = writeln!(out, "{comment}{} = {}  # {}", proposal.channel, string(&proposal.expr), proposal.why);
    }
    for channel in ["time_s", "current_a", "pressure_bar"] {
        // Each group of an MDF file has its own time.
        let own_time = channel == "time_s" && survey.channels.iter().any(|c| !c.group.is_empty());
        if !own_time && !survey.proposals.iter().any(|p| p.channel == channel) {
            let _ = writeln!(out, "# {channel} = \"?\"  # nothing in the file looks like it");
        }
    }
    let (row, encoding) = (mapping.read.header_row, mapping.read.encoding);
    if row.is_some() || encoding.is_some() {
        out += "\n[read]\n";
        if let Some(row) = row {
            let _ = writeln!(out, "header_row = {row}");
        }
        if let Some(encoding) = encoding {
            let _ = writeln!(out, "encoding = {}", string(encoding.name()));
        }
    }
    out += "\n[select]\n# run = [\"name\"]\n# from = \"0 s\"\n# to = \"60 s\"\n";
    if let Some(problem) = problem {
        let _ = writeln!(out, "\n# Read like this, the log is refused:");
        problem.lines().for_each(|line| {
            let _ = writeln!(out, "# {line}");
        });
    }
    Ok(out)
}

fn run_json(run: &crate::recording::Run) -> serde_json::Value {
    let channels: serde_json::Map<String, serde_json::Value> =
        Channel::ALL.into_iter().filter_map(|c| Some((c.name().to_string(), json!(range(run.channel(c)?)?)))).collect();
    json!({
        "run": run.name, "samples": run.len(), "from_s": run.time_s.first(), "to_s": run.time_s.last(), "step_s": run.step_s(),
        "range": channels,
    })
}

fn range(values: &[f64]) -> Option<(f64, f64)> {
    let finite = values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |r, v| (r.0.min(v), r.1.max(v)));
    (low <= high).then_some((low, high))
}

/// Blocks from low to high; a space where there is no value.
fn sparkline(values: &[f64]) -> String {
    let Some((low, high)) = range(values) else { return " ".repeat(values.len()) };
    let blocks = ['\u{2581}', '\u{2582}', '\u{2583}', '\u{2584}', '\u{2585}', '\u{2586}', '\u{2587}', '\u{2588}'];
    let block = |v: &f64| match v {
        v if !v.is_finite() => ' ',
        _ if high <= low => blocks[3],
        v => blocks[(((v - low) / (high - low)) * 7.0).round() as usize],
    };
    values.iter().map(block).collect()
}

/// Four significant digits, without an exponent where none is needed.
fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let magnitude = value.abs().log10().floor();
    if !(-5.0..9.0).contains(&magnitude) {
        return format!("{value:.3e}");
    }
    let text = format!("{value:.*}", (3.0 - magnitude).clamp(0.0, 8.0) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

fn text(survey: &Survey, read: &Result<Recording, String>, mapping: &str) -> String {
    let mut out = format!("{}: {} columns", survey.file, survey.channels.len());
    if let Some(row) = survey.header_row {
        let _ = write!(out, ", names in line {row}");
    }
    out.push('\n');
    for note in &survey.notes {
        let _ = writeln!(out, "  {note}");
    }
    let longest =
        |of: &dyn Fn(&ChannelSurvey) -> usize, most: usize| survey.channels.iter().map(of).filter(|n| *n <= most).max().unwrap_or(0);
    let widths = (longest(&|c| c.name.chars().count(), NAME_COLUMNS), longest(&|c| unit(c).chars().count(), UNIT_COLUMNS));
    let mut group = "";
    for channel in &survey.channels {
        if channel.group != group {
            group = &channel.group;
            let raster = channel.raster_s.filter(|r| *r > 0.0).map_or_else(String::new, |r| format!(", every {} s", short(r)));
            let _ = writeln!(out, "\ngroup {group}{raster}");
        }
        out += &line(channel, widths);
    }
    match read {
        Err(problem) => {
            let _ = writeln!(out, "\nnot readable like this:");
            problem.lines().for_each(|line| {
                let _ = writeln!(out, "  {line}");
            });
        }
        Ok(recording) => {
            out += "\nread with the mapping below:\n";
            for run in &recording.runs {
                let name = run.name.as_ref().map_or_else(|| "one run".into(), |n| format!("run {n}"));
                let (from, to) = (run.time_s.first().copied().unwrap_or(0.0), run.time_s.last().copied().unwrap_or(0.0));
                let _ =
                    writeln!(out, "  {name}: {} samples, {} s to {} s, every {} s", run.len(), short(from), short(to), short(run.step_s()));
                for channel in Channel::ALL {
                    let Some((low, high)) = run.channel(channel).and_then(range) else { continue };
                    let gaps = run.channel(channel).map_or(0, |v| v.iter().filter(|v| v.is_nan()).count());
                    let gaps = if gaps > 0 { format!(", {gaps} gaps") } else { String::new() };
                    let _ = writeln!(out, "    {:<15} {} to {} {}{gaps}", channel.name(), short(low), short(high), channel.unit().symbol);
                }
            }
            for note in &recording.notes {
                let _ = writeln!(out, "  {note}");
            }
        }
    }
    let _ = write!(out, "\n{mapping}");
    out
}

/// Columns that the names of channels, and their units, have at most; a longer name has a line of its own.
const NAME_COLUMNS: usize = 22;
const UNIT_COLUMNS: usize = 8;

fn unit(channel: &ChannelSurvey) -> &str {
    channel.unit.as_deref().unwrap_or("-")
}

fn line(channel: &ChannelSurvey, (names, units): (usize, usize)) -> String {
    let what = match channel.range {
        Some((low, high)) => format!("{} .. {}", short(low), short(high)),
        None if channel.texts.is_empty() => channel.content.to_string(),
        None => format!("{}: {}", channel.content, channel.texts.join(", ")),
    };
    let gaps = if channel.gaps > 0 { format!("  {} gaps", channel.gaps) } else { String::new() };
    let spark = sparkline(&channel.spark);
    let curve = if spark.trim().is_empty() { String::new() } else { format!("{spark:<32} ") };
    let (own_line, name) =
        if channel.name.chars().count() > names { (format!("  {}\n", channel.name), "") } else { (String::new(), channel.name.as_str()) };
    format!("{own_line}  {name:<names$} {:<units$} {curve}{what}{gaps}\n", unit(channel))
}
