//! The journal: append-only segments of framed lines, from which everything else can be rebuilt.
//!
//! A line is `CRC32 DIGEST JSON\n`, where the digest is that of the line before, also over the end of a segment: a line that is
//! lost, changed or put in between breaks the chain. The first version wrote `CRC32 JSON\n`; such lines are read as they are.
//! Beside the segments, `tip` says how far the journal was confirmed, so that a lost end is noticed too.
//!
//! Every process writes a segment of its own, so that two never mix and a torn end is never written behind. An attempt is opened
//! by a line before the valve moves and closed by the line that holds its whole record; what is opened and not closed was
//! interrupted.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::BatchError;
use crate::output::{clear_leftovers, make_folder_within, sync_folder, whole_file};
use crate::record::{Dut, TestRecord};

/// Name of the folder of the segments.
const FOLDER: &str = "journal";
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

/// What is wrong with a journal, and where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Damage {
    /// File name of the segment.
    pub segment: String,
    /// First byte.
    pub offset: u64,
    /// `torn` at the end of a segment (the process ended while writing), `damaged` elsewhere, `unchained` where the line before is
    /// not the one that was there, `lost` where confirmed lines are missing.
    pub what: String,
}

impl Damage {
    /// What is wrong, for people.
    pub fn text(&self) -> String {
        let (segment, offset) = (&self.segment, self.offset);
        match self.what.as_str() {
            "unchained" => {
                format!("the chain is broken in {segment} at byte {offset}: a line before it was lost, changed or put in between")
            }
            "lost" => format!("the journal was confirmed up to byte {offset} of {segment}, and what stood there is lost or changed"),
            what => format!("{what} line in {segment} at byte {offset}: not counted"),
        }
    }
}

/// The folder of the segments.
pub fn folder(batch: &Path) -> PathBuf {
    batch.join(FOLDER)
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

/// A line as JSON, for [`Journal::append`].
pub fn encode(line: &Line) -> Vec<u8> {
    // A `Line` holds only strings, numbers and JSON values: it always serialises.
    serde_json::to_vec(line).unwrap_or_default()
}

/// A line in its frame, behind the line with the digest `previous`.
fn frame(json: &[u8], previous: &str) -> Vec<u8> {
    let mut crc = flate2::Crc::new();
    [previous.as_bytes(), b" ", json].iter().for_each(|bytes| crc.update(bytes));
    let mut bytes = format!("{:08x} {previous} ", crc.sum()).into_bytes();
    bytes.extend_from_slice(json);
    bytes.push(b'\n');
    bytes
}

/// Characters of a digest: 128 bits.
const DIGEST: usize = 32;
/// What the first line of a journal has for the digest of the one before.
const FIRST: &str = "00000000000000000000000000000000";

/// Digest of a framed line.
fn digest(framed: &[u8]) -> String {
    crate::digest::sha256(framed)[..DIGEST].to_string()
}

/// The digest of the line before, `None` in a line of the first version, and the JSON; `None` where the line is not whole.
fn unframe(line: &[u8]) -> Option<(Option<&str>, &[u8])> {
    let rest = line.strip_suffix(b"\n")?.get(9..)?;
    let expected = u32::from_str_radix(std::str::from_utf8(line.get(..8)?).ok()?, 16).ok()?;
    if line.get(8) != Some(&b' ') || crc(rest) != expected {
        return None;
    }
    if rest.first() == Some(&b'{') {
        return Some((None, rest));
    }
    let previous = std::str::from_utf8(rest.get(..DIGEST)?).ok()?;
    (rest.get(DIGEST) == Some(&b' ')).then_some((Some(previous), &rest[DIGEST + 1..]))
}

/// How far a journal was confirmed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Tip {
    segment: u32,
    /// End of the last confirmed line.
    end: u64,
    digest: String,
}

fn tip_path(batch: &Path) -> PathBuf {
    folder(batch).join("tip")
}

/// The digest of the last whole line of a journal.
fn last_digest(batch: &Path) -> Result<String, BatchError> {
    for segment in segments(batch)?.into_iter().rev() {
        let mut last = None;
        each_line(&segment_path(batch, segment), 0, |_, bytes| {
            if unframe(bytes).is_some() {
                last = Some(digest(bytes));
            }
            Ok(())
        })?;
        if let Some(last) = last {
            return Ok(last);
        }
    }
    Ok(FIRST.into())
}

/// Feeds the lines of a file from byte `from` with their places to `each`; the last may lack its line feed.
fn each_line(path: &Path, from: u64, mut each: impl FnMut(u64, &[u8]) -> Result<(), BatchError>) -> Result<(), BatchError> {
    let fail = |e| BatchError::store(path, e);
    let mut file = File::open(path).map_err(fail)?;
    file.seek(SeekFrom::Start(from)).map_err(fail)?;
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let (mut offset, mut bytes) = (from, Vec::new());
    loop {
        bytes.clear();
        let read = (&mut reader).take(MAX_LINE).read_until(b'\n', &mut bytes).map_err(fail)? as u64;
        if read == 0 {
            return Ok(());
        }
        each(offset, &bytes)?;
        offset += read;
    }
}

/// The writer of one segment.
#[derive(Debug)]
pub struct Journal {
    file: File,
    path: PathBuf,
    segment: u32,
    written: u64,
    confirmed: u64,
    /// Digest of the last line that was appended.
    last: String,
}

