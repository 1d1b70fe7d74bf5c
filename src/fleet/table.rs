//! All rows as one Parquet table, for DuckDB, pandas and Spark.
//!
//! One row a job, flat columns of text and numbers; free columns of the list are `tag_<name>`. The schema is stable:
//! columns are added at the end, never renamed.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::record::Field;
use parquet::schema::parser::parse_message_type;
use serde::{Deserialize, Serialize};

use super::FleetError;
use super::collected::{Collected, Earlier, Segments};
use super::row::{Row, RowEffect, Status};
use super::standing::Standing;
use crate::recording::replace_file;

/// A column: name, and its cell of a row.
enum Column<'s> {
    Text(String, fn(&Row) -> Option<String>),
    Number(String, fn(&Row) -> Option<f64>),
    /// What counts against the valve.
    Causes(&'s Standing),
    Tag(String),
}

impl Column<'_> {
    fn name(&self) -> String {
        match self {
            Self::Text(name, _) | Self::Number(name, _) => name.clone(),
            Self::Causes(_) => "causes".to_owned(),
            Self::Tag(tag) => format!("tag_{}", tag.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect::<String>()),
        }
    }
}

fn columns<'s>(rows: &[Row], standing: &'s Standing) -> Vec<Column<'s>> {
    let text = |name: &str, cell| Column::Text(name.to_owned(), cell);
    let number = |name: &str, cell| Column::Number(name.to_owned(), cell);
    let mut columns = vec![
        text("id", |r| Some(r.id.clone())),
        text("task", |r| Some(r.task.clone())),
        text("status", |r| Some(if r.status == Status::Done { "done" } else { "unusable" }.to_owned())),
        text("error", |r| r.error.clone()),
        text("recording", |r| Some(r.recording.clone())),
        text("recording_sha256", |r| r.recording_sha256.clone()),
        text("model", |r| Some(r.model.clone())),
        text("model_sha256", |r| r.model_sha256.clone()),
        text("version", |r| Some(r.version.clone())),
        text("verdict", |r| r.verdict.clone()),
        text("effects", |r| Some(r.effects.iter().map(|e| e.id.as_str()).collect::<Vec<_>>().join("+"))),
        Column::Causes(standing),
        text("form", |r| Some(r.form.join("+"))),
        number("base_bar", |r| r.rmse_bar.get("base").copied()),
        number("base_heldout_bar", |r| r.rmse_bar.get("base_heldout").copied()),
        number("augmented_heldout_bar", |r| r.rmse_bar.get("augmented_heldout").copied()),
        number("noise_floor_bar", |r| r.rmse_bar.get("noise_floor").copied()),
        text("remainder", |r| r.remainder.clone()),
        text("parameters", |r| serde_json::to_string(&r.effects).ok()),
        text("document", |r| r.document.clone()),
        number("attempt", |r| Some(f64::from(r.attempt))),
        text("errors_bar", |r| serde_json::to_string(&r.rmse_bar).ok()),
        text("recalibration", |r| serde_json::to_string(&r.recalibration).ok()),
    ];
    columns.extend(tags(rows).into_iter().map(|t| Column::Tag(t.clone())));
    columns
}

/// The free columns of all rows.
fn tags(rows: &[Row]) -> BTreeSet<&String> {
    rows.iter().flat_map(|r| r.tags.keys()).collect()
}

/// The key under which the findings of the last collection stand.
const FINDINGS: &str = "hil.findings";
/// The key under which stands what the next collection need not read again.
const STATE: &str = "hil.collected";

/// How far the segments have been read, and the free columns as the list calls them.
#[derive(Serialize, Deserialize)]
struct State {
    segments: Segments,
    tags: Vec<String>,
}

