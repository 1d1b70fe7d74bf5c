//! A foreign plant model as an FMU: read, trusted once, run in a process of its own.
//!
//! The code inside an FMU is anybody's. It runs only after the user has said so for this very file, and in a child
//! process, so that a crash or an endless loop of it is a message of ours.

mod archive;
mod description;
mod fmi2;
mod fmi3;
mod job;
mod process;
mod trust;

pub use archive::ForeignFmu;
pub use description::{Description, Port, Ports};
pub use job::Job;
pub use process::{TIME_LIMIT, Unpacked, serve};
pub use trust::Trust;

/// What can be wrong with a foreign model.
#[derive(Debug, thiserror::Error)]
pub enum ForeignError {
    /// The file cannot be read.
    #[error("{file}: {what}")]
    File {
        /// The FMU.
        file: String,
        /// What is wrong, and what is wanted.
        what: String,
    },
    /// Nobody has said that the code inside may run.
    #[error(
        "{file}: holds native code that would run here with your rights; say once that you trust it with --trust-fmu (SHA-256 {sha256})"
    )]
    NotTrusted {
        /// The FMU.
        file: String,
        /// Digest of the file.
        sha256: String,
    },
    /// The model did not do what was asked.
    #[error("{file}: {what}")]
    Run {
        /// The FMU.
        file: String,
        /// What it did.
        what: String,
    },
}