impl Journal {
    /// Begins a new segment behind those that exist.
    pub fn begin(batch: &Path) -> Result<Self, BatchError> {
        let dir = folder(batch);
        make_folder_within(batch, Path::new(FOLDER)).map_err(|e| BatchError::store(&dir, e))?;
        clear_leftovers(&dir);
        let last = last_digest(batch)?;
        let mut segment = segments(batch)?.last().map_or(1, |last| last + 1);
        loop {
            let path = segment_path(batch, segment);
            match OpenOptions::new().read(true).append(true).create_new(true).open(&path) {
                Ok(file) => {
                    // The name of the segment must survive a power cut as well as its content.
                    sync_folder(&dir).map_err(|e| BatchError::store(&dir, e))?;
                    return Ok(Self { file, path, segment, written: 0, confirmed: 0, last });
                }
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => segment += 1,
                Err(e) => return Err(BatchError::store(&path, e)),
            }
        }
    }

    /// Appends a line ([`encode`]) behind the last one. It is not confirmed before [`Journal::confirm`].
    pub fn append(&mut self, json: &[u8]) -> Result<Place, BatchError> {
        let framed = frame(json, &self.last);
        if let Err(e) = self.file.write_all(&framed) {
            // Half a line would only be reported as torn; cut it where that is still possible.
            let _ = self.file.set_len(self.written);
            return Err(BatchError::store(&self.path, e));
        }
        let place = Place { segment: self.segment, offset: self.written, length: framed.len() as u64 };
        self.written += framed.len() as u64;
        self.last = digest(&framed);
        Ok(place)
    }

    /// What [`Pending::confirm`] needs, so that it can be done without holding the journal.
    pub fn pending(&self) -> Result<Pending, BatchError> {
        let file = self.file.try_clone().map_err(|e| BatchError::store(&self.path, e))?;
        let tip = Tip { segment: self.segment, end: self.written, digest: self.last.clone() };
        Ok(Pending { file, path: self.path.clone(), from: self.confirmed, to: self.written, tip })
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
    tip: Tip,
}

impl Pending {
    /// Flushes to the disk, reads the lines back from the file, checks every frame, and says in `tip` how far the journal is
    /// confirmed. Returns that end.
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
        let tip = self.path.with_file_name("tip");
        let text = serde_json::to_vec(&self.tip).unwrap_or_default();
        whole_file(&tip, |file| file.write_all(&text)).map_err(|e| BatchError::store(&tip, e.into_io()))?;
        Ok(self.to)
    }
}

/// Reads the whole lines of a segment from byte `from`; returns what is no line, and the end of the last whole line.
pub fn read_segment(
    batch: &Path,
    segment: u32,
    from: u64,
    each: impl FnMut(Place, Line) -> Result<(), BatchError>,
) -> Result<(Vec<Damage>, u64), BatchError> {
    // From the middle nothing is known of the line before.
    let mut chain = Chain { before: (from == 0).then_some(FIRST.into()).filter(|_| segment == 1), tip: None };
    chain.read(batch, segment, from, each)
}

/// Where a reader stands in the chain.
struct Chain {
    /// Digest of the last whole line; `None` where it is not known.
    before: Option<String>,
    /// The end that was confirmed, until it is found.
    tip: Option<Tip>,
}

impl Chain {
    fn read(
        &mut self,
        batch: &Path,
        segment: u32,
        from: u64,
        mut each: impl FnMut(Place, Line) -> Result<(), BatchError>,
    ) -> Result<(Vec<Damage>, u64), BatchError> {
        let path = segment_path(batch, segment);
        let name = file_name(&path);
        let (mut damage, mut whole) = (Vec::new(), from);
        each_line(&path, from, |offset, bytes| {
            let found = unframe(bytes).and_then(|(previous, json)| Some((previous, serde_json::from_slice::<Line>(json).ok()?)));
            let mut note = |what: &str| damage.push(Damage { segment: name.clone(), offset, what: what.into() });
            let Some((previous, line)) = found else {
                let torn = !bytes.ends_with(b"\n");
                note(if torn { "torn" } else { "damaged" });
                // Behind a damaged line the chain begins anew; a torn one was never part of it.
                self.before = self.before.take().filter(|_| torn);
                return Ok(());
            };
            if let (Some(previous), Some(before)) = (previous, &self.before)
                && previous != before
            {
                note("unchained");
            }
            let own = digest(bytes);
            let length = bytes.len() as u64;
            if self.tip.as_ref().is_some_and(|t| t.segment == segment && t.end == offset + length && t.digest == own) {
                self.tip = None;
            }
            self.before = Some(own);
            whole = offset + length;
            each(Place { segment, offset, length }, line)
        })?;
        Ok((damage, whole))
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

/// Reads every segment of a batch, and follows the chain through all of them.
pub fn read(batch: &Path, mut each: impl FnMut(Place, Line) -> Result<(), BatchError>) -> Result<Vec<Damage>, BatchError> {
    let mut damage = Vec::new();
    let tip = std::fs::read(tip_path(batch)).ok().and_then(|bytes| serde_json::from_slice::<Tip>(&bytes).ok());
    let mut chain = Chain { before: Some(FIRST.into()), tip };
    for segment in segments(batch)? {
        damage.extend(chain.read(batch, segment, 0, &mut each)?.0);
    }
    if let Some(tip) = chain.tip {
        let segment = file_name(&segment_path(batch, tip.segment));
        damage.push(Damage { segment, offset: tip.end, what: "lost".into() });
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
    let line = unframe(&bytes).and_then(|(_, json)| serde_json::from_slice(json).ok());
    line.ok_or(BatchError::NotReadBack { path, offset: place.offset })
}

#[cfg(test)]
mod tests;
