//! Which foreign code the user has allowed: digests, one a line, in the user's own state folder.

use std::io::Write;
use std::path::PathBuf;

/// The digests that the user trusts.
#[derive(Debug, Clone, Default)]
pub struct Trust {
    file: Option<PathBuf>,
    now: Vec<String>,
}

impl Trust {
    /// The list of this user: `$XDG_STATE_HOME/hil/trusted-fmu`, by default below `~/.local/state`.
    pub fn of_user() -> Self {
        let state = std::env::var_os("XDG_STATE_HOME").map(PathBuf::from).filter(|p| p.is_absolute());
        let home = || std::env::var_os("HOME").map(|h| PathBuf::from(h).join(".local/state"));
        Self { file: state.or_else(home).map(|folder| folder.join("hil/trusted-fmu")), now: Vec::new() }
    }

    /// A list in this file.
    pub fn at(file: PathBuf) -> Self {
        Self { file: Some(file), now: Vec::new() }
    }

    /// The same list, with a digest that is trusted for this call.
    pub fn and_now(mut self, sha256: &str) -> Self {
        self.now.push(sha256.into());
        self
    }

    /// Whether this digest is on the list.
    pub fn holds(&self, sha256: &str) -> bool {
        self.now.iter().any(|now| now == sha256) || self.remembers(sha256)
    }

    fn remembers(&self, sha256: &str) -> bool {
        let text = self.file.as_ref().and_then(|f| std::fs::read_to_string(f).ok()).unwrap_or_default();
        text.lines().any(|line| line.split_whitespace().next() == Some(sha256))
    }

    /// Puts a digest on the list.
    ///
    /// # Errors
    /// Where it cannot be remembered; the present run is allowed all the same.
    pub fn add(&self, sha256: &str, file_name: &str) -> std::io::Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        if self.remembers(sha256) {
            return Ok(());
        }
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let clean: String = file_name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        std::fs::OpenOptions::new().create(true).append(true).open(file)?.write_all(format!("{sha256} {clean}\n").as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_is_trusted_after_it_was_added_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let trust = Trust::at(folder.path().join("state/trusted-fmu"));
        assert!(!trust.holds("aa"));
        trust.add("aa", "plant.fmu\nbb").unwrap();
        trust.add("aa", "plant.fmu").unwrap();
        assert!(trust.holds("aa") && !trust.holds("bb") && !trust.holds(""));
    }
}
