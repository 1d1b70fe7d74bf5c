//! The record itself, as JSON (`schema = "hil.record/1"`).

use crate::record::TestRecord;

/// The record as a JSON document, keys in the order of the schema.
pub fn json(record: &TestRecord) -> String {
    // A record holds only text, numbers and lists: it can always be written.
    let mut text = serde_json::to_string_pretty(record).unwrap_or_default();
    text.push('\n');
    text
}

/// The record without what differs between two runs of the same test on the same valve: when, where, with which version.
pub fn without_provenance(record: &TestRecord) -> TestRecord {
    TestRecord { provenance: None, ..record.clone() }
}
