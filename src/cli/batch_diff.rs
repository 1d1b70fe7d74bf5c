//! `hil diff` of two batch folders: which metrics moved, by how much, and whether that is more than noise.

use std::path::Path;

use super::batch_error::failed;
use super::diff_format::DiffFormat;
use super::{CliError, CliResult, exit};
use crate::batch::comparison::compare;
use crate::batch::store::{load, read_header};
use crate::batch::summary::{BatchSummary, summarise};
use crate::batch::tally::{Attempt, Tally};
use crate::report::batch::{comparison_markdown, comparison_text};

/// Whether the folder is that of a batch.
pub fn is_batch(dir: &Path) -> bool {
    dir.join("batch.json").is_file() && crate::batch::journal::folder(dir).is_dir()
}

/// Compares two batches; the exit code is 1 where they differ by more than noise.
pub fn run(before: &Path, after: &Path, format: DiffFormat) -> CliResult {
    let comparison = compare(&summary(before)?, &summary(after)?);
    super::print(&match format {
        DiffFormat::Text => comparison_text(&comparison),
        DiffFormat::Markdown => comparison_markdown(&comparison),
        DiffFormat::Json => {
            let value = serde_json::json!({ "schema": "hil.batch-diff/1", "comparison": comparison });
            format!("{}\n", serde_json::to_string_pretty(&value).unwrap_or_default())
        }
    })?;
    Ok(if comparison.moved { exit::NEGATIVE } else { exit::DONE })
}

fn summary(dir: &Path) -> Result<BatchSummary, CliError> {
    Ok(loaded(dir)?.0)
}

/// A batch as its journal tells it, with the valves' own reports linked.
pub fn loaded(dir: &Path) -> Result<(BatchSummary, Tally), CliError> {
    let header = read_header(dir).map_err(failed)?;
    let loaded = load(dir).map_err(failed)?;
    if loaded.tally.attempts().is_empty() {
        return Err(CliError::input(format!("{}: holds no finished attempt", dir.display())));
    }
    let link = |a: &Attempt| super::batch_folder::report_link(dir, a);
    Ok((summarise(&header, &loaded.tally, loaded.damage, |_| None, link), loaded.tally))
}
