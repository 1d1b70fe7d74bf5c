//! What goes to the terminal: results to stdout, the rest to stderr.

use std::borrow::Cow;
use std::io::Write;

use super::error::{CliError, exit};
use super::narrow;

/// Writes `text` to stdout, as wide as a terminal there is; a closed pipe (`hil explain | head`) is no error.
pub fn print(text: &str) -> Result<(), CliError> {
    let narrow = narrow::for_terminal(text);
    let text = narrow.as_deref().unwrap_or(text);
    let text = &verdicts_painted(text);
    let mut out = anstream::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(CliError::not_stored(format!("stdout: {error}"))),
        _ => Ok(()),
    }
}

/// The verdicts at the ends of lines in their colours, which only a terminal is sent; what programs read (JSON, XML, HTML, Markdown) stays.
fn verdicts_painted(text: &str) -> Cow<'_, str> {
    // Green, yellow, red.
    const COLORS: [(&str, u8); 6] = [("PASS", 32), ("MARGINAL", 33), ("FAIL", 31), ("ERROR", 31), ("INVALID", 31), ("ABORTED", 31)];
    if text.starts_with(['{', '[', '<', '#', '|']) || !COLORS.iter().any(|(word, _)| text.contains(word)) {
        return Cow::Borrowed(text);
    }
    let painted = |line: &str| {
        let body = line.trim_end_matches('\n');
        let color = COLORS.iter().find(|(word, _)| body.strip_suffix(word).is_some_and(|rest| rest.is_empty() || rest.ends_with(' ')));
        color.map_or_else(
            || line.to_owned(),
            |(word, color)| format!("{}\u{1b}[1;{color}m{word}\u{1b}[0m{}", &body[..body.len() - word.len()], &line[body.len()..]),
        )
    };
    Cow::Owned(text.split_inclusive('\n').map(painted).collect())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_at_the_end_of_a_line_has_a_colour_and_nothing_else_has() {
        let text = "tipin on paper   FAIL\n  limits 1 PASS, 6 FAIL\nBYPASS\nnothing\n";
        let painted = verdicts_painted(text);
        assert_eq!(painted, "tipin on paper   \u{1b}[1;31mFAIL\u{1b}[0m\n  limits 1 PASS, 6 \u{1b}[1;31mFAIL\u{1b}[0m\nBYPASS\nnothing\n");
        assert_eq!(verdicts_painted("# tipin FAIL\n"), "# tipin FAIL\n");
    }
}
