//! The outputs of a command: the flag that replaces, and the exit codes of what the guard refuses.

use clap::Args;

use super::{CliError, exit};
use crate::output::{Mark, OutputError};

/// A valve model.
pub const VALVE: Mark = Mark::Schema("hil.valve/1");
/// A foreign model with effects about it.
pub const ATTACHED: Mark = Mark::Schema(crate::exchange::ATTACHED_SCHEMA);
/// A plan.
pub const PLAN: Mark = Mark::Schema(crate::plan::SCHEMA);
/// A mapping.
pub const MAPPING: Mark = Mark::Schema(crate::recording::MAPPING_SCHEMA);
/// The files of a run's folder; the record is written last and never replaced.
pub const RUN: [(&str, Mark); 5] = [
    ("trace.parquet", Mark::None),
    ("report.html", Mark::Page),
    ("junit.xml", Mark::None),
    ("frames.txt", Mark::None),
    ("record.json", Mark::None),
];

/// Whether existing files may be replaced.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct Force {
    /// Replace existing files also where they do not carry hil's own mark; an input or a record never.
    #[arg(long)]
    pub force: bool,
}

impl From<OutputError> for CliError {
    /// What the command line asks for cannot be: usage. What the disk refuses: not stored.
    fn from(error: OutputError) -> Self {
        let code = match error {
            OutputError::Busy { .. } | OutputError::Unwritable { .. } => exit::NOT_STORED,
            _ => exit::USAGE,
        };
        Self { code, message: error.to_string() }
    }
}
