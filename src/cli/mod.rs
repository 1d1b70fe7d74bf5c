//! The command line: one file per subcommand, each with its arguments and its `run`.
//!
//! Data goes to stdout, progress and messages to stderr. The exit codes are part of the contract with scripts
//! and CI: see [`exit`].

mod completions;
mod identify;

use std::io::Write;

use clap::{Parser, Subcommand};

/// Exit codes, stable across versions.
pub mod exit {
    /// Done; for `run` and `batch`: PASS or MARGINAL; for `diff`: no difference beyond tolerance.
    pub const DONE: u8 = 0;
    /// A negative verdict: FAIL, a difference, a failed check with `--fail-on mismatch`.
    pub const NEGATIVE: u8 = 1;
    /// Wrong usage of the command line.
    pub const USAGE: u8 = 2;
    /// An input file is wrong.
    pub const INPUT: u8 = 3;
    /// Rig or station error: communication, interlock, safe state not confirmed.
    pub const RIG: u8 = 4;
    /// Aborted by a signal; the safe state was reached.
    pub const ABORTED: u8 = 5;
    /// INVALID: timing or preconditions broken, so neither PASS nor FAIL.
    pub const INVALID: u8 = 6;
    /// Tested, but the record could not be stored.
    pub const NOT_STORED: u8 = 7;
    /// Internal error: a bug.
    pub const INTERNAL: u8 = 70;
}

/// An error with the exit code that it ends the program with. The message is complete: what, where, what is allowed.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct CliError {
    /// One of [`exit`].
    pub code: u8,
    /// What is printed to stderr.
    pub message: String,
}

impl CliError {
    /// The command line asks for something that cannot be.
    pub fn usage(message: impl ToString) -> Self {
        Self { code: exit::USAGE, message: message.to_string() }
    }
    /// An input file is wrong.
    pub fn input(message: impl ToString) -> Self {
        Self { code: exit::INPUT, message: message.to_string() }
    }
    /// The rig or the station failed.
    pub fn rig(message: impl ToString) -> Self {
        Self { code: exit::RIG, message: message.to_string() }
    }
    /// The result could not be stored.
    pub fn not_stored(message: impl ToString) -> Self {
        Self { code: exit::NOT_STORED, message: message.to_string() }
    }
}

/// What a subcommand ends with: an exit code, or an error that carries one.
pub type CliResult = Result<u8, CliError>;

/// Hardware-in-the-loop acceptance tests for electro-hydraulic clutch valves.
#[derive(Debug, Parser)]
#[command(name = "hil", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Identify a valve model from a recording.
    #[command(
        after_help = "Examples:\n  hil identify sweep.csv -o valve.toml\n  hil identify log.csv --map current_a=\"I_cmd [mA]\" -o valve.toml"
    )]
    Identify(identify::IdentifyArgs),
    /// Print a completion script for a shell.
    Completions(completions::CompletionsArgs),
}

/// Runs the command line and returns the exit code.
pub fn main() -> u8 {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let code = if error.use_stderr() { exit::USAGE } else { exit::DONE };
            let _ = error.print();
            return code;
        }
    };
    let result: CliResult = match cli.command {
        Command::Identify(args) => identify::run(&args),
        Command::Completions(args) => completions::run(&args),
    };
    result.unwrap_or_else(|error| {
        let _ = writeln!(anstream::stderr(), "error: {error}");
        error.code
    })
}

/// Writes `text` to stdout; a closed pipe (`hil explain | head`) is no error.
pub fn print(text: &str) -> Result<(), CliError> {
    let mut out = anstream::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(CliError::not_stored(format!("stdout: {error}"))),
        _ => Ok(()),
    }
}
