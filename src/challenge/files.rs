//! Recordings and truth as files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::draw::Case;
use crate::recording::Run;

/// What can go wrong outside the arithmetic.
#[derive(Debug, thiserror::Error)]
pub enum ChallengeError {
    /// A file or folder could not be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Writes a run as CSV (`time_s,current_a,pressure_bar[,target_bar]`).
pub fn write_run(path: &Path, run: &Run) -> Result<(), ChallengeError> {
    write_text(path, &run_csv(run))
}

fn run_csv(run: &Run) -> String {
    let pressure = run.pressure_bar.as_deref().unwrap_or_default();
    let mut text = String::with_capacity(32 * run.len());
    text.push_str(if run.target_bar.is_some() { "time_s,current_a,pressure_bar,target_bar\n" } else { "time_s,current_a,pressure_bar\n" });
    for k in 0..run.len() {
        let _ = write!(text, "{:.2},{:.5},{:.3}", run.time_s[k], run.current_a[k], pressure[k]);
        if let Some(target) = &run.target_bar {
            let _ = write!(text, ",{:.3}", target[k]);
        }
        text.push('\n');
    }
    text
}

/// Writes a text beside its place and moves it there, so that nobody ever reads half a file.
pub fn write_text(path: &Path, text: &str) -> Result<(), ChallengeError> {
    let fail = |source| ChallengeError::Write { path: path.to_owned(), source };
    let unfinished = path.with_extension("part");
    std::fs::write(&unfinished, text).map_err(fail)?;
    std::fs::rename(&unfinished, path).map_err(fail)
}

/// The truth of a case, as it is sealed.
pub fn truth_json(case: &Case) -> serde_json::Value {
    serde_json::json!({
        "effects": case.ids(),
        "variant": case.effects.first().map_or(0, |e| e.variant),
        "variants": case.effects.iter().map(|e| e.variant).collect::<Vec<_>>(),
        "severity": case.effects.first().map_or(1.0, |e| e.severity),
        "closed": case.closed,
        "absorbed": case.absorbed,
        "fam": case.family(),
        "delay": case.delay_s(),
        "seed": case.seed,
    })
}
