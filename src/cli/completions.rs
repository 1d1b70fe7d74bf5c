//! `hil completions`: completion scripts for shells.

use clap::{Args, Command};

use super::CliResult;

/// Arguments of `hil completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell to complete for.
    shell: clap_complete::Shell,
}

/// Prints the script.
pub fn run(args: &CompletionsArgs, program: &mut Command) -> CliResult {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, program, "hil", &mut script);
    super::print(&String::from_utf8_lossy(&script))?;
    Ok(super::exit::DONE)
}
