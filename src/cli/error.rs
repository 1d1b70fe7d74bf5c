//! What a subcommand ends with: exit codes and errors that carry one.

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

/// A message without the numbers of the operating system: "No such file or directory (os error 2)" says it in words before.
pub fn plain(message: &str) -> String {
    let mut pieces = message.split(" (os error ");
    let mut out = pieces.next().unwrap_or_default().to_string();
    for piece in pieces {
        match piece.split_once(')') {
            Some((number, rest)) if number.bytes().all(|b| b.is_ascii_digit()) => out += rest,
            _ => out += &format!(" (os error {piece}"),
        }
    }
    out
}

/// What is to be said of a number that clap could not read, without the words of the programming language.
pub fn not_a_number(error: &clap::Error) -> Option<String> {
    use clap::error::{ContextKind, ContextValue};
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    let (argument, value) = (text(ContextKind::InvalidArg)?, text(ContextKind::InvalidValue)?);
    let source = std::error::Error::source(error)?.to_string();
    let reason = match source.split_once(" is not in ").and_then(|(_, range)| range.split_once("..")) {
        Some((low, high)) => match high.trim_start_matches('=') {
            "" | "255" | "65535" | "4294967295" | "18446744073709551615" => format!("a whole number from {low} on is wanted"),
            high => format!("a whole number from {low} to {high} is wanted"),
        },
        None if source.contains("digit") || source.contains("integer") || source.contains("number too") => {
            "a whole number is wanted".into()
        }
        None => return None,
    };
    Some(format!("invalid value '{value}' for '{argument}': {reason}"))
}

/// What a subcommand ends with: an exit code, or an error that carries one.
pub type CliResult = Result<u8, CliError>;
