//! Recordings and truth as files.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::output::{WriteError, whole_file};
use crate::recording::{Recording, RecordingError, Run};

/// What can go wrong outside the arithmetic.
#[derive(Debug, thiserror::Error)]
pub enum ChallengeError {
    /// A file or folder could not be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A recording could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// Writes a run as a recording.
///
/// # Errors
/// What the file system says.
pub fn write_run(path: &Path, run: &Run) -> Result<(), ChallengeError> {
    let recording = Recording { runs: vec![run.clone()], ..Recording::default() };
    Ok(recording.write(path)?)
}

/// Writes a text, whole or not at all, so that nobody ever reads half a file.
///
/// # Errors
/// What the file system says.
pub fn write_text(path: &Path, text: &str) -> Result<(), ChallengeError> {
    let fail = |e: WriteError<std::io::Error>| ChallengeError::Write { path: path.to_owned(), source: e.into_io() };
    whole_file(path, |file| file.write_all(text.as_bytes())).map_err(fail)
}
