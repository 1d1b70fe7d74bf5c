//! Questions to the index, and an index that was tampered with.

use super::*;
use crate::batch::example;
use crate::batch::journal::{Journal, encode};
use crate::record::Outcome;

fn write(batch: &Path, from: usize, to: usize) {
    let mut journal = Journal::begin(batch).unwrap();
    for position in from..to {
        let mut record = example::record(&format!("V{position}"), position as u64);
        record.dut.lot = Some(format!("L{}", position / 10));
        let at = format!("2026-01-01T00:{:02}:{:02}Z", position / 60, position % 60);
        let line = Line { event: Kind::Finished, position, attempt: 1, at, dut: None, record: Some(record) };
        journal.append(&encode(&line)).unwrap();
    }
    journal.confirm().unwrap();
}

fn ask(root: &Path, query: Query) -> Vec<Answer> {
    Index::open(root).unwrap().query(&Query { limit: 1000, ..query }).unwrap()
}

#[test]
fn answers_by_serial_lot_metric_time_and_outcome() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("a/b"), 0, 50);
    write(&dir.path().join("c"), 50, 100);
    let by_serial = ask(dir.path(), Query { serial: Some("V73".into()), ..Query::default() });
    assert_eq!((by_serial.len(), by_serial[0].batch.as_str()), (1, "c"));
    let index = Index::open(dir.path()).unwrap();
    assert_eq!(index.record(&by_serial[0]).unwrap().record.unwrap().dut.serial, "V73");
    assert_eq!(ask(dir.path(), Query { lot: Some("L3".into()), ..Query::default() }).len(), 10);
    let by_metric = ask(dir.path(), Query { lot: Some("L3".into()), metric: Some("main/rmse".into()), ..Query::default() });
    assert_eq!(by_metric[0].measurements[0].unit, "bar");
    assert!(ask(dir.path(), Query { metric: Some("overshoot".into()), ..Query::default() }).is_empty());
    let time = Query { since: Some("2026-01-01T00:01:00Z".into()), until: Some("2026-01-01T00:01:05Z".into()), ..Query::default() };
    assert_eq!(ask(dir.path(), time).len(), 5);
    let failed = ask(dir.path(), Query { outcome: Some("FAIL".into()), ..Query::default() });
    let wanted = (0..100).filter(|i| example::record("", *i).outcome == Outcome::Fail).count();
    assert!(wanted > 0 && failed.len() == wanted);
}

#[test]
fn reads_only_what_is_new_and_can_be_made_anew() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), 0, 5);
    assert_eq!(ask(dir.path(), Query::default()).len(), 5);
    write(dir.path(), 5, 8);
    assert_eq!(ask(dir.path(), Query::default()).len(), 8);
    std::fs::write(dir.path().join(FILE), "no database").unwrap();
    let rebuilt = Index::rebuild(dir.path()).unwrap();
    assert_eq!(rebuilt.query(&Query { limit: 1000, ..Query::default() }).unwrap().len(), 8);
}

#[test]
fn two_readers_at_once_count_nothing_twice() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), 0, 200);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| assert_eq!(ask(dir.path(), Query::default()).len(), 200));
        }
    });
}

/// Each of these edits of the file was believed once.
#[test]
fn an_edited_index_is_not_believed() {
    let edits = [
        "UPDATE attempt SET outcome = 'PASS', serial = 'V3' WHERE serial = 'V7'",
        "UPDATE attempt SET simulated = 0",
        "DELETE FROM attempt WHERE serial = 'V7'",
        "INSERT INTO attempt SELECT id + 1000, segment, offset, length, 'V7', part_number, revision, lot, position, attempt, outcome, simulated, emulated, at, plan, plan_sha256 FROM attempt WHERE serial = 'V3'",
        "UPDATE measurement SET value = value + 1",
        "UPDATE segment SET read_to = read_to + 100000",
        "DELETE FROM segment",
    ];
    for edit in edits {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), 0, 20);
        let query = Query { serial: Some("V7".into()), metric: Some("rmse".into()), limit: 10, ..Query::default() };
        let before = Index::answers(dir.path(), &query).unwrap();
        assert!(before.1.len() == 1 && !before.2);
        drop(before.0);
        Connection::open(dir.path().join(FILE)).unwrap().execute_batch(&format!("PRAGMA foreign_keys = OFF; {edit}")).unwrap();
        let (_, after, _) = Index::answers(dir.path(), &query).unwrap();
        assert_eq!(after, before.1, "{edit}");
    }
}

#[test]
fn a_journal_that_shrank_or_went_takes_its_answers_with_it() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("a"), 0, 5);
    write(&dir.path().join("b"), 5, 8);
    assert_eq!(ask(dir.path(), Query::default()).len(), 8);
    std::fs::remove_dir_all(dir.path().join("b")).unwrap();
    assert_eq!(ask(dir.path(), Query::default()).len(), 5);
}

#[test]
fn a_link_to_a_batch_is_not_followed() {
    let (dir, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    write(&elsewhere.path().join("x"), 0, 3);
    write(&dir.path().join("own"), 3, 5);
    std::os::unix::fs::symlink(elsewhere.path(), dir.path().join("link")).unwrap();
    assert_eq!(ask(dir.path(), Query::default()).len(), 2);
}
