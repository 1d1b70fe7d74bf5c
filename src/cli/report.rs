//! `hil report`: an old record, or an old batch, shown again in any format.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;

use super::outputs::Force;
use super::run::Format;
use super::{CliError, CliResult, batch_diff, batch_folder, exit, run_folder};
use crate::output::{Mark, Outputs};
use crate::record::{TestRecord, Trace};
use crate::recording::replace_file;
use crate::report;

/// What to show.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// The record: a record.json, the folder of a run, or the folder of a batch
    record: PathBuf,
    /// What is printed
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    /// Write it here instead of stdout
    #[arg(short = 'o', long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Existing files.
    #[command(flatten)]
    force: Force,
}

/// Prints the report; the exit code says nothing of the verdict.
pub fn run(args: &ReportArgs) -> CliResult {
    let mark = if args.format == Format::Html { Mark::Page } else { Mark::None };
    let _claim = Outputs::new(args.force.force).reads([&args.record]).file(args.output.as_ref(), mark).claim()?;
    let text = if batch_diff::is_batch(&args.record) { of_batch(&args.record, args.format)? } else { of_run(&args.record, args.format)? };
    match &args.output {
        Some(path) => replace_file(path, |file| file.write_all(text.as_bytes())).map_err(CliError::not_stored)?,
        None => super::print(&text)?,
    }
    Ok(exit::DONE)
}

fn of_run(path: &Path, format: Format) -> Result<String, CliError> {
    let record = TestRecord::load(path).map_err(CliError::input)?;
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let trace = match format {
        Format::Html => run_folder::read_trace(folder, &record)?.unwrap_or_else(|| {
            super::note(&format!("{}: no trace lies beside the record; its page has no figures over time", folder.display()));
            Trace::default()
        }),
        _ => Trace::default(),
    };
    Ok(match format {
        Format::Text => report::text(&record),
        Format::Json => report::json(&record),
        Format::Markdown => report::markdown(&record),
        Format::Junit => report::junit(&record),
        Format::Html => report::html(&record, &trace),
    })
}

fn of_batch(folder: &Path, format: Format) -> Result<String, CliError> {
    let (summary, tally) = batch_diff::loaded(folder)?;
    Ok(match format {
        Format::Text => report::batch::text(&summary),
        Format::Json => batch_folder::json(&summary),
        Format::Markdown => report::batch::markdown(&summary),
        Format::Junit => batch_folder::junit(&summary, &tally),
        Format::Html => report::batch::html(&summary, &batch_folder::report_id(&summary)),
    })
}
