//! Whether an index is to be believed: its rows against their seals and against the journals.

use std::path::Path;

use super::seal::seal;
use super::{Answer, Figure, Index, Query};
use crate::batch::BatchError;
use crate::batch::journal;
use crate::batch::tally::measurements;

impl Index {
    /// The answers from an index that agrees with the journals. Where a row says something else than its record, or rows were lost
    /// or added, the index is made anew; the flag says so.
    pub fn answers(root: &Path, query: &Query) -> Result<(Self, Vec<Answer>, bool), BatchError> {
        let index = Self::open(root)?;
        let answers = index.query(query)?;
        if answers.iter().all(|a| index.is_true(a)) {
            return Ok((index, answers, false));
        }
        drop(index);
        let index = Self::rebuild(root)?;
        let answers = index.query(query)?;
        Ok((index, answers, true))
    }

    /// Whether an answer is what the journal says at its place.
    fn is_true(&self, a: &Answer) -> bool {
        let Ok(line) = self.record(a) else { return false };
        let Some(record) = line.record else { return false };
        let dut = &record.dut;
        let same = (a.serial == dut.serial, a.part_number == dut.part_number, a.revision == dut.revision, a.lot == dut.lot)
            == (true, true, true, true);
        let figure = |f: &Figure| {
            measurements(&record).any(|(phase, metric, m)| {
                phase == f.phase && metric == f.metric && m.unit == f.unit && m.value == f.value && m.outcome.text() == f.outcome
            })
        };
        same && a.attempt == line.attempt
            && a.outcome == record.outcome.text()
            && (a.simulated, a.emulated) == (record.simulated, record.rig.emulated)
            && (&a.at, &a.plan) == (&line.at, &record.plan.name)
            && a.measurements.iter().all(figure)
    }

    /// Whether the rows are those that were read from the journals, as far as the index itself can tell, and no segment shrank.
    pub(super) fn agrees(&self) -> Result<bool, BatchError> {
        let fail = |source| BatchError::Index { path: self.path.clone(), source };
        let mut statement = self.db.prepare("SELECT id, batch, number, read_to, seal FROM segment").map_err(fail)?;
        let row = |r: &rusqlite::Row| Ok((r.get(0)?, r.get::<_, String>(1)?, r.get(2)?, r.get::<_, i64>(3)?, r.get::<_, String>(4)?));
        let segments: Vec<(i64, String, u32, i64, String)> =
            statement.query_map([], row).map_err(fail)?.collect::<rusqlite::Result<_>>().map_err(fail)?;
        for (id, batch, number, read_to, kept) in segments {
            let size = std::fs::metadata(journal::segment_path(&self.root.join(&batch), number)).map_or(0, |m| m.len());
            if size < read_to as u64 || seal(&self.db, id).map_err(fail)? != kept {
                return Ok(false);
            }
        }
        let orphans: i64 = self
            .db
            .query_row("SELECT COUNT(*) FROM attempt WHERE segment NOT IN (SELECT id FROM segment)", [], |r| r.get(0))
            .map_err(fail)?;
        Ok(orphans == 0)
    }
}
