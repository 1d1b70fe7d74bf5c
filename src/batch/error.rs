//! What can go wrong with a batch and its store.

use std::path::{Path, PathBuf};

/// Why a batch cannot begin, go on, or be read.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// A file that a person wrote is wrong; the message names file, row or line, and what is allowed.
    #[error("{0}")]
    Input(String),
    /// The store cannot be written or read; nothing that was confirmed before is lost.
    #[error("{path}: {source}", path = path.display())]
    Store {
        /// File or folder.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// What was written does not read back.
    #[error("{path}: the record written at byte {offset} does not read back as it was written; nothing was confirmed", path = path.display())]
    NotReadBack {
        /// Segment of the journal.
        path: PathBuf,
        /// Place of the record.
        offset: u64,
    },
    /// Another process holds the folder.
    #[error("{path}: another `hil` works in this folder; wait for it, or give another --out", path = path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// The folder holds a batch already.
    #[error("{path}: holds a batch already; --resume goes on with it, another --out begins a new one", path = path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The batch in the folder is not the one that was asked for.
    #[error("{path}: cannot resume: {what}", path = path.display())]
    Mismatch {
        /// The folder.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// The index failed; it can be rebuilt from the records.
    #[cfg(feature = "history")]
    #[error("{path}: {source}; the index can be made anew from the records: hil history --rebuild", path = path.display())]
    Index {
        /// The index file.
        path: PathBuf,
        /// What SQLite says.
        source: rusqlite::Error,
    },
    /// The rig or the station failed.
    #[error("{0}")]
    Rig(String),
    /// The gate of the master valves is closed.
    #[error("{0}")]
    Gate(String),
}

impl BatchError {
    /// An I/O error at a path.
    pub fn store(path: &Path, source: std::io::Error) -> Self {
        Self::Store { path: path.to_path_buf(), source }
    }
}
