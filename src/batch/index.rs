//! The index: an SQLite file over the journals of a folder, for questions about many records.
//!
//! It holds nothing of its own: it can be deleted at any time and is made anew from the journals. It remembers how far it has
//! read each segment, so that bringing it up to date reads only what is new. It is believed only where it agrees with the
//! journals: rows that were lost, added or changed, and segments that shrank, make it be built anew ([`Index::answers`]).

use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::{Connection, OpenFlags, OptionalExtension, Transaction, params};
use serde::Serialize;

use super::BatchError;
use super::journal::{self, Kind, Line, Place};
use super::tally::measurements;

mod agree;
mod seal;

/// Name of the file in the folder that it indexes.
pub const FILE: &str = "index.sqlite";
/// Batches may lie this many folders deep.
const DEPTH: usize = 4;

const SCHEMA: &str = "
PRAGMA user_version = 2;
CREATE TABLE IF NOT EXISTS segment (id INTEGER PRIMARY KEY, batch TEXT NOT NULL, number INTEGER NOT NULL, read_to INTEGER NOT NULL, seal TEXT NOT NULL DEFAULT '', UNIQUE (batch, number));
CREATE TABLE IF NOT EXISTS attempt (id INTEGER PRIMARY KEY, segment INTEGER NOT NULL REFERENCES segment(id), offset INTEGER NOT NULL, length INTEGER NOT NULL,
  serial TEXT NOT NULL, part_number TEXT, revision TEXT, lot TEXT, position INTEGER NOT NULL, attempt INTEGER NOT NULL, outcome TEXT NOT NULL, simulated INTEGER NOT NULL, emulated INTEGER NOT NULL,
  at TEXT NOT NULL, plan TEXT NOT NULL, plan_sha256 TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS attempt_serial ON attempt(serial);
CREATE INDEX IF NOT EXISTS attempt_lot ON attempt(lot) WHERE lot IS NOT NULL;
CREATE INDEX IF NOT EXISTS attempt_at ON attempt(at);
CREATE TABLE IF NOT EXISTS metric (id INTEGER PRIMARY KEY, phase TEXT NOT NULL, metric TEXT NOT NULL, unit TEXT NOT NULL, UNIQUE (phase, metric, unit));
CREATE TABLE IF NOT EXISTS measurement (metric INTEGER NOT NULL, attempt INTEGER NOT NULL, value REAL, outcome TEXT NOT NULL, PRIMARY KEY (metric, attempt)) WITHOUT ROWID;
";

/// Version of the tables; `SCHEMA` writes it.
const VERSION: i64 = 2;
const READ_TO: &str = "SELECT read_to FROM segment WHERE batch = ?1 AND number = ?2";

/// What is asked. Everything that is given must hold.
#[derive(Debug, Clone, Default)]
pub struct Query {
    /// Serial number.
    pub serial: Option<String>,
    /// Lot.
    pub lot: Option<String>,
    /// Part number.
    pub part_number: Option<String>,
    /// Outcome, as the records write it.
    pub outcome: Option<String>,
    /// Not before, RFC 3339 or its beginning.
    pub since: Option<String>,
    /// Before, RFC 3339 or its beginning.
    pub until: Option<String>,
    /// Metric whose values are wanted, `rmse` or `phase/rmse`.
    pub metric: Option<String>,
    /// At most so many answers, the newest.
    pub limit: usize,
}

/// One measurement of an answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    /// Phase of the plan.
    pub phase: String,
    /// Metric.
    pub metric: String,
    /// The value; `None` where it could not be measured.
    pub value: Option<f64>,
    /// Unit of the value.
    pub unit: String,
    /// Verdict, as the records write it.
    pub outcome: String,
}

/// One attempt.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Answer {
    /// Folder of the batch, below the indexed folder.
    pub batch: String,
    /// Serial number.
    pub serial: String,
    /// Part number.
    pub part_number: Option<String>,
    /// Revision of the part.
    pub revision: Option<String>,
    /// Lot.
    pub lot: Option<String>,
    /// Which attempt, from 1.
    pub attempt: u32,
    /// Outcome, as the records write it.
    pub outcome: String,
    /// Whether it was a simulation.
    pub simulated: bool,
    /// Whether an emulator stood for driver and valve.
    pub emulated: bool,
    /// When it ended.
    pub at: String,
    /// Name of the plan.
    pub plan: String,
    /// The metrics that were asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub measurements: Vec<Figure>,
    /// Where the record stands.
    #[serde(skip)]
    pub place: (String, u32, u64, u64),
}

