//! The journal: append-only segments of framed lines, from which everything else can be rebuilt.
//!
//! A line is `CRC32 JSON\n`. Every process writes a segment of its own, so that two never mix and a torn end is
//! never written behind. An attempt is opened by a line before the valve moves and closed by the line that holds its whole
//! record; what is opened and not closed was interrupted.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::BatchError;
use crate::record::{Dut, TestRecord};

/// Longest line that is read back [bytes]: a record has some 10 kB.
const MAX_LINE: u64 = 64 << 20;

/// What a line says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// An attempt begins.
    Started,
    /// An attempt ended; the line holds its record.
    Finished,
}

/// A line of the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// What it says.
    pub event: Kind,
    /// Place of the valve in the batch, from 0.
    pub position: usize,
    /// Which attempt on this valve, from 1.
    pub attempt: u32,
    /// When, RFC 3339.
    pub at: String,
    /// The valve, where the attempt begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dut: Option<Dut>,
    /// The record, where the attempt ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record: Option<TestRecord>,
}

/// Where a line stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Number of the segment.
    pub segment: u32,
    /// First byte of the line.
    pub offset: u64,
    /// Length of the line with its line feed.
    pub length: u64,
}

/// Bytes of a segment that are no whole line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Damage {
    /// File name of the segment.
    pub segment: String,
    /// First byte.
    pub offset: u64,
    /// `torn` at the end of a segment (the process ended while writing), `damaged` elsewhere.
    pub what: String,
}

/// The folder of the segments.
pub fn folder(batch: &Path) -> PathBuf {
    batch.join("journal")
}

/// Path of a segment.
pub fn segment_path(batch: &Path, segment: u32) -> PathBuf {
    folder(batch).join(format!("{segment:06}.jsonl"))
}

/// The segments of a batch, in the order in which they were begun.
pub fn segments(batch: &Path) -> Result<Vec<u32>, BatchError> {
    let path = folder(batch);
    let entries = match std::fs::read_dir(&path) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(BatchError::store(&path, e)),
    };
    let number = |name: &str| name.strip_suffix(".jsonl").and_then(|stem| stem.parse::<u32>().ok());
    let mut numbers: Vec<u32> = entries.filter_map(|e| number(e.ok()?.file_name().to_str()?)).collect();
    numbers.sort_unstable();
    Ok(numbers)
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// The framed text of a line.
pub fn frame(line: &Line) -> Vec<u8> {
    // A `Line` holds only strings, numbers and JSON values: it always serialises.
    let json = serde_json::to_vec(line).unwrap_or_default();
    let mut bytes = format!("{:08x} ", crc(&json)).into_bytes();
    bytes.extend_from_slice(&json);
    bytes.push(b'\n');
    bytes
}

/// The JSON of a framed line, or `None` where it is not whole.
fn unframe(line: &[u8]) -> Option<&[u8]> {
    let json = line.strip_suffix(b"\n")?.get(9..)?;
    let expected = u32::from_str_radix(std::str::from_utf8(line.get(..8)?).ok()?, 16).ok()?;
    (line.get(8) == Some(&b' ') && crc(json) == expected).then_some(json)
}

/// The writer of one segment.
#[derive(Debug)]
pub struct Journal {
    file: File,
    path: PathBuf,
    segment: u32,
    written: u64,
    confirmed: u64,
}

impl Journal {
    /// Begins a new segment behind those that exist.
    pub fn begin(batch: &Path) -> Result<Self, BatchError> {
        let dir = folder(batch);
        std::fs::create_dir_all(&dir).map_err(|e| BatchError::store(&dir, e))?;
        let mut segment = segments(batch)?.last().map_or(1, |last| last + 1);
        loop {
            let path = segment_path(batch, segment);
            match OpenOptions::new().read(true).append(true).create_new(true).open(&path) {
                Ok(file) => {
                    // The name of the segment must survive a power cut as well as its content.
                    File::open(&dir).and_then(|d| d.sync_all()).map_err(|e| BatchError::store(&dir, e))?;
                    return Ok(Self { file, path, segment, written: 0, confirmed: 0 });
                }
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => segment += 1,
                Err(e) => return Err(BatchError::store(&path, e)),
            }
        }
    }

