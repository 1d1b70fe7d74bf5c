//! What goes to the terminal: results to stdout, the rest to stderr.

use std::io::Write;

use super::error::{CliError, exit};
use super::narrow;

/// Writes `text` to stdout, as wide as a terminal there is; a closed pipe (`hil explain | head`) is no error.
pub fn print(text: &str) -> Result<(), CliError> {
    let narrow = narrow::for_terminal(text);
    let text = narrow.as_deref().unwrap_or(text);
    let mut out = anstream::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(CliError::not_stored(format!("stdout: {error}"))),
        _ => Ok(()),
    }
}

/// Writes a line to stderr, as wide as a terminal there is.
pub fn note(text: &str) {
    let narrow = narrow::for_notes(text);
    let text = narrow.as_deref().unwrap_or(text);
    let _ = writeln!(anstream::stderr(), "{text}");
}

/// One JSON document with a newline at its end.
pub fn to_json(value: &impl serde::Serialize) -> Result<String, CliError> {
    match serde_json::to_string_pretty(value) {
        Ok(text) => Ok(text + "\n"),
        Err(error) => Err(CliError { code: exit::INTERNAL, message: error.to_string() }),
    }
}