/// An open index.
#[derive(Debug)]
pub struct Index {
    root: PathBuf,
    path: PathBuf,
    db: Connection,
    /// Whether it lives in memory, because the folder cannot be written.
    pub temporary: bool,
}

impl Index {
    /// Opens the index of a folder, makes it where there is none, and reads what is new. A folder that cannot be written is
    /// indexed in memory where it has no index yet.
    pub fn open(root: &Path) -> Result<Self, BatchError> {
        std::fs::read_dir(root).map_err(|e| BatchError::store(root, e))?;
        let path = root.join(FILE);
        let mut index = match writable(&path) {
            Ok(db) => Self { root: root.into(), path, db, temporary: false },
            Err(_) => {
                if let Some(index) = Self::as_it_stands(root, &path)? {
                    return Ok(index);
                }
                let db = Connection::open_in_memory().map_err(|source| BatchError::Index { path: path.clone(), source })?;
                db.execute_batch(SCHEMA).map_err(|source| BatchError::Index { path: path.clone(), source })?;
                Self { root: root.into(), path, db, temporary: true }
            }
        };
        if !index.agrees()? {
            drop(index);
            return Self::rebuild(root);
        }
        index.refresh()?;
        Ok(index)
    }

    /// The index of a folder that cannot be written, where it is up to date.
    fn as_it_stands(root: &Path, path: &Path) -> Result<Option<Self>, BatchError> {
        let escaped = path.display().to_string().replace('%', "%25").replace('?', "%3f").replace('#', "%23");
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        // Immutable: no lock and no shared memory, which a folder that cannot be written cannot have.
        let Ok(db) = Connection::open_with_flags(format!("file:{escaped}?immutable=1"), flags) else { return Ok(None) };
        let version = db.query_row("PRAGMA user_version", [], |r| r.get::<_, i64>(0));
        let index = Self { root: root.into(), path: path.into(), db, temporary: false };
        if version != Ok(VERSION) || !index.agrees()? {
            return Ok(None);
        }
        let mut batches = Vec::new();
        find_batches(root, "", DEPTH, &mut batches)?;
        for batch in batches {
            let folder = root.join(&batch);
            for number in journal::segments(&folder)? {
                let segment = journal::segment_path(&folder, number);
                let size = std::fs::metadata(&segment).map_err(|e| BatchError::store(&segment, e))?.len();
                let read_to = index.db.query_row(READ_TO, params![batch, number], |row| row.get::<_, i64>(0));
                if read_to.map_or(true, |to| to as u64 != size) {
                    return Ok(None);
                }
            }
        }
        Ok(Some(index))
    }

    /// Deletes the index of a folder and makes it anew.
    pub fn rebuild(root: &Path) -> Result<Self, BatchError> {
        for suffix in ["", "-wal", "-shm"] {
            let path = root.join(format!("{FILE}{suffix}"));
            match std::fs::remove_file(&path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(BatchError::store(&path, e)),
                _ => {}
            }
        }
        Self::open(root)
    }

    /// Reads what the journals hold and the index does not.
    fn refresh(&mut self) -> Result<(), BatchError> {
        let path = self.path.clone();
        let fail = move |source| BatchError::Index { path: path.clone(), source };
        let mut batches = Vec::new();
        find_batches(&self.root, "", DEPTH, &mut batches)?;
        for batch in batches {
            let folder = self.root.join(&batch);
            for number in journal::segments(&folder)? {
                let segment = journal::segment_path(&folder, number);
                let size = std::fs::metadata(&segment).map_err(|e| BatchError::store(&segment, e))?.len();
                let read_to: Option<i64> =
                    self.db.query_row(READ_TO, params![batch, number], |row| row.get(0)).optional().map_err(&fail)?;
                if read_to.is_some_and(|to| to as u64 == size) {
                    continue;
                }
                // Immediate: of two processes, the second waits here and then sees how far the first has read.
                let transaction = self.db.transaction_with_behavior(rusqlite::TransactionBehavior::Immediate).map_err(&fail)?;
                read_new(&transaction, &folder, &batch, number, &fail)?;
                transaction.commit().map_err(&fail)?;
            }
        }
        Ok(())
    }

