//! Rows collected once need not be read again: the table holds them, and how far each segment has been read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::FleetError;
use super::row::{Row, Status};
use super::store::{rows_after, segments};
use crate::digest;

/// So much of a segment ahead of the place up to which it was read tells whether it is still the same [bytes].
const TAIL: u64 = 256;

/// Up to where a segment has been read: the end of a whole row.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReadUpTo {
    bytes: u64,
    tail_sha256: String,
}

/// Segments by their paths.
pub type Segments = BTreeMap<String, ReadUpTo>;

/// What an earlier collection has left.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Earlier {
    /// The last row of every id.
    pub rows: Vec<Row>,
    /// How far the segments had been read.
    pub segments: Segments,
}

/// The last answer to every id, and what it took to have them.
#[derive(Debug, Clone, PartialEq)]
pub struct Collected {
    /// By id.
    pub rows: Vec<Row>,
    /// How far the segments have been read.
    pub segments: Segments,
    /// Rows that were read now; the others were there.
    pub read: usize,
}

/// Collects the last answer to every id. What an earlier collection of the same folders has read is not read again; where a
/// segment is no longer what it was, everything is.
///
/// # Errors
/// What the file system says.
pub fn collect<'a>(folders: impl IntoIterator<Item = &'a Path>, earlier: Option<Earlier>) -> Result<Collected, FleetError> {
    let mut found = Vec::new();
    for folder in folders {
        found.extend(segments(folder)?.into_iter().map(|path| (folder, path)));
    }
    let name = |path: &Path| path.display().to_string();
    let same = |earlier: &Earlier| {
        let there = |path: &String| found.iter().any(|(_, p)| name(p) == *path);
        earlier
            .segments
            .iter()
            .all(|(path, mark)| there(path) && tail_sha256(Path::new(path), mark.bytes).is_ok_and(|t| t == mark.tail_sha256))
    };
    let Earlier { rows, segments: before } = earlier.filter(same).unwrap_or_default();
    let mut last: BTreeMap<String, Row> = rows.into_iter().map(|row| (row.id.clone(), row)).collect();
    let (mut marks, mut read) = (Segments::new(), 0);
    for (folder, path) in &found {
        let from = before.get(&name(path)).map_or(0, |mark| mark.bytes);
        let bytes = rows_after(path, from, &mut |mut row: Row| {
            read += 1;
            row.document = row.document.map(|d| folder.join(d).display().to_string());
            if last.get(&row.id).is_none_or(|before| better(&row, before)) {
                last.insert(row.id.clone(), row);
            }
        })?;
        let tail_sha256 = tail_sha256(path, bytes).map_err(FleetError::store(path))?;
        marks.insert(name(path), ReadUpTo { bytes, tail_sha256 });
    }
    Ok(Collected { rows: last.into_values().collect(), segments: marks, read })
}

/// The last answer to every id, by id.
///
/// # Errors
/// What the file system says.
pub fn last_rows<'a>(folders: impl IntoIterator<Item = &'a Path>) -> Result<Vec<Row>, FleetError> {
    Ok(collect(folders, None)?.rows)
}

/// Digest of what stands ahead of this place.
fn tail_sha256(path: &Path, bytes: u64) -> std::io::Result<String> {
    let mut file = File::open(path)?;
    let from = bytes.saturating_sub(TAIL);
    file.seek(SeekFrom::Start(from))?;
    let mut tail = vec![0; (bytes - from) as usize];
    file.read_exact(&mut tail)?;
    Ok(digest::sha256(&tail))
}

/// A later answer, or one in place of none. Two workers on the same job give the same row; where they do not, which of them
/// counts does not hang on the order of reading.
fn better(new: &Row, before: &Row) -> bool {
    let rank = |row: &Row| (row.attempt, row.status == Status::Done);
    let text = |row: &Row| serde_json::to_string(row).unwrap_or_default();
    match rank(new).cmp(&rank(before)) {
        std::cmp::Ordering::Equal => new != before && text(new) > text(before),
        other => other.is_gt(),
    }
}
