//! A file appears whole under its name or not at all.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use super::error::RecordingError;
use crate::output::{WriteError, whole_file};

/// Writes a file that is whole under its name, or not there ([`whole_file`]).
///
/// # Errors
/// What the file system or `write` says; nothing is left behind then, and an older file stays as it was.
pub fn replace_file<E>(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>) -> Result<(), RecordingError>
where
    RecordingError: From<(E, std::path::PathBuf)>,
{
    whole_file(path, write).map_err(|e| match e {
        WriteError::Io(source) => RecordingError::io(path)(source),
        WriteError::Content(e) => RecordingError::from((e, path.into())),
    })
}

impl From<(std::io::Error, std::path::PathBuf)> for RecordingError {
    fn from((source, path): (std::io::Error, std::path::PathBuf)) -> Self {
        Self::Io { path, source }
    }
}
