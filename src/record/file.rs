//! Records in files: one `record.json`, or every one below a folder.

use std::path::{Path, PathBuf};

use super::TestRecord;

/// The schema key of a record.
pub const SCHEMA: &str = "hil.record/1";
/// Name of the record inside a run's folder.
pub const RECORD_FILE: &str = "record.json";
/// Largest record that is read [bytes].
const MAX_BYTES: u64 = 256 << 20;

/// Why a record cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file or folder cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file is no record.
    #[error("{}: is not a record (`schema` = \"{SCHEMA}\"): {problem}", path.display())]
    NotARecord {
        /// Where.
        path: PathBuf,
        /// What is wrong, with line and column.
        problem: String,
    },
    /// A folder without any record.
    #[error("{}: no {RECORD_FILE} in this folder; a run writes one", path.display())]
    NoRecord {
        /// Where.
        path: PathBuf,
    },
}

impl TestRecord {
    /// Reads a record from its file, or from the run's folder that holds it.
    pub fn load(path: &Path) -> Result<Self, RecordError> {
        if path.is_dir() && !path.join(RECORD_FILE).exists() {
            return Err(RecordError::NoRecord { path: path.into() });
        }
        let path = if path.is_dir() { path.join(RECORD_FILE) } else { path.to_path_buf() };
        let io = |source| RecordError::Io { path: path.clone(), source };
        let wrong = |problem: String| RecordError::NotARecord { path: path.clone(), problem };
        let bytes = std::fs::metadata(&path).map_err(io)?.len();
        if bytes > MAX_BYTES {
            return Err(wrong(format!("has {bytes} bytes; at most {MAX_BYTES} are read")));
        }
        let text = std::fs::read(&path).map_err(io)?;
        let record: Self = serde_json::from_slice(&text).map_err(|e| wrong(in_words(&e)))?;
        if record.schema == SCHEMA { Ok(record) } else { Err(wrong(format!("its schema is `{}`", record.schema))) }
    }
}

/// What the parser says of a file; of one that is no JSON from its first line on, that alone.
fn in_words(error: &serde_json::Error) -> String {
    match error.classify() {
        serde_json::error::Category::Syntax if error.line() <= 1 => "it is no JSON".into(),
        _ => error.to_string(),
    }
}

/// The records at `path` by their place below it: one for a file or a run's folder (named ""), else every `record.json` below.
pub fn records(path: &Path) -> Result<Vec<(String, TestRecord)>, RecordError> {
    if !path.is_dir() || path.join(RECORD_FILE).is_file() {
        return Ok(vec![(String::new(), TestRecord::load(path)?)]);
    }
    let mut places = Vec::new();
    collect(path, path, &mut places, 0)?;
    places.sort();
    if places.is_empty() {
        return Err(RecordError::NoRecord { path: path.into() });
    }
    places.into_iter().map(|place| Ok((place.clone(), TestRecord::load(&path.join(place))?))).collect()
}

fn collect(root: &Path, folder: &Path, places: &mut Vec<String>, depth: usize) -> Result<(), RecordError> {
    let io = |source| RecordError::Io { path: folder.into(), source };
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        // Links are not followed and the depth is bounded: a loop of links must not hang.
        if path.is_dir() && !path.is_symlink() && depth < 16 {
            if path.join(RECORD_FILE).is_file() {
                let place = path.strip_prefix(root).unwrap_or(&path);
                places.push(place.iter().map(|p| p.to_string_lossy()).collect::<Vec<_>>().join("/"));
            } else {
                collect(root, &path, places, depth + 1)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_record_is_refused_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("x.json");
        let refused = |text: &str| {
            std::fs::write(&file, text).unwrap();
            TestRecord::load(&file).unwrap_err().to_string()
        };
        assert!(refused("").contains("x.json: is not a record"));
        assert!(refused("{\"schema\": 1}").contains("line 1"));
        assert!(records(folder.path()).unwrap_err().to_string().contains("no record.json"));
        assert!(TestRecord::load(&folder.path().join("none")).unwrap_err().to_string().contains("none"));
    }
}
