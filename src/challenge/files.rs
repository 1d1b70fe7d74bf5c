//! Recordings and truth as files.

use std::path::{Path, PathBuf};

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

/// Writes a text beside its place and moves it there, so that nobody ever reads half a file.
///
/// # Errors
/// What the file system says.
pub fn write_text(path: &Path, text: &str) -> Result<(), ChallengeError> {
    let fail = |source| ChallengeError::Write { path: path.to_owned(), source };
    let unfinished = path.with_extension("part");
    std::fs::write(&unfinished, text).map_err(fail)?;
    std::fs::rename(&unfinished, path).map_err(fail)
}
