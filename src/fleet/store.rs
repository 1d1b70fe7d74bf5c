//! The folder of answers: append-only segments of rows, one document a job.
//!
//! Every process writes a segment of its own, `rows/<name>.jsonl`. A row is one line, written with one call and flushed
//! after its document is in place: a kill leaves it there whole or not at all, and a torn last line is nobody's row.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::FleetError;
use super::row::Row;
use crate::digest;
use crate::recording::replace_file;

/// What decides whether a job is done: recording, model, version.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Done {
    recording_sha256: Option<String>,
    model_sha256: Option<String>,
    version: String,
    task: String,
    attempt: u32,
}

/// An open folder.
pub struct Store {
    folder: PathBuf,
    segment: Mutex<Option<File>>,
    name: String,
    done: HashMap<String, Done>,
}

impl Store {
    /// Opens a folder, or makes it. `name` tells this process's segment apart from all others.
    ///
    /// # Errors
    /// What the file system says.
    pub fn open(folder: &Path, name: &str) -> Result<Self, FleetError> {
        let rows = folder.join("rows");
        std::fs::create_dir_all(&rows).map_err(FleetError::store(&rows))?;
        let mut done = HashMap::new();
        each_row(folder, |row| {
            let new = Done {
                recording_sha256: row.recording_sha256,
                model_sha256: row.model_sha256,
                version: row.version,
                task: row.task,
                attempt: row.attempt,
            };
            if done.get(&row.id).is_none_or(|before: &Done| before.attempt <= new.attempt) {
                done.insert(row.id, new);
            }
        })?;
        Ok(Self { folder: folder.to_path_buf(), segment: Mutex::new(None), name: name.to_owned(), done })
    }

    /// Whether the last answer to this id was to the same question.
    pub fn has(&self, row: &Row) -> bool {
        // a recording that could not be read may be there now
        row.recording_sha256.is_some()
            && self.done.get(&row.id).is_some_and(|d| {
                d.recording_sha256 == row.recording_sha256
                    && d.model_sha256 == row.model_sha256
                    && d.version == row.version
                    && d.task == row.task
            })
    }

    /// Number of the next answer to an id.
    pub fn attempt(&self, id: &str) -> u32 {
        self.done.get(id).map_or(1, |d| d.attempt + 1)
    }

    /// Stores the files of an answer, then its row. A file's name is given by its extension.
    ///
    /// # Errors
    /// What the file system says; the row is then not there.
    pub fn keep(&self, mut row: Row, files: &[(&str, &str)]) -> Result<(), FleetError> {
        let digest = digest::sha256(&row.id);
        let place = PathBuf::from("answers").join(&digest[..2]).join(file_name(&row.id, &digest));
        for (extension, text) in files {
            let path = self.folder.join(place.with_extension(extension));
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent).map_err(FleetError::store(parent))?;
            }
            replace_file(&path, |file| file.write_all(text.as_bytes()))
                .map_err(|e| FleetError::Store { path: path.clone(), source: std::io::Error::other(e.to_string()) })?;
            if *extension == "json" {
                row.document = Some(place.with_extension(extension).display().to_string());
            }
        }
        let mut line = serde_json::to_vec(&row).unwrap_or_default();
        line.push(b'\n');
        let path = self.folder.join("rows").join(format!("{}.jsonl", self.name));
        let fail = || FleetError::store(&path);
        let mut segment = self.segment.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if segment.is_none() {
            *segment = Some(OpenOptions::new().create_new(true).append(true).open(&path).map_err(fail())?);
        }
        if let Some(file) = segment.as_mut() {
            file.write_all(&line).map_err(fail())?;
            file.sync_data().map_err(fail())?;
        }
        Ok(())
    }
}

/// A name that any file system takes: the id's harmless characters, and a piece of its digest.
fn file_name(id: &str, digest: &str) -> String {
    let plain: String = id.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).take(60).collect();
    format!("{plain}-{}.x", &digest[..10])
}

/// Calls `take` with every whole row of a folder, segment by segment in the order of their names.
///
/// # Errors
/// What the file system says. A torn line is the rest of a kill and no error.
pub fn each_row(folder: &Path, mut take: impl FnMut(Row)) -> Result<(), FleetError> {
    for path in segments(folder)? {
        rows_after(&path, 0, &mut take)?;
    }
    Ok(())
}

/// The segments of a folder, by name.
pub(super) fn segments(folder: &Path) -> Result<Vec<PathBuf>, FleetError> {
    let rows = folder.join("rows");
    let mut segments: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(&rows).map_err(FleetError::store(&rows))? {
        let path = entry.map_err(FleetError::store(&rows))?.path();
        if path.extension().is_some_and(|e| e == "jsonl") {
            segments.push(path);
        }
    }
    segments.sort();
    Ok(segments)
}

/// Calls `take` with every whole row of a segment from this byte on; the end of the last of them [bytes].
pub(super) fn rows_after(path: &Path, from: u64, take: &mut dyn FnMut(Row)) -> Result<u64, FleetError> {
    let mut file = File::open(path).map_err(FleetError::store(path))?;
    file.seek(SeekFrom::Start(from)).map_err(FleetError::store(path))?;
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let (mut line, mut end) = (Vec::new(), from);
    loop {
        line.clear();
        let bytes = reader.read_until(b'\n', &mut line).map_err(FleetError::store(path))?;
        if !line.ends_with(b"\n") {
            return Ok(end);
        }
        end += bytes as u64;
        if let Ok(row) = serde_json::from_slice::<Row>(&line) {
            take(row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::collected::last_rows;
    use super::super::table::example;
    use super::*;

    #[test]
    fn a_row_is_there_whole_or_not_at_all_and_is_not_done_again() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let store = Store::open(folder.path(), "a")?;
        store.keep(example("../x y"), &[("json", "{}")])?;
        store.keep(example("b"), &[])?;
        // the rest of a kill in the middle of a line
        let path = folder.path().join("rows/a.jsonl");
        let whole = std::fs::read(&path)?;
        std::fs::write(&path, &whole[..whole.len() - 20])?;
        let again = Store::open(folder.path(), "b")?;
        assert!(again.has(&example("../x y")) && !again.has(&example("b")));
        assert_eq!((again.attempt("../x y"), again.attempt("b")), (2, 1));
        let mut other = example("../x y");
        other.version = "0.0.0".into();
        assert!(!again.has(&other), "another version is another question");
        let rows = last_rows([folder.path()])?;
        assert_eq!(rows.len(), 1);
        let document = rows[0].document.clone().unwrap_or_default();
        assert!(Path::new(&document).starts_with(folder.path().join("answers")) && Path::new(&document).exists(), "{document}");
        Ok(())
    }

    #[test]
    fn a_later_answer_replaces_an_earlier_one_and_twins_are_one() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        for (name, attempt, verdict) in [("a", 1, "match"), ("b", 1, "match"), ("0", 2, "explained")] {
            let row = Row { attempt, verdict: Some(verdict.into()), ..example("x") };
            Store::open(folder.path(), name)?.keep(row, &[])?;
        }
        let rows = last_rows([folder.path()])?;
        assert_eq!((rows.len(), rows[0].verdict.as_deref()), (1, Some("explained")));
        Ok(())
    }
}
