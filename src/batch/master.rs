//! The gate of the master valves: production waits until the station has given known valves their known verdicts.
//!
//! Every check is a line in a log beside the station file; the gate reads the last one of each master.

use std::io::Write;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use super::BatchError;
use super::station::{Expectation, MasterGate, Station};
use crate::record::{Outcome, TestRecord};

/// One check of a master valve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MasterCheck {
    /// When.
    pub at: Timestamp,
    /// Id of the station.
    pub station: String,
    /// Serial number of the master.
    pub serial: String,
    /// SHA-256 of the plan, hex.
    pub plan_sha256: String,
    /// Whether the pressure came from a simulation or an emulator; such a check opens no gate of a real batch.
    pub simulated: bool,
    /// The verdict it got.
    pub outcome: Outcome,
    /// Whether that is the verdict it should get.
    pub as_expected: bool,
}

/// The log that belongs to a station file: `bench.toml` has `bench.masters.jsonl`.
pub fn log_path(station_file: &Path) -> PathBuf {
    station_file.with_extension("masters.jsonl")
}

/// What a record of a master valve says of the station.
///
/// # Errors
/// [`BatchError::Input`] where the station names no such master.
pub fn judge(station: &Station, record: &TestRecord, at: Timestamp) -> Result<MasterCheck, BatchError> {
    let gate = gate(station)?;
    let Some(master) = gate.valves.iter().find(|v| v.serial == record.dut.serial) else {
        let known: Vec<&str> = gate.valves.iter().map(|v| v.serial.as_str()).collect();
        let problem = format!("station `{}` has no master `{}`; its masters are: {}", station.id, record.dut.serial, known.join(", "));
        return Err(BatchError::Input(problem));
    };
    let as_expected = match master.expect {
        Expectation::Pass => matches!(record.outcome, Outcome::Pass | Outcome::Marginal),
        Expectation::Fail => record.outcome == Outcome::Fail,
    };
    Ok(MasterCheck {
        at,
        station: station.id.clone(),
        serial: master.serial.clone(),
        plan_sha256: record.plan.sha256.clone(),
        simulated: record.origin() != crate::record::Origin::Real,
        outcome: record.outcome,
        as_expected,
    })
}

fn gate(station: &Station) -> Result<&MasterGate, BatchError> {
    let missing = || BatchError::Input(format!("station `{}` has no [master] block", station.id));
    station.master.as_ref().ok_or_else(missing)
}

/// Appends a check to the log and puts it on the disk.
pub fn append(log: &Path, check: &MasterCheck) -> Result<(), BatchError> {
    let fail = |e| BatchError::store(log, e);
    let mut line = serde_json::to_vec(check).unwrap_or_default();
    line.push(b'\n');
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(log).map_err(fail)?;
    file.write_all(&line).and_then(|()| file.sync_data()).map_err(fail)
}

/// The checks in the log; a torn last line is none. A log that does not exist holds none.
pub fn read(log: &Path) -> Result<Vec<MasterCheck>, BatchError> {
    match std::fs::read_to_string(log) {
        Ok(text) => Ok(text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(e) => Err(BatchError::store(log, e)),
    }
}

/// Whether production may begin: each master was checked with this plan, with its expected verdict, not too long ago.
///
/// # Errors
/// [`BatchError::Gate`] with the master that is missing, failed or old, and the command that checks it.
pub fn open(station: &Station, checks: &[MasterCheck], plan_sha256: &str, simulated: bool, now: Timestamp) -> Result<(), BatchError> {
    let Some(gate) = &station.master else { return Ok(()) };
    for master in &gate.valves {
        let own = |c: &&MasterCheck| c.station == station.id && c.serial == master.serial && c.plan_sha256 == plan_sha256;
        let last = checks.iter().filter(own).rfind(|c| simulated || !c.simulated);
        let problem = match last {
            None => "has not been checked with this plan on this station".to_string(),
            Some(c) if !c.as_expected => format!("got {:?} at the last check ({}), not what it should get", c.outcome, c.at),
            Some(c) if now.duration_since(c.at).as_secs_f64() > gate.max_age.value() => {
                format!("was last checked at {}; that is more than {} ago", c.at, gate.max_age)
            }
            Some(_) => continue,
        };
        let serial = &master.serial;
        return Err(BatchError::Gate(format!(
            "the gate of station `{}` is closed: master valve `{serial}` {problem}. Check it: hil master PLAN --station FILE --serial {serial}",
            station.id
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::example;

    fn station() -> Station {
        let text = "schema = \"hil.station/1\"\nid = \"b\"\n[master]\nmax_age = \"8 h\"\n[[master.valve]]\nserial = \"GOOD\"\nexpect = \"pass\"\n[[master.valve]]\nserial = \"BAD\"\nexpect = \"fail\"\n";
        Station::from_toml(text, "b.toml").unwrap()
    }

    fn at(hour: i64) -> Timestamp {
        Timestamp::from_second(1_800_000_000 + 3600 * hour).unwrap()
    }

    fn check(serial: &str, outcome: Outcome, hour: i64) -> MasterCheck {
        let mut record = example::record(serial, 0);
        record.outcome = outcome;
        record.simulated = false;
        judge(&station(), &record, at(hour)).unwrap()
    }

    #[test]
    fn the_gate_needs_each_master_as_expected_and_recent() {
        let good = check("GOOD", Outcome::Marginal, 0);
        let bad = check("BAD", Outcome::Fail, 0);
        let opens = |checks: &[MasterCheck], hour| open(&station(), checks, "00", false, at(hour)).map_err(|e| e.to_string());
        assert!(opens(&[good.clone(), bad.clone()], 8).is_ok());
        assert!(opens(&[good.clone(), bad.clone()], 9).unwrap_err().contains("more than 28800 s ago"));
        assert!(opens(std::slice::from_ref(&good), 1).unwrap_err().contains("`BAD` has not been checked"));
        // A bad master that passes says that the station sees no fault.
        assert!(opens(&[good.clone(), check("BAD", Outcome::Pass, 1)], 1).unwrap_err().contains("got Pass"));
        assert!(open(&station(), &[good.clone(), bad.clone()], "another plan", false, at(1)).is_err());
        let simulated = MasterCheck { simulated: true, ..good };
        assert!(open(&station(), &[simulated.clone(), bad.clone()], "00", false, at(1)).is_err());
        assert!(open(&station(), &[simulated, bad], "00", true, at(1)).is_ok());
    }

    #[test]
    fn the_log_keeps_every_check_and_survives_a_torn_line() {
        let dir = tempfile::tempdir().unwrap();
        let log = log_path(&dir.path().join("b.toml"));
        assert!(read(&log).unwrap().is_empty());
        let first = check("GOOD", Outcome::Pass, 0);
        append(&log, &first).unwrap();
        append(&log, &check("BAD", Outcome::Fail, 1)).unwrap();
        let bytes = std::fs::read(&log).unwrap();
        std::fs::write(&log, &bytes[..bytes.len() - 5]).unwrap();
        assert_eq!(read(&log).unwrap(), [first]);
        assert!(judge(&station(), &example::record("X", 0), at(0)).unwrap_err().to_string().contains("its masters are: GOOD, BAD"));
    }
}