/// Writes the table; the findings' names go with it, so that the next collection knows what is new, and how far the segments
/// were read.
///
/// # Errors
/// [`FleetError::Table`] where it cannot be written.
pub fn write(path: &Path, collected: &Collected, standing: &Standing, findings: &[String]) -> Result<(), FleetError> {
    let wrong = |e: String| FleetError::Table { path: path.to_path_buf(), what: e };
    let rows = &collected.rows[..];
    let columns = columns(rows, standing);
    let fields: Vec<String> = columns
        .iter()
        .map(|c| match c {
            Column::Number(name, _) => format!("optional double {name};"),
            other => format!("optional binary {} (UTF8);", other.name()),
        })
        .collect();
    let schema = Arc::new(parse_message_type(&format!("message fleet {{ {} }}", fields.join(" "))).map_err(|e| wrong(e.to_string()))?);
    let state = State { segments: collected.segments.clone(), tags: tags(rows).into_iter().cloned().collect() };
    let kept = [(FINDINGS, serde_json::to_string(findings)), (STATE, serde_json::to_string(&state))]
        .map(|(key, text)| KeyValue { key: key.to_owned(), value: text.ok() });
    let properties = WriterProperties::builder()
        .set_compression(parquet::basic::Compression::ZSTD(parquet::basic::ZstdLevel::default()))
        .set_created_by("hil".to_owned())
        .set_key_value_metadata(Some(kept.into()))
        .build();
    replace_file(path, |file| -> Result<(), ParquetError> {
        let mut writer = SerializedFileWriter::new(file, Arc::clone(&schema), Arc::new(properties))?;
        let mut group = writer.next_row_group()?;
        for column in &columns {
            let Some(mut target) = group.next_column()? else { break };
            match column {
                Column::Number(_, cell) => {
                    let cells: Vec<Option<f64>> = rows.iter().map(cell).collect();
                    let levels: Vec<i16> = cells.iter().map(|c| i16::from(c.is_some())).collect();
                    let values: Vec<f64> = cells.into_iter().flatten().collect();
                    target.typed::<DoubleType>().write_batch(&values, Some(&levels), None)?;
                }
                text => {
                    let cell = |row: &Row| match text {
                        Column::Text(_, cell) => cell(row),
                        Column::Causes(standing) => Some(standing.causes(row).map(|e| e.id.as_str()).collect::<Vec<_>>().join("+")),
                        Column::Tag(tag) => row.tags.get(tag).cloned(),
                        Column::Number(..) => None,
                    };
                    let cells: Vec<Option<String>> = rows.iter().map(cell).collect();
                    let levels: Vec<i16> = cells.iter().map(|c| i16::from(c.is_some())).collect();
                    let values: Vec<ByteArray> = cells.into_iter().flatten().map(|t| ByteArray::from(t.into_bytes())).collect();
                    target.typed::<ByteArrayType>().write_batch(&values, Some(&levels), None)?;
                }
            }
            target.close()?;
        }
        group.close()?;
        writer.close()?;
        Ok(())
    })
    .map_err(|e| wrong(e.to_string()))
}

/// The findings that an earlier table of this place holds, and its rows if they can be gone on from; nothing where there is no
/// table.
///
/// # Errors
/// [`FleetError::Table`] where there is a file that is no such table.
pub fn earlier(path: &Path) -> Result<(Vec<String>, Option<Earlier>), FleetError> {
    let wrong = |e: String| FleetError::Table { path: path.to_path_buf(), what: e };
    if !path.exists() {
        return Ok((Vec::new(), None));
    }
    let file = std::fs::File::open(path).map_err(|e| wrong(e.to_string()))?;
    let reader = SerializedFileReader::new(file).map_err(|e| wrong(e.to_string()))?;
    let metadata = reader.metadata().file_metadata().key_value_metadata();
    let kept = |key: &str| metadata.into_iter().flatten().find(|k| k.key == key).and_then(|k| k.value.clone());
    let text = kept(FINDINGS).ok_or_else(|| wrong("is no table of a fleet; give another name".to_owned()))?;
    let findings = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    // A table of another version of the program lacks something: then all rows are read again.
    let state = kept(STATE).and_then(|text| serde_json::from_str::<State>(&text).ok());
    Ok((findings, state.and_then(|state| Some(Earlier { rows: rows(&reader, &state.tags)?, segments: state.segments }))))
}

