//! What stands for Parquet in a library that was built without the feature `parquet`: an error that says so.

use std::path::Path;

use super::raw::Table;
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

/// As [`write_parquet`].
///
/// # Errors
/// Always.
pub fn write_parquet_stating(path: &Path, tables: &[Vec<Column<'_>>], _input: Option<crate::valve::Input>) -> Result<(), RecordingError> {
    write_parquet(path, tables)
}

/// The rows of one value of a column; here there are none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// The column.
    pub column: String,
    /// Its value.
    pub value: String,
    /// Other columns that hold one value in all these rows.
    pub facts: std::collections::BTreeMap<String, String>,
}

impl Group {
    /// The rows as a recording; here never.
    ///
    /// # Errors
    /// Always.
    pub fn read(&self, path: &Path, _map: &[Mapping]) -> Result<super::Recording, RecordingError> {
        Err(absent(&path.display().to_string()))
    }
}

/// The groups of a file; here never.
///
/// # Errors
/// Always.
pub fn groups(path: &Path, _column: &str, _map: &[Mapping]) -> Result<Vec<Group>, RecordingError> {
    Err(absent(&path.display().to_string()))
}
