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
use parquet::schema::parser::parse_message_type;

use super::FleetError;
use super::row::{Row, Status};
use crate::recording::replace_file;

/// A column: name, and its cell of a row.
enum Column {
    Text(String, fn(&Row) -> Option<String>),
    Number(String, fn(&Row) -> Option<f64>),
    Tag(String),
}

impl Column {
    fn name(&self) -> String {
        match self {
            Self::Text(name, _) | Self::Number(name, _) => name.clone(),
            Self::Tag(tag) => format!("tag_{}", tag.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect::<String>()),
        }
    }
}

fn columns(rows: &[Row]) -> Vec<Column> {
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
        text("causes", |r| Some(r.causes().map(|e| e.id.as_str()).collect::<Vec<_>>().join("+"))),
        text("form", |r| Some(r.form.join("+"))),
        number("base_bar", |r| r.rmse_bar.get("base").copied()),
        number("base_heldout_bar", |r| r.rmse_bar.get("base_heldout").copied()),
        number("augmented_heldout_bar", |r| r.rmse_bar.get("augmented_heldout").copied()),
        number("noise_floor_bar", |r| r.rmse_bar.get("noise_floor").copied()),
        text("remainder", |r| r.remainder.clone()),
        text("parameters", |r| serde_json::to_string(&r.effects).ok()),
        text("document", |r| r.document.clone()),
    ];
    let tags: BTreeSet<&String> = rows.iter().flat_map(|r| r.tags.keys()).collect();
    columns.extend(tags.into_iter().map(|t| Column::Tag(t.clone())));
    columns
}

/// The key under which the findings of the last collection stand.
const FINDINGS: &str = "hil.findings";

/// Writes the table; the findings' names go with it, so that the next collection knows what is new.
///
/// # Errors
/// [`FleetError::Table`] where it cannot be written.
pub fn write(path: &Path, rows: &[Row], findings: &[String]) -> Result<(), FleetError> {
    let wrong = |e: String| FleetError::Table { path: path.to_path_buf(), what: e };
    let columns = columns(rows);
    let fields: Vec<String> = columns
        .iter()
        .map(|c| match c {
            Column::Number(name, _) => format!("optional double {name};"),
            other => format!("optional binary {} (UTF8);", other.name()),
        })
        .collect();
    let schema = Arc::new(parse_message_type(&format!("message fleet {{ {} }}", fields.join(" "))).map_err(|e| wrong(e.to_string()))?);
    let kept = KeyValue { key: FINDINGS.to_owned(), value: Some(serde_json::to_string(findings).unwrap_or_default()) };
    let properties = WriterProperties::builder()
        .set_compression(parquet::basic::Compression::ZSTD(parquet::basic::ZstdLevel::default()))
        .set_created_by("hil".to_owned())
        .set_key_value_metadata(Some(vec![kept]))
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

/// The findings that an earlier table of this place holds; none where there is no table.
///
/// # Errors
/// [`FleetError::Table`] where there is a file that is no such table.
pub fn earlier_findings(path: &Path) -> Result<Vec<String>, FleetError> {
    let wrong = |e: String| FleetError::Table { path: path.to_path_buf(), what: e };
    if !path.exists() {
        return Ok(Vec::new());
    }
    let file = std::fs::File::open(path).map_err(|e| wrong(e.to_string()))?;
    let reader = SerializedFileReader::new(file).map_err(|e| wrong(e.to_string()))?;
    let kept = reader.metadata().file_metadata().key_value_metadata();
    let text = kept.into_iter().flatten().find(|k| k.key == FINDINGS).and_then(|k| k.value.clone());
    let text = text.ok_or_else(|| wrong("is no table of a fleet; give another name".to_owned()))?;
    serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))
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
        rmse_bar: std::collections::BTreeMap::from([("base".to_owned(), 0.25)]),
        remainder: None,
        document: None,
        tags: std::collections::BTreeMap::from([("lot".to_owned(), "L1".to_owned())]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_reads_back_and_remembers_its_findings() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("fleet.parquet");
        assert!(earlier_findings(&path)?.is_empty());
        write(&path, &[example("a"), Row { verdict: None, ..example("b") }], &["lot L1: creep".to_owned()])?;
        assert_eq!(earlier_findings(&path)?, ["lot L1: creep"]);
        let reader = SerializedFileReader::new(std::fs::File::open(&path)?)?;
        let rows: Vec<String> = reader.get_row_iter(None)?.map(|r| r.map(|r| r.to_string())).collect::<Result<_, _>>()?;
        assert!(rows.len() == 2 && rows[0].contains("verdict: \"match\"") && rows[0].contains("tag_lot: \"L1\""), "{rows:?}");
        assert!(rows[1].contains("verdict: null") && rows[1].contains("base_bar: 0.25"), "{rows:?}");
        let other = folder.path().join("other.parquet");
        std::fs::write(&other, "x")?;
        assert!(earlier_findings(&other).is_err());
        Ok(())
    }
}
