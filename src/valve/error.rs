//! What can be wrong with a valve model.

use std::path::PathBuf;

/// Why a valve file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ValveError {
    /// The file cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// No file of that name.
    #[error(transparent)]
    Unknown(#[from] crate::shipped::NotFound),
    /// The text is not a valve file; the message shows the place.
    #[error("{0}")]
    Syntax(String),
    /// A value is of the right type, but makes no sense.
    #[error("{file}: {key}: {problem}")]
    Value {
        /// The file.
        file: String,
        /// The key.
        key: String,
        /// What is wrong, and what is allowed.
        problem: String,
    },
}
