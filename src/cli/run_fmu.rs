//! `hil run-fmu`: the child process in which a foreign FMU runs. Hidden: `hil diagnose --model plant.fmu` starts it.

use super::{CliError, CliResult, exit};
use crate::exchange::foreign;

/// Runs the job on stdin.
pub fn run() -> CliResult {
    foreign::serve(&mut std::io::stdin().lock(), &mut std::io::stdout().lock()).map_err(CliError::input)?;
    Ok(exit::DONE)
}