    /// The answers, oldest first.
    pub fn query(&self, query: &Query) -> Result<Vec<Answer>, BatchError> {
        let fail = |source| BatchError::Index { path: self.path.clone(), source };
        let mut conditions = vec!["1 = 1".to_string()];
        let mut values: Vec<&str> = Vec::new();
        let given = [
            ("a.serial = ", &query.serial),
            ("a.lot = ", &query.lot),
            ("a.part_number = ", &query.part_number),
            ("a.outcome = ", &query.outcome),
            ("a.at >= ", &query.since),
            ("a.at < ", &query.until),
        ];
        for (condition, value) in given {
            if let Some(value) = value {
                values.push(value);
                conditions.push(format!("{condition}?{}", values.len()));
            }
        }
        let (phase, metric) = match query.metric.as_deref() {
            Some(name) => name.rsplit_once('/').map_or((None, Some(name)), |(p, m)| (Some(p), Some(m))),
            None => (None, None),
        };
        if let Some(metric) = metric {
            values.push(metric);
            let mut ids = format!("SELECT id FROM metric WHERE metric = ?{}", values.len());
            if let Some(phase) = phase {
                values.push(phase);
                ids += &format!(" AND phase = ?{}", values.len());
            }
            conditions.push(format!("a.id IN (SELECT attempt FROM measurement WHERE metric IN ({ids}))"));
        }
        let text = format!(
            "SELECT s.batch, a.serial, a.part_number, a.revision, a.lot, a.attempt, a.outcome, a.simulated, a.at, a.plan, s.number, a.offset, a.length, a.id, a.emulated \
             FROM attempt a JOIN segment s ON s.id = a.segment WHERE {} ORDER BY a.at DESC, a.id DESC LIMIT {}",
            conditions.join(" AND "),
            query.limit
        );
        let mut statement = self.db.prepare(&text).map_err(fail)?;
        let mut rows = statement.query(rusqlite::params_from_iter(&values)).map_err(fail)?;
        let mut answers = Vec::new();
        while let Some(row) = rows.next().map_err(fail)? {
            let mut answer = answer(row).map_err(fail)?;
            if let Some(metric) = metric {
                answer.measurements = self.measurements(row.get(13).map_err(fail)?, phase, metric).map_err(fail)?;
            }
            answers.push(answer);
        }
        answers.reverse();
        Ok(answers)
    }

    fn measurements(&self, attempt: i64, phase: Option<&str>, metric: &str) -> rusqlite::Result<Vec<Figure>> {
        let text = "SELECT k.phase, k.metric, m.value, k.unit, m.outcome FROM metric k JOIN measurement m ON m.metric = k.id \
                    WHERE k.metric = ?1 AND (?2 IS NULL OR k.phase = ?2) AND m.attempt = ?3 ORDER BY k.id";
        let mut statement = self.db.prepare_cached(text)?;
        let rows = statement.query_map(params![metric, phase, attempt], |r| {
            Ok(Figure { phase: r.get(0)?, metric: r.get(1)?, value: r.get(2)?, unit: r.get(3)?, outcome: r.get(4)? })
        })?;
        rows.collect()
    }

    /// The record behind an answer.
    pub fn record(&self, answer: &Answer) -> Result<Line, BatchError> {
        let (batch, segment, offset, length) = &answer.place;
        journal::read_at(&self.root.join(batch), Place { segment: *segment, offset: *offset, length: *length })
    }
}

fn answer(row: &rusqlite::Row) -> rusqlite::Result<Answer> {
    let batch: String = row.get(0)?;
    Ok(Answer {
        serial: row.get(1)?,
        part_number: row.get(2)?,
        revision: row.get(3)?,
        lot: row.get(4)?,
        attempt: row.get(5)?,
        outcome: row.get(6)?,
        simulated: row.get(7)?,
        emulated: row.get(14)?,
        at: row.get(8)?,
        plan: row.get(9)?,
        measurements: Vec::new(),
        place: (batch.clone(), row.get(10)?, row.get::<_, i64>(11)? as u64, row.get::<_, i64>(12)? as u64),
        batch,
    })
}

