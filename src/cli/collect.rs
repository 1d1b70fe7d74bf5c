//! `hil collect`: the rows of many jobs as one table and one page.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::Value;

use super::outputs::Force;
use super::{CliError, CliResult, exit};
use crate::fleet::collected::collect;
use crate::fleet::findings::{FleetFinding, findings};
use crate::fleet::rate::Rate;
use crate::fleet::standing::Standing;
use crate::fleet::{FleetError, table};
use crate::output::{Mark, Outputs};
use crate::recording::replace_file;
use crate::report::fleet as report;

/// What to collect.
#[derive(Debug, Args)]
pub struct CollectArgs {
    /// Folders that `hil diagnose --jobs --out` has filled
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// The table; an earlier one of this name says which findings are not new
    #[arg(short = 'o', long, value_name = "fleet.parquet")]
    output: PathBuf,
    /// The page
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// What `hil challenge --format json` has measured of this version: shares are corrected for what the diagnosis misses
    /// and invents
    #[arg(long, value_name = "CHALLENGE.json")]
    confusion: Option<PathBuf>,
    /// Exit with 1 where there is a finding that the earlier table does not hold
    #[arg(long, value_enum, value_name = "new-finding")]
    fail_on: Option<FailOn>,
    /// Existing files.
    #[command(flatten)]
    force: Force,
    /// Format of what is printed
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FailOn {
    NewFinding,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Reads the rows, finds what is more than chance, writes table and page.
pub fn run(args: &CollectArgs) -> CliResult {
    let failed = |e: FleetError| match e {
        FleetError::Store { .. } | FleetError::List(_) | FleetError::Table { .. } => CliError::input(e),
    };
    if !args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("parquet")) {
        return Err(CliError::usage(format!("{}: the table is a Parquet file, so its name ends with .parquet", args.output.display())));
    }
    if let Some(folder) = args.folders.iter().find(|folder| !folder.join("rows").is_dir()) {
        let what = match folder.exists() {
            true => "holds no rows: `hil diagnose --jobs LIST --out DIR` fills such a folder",
            false => "there is no such folder",
        };
        return Err(CliError::input(format!("{}: {what}", folder.display())));
    }
    // a table of a fleet is known by its findings, which are read here: no other file is replaced
    let (earlier, before) = if args.force.force { (Vec::new(), None) } else { table::earlier(&args.output).map_err(failed)? };
    let _claim = Outputs::new(args.force.force).file(args.report.as_ref(), Mark::Page).claim()?;
    let confusion = args.confusion.as_deref().map(confusion).transpose()?;
    let collected = collect(args.folders.iter().map(PathBuf::as_path), before).map_err(failed)?;
    let rows = &collected.rows;
    let standing = Standing::of(rows);
    let found = findings(rows, &standing);
    let names: Vec<String> = found.iter().map(FleetFinding::name).collect();
    let new: Vec<&String> = names.iter().filter(|n| !earlier.contains(n)).collect();
    let summary = report::Summary::new(rows, &standing, &found, &new, confusion);
    if let Some(path) = &args.report {
        let page = report::page(rows, &standing, &summary, path.parent().unwrap_or(Path::new("")));
        replace_file(path, |file| file.write_all(page.as_bytes())).map_err(CliError::not_stored)?;
    }
    // last: once the table holds a finding, it is no longer new
    table::write(&args.output, &collected, &standing, &names).map_err(CliError::not_stored)?;
    super::print(&if args.format == Format::Json { report::json(&summary) } else { report::text(&summary) })?;
    Ok(if args.fail_on.is_some() && !new.is_empty() { exit::NEGATIVE } else { exit::DONE })
}

/// Share of the faulty that is found, and of the healthy that is accused, as a challenge has measured them.
fn confusion(path: &Path) -> Result<(Rate, Rate), CliError> {
    let wrong = |what: String| CliError::input(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| wrong(e.to_string()))?;
    let document: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let rate = |key: &str| {
        let count = |k: &str| document["figures"][key][k].as_u64().map(|n| n as usize);
        count("hits")
            .zip(count("of"))
            .map(|(hits, of)| Rate::new(hits, of))
            .ok_or_else(|| wrong(format!("no figures.{key}; this is what `hil challenge --format json` prints")))
    };
    Ok((rate("some_cause_named")?, rate("false_alarm")?))
}
