//! The file formats of recordings.

use std::path::Path;

use super::error::RecordingError;

/// A file format of recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Text with a header: `.csv`, `.tsv`, `.txt`.
    Csv,
    /// Apache Parquet: `.parquet`, `.pq`.
    Parquet,
    /// ASAM MDF 4: `.mf4`, `.mdf`.
    Mdf4,
}

impl Format {
    /// The format that a file's extension names.
    ///
    /// # Errors
    /// [`RecordingError::UnknownFormat`] with what is allowed.
    pub fn of(path: &Path) -> Result<Self, RecordingError> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match extension.as_str() {
            "csv" | "tsv" | "txt" => Ok(Self::Csv),
            "parquet" | "pq" => Ok(Self::Parquet),
            "mf4" | "mdf" => Ok(Self::Mdf4),
            _ => Err(RecordingError::UnknownFormat { path: path.into(), extension }),
        }
    }
}