    /// Appends a framed line ([`frame`]). It is not confirmed before [`Journal::confirm`].
    pub fn append(&mut self, framed: &[u8]) -> Result<Place, BatchError> {
        if let Err(e) = self.file.write_all(framed) {
            // Half a line would only be reported as torn; cut it where that is still possible.
            let _ = self.file.set_len(self.written);
            return Err(BatchError::store(&self.path, e));
        }
        let place = Place { segment: self.segment, offset: self.written, length: framed.len() as u64 };
        self.written += framed.len() as u64;
        Ok(place)
    }

    /// What [`Pending::confirm`] needs, so that it can be done without holding the journal.
    pub fn pending(&self) -> Result<Pending, BatchError> {
        let file = self.file.try_clone().map_err(|e| BatchError::store(&self.path, e))?;
        Ok(Pending { file, path: self.path.clone(), from: self.confirmed, to: self.written })
    }

    /// Marks everything up to `to` as confirmed.
    pub fn confirmed(&mut self, to: u64) {
        self.confirmed = self.confirmed.max(to);
    }

    /// Puts everything on the disk and reads it back.
    pub fn confirm(&mut self) -> Result<(), BatchError> {
        let to = self.pending()?.confirm()?;
        self.confirmed(to);
        Ok(())
    }
}

/// Bytes that were appended and not yet confirmed.
#[derive(Debug)]
pub struct Pending {
    file: File,
    path: PathBuf,
    from: u64,
    to: u64,
}

impl Pending {
    /// Flushes to the disk, reads the lines back from the file and checks every frame. Returns the end of what is confirmed.
    pub fn confirm(self) -> Result<u64, BatchError> {
        if self.from == self.to {
            return Ok(self.to);
        }
        let fail = |e| BatchError::store(&self.path, e);
        self.file.sync_data().map_err(fail)?;
        let mut reader = File::open(&self.path).map_err(fail)?;
        reader.seek(SeekFrom::Start(self.from)).map_err(fail)?;
        let mut reader = BufReader::with_capacity(1 << 16, reader.take(self.to - self.from));
        let (mut line, mut offset) = (Vec::new(), self.from);
        while offset < self.to {
            line.clear();
            let read = reader.read_until(b'\n', &mut line).map_err(fail)? as u64;
            if unframe(&line).is_none() {
                return Err(BatchError::NotReadBack { path: self.path.clone(), offset });
            }
            offset += read;
        }
        Ok(self.to)
    }
}

/// Reads the whole lines of a segment from byte `from`; returns what is no line, and the end of the last whole line.
pub fn read_segment(
    batch: &Path,
    segment: u32,
    from: u64,
    mut each: impl FnMut(Place, Line) -> Result<(), BatchError>,
) -> Result<(Vec<Damage>, u64), BatchError> {
    let path = segment_path(batch, segment);
    let fail = |e| BatchError::store(&path, e);
    let mut file = File::open(&path).map_err(fail)?;
    file.seek(SeekFrom::Start(from)).map_err(fail)?;
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let (mut damage, mut offset, mut whole, mut bytes) = (Vec::new(), from, from, Vec::new());
    loop {
        bytes.clear();
        let read = (&mut reader).take(MAX_LINE).read_until(b'\n', &mut bytes).map_err(fail)? as u64;
        if read == 0 {
            return Ok((damage, whole));
        }
        let line = unframe(&bytes).and_then(|json| serde_json::from_slice::<Line>(json).ok());
        match line {
            Some(line) => {
                each(Place { segment, offset, length: read }, line)?;
                whole = offset + read;
            }
            None => {
                let what = if bytes.ends_with(b"\n") { "damaged" } else { "torn" };
                damage.push(Damage { segment: name.clone(), offset, what: what.into() });
            }
        }
        offset += read;
    }
}

