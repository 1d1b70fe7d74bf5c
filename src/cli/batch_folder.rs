//! The files that a batch leaves beside its journal, all made from it: page, summary, JUnit, measurements, statistics.

use std::io::Write;
use std::path::Path;

use crate::batch::BatchError;
use crate::batch::index::Index;
use crate::batch::store::write_whole;
use crate::batch::summary::BatchSummary;
use crate::batch::tally::{Attempt, Tally};
use crate::digest;
use crate::output::{Mark, folder_name};
use crate::record::TestRecord;
use crate::recording::{Column, RecordingError, Values, replace_file, write_parquet};
use crate::report;

/// The files of a batch beside its journal.
pub const FILES: [(&str, Mark); 7] = [
    ("summary.md", Mark::None),
    ("statistics.json", Mark::Schema(crate::batch::store::SCHEMA)),
    ("report.html", Mark::Page),
    ("junit.xml", Mark::None),
    ("measurements.csv", Mark::None),
    ("measurements.parquet", Mark::None),
    ("valves", Mark::None),
];

/// Folder of one attempt below that of the batch; no two serial numbers share one.
pub fn attempt_folder(serial: &str, attempt: u32) -> String {
    format!("valves/{}/attempt-{attempt}", folder_name(serial))
}

/// The report of an attempt, where it has one.
pub fn report_link(dir: &Path, attempt: &Attempt) -> Option<String> {
    let here = format!("{}/report.html", attempt_folder(&attempt.dut.serial, attempt.number));
    if dir.join(&here).is_file() {
        return Some(here.replace('#', "%23"));
    }
    // The first version had other names, which two serial numbers could share: the record in it says whose it is.
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.+#".contains(c) { c } else { '_' };
    let old = format!("valves/{}/attempt-{}", attempt.dut.serial.chars().map(plain).collect::<String>(), attempt.number);
    let record = TestRecord::load(&dir.join(&old)).ok()?;
    (record.dut.serial == attempt.dut.serial).then(|| format!("{old}/report.html").replace('#', "%23"))
}

/// An id that follows from what the report says.
pub fn report_id(summary: &BatchSummary) -> String {
    let bytes = serde_json::to_vec(&(&summary.batch, &summary.valves)).unwrap_or_default();
    format!("HIL-{}", digest::sha256(&bytes)[..12].to_uppercase())
}

/// The batch as JSON.
pub fn json(summary: &BatchSummary) -> String {
    let mut text = serde_json::to_string_pretty(summary).unwrap_or_default();
    text.push('\n');
    text
}

/// The batch as JUnit XML.
pub fn junit(summary: &BatchSummary, tally: &Tally) -> String {
    let mut bytes = Vec::new();
    // Writing to memory cannot fail.
    let _ = report::batch::junit(summary, tally, &mut bytes);
    String::from_utf8(bytes).unwrap_or_default()
}

/// Writes every file; each is whole or not there.
pub fn write(dir: &Path, summary: &BatchSummary, tally: &Tally) -> Result<(), BatchError> {
    write_whole(&dir.join("summary.md"), report::batch::markdown(summary).as_bytes())?;
    write_whole(&dir.join("statistics.json"), json(summary).as_bytes())?;
    write_whole(&dir.join("report.html"), report::batch::html(summary, &report_id(summary)).as_bytes())?;
    stream(&dir.join("junit.xml"), |out| report::batch::junit(summary, tally, out))?;
    stream(&dir.join("measurements.csv"), |out| report::batch::csv(tally, out))?;
    parquet(&dir.join("measurements.parquet"), tally)?;
    // The index is made from the journal and can be made again: a batch is none the worse without it.
    if let Err(e) = Index::open(dir) {
        super::note(&format!("warning: {e}"));
    }
    Ok(())
}

fn stream(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), BatchError> {
    replace_file(path, |file| write(file)).map_err(stored(path))
}

fn stored(path: &Path) -> impl Fn(RecordingError) -> BatchError + '_ {
    move |e| BatchError::store(path, std::io::Error::other(e.to_string()))
}

/// All measurements as one Parquet file: the rows of the CSV.
fn parquet(path: &Path, tally: &Tally) -> Result<(), BatchError> {
    let mut positions = Vec::new();
    let mut attempts = Vec::new();
    let mut values = Vec::new();
    let mut texts: [Vec<&str>; 9] = Default::default();
    for a in tally.attempts() {
        for (m, (value, verdict)) in tally.metrics().iter().zip(&a.values) {
            if value.is_nan() && *verdict == crate::record::Outcome::NotRun {
                continue;
            }
            positions.push(a.position as i64);
            attempts.push(i64::from(a.number));
            values.push(*value);
            let row: [&str; 9] = [
                &a.dut.serial,
                a.dut.part_number.as_deref().unwrap_or(""),
                a.dut.revision.as_deref().unwrap_or(""),
                a.dut.lot.as_deref().unwrap_or(""),
                a.outcome.text(),
                &m.phase,
                &m.metric,
                &m.unit,
                verdict.text(),
            ];
            texts.iter_mut().zip(row).for_each(|(column, text)| column.push(text));
        }
    }
    let names = ["serial", "part_number", "revision", "lot", "outcome", "phase", "metric", "unit", "verdict"];
    let mut table = vec![
        Column { name: "position", values: Values::Integers(&positions) },
        Column { name: "attempt", values: Values::Integers(&attempts) },
        Column { name: "value", values: Values::Numbers(&values) },
    ];
    table.extend(names.into_iter().zip(&texts).map(|(name, column)| Column { name, values: Values::Texts(column) }));
    write_parquet(path, &[table]).map_err(stored(path))
}
