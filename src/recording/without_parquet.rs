//! What stands for Parquet in a library that was built without the feature `parquet`: an error that says so.

use std::path::Path;

use super::inspect::Table;
use super::source::Rows;
use super::{Cells, Column, Mapping, RecordingError};

fn absent(file: &str) -> RecordingError {
    RecordingError::format(file, "this library was built without the feature `parquet`; CSV and MDF 4 are read")
}

pub(super) fn read(_path: &Path, file: &str, _map: &[Mapping]) -> Result<Rows, RecordingError> {
    Err(absent(file))
}

pub(super) fn table(path: &Path) -> Result<Table, RecordingError> {
    Err(absent(&path.display().to_string()))
}

/// Every column of a Parquet file; here never.
///
/// # Errors
/// Always.
pub fn read_parquet(path: &Path) -> Result<Vec<(String, Cells)>, RecordingError> {
    Err(absent(&path.display().to_string()))
}

/// Writes tables as one Parquet file; here never.
///
/// # Errors
/// Always.
pub fn write_parquet(path: &Path, _tables: &[Vec<Column<'_>>]) -> Result<(), RecordingError> {
    Err(absent(&path.display().to_string()))
}
