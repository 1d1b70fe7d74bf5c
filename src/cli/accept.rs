//! `hil accept`: makes a record the accepted one of its plan, the one that a pull request diffs.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;

use super::{CliError, CliResult, exit};
use crate::record::{Outcome, RECORD_FILE, TestRecord};
use crate::recording::{RecordingError, replace_file};
use crate::report;

/// Which record.
#[derive(Debug, Args)]
pub struct AcceptArgs {
    /// The record: a record.json or a run's folder
    record: PathBuf,
    /// Folder of the accepted reports
    #[arg(long, default_value = "reports", value_name = "DIR")]
    into: PathBuf,
}

/// Writes record.json, report.md and report.txt into the plan's folder, and prints what that changes.
pub fn run(args: &AcceptArgs) -> CliResult {
    let record = report::without_provenance(&TestRecord::load(&args.record).map_err(CliError::input)?);
    if !matches!(record.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail) {
        let outcome = record.outcome.text();
        return Err(CliError::input(format!(
            "{}: the outcome is {outcome}; only a run with a verdict (PASS, MARGINAL, FAIL) can be accepted",
            args.record.display()
        )));
    }
    let folder = args.into.join(folder_name(&record.plan.name)?);
    let previous = TestRecord::load(&folder).ok();
    crate::output::make_folder(&folder).map_err(|e| CliError::not_stored(format!("{}: {e}", folder.display())))?;
    store(&folder.join("report.md"), &report::markdown(&record))?;
    store(&folder.join("report.txt"), &report::text(&record))?;
    // The record comes last: it is what `hil diff` reads, so it must not be newer than the reports beside it.
    store(&folder.join(RECORD_FILE), &report::json(&record))?;
    let diff = report::diff::compare(&record.plan.name, previous.as_ref(), Some(&record), &report::diff::Tolerances::default());
    super::print(&report::diff::text(&[diff]))?;
    let _ = writeln!(anstream::stderr(), "accepted: {}", folder.display());
    Ok(exit::DONE)
}

/// A plan's name as the name of a folder; it must not lead elsewhere.
fn folder_name(plan: &str) -> Result<&str, CliError> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if plan.is_empty() || plan.starts_with('.') || !plan.chars().all(allowed) {
        return Err(CliError::input(format!(
            "plan name `{plan}`: a folder under the accepted reports needs a name of letters, digits, `-`, `_` and `.`"
        )));
    }
    Ok(plan)
}

fn store(path: &Path, text: &str) -> Result<(), CliError> {
    replace_file(path, |file| file.write_all(text.as_bytes())).map_err(|e: RecordingError| CliError::not_stored(e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_name_stays_below_the_folder() {
        assert!(folder_name("triangle-sweep").is_ok());
        for wrong in ["", ".", "..", "../x", "a/b", "a b", "C:x"] {
            assert!(folder_name(wrong).is_err(), "{wrong}");
        }
    }
}
