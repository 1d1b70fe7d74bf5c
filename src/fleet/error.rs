//! What can go wrong with a fleet.

use std::path::{Path, PathBuf};

/// Why a list cannot be worked off, or rows not collected.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// The list is wrong: the message names file, row and key, and what is allowed.
    #[error("{0}")]
    List(String),
    /// The store cannot be written or read; what was finished before is there, and another call goes on.
    #[error("{path}: {source}; what is finished is kept, call it again", path = path.display())]
    Store {
        /// File or folder.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A table of rows is damaged.
    #[error("{path}: {what}", path = path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
}

impl FleetError {
    pub(super) fn store(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Store { path, source }
    }
}
