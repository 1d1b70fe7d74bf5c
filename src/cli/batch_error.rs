//! What can end a batch.

use super::CliError;
use crate::batch::BatchError;

/// What can end a batch, as an exit code.
pub fn failed(error: BatchError) -> CliError {
    match error {
        BatchError::Input(_) | BatchError::Exists { .. } | BatchError::Mismatch { .. } => CliError::input(error),
        BatchError::Store { .. } | BatchError::NotReadBack { .. } | BatchError::Busy { .. } | BatchError::Index { .. } => {
            CliError::not_stored(error)
        }
        BatchError::Rig(_) | BatchError::Gate(_) => CliError::rig(error),
    }
}
