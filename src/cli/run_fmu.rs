//! `hil run-fmu`: the child process in which a foreign FMU runs. Hidden: `hil diagnose --model plant.fmu` starts it.

use super::{CliError, CliResult, exit};
use crate::exchange::foreign;

/// Runs the job on stdin.
pub fn run() -> CliResult {
    // A model that hangs does not outlive the program that started it; where the kernel cannot promise that, it is ended by its time limit.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL));
    foreign::serve(&mut std::io::stdin().lock()).map_err(CliError::input)?;
    Ok(exit::DONE)
}
