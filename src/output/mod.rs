//! What the program writes: the guard that every command asks before its work begins, and files that are whole under
//! their name or not there.
//!
//! A command lists what it reads and what it writes in [`Outputs`] and claims all of it at once; [`whole_file`] then
//! writes each. Nothing is replaced that is an input, another output, part of a record, or not the program's own.

mod cell;
mod claim;
mod mark;
mod whole;

pub use cell::{inert, original};
pub use claim::{Claim, Outputs};
pub use mark::Mark;
pub use whole::{WriteError, clear_leftovers, folder_name, make_folder, make_folder_within, sync_folder, whole_file};

use std::path::PathBuf;

/// Why an output may not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// It is one of the files that the command reads.
    #[error("{}: is read by this command as {}, so it cannot be written; name another file", path.display(), input.display())]
    IsInput {
        /// The output.
        path: PathBuf,
        /// The input as it was named.
        input: PathBuf,
    },
    /// Two outputs of the command are the same file.
    #[error("{}: is named twice as an output ({}); name two files", path.display(), other.display())]
    Twice {
        /// The output.
        path: PathBuf,
        /// The other output.
        other: PathBuf,
    },
    /// It exists and nothing shows that the program wrote it.
    #[error("{}: exists and {found}; --force replaces it, or name another file", path.display())]
    Exists {
        /// The output.
        path: PathBuf,
        /// What it is, and what would be replaced without asking.
        found: String,
    },
    /// It belongs to a record, or is a folder that holds one.
    #[error("{}: {what}; a record is never written over, name another place", path.display())]
    Record {
        /// The output.
        path: PathBuf,
        /// What is there.
        what: String,
    },
    /// Another process works on the same folder.
    #[error("{}: another `hil` works in this folder; wait for it, or name another", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// It cannot be written.
    #[error("{}: {reason}", path.display())]
    Unwritable {
        /// The output.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
}
