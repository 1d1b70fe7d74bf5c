//! The digest over what an index holds of a segment.

use rusqlite::Connection;
use sha2::{Digest, Sha256};

/// Digest over the attempts of a segment as the index has them.
pub(super) fn seal(db: &Connection, segment: i64) -> rusqlite::Result<String> {
    let mut statement = db.prepare_cached(
        "SELECT offset, length, serial, part_number, revision, lot, position, attempt, outcome, simulated, emulated, at, plan, plan_sha256 \
         FROM attempt WHERE segment = ?1 ORDER BY offset, id",
    )?;
    let mut rows = statement.query([segment])?;
    let mut hash = Sha256::new();
    while let Some(row) = rows.next()? {
        for k in 0..14 {
            hash.update(format!("{:?};", row.get_ref(k)?));
        }
    }
    Ok(crate::digest::hex(hash))
}
