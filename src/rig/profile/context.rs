//! The file under check, and where in it a key stands.

use super::parts::ProfileError;

/// The file under check, for messages.
pub(super) struct Context<'a> {
    pub(super) text: &'a str,
    pub(super) source_name: &'a str,
}

impl Context<'_> {
    /// An error at `key`, written with dots as in TOML: `signal.pressure.scale`.
    pub(super) fn error(&self, key: &str, message: impl Into<String>) -> ProfileError {
        ProfileError::Check { file: self.source_name.into(), line: line_of(self.text, key), key: key.into(), message: message.into() }
    }
}

/// Line of `key`, or of the innermost of its tables that the text has; 1 where there is none.
fn line_of(text: &str, key: &str) -> usize {
    let wanted: Vec<String> = key.split('.').map(|p| p.split('[').next().unwrap_or(p).to_string()).collect();
    let (mut table, mut best, mut depth) = (Vec::<String>::new(), 1, 0);
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        let path = if line.starts_with('[') {
            table = line.trim_matches(['[', ']']).split('.').map(|p| p.trim().to_string()).collect();
            table.clone()
        } else {
            let name = line.split(['=', '#']).next().unwrap_or_default().trim();
            table.iter().cloned().chain(name.split('.').map(|p| p.trim().to_string())).collect()
        };
        let common = path.iter().zip(&wanted).take_while(|(a, b)| a == b).count();
        if common > depth && common == path.len() {
            (best, depth) = (index + 1, common);
        }
    }
    best
}