/// Reads every segment of a batch.
pub fn read(batch: &Path, mut each: impl FnMut(Place, Line) -> Result<(), BatchError>) -> Result<Vec<Damage>, BatchError> {
    let mut damage = Vec::new();
    for segment in segments(batch)? {
        damage.extend(read_segment(batch, segment, 0, &mut each)?.0);
    }
    Ok(damage)
}

/// Reads one line at its place.
pub fn read_at(batch: &Path, place: Place) -> Result<Line, BatchError> {
    let path = segment_path(batch, place.segment);
    let fail = |e| BatchError::store(&path, e);
    let mut file = File::open(&path).map_err(fail)?;
    file.seek(SeekFrom::Start(place.offset)).map_err(fail)?;
    let mut bytes = Vec::new();
    file.take(place.length.min(MAX_LINE)).read_to_end(&mut bytes).map_err(fail)?;
    let line = unframe(&bytes).and_then(|json| serde_json::from_slice(json).ok());
    line.ok_or(BatchError::NotReadBack { path, offset: place.offset })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(position: usize) -> Line {
        let dut = Dut { serial: format!("V{position}"), ..Dut::default() };
        Line { event: Kind::Started, position, attempt: 1, at: "2026-01-01T00:00:00Z".into(), dut: Some(dut), record: None }
    }

    fn all(batch: &Path) -> (Vec<Line>, Vec<Damage>) {
        let mut lines = Vec::new();
        let damage = read(batch, |_, line| {
            lines.push(line);
            Ok(())
        });
        (lines, damage.unwrap())
    }

    #[test]
    fn what_is_confirmed_reads_back_at_its_place() {
        let dir = tempfile::tempdir().unwrap();
        let mut journal = Journal::begin(dir.path()).unwrap();
        let places: Vec<Place> = (0..3).map(|i| journal.append(&frame(&line(i))).unwrap()).collect();
        journal.confirm().unwrap();
        assert_eq!(read_at(dir.path(), places[1]).unwrap(), line(1));
        assert_eq!(all(dir.path()), ((0..3).map(line).collect(), vec![]));
    }

    /// Cut at every byte of the last line: the lines before it are read, the torn one is named, and a new writer adds behind it.
    #[test]
    fn a_cut_at_any_byte_loses_nothing_that_was_whole() {
        let framed = frame(&line(1));
        for cut in 0..framed.len() {
            let dir = tempfile::tempdir().unwrap();
            let mut journal = Journal::begin(dir.path()).unwrap();
            journal.append(&frame(&line(0))).unwrap();
            journal.append(&framed[..cut]).unwrap();
            let mut second = Journal::begin(dir.path()).unwrap();
            second.append(&frame(&line(2))).unwrap();
            second.confirm().unwrap();
            let (lines, damage) = all(dir.path());
            assert_eq!(lines, [line(0), line(2)]);
            assert_eq!(damage.len(), usize::from(cut > 0));
            assert!(damage.iter().all(|d| d.what == "torn"));
        }
    }

    #[test]
    fn a_flipped_bit_is_found_by_confirm_and_by_read() {
        let dir = tempfile::tempdir().unwrap();
        let mut journal = Journal::begin(dir.path()).unwrap();
        journal.append(&frame(&line(0))).unwrap();
        let mut framed = frame(&line(1));
        framed[20] ^= 1;
        journal.append(&framed).unwrap();
        assert!(matches!(journal.confirm(), Err(BatchError::NotReadBack { .. })));
        let (lines, damage) = all(dir.path());
        assert_eq!((lines.len(), damage.len(), damage[0].what.as_str()), (1, 1, "damaged"));
    }

    #[test]
    fn every_writer_has_a_segment_of_its_own() {
        let dir = tempfile::tempdir().unwrap();
        let (mut a, mut b) = (Journal::begin(dir.path()).unwrap(), Journal::begin(dir.path()).unwrap());
        for i in 0..50 {
            a.append(&frame(&line(2 * i))).unwrap();
            b.append(&frame(&line(2 * i + 1))).unwrap();
        }
        assert_eq!(segments(dir.path()).unwrap(), [1, 2]);
        let (lines, damage) = all(dir.path());
        assert_eq!((lines.len(), damage.len()), (100, 0));
    }
}
