//! The folder of a batch: what was asked for, the journal, and the lock that keeps a second process out.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::BatchError;
use super::journal::{self, Damage, Journal, Kind, Line};
use super::population::Population;
use super::tally::Tally;
use crate::output::{clear_leftovers, make_folder, whole_file};
use crate::record::{Dut, Outcome};
use crate::rig::RigIdentity;

/// The schema key of a batch.
pub const SCHEMA: &str = "hil.batch/1";
const HEADER: &str = "batch.json";
const LOCK: &str = "lock";

/// What was asked for; the same in every session of a batch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// `hil.batch/1`.
    pub schema: String,
    /// Name of the plan.
    pub plan: String,
    /// SHA-256 of the plan file, hex.
    pub plan_sha256: String,
    /// Every parameter's effective value.
    pub parameters: Vec<(String, String)>,
    /// The parameters that `--set` changed.
    pub overridden: Vec<String>,
    /// Whether the valves are simulated; such a batch never enters statistics of real ones.
    pub simulated: bool,
    /// Seed of the whole batch.
    pub seed: u64,
    /// The rig: valve model or driver profile.
    pub rig: RigIdentity,
    /// Number of valves; `None` where they are entered one by one.
    pub valves: Option<usize>,
    /// SHA-256 over the list of the valves, hex; `None` where they are entered one by one.
    pub valves_sha256: Option<String>,
    /// The simulated population.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub population: Option<Population>,
    /// Part number and revision of the limits file, and its SHA-256.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<(String, String)>,
    /// The decision rule, in words.
    pub decision_rule: String,
    /// Attempts per valve, and after which outcomes a further one is made.
    pub attempts: (u32, Vec<String>),
    /// The station, as its file has it, with operator and overrides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub station: Option<serde_json::Value>,
    /// Version of the program that began the batch.
    pub version: String,
}

impl Header {
    /// Whether a batch with this head may go on with `other`.
    pub fn continues(&self, other: &Header) -> bool {
        self.differences(other).is_empty()
    }

    /// What differs in a way that forbids to go on with this batch; the station and the version may change over a night.
    fn differences(&self, other: &Header) -> Vec<&'static str> {
        let pairs = [
            ("the plan", self.plan_sha256 == other.plan_sha256),
            ("the parameters", self.parameters == other.parameters),
            ("--sim", self.simulated == other.simulated),
            ("the seed", self.seed == other.seed),
            ("the valve model or driver", self.rig.sha256 == other.rig.sha256 && self.rig.kind == other.rig.kind),
            ("the list of the valves", self.valves_sha256 == other.valves_sha256),
            ("the population", self.population == other.population),
            ("the limits", self.limits == other.limits),
        ];
        pairs.into_iter().filter(|p| !p.1).map(|p| p.0).collect()
    }
}

/// An attempt that was begun and never ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Interrupted {
    /// Place of the valve in the batch.
    pub position: usize,
    /// Which attempt.
    pub attempt: u32,
    /// The valve.
    pub dut: Dut,
    /// When it began.
    pub at: String,
}

/// What the journal of a batch holds.
#[derive(Debug, Default)]
pub struct Loaded {
    /// The attempts that ended.
    pub tally: Tally,
    /// The attempts that did not.
    pub interrupted: Vec<Interrupted>,
    /// What is no whole line.
    pub damage: Vec<Damage>,
    /// The last attempt on each valve and its outcome.
    pub last: BTreeMap<usize, (u32, Outcome)>,
}

/// The folder of a batch, held by this process.
#[derive(Debug)]
pub struct Store {
    dir: PathBuf,
    header: Header,
    // Held for as long as the store lives; the system lets go of it however the process ends.
    _lock: File,
}