/// The rows of a table, if each is there with all that it was made from.
fn rows(reader: &SerializedFileReader<std::fs::File>, tags: &[String]) -> Option<Vec<Row>> {
    reader.get_row_iter(None).ok()?.map(|cells| row(&cells.ok()?.into_columns(), tags)).collect()
}

fn row(cells: &[(String, Field)], tags: &[String]) -> Option<Row> {
    let at = |name: &str| cells.iter().find(|(n, _)| n == name).map(|(_, field)| field);
    let text = |field: &Field| if let Field::Str(text) = field { Some(text.clone()) } else { None };
    let maybe = |name: &str| at(name).map(text);
    let must = |name: &str| maybe(name)?;
    let status = match must("status")?.as_str() {
        "done" => Status::Done,
        "unusable" => Status::Unusable,
        _ => return None,
    };
    let Field::Double(attempt) = at("attempt")? else { return None };
    let parameters = must("parameters")?;
    let effects: Vec<RowEffect> = serde_json::from_str(&parameters).ok()?;
    // Free columns stand last, in the order of the list of their names: two of them may have the same name in the table.
    let free = cells.get(cells.len().checked_sub(tags.len())?..)?;
    let row = Row {
        id: must("id")?,
        task: must("task")?,
        attempt: *attempt as u32,
        status,
        error: maybe("error")?,
        recording: must("recording")?,
        recording_sha256: maybe("recording_sha256")?,
        model: must("model")?,
        model_sha256: maybe("model_sha256")?,
        version: must("version")?,
        verdict: maybe("verdict")?,
        effects,
        form: must("form")?.split('+').filter(|id| !id.is_empty()).map(str::to_owned).collect(),
        recalibration: serde_json::from_str(&must("recalibration")?).ok()?,
        rmse_bar: serde_json::from_str(&must("errors_bar")?).ok()?,
        remainder: maybe("remainder")?,
        document: maybe("document")?,
        tags: tags.iter().zip(free).filter_map(|(tag, (_, field))| Some((tag.clone(), text(field)?))).collect(),
    };
    // Numbers come back as they were written, or the row is read where it came from.
    (serde_json::to_string(&row.effects).ok()? == parameters).then_some(row)
}

