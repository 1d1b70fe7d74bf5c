//! `hil history`: what the records of many batches say of a serial number, a lot, a metric, a time.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;

use super::batch_error::failed;
use super::{CliError, CliResult, exit};
use crate::batch::index::{Answer, Index, Query};
use crate::report::format;

/// Arguments of `hil history`.
#[derive(Debug, Args)]
pub struct HistoryArgs {
    /// Folder of a batch, or one with batches below it.
    #[arg(default_value = "reports/runs")]
    pub store: PathBuf,
    /// Serial number.
    #[arg(long)]
    pub serial: Option<String>,
    /// Lot.
    #[arg(long)]
    pub lot: Option<String>,
    /// Part number.
    #[arg(long)]
    pub part_number: Option<String>,
    /// Metric whose values are wanted: `rmse`, or `phase/rmse`.
    #[arg(long)]
    pub metric: Option<String>,
    /// Outcome: PASS, MARGINAL, FAIL, INVALID, ERROR, ABORTED.
    #[arg(long, ignore_case = true, value_parser = ["PASS", "MARGINAL", "FAIL", "INVALID", "ERROR", "ABORTED", "NOT_RUN"])]
    pub outcome: Option<String>,
    /// Not before: 2026-11-21, or 2026-11-21T08:00:00Z.
    #[arg(long, value_parser = moment)]
    pub since: Option<String>,
    /// Before that time.
    #[arg(long, value_parser = moment)]
    pub until: Option<String>,
    /// At most so many answers, the newest.
    #[arg(long, default_value_t = 1000)]
    pub limit: usize,
    /// Print the whole records instead of a table.
    #[arg(long)]
    pub record: bool,
    /// Make the index anew from the records first.
    #[arg(long)]
    pub rebuild: bool,
    /// What is printed on stdout.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// What is printed on stdout.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// A table.
    #[default]
    Text,
    /// A list of attempts.
    Json,
}

/// A date or a time as RFC 3339, or its beginning.
fn moment(text: &str) -> Result<String, String> {
    let date = text.parse::<jiff::civil::Date>().is_ok();
    if date || text.parse::<jiff::Timestamp>().is_ok() {
        return Ok(text.into());
    }
    Err("a date (2026-11-21) or a time (2026-11-21T08:00:00Z) is wanted".into())
}

/// Runs the command.
pub fn run(args: &HistoryArgs) -> CliResult {
    if !args.store.is_dir() {
        return Err(CliError::input(format!("{}: is no folder with batches", args.store.display())));
    }
    if args.rebuild {
        Index::rebuild(&args.store).map_err(failed)?;
    }
    let query = Query {
        serial: args.serial.clone(),
        lot: args.lot.clone(),
        part_number: args.part_number.clone(),
        outcome: args.outcome.as_ref().map(|o| o.to_uppercase()),
        since: args.since.clone(),
        until: args.until.clone(),
        metric: args.metric.clone(),
        limit: args.limit,
    };
    let (index, answers, anew) = Index::answers(&args.store, &query).map_err(failed)?;
    if index.temporary {
        super::note(&format!("{} cannot be written: the index is made in memory for this question", args.store.display()));
    }
    if anew {
        super::note("warning: the index did not agree with the journals; it was made anew from them");
    }
    if args.record {
        return records(&index, &answers);
    }
    match args.format {
        Format::Json => {
            let text =
                serde_json::to_string_pretty(&serde_json::json!({ "schema": "hil.history/1", "attempts": answers })).unwrap_or_default();
            super::print(&format!("{text}\n"))?;
        }
        Format::Text => super::print(&table(&answers))?,
    }
    Ok(exit::DONE)
}

fn records(index: &Index, answers: &[Answer]) -> CliResult {
    for answer in answers {
        let line = index.record(answer).map_err(failed)?;
        if let Some(record) = line.record {
            super::print(&crate::report::json(&record))?;
        }
    }
    Ok(exit::DONE)
}

fn table(answers: &[Answer]) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "{:<24} {:<20} {:<3} {:<9} {:<16} batch", "serial", "at", "try", "outcome", "plan");
    for a in answers {
        let at = a.at.get(..19).unwrap_or(&a.at);
        let sim = match (a.simulated, a.emulated) {
            (true, _) => " (simulated)",
            (false, true) => " (EMULATED)",
            _ => "",
        };
        let _ = writeln!(out, "{:<24} {at:<20} {:<3} {:<9} {:<16} {}{sim}", a.serial, a.attempt, a.outcome, a.plan, a.batch);
        for m in &a.measurements {
            let value = m.value.map_or_else(|| "-".into(), |v| format::quantity(v, &m.unit));
            let _ = writeln!(out, "    {:<60} {value:>14} {}", format!("{}/{}", m.phase, m.metric), m.outcome);
        }
    }
    let _ = writeln!(out, "{} attempt(s)", answers.len());
    out
}