impl Store {
    /// Begins a batch in a folder that holds none, or, with `resume`, goes on with the one that it holds.
    ///
    /// # Errors
    /// [`BatchError::Busy`], [`BatchError::Exists`], [`BatchError::Mismatch`] where the batch is another one, [`BatchError::Store`].
    pub fn open(dir: &Path, header: Header, resume: bool) -> Result<Self, BatchError> {
        make_folder(dir).map_err(|e| BatchError::store(dir, e))?;
        let lock_path = dir.join(LOCK);
        let lock = File::options().create(true).append(true).open(&lock_path).map_err(|e| BatchError::store(&lock_path, e))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => return Err(BatchError::Busy { path: dir.into() }),
            Err(std::fs::TryLockError::Error(e)) => return Err(BatchError::store(&lock_path, e)),
        }
        clear_leftovers(dir);
        let path = dir.join(HEADER);
        let held = match std::fs::read(&path) {
            Ok(bytes) => Some(serde_json::from_slice::<Header>(&bytes).map_err(|e| {
                let what = format!("`{HEADER}` cannot be read: {e}");
                BatchError::Mismatch { path: dir.into(), what }
            })?),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
            Err(e) => return Err(BatchError::store(&path, e)),
        };
        let header = match held {
            Some(_) if !resume => return Err(BatchError::Exists { path: dir.into() }),
            Some(held) => {
                let differences = held.differences(&header);
                if !differences.is_empty() {
                    let what = format!("{} changed since the batch began", differences.join(", "));
                    return Err(BatchError::Mismatch { path: dir.into(), what });
                }
                held
            }
            None if !journal::segments(dir)?.is_empty() => {
                let what = format!("it holds a journal, but no `{HEADER}`");
                return Err(BatchError::Mismatch { path: dir.into(), what });
            }
            None => {
                let text = serde_json::to_vec_pretty(&header).unwrap_or_default();
                write_whole(&path, &text)?;
                header
            }
        };
        Ok(Self { dir: dir.into(), header, _lock: lock })
    }

    /// The folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// What was asked for when the batch began.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Begins a segment of the journal for this session.
    pub fn journal(&self) -> Result<Journal, BatchError> {
        Journal::begin(&self.dir)
    }

    /// Reads what the journal holds.
    pub fn load(&self) -> Result<Loaded, BatchError> {
        load(&self.dir)
    }
}

/// Reads the header of a batch without holding its folder.
pub fn read_header(dir: &Path) -> Result<Header, BatchError> {
    let path = dir.join(HEADER);
    if !path.exists() {
        return Err(BatchError::Input(format!("{}: is not the folder of a batch, which holds a {HEADER}", dir.display())));
    }
    let bytes = std::fs::read(&path).map_err(|e| BatchError::store(&path, e))?;
    serde_json::from_slice(&bytes).map_err(|e| BatchError::Input(format!("{}: is not the head of a batch: {e}", path.display())))
}

/// Reads the journal of a batch without holding its folder. A line that says again what another said counts once.
pub fn load(dir: &Path) -> Result<Loaded, BatchError> {
    let mut loaded = Loaded::default();
    let mut begun: BTreeMap<(usize, u32), Interrupted> = BTreeMap::new();
    let mut ended = std::collections::BTreeSet::new();
    loaded.damage = journal::read(dir, |_, line: Line| {
        let key = (line.position, line.attempt);
        match (line.event, line.dut, line.record) {
            (Kind::Started, Some(dut), _) => {
                let begin = Interrupted { position: line.position, attempt: line.attempt, dut, at: line.at };
                begun.entry(key).or_insert(begin);
            }
            (Kind::Finished, _, Some(record)) if ended.insert(key) => {
                loaded.tally.add(line.position, line.attempt, &record);
                let last = loaded.last.entry(line.position).or_insert((line.attempt, record.outcome));
                if line.attempt >= last.0 {
                    *last = (line.attempt, record.outcome);
                }
            }
            _ => {}
        }
        Ok(())
    })?;
    loaded.interrupted = begun.into_iter().filter(|(key, _)| !ended.contains(key)).map(|(_, i)| i).collect();
    loaded.tally.sort();
    Ok(loaded)
}

/// Writes a file that is whole or not there.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), BatchError> {
    whole_file(path, |file| file.write_all(bytes)).map_err(|e| BatchError::store(path, e.into_io()))
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn header() -> Header {
        Header {
            schema: SCHEMA.into(),
            plan: "example".into(),
            plan_sha256: "00".into(),
            parameters: vec![],
            overridden: vec![],
            simulated: true,
            seed: 1,
            rig: RigIdentity::default(),
            valves: Some(3),
            valves_sha256: Some("11".into()),
            population: None,
            limits: None,
            decision_rule: "simple".into(),
            attempts: (1, vec![]),
            station: None,
            version: "0".into(),
        }
    }

    #[test]
    fn a_folder_holds_one_batch_and_one_process() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path(), header(), false).unwrap();
        assert!(matches!(Store::open(dir.path(), header(), true), Err(BatchError::Busy { .. })));
        drop(store);
        assert!(matches!(Store::open(dir.path(), header(), false), Err(BatchError::Exists { .. })));
        let other = Header { seed: 2, plan_sha256: "ff".into(), version: "9".into(), ..header() };
        let error = Store::open(dir.path(), other, true).unwrap_err().to_string();
        assert!(error.ends_with("cannot resume: the plan, the seed changed since the batch began"), "{error}");
        let later = Store::open(dir.path(), Header { version: "9".into(), ..header() }, true).unwrap();
        assert_eq!(later.header().version, "0", "the batch keeps the head that it began with");
    }

    #[test]
    fn a_read_only_folder_is_a_clear_error() {
        let error = Store::open(Path::new("/proc/hil"), header(), false).unwrap_err();
        assert!(matches!(error, BatchError::Store { .. }) && error.to_string().starts_with("/proc/hil: "));
    }
}