/// A row as tests want it.
#[cfg(test)]
pub(super) fn example(id: &str) -> Row {
    Row {
        id: id.to_owned(),
        task: "diagnose".to_owned(),
        attempt: 1,
        status: Status::Done,
        error: None,
        recording: format!("{id}.csv"),
        recording_sha256: Some("aa".to_owned()),
        model: "m.toml".to_owned(),
        model_sha256: Some("bb".to_owned()),
        version: "1".to_owned(),
        verdict: Some("match".to_owned()),
        effects: Vec::new(),
        form: Vec::new(),
        recalibration: std::collections::BTreeMap::new(),
        rmse_bar: std::collections::BTreeMap::from([("base".to_owned(), 0.25)]),
        remainder: None,
        document: None,
        tags: std::collections::BTreeMap::from([("lot".to_owned(), "L1".to_owned())]),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::collected::collect;
    use super::super::store::Store;
    use super::*;

    #[test]
    fn the_table_reads_back_and_remembers_its_findings() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("fleet.parquet");
        assert!(earlier(&path)?.0.is_empty());
        let rows = vec![example("a"), Row { verdict: None, ..example("b") }];
        write(
            &path,
            &Collected { rows: rows.clone(), segments: Segments::new(), read: 2 },
            &Standing::default(),
            &["lot L1: creep".to_owned()],
        )?;
        assert_eq!(earlier(&path)?, (vec!["lot L1: creep".to_owned()], Some(Earlier { rows, segments: Segments::new() })));
        let reader = SerializedFileReader::new(std::fs::File::open(&path)?)?;
        let rows: Vec<String> = reader.get_row_iter(None)?.map(|r| r.map(|r| r.to_string())).collect::<Result<_, _>>()?;
        assert!(rows.len() == 2 && rows[0].contains("verdict: \"match\"") && rows[0].contains("tag_lot: \"L1\""), "{rows:?}");
        assert!(rows[1].contains("verdict: null") && rows[1].contains("base_bar: 0.25"), "{rows:?}");
        let other = folder.path().join("other.parquet");
        std::fs::write(&other, "x")?;
        assert!(earlier(&other).is_err());
        Ok(())
    }

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    fn put(folder: &Path, segment: &str, rows: &[Row]) -> Outcome {
        let store = Store::open(folder, segment)?;
        rows.iter().try_for_each(|row| store.keep(row.clone(), &[("json", "{}")]))?;
        Ok(())
    }

    /// Collected over the table that is there, which is written anew.
    fn collected(folder: &Path, table: &Path) -> Result<Collected, FleetError> {
        let done = collect([folder], earlier(table)?.1)?;
        write(table, &done, &Standing::of(&done.rows), &[])?;
        Ok(done)
    }

    #[test]
    fn only_new_rows_are_read_and_the_table_is_that_of_a_full_collection() -> Outcome {
        let place = tempfile::tempdir()?;
        let (folder, table) = (place.path().join("answers"), place.path().join("fleet.parquet"));
        let mut full = example("a");
        full.effects = vec![RowEffect {
            id: "creep".into(),
            claim: Some("changed".into()),
            parameters: BTreeMap::from([("share".into(), (0.0512345, Some(0.0012), "1".into())), ("tau".into(), (3.5, None, "s".into()))]),
            indistinguishable: vec!["leakage".into()],
        }];
        full.form = vec!["reference_shape".into(), "reference_shift".into()];
        full.rmse_bar.insert("another".into(), 0.125);
        full.tags.insert("date of test".into(), "2026-01-05".into());
        full.tags.insert("date-of-test".into(), "another column of the same name in the table".into());
        let unusable = Row { status: Status::Unusable, error: Some("row 3".into()), verdict: None, tags: BTreeMap::new(), ..example("b") };
        put(&folder, "1", &[full, unusable.clone()])?;
        assert_eq!(collected(&folder, &table)?.read, 2);
        assert_eq!(collected(&folder, &table)?.read, 0);
        // A later answer, a twin, and a new one, in segments that come ahead of and after the one that was read.
        put(&folder, "0", &[Row { attempt: 2, ..example("b") }, Row { verdict: Some("x".into()), ..example("a") }])?;
        put(&folder, "2", &[example("c")])?;
        let some = collected(&folder, &table)?;
        assert_eq!(some.read, 3);
        let bytes = std::fs::read(&table)?;
        std::fs::remove_file(&table)?;
        let all = collected(&folder, &table)?;
        assert_eq!((all.read, &all.rows, &all.segments), (5, &some.rows, &some.segments));
        assert!(std::fs::read(&table)? == bytes, "the tables differ");
        Ok(())
    }

    #[test]
    fn a_torn_row_is_read_once_it_is_whole_and_a_changed_segment_anew() -> Outcome {
        let place = tempfile::tempdir()?;
        let (folder, table) = (place.path().join("answers"), place.path().join("fleet.parquet"));
        put(&folder, "1", &[example("a"), example("b")])?;
        let path = folder.join("rows/1.jsonl");
        let whole = std::fs::read(&path)?;
        std::fs::write(&path, &whole[..whole.len() - 9])?;
        assert_eq!(collected(&folder, &table)?.rows.len(), 1);
        std::fs::write(&path, &whole)?;
        let now = collected(&folder, &table)?;
        assert_eq!((now.rows.len(), now.read), (2, 1));
        // Somebody has written another segment in its place, or taken it away.
        std::fs::write(&path, String::from_utf8(whole)?.replace("match", "other"))?;
        let now = collected(&folder, &table)?;
        assert_eq!((now.read, now.rows[0].verdict.as_deref()), (2, Some("other")));
        std::fs::remove_file(&path)?;
        assert_eq!(collected(&folder, &table)?.rows.len(), 0);
        Ok(())
    }
}