fn writable(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_CREATE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let db = Connection::open_with_flags(path, flags)?;
    db.busy_timeout(Duration::from_secs(30))?;
    db.pragma_update(None, "journal_mode", "wal")?;
    // The records are the truth; the index may lose its last transaction in a power cut, not its soundness.
    db.pragma_update(None, "synchronous", "normal")?;
    let version: i64 = db.query_row("PRAGMA user_version", [], |r| r.get(0))?;
    if version != 0 && version != VERSION {
        // Another version's index: it holds nothing of its own.
        db.execute_batch(
            "DROP TABLE IF EXISTS measurement; DROP TABLE IF EXISTS metric; DROP TABLE IF EXISTS attempt; DROP TABLE IF EXISTS segment;",
        )?;
    }
    db.execute_batch(SCHEMA)?;
    Ok(db)
}

/// Folders below `root` that hold a journal, as paths relative to it.
fn find_batches(root: &Path, relative: &str, depth: usize, found: &mut Vec<String>) -> Result<(), BatchError> {
    let folder = root.join(relative);
    // Links are not followed: neither to a batch elsewhere nor in a circle.
    if std::fs::symlink_metadata(journal::folder(&folder)).is_ok_and(|m| m.is_dir()) {
        found.push(relative.to_string());
        return Ok(());
    }
    if depth == 0 {
        return Ok(());
    }
    let entries = std::fs::read_dir(&folder).map_err(|e| BatchError::store(&folder, e))?;
    let mut names: Vec<String> = entries
        .filter_map(|e| e.ok())
        .filter(|e| e.file_type().is_ok_and(|t| t.is_dir()))
        .filter_map(|e| e.file_name().into_string().ok())
        .collect();
    names.sort();
    for name in names {
        let below = if relative.is_empty() { name } else { format!("{relative}/{name}") };
        find_batches(root, &below, depth - 1, found)?;
    }
    Ok(())
}

fn read_new(
    transaction: &Transaction,
    folder: &Path,
    batch: &str,
    number: u32,
    fail: &impl Fn(rusqlite::Error) -> BatchError,
) -> Result<(), BatchError> {
    transaction
        .execute("INSERT OR IGNORE INTO segment (batch, number, read_to) VALUES (?1, ?2, 0)", params![batch, number])
        .map_err(fail)?;
    let (segment, read_to): (i64, i64) = transaction
        .query_row("SELECT id, read_to FROM segment WHERE batch = ?1 AND number = ?2", params![batch, number], |r| {
            Ok((r.get(0)?, r.get(1)?))
        })
        .map_err(fail)?;
    let (_, end) =
        journal::read_segment(folder, number, read_to as u64, |place, line| insert(transaction, segment, place, &line).map_err(fail))?;
    let seal = seal::seal(transaction, segment).map_err(fail)?;
    transaction.execute("UPDATE segment SET read_to = ?1, seal = ?2 WHERE id = ?3", params![end as i64, seal, segment]).map_err(fail)?;
    Ok(())
}

fn insert(transaction: &Transaction, segment: i64, place: Place, line: &Line) -> rusqlite::Result<()> {
    let Some(record) = line.record.as_ref().filter(|_| line.event == Kind::Finished) else { return Ok(()) };
    let mut attempt = transaction.prepare_cached(
        "INSERT INTO attempt (segment, offset, length, serial, part_number, revision, lot, position, attempt, outcome, simulated, at, plan, plan_sha256, emulated) \
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15)",
    )?;
    let dut = &record.dut;
    attempt.execute(params![
        segment,
        place.offset as i64,
        place.length as i64,
        dut.serial,
        dut.part_number,
        dut.revision,
        dut.lot,
        line.position as i64,
        line.attempt,
        record.outcome.text(),
        record.simulated,
        line.at,
        record.plan.name,
        record.plan.sha256,
        record.rig.emulated
    ])?;
    let id = transaction.last_insert_rowid();
    let mut find = transaction.prepare_cached("SELECT id FROM metric WHERE phase = ?1 AND metric = ?2 AND unit = ?3")?;
    let mut name = transaction.prepare_cached("INSERT INTO metric (phase, metric, unit) VALUES (?1, ?2, ?3)")?;
    let mut measurement =
        transaction.prepare_cached("INSERT OR REPLACE INTO measurement (metric, attempt, value, outcome) VALUES (?1, ?2, ?3, ?4)")?;
    for (phase, metric, m) in measurements(record) {
        let key = params![phase, metric, m.unit];
        let metric: i64 = match find.query_row(key, |r| r.get(0)).optional()? {
            Some(id) => id,
            None => {
                name.execute(key)?;
                transaction.last_insert_rowid()
            }
        };
        measurement.execute(params![metric, id, m.value, m.outcome.text()])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
