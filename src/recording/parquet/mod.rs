//! Recordings as Parquet: flat columns of numbers, null as gap, and the time also as a time stamp.

use std::path::Path;

use parquet::basic::{ConvertedType, LogicalType, TimeUnit};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::metadata::FileMetaData;
use parquet::schema::types::ColumnDescriptor;

use super::mapping::Role;
use super::raw::{Content, RawColumn, Table};
use super::source::{Rows, Source, resolve};
use super::{Cells, Mapping, RecordingError};
use crate::valve::Input;

mod compact;
mod footer;
mod groups;
mod pages;
mod write;

use footer::{bounded, open};
pub use groups::{Group, groups};
use pages::Chunk;
pub use write::{write_parquet, write_parquet_stating};

/// Key under which a file of the program states what its command does between the samples.
const INPUT_KEY: &str = "hil.input";

/// Values taken from a column at a time.
const BATCH: usize = 1 << 16;

/// Reads a file. The library panics on some damaged files; such a panic becomes a message.
pub(super) fn read(path: &Path, file: &str, map: &[Mapping]) -> Result<Rows, RecordingError> {
    guarded(file, || read_trusting(path, file, map))
}

/// Every column of a Parquet file with its name, but for lists.
///
/// # Errors
/// What cannot be read, see [`RecordingError`].
pub fn read_parquet(path: &Path) -> Result<Vec<(String, Cells)>, RecordingError> {
    let file = path.display().to_string();
    guarded(&file, || columns(path, &file))
}

/// Does `work` on a file; a panic of the library on a damaged one becomes a message.
fn guarded<T>(file: &str, work: impl FnOnce() -> Result<T, RecordingError>) -> Result<T, RecordingError> {
    let result = silenced(|| std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)));
    result.unwrap_or_else(|_| Err(RecordingError::format(file, "the file is damaged: its pages contradict one another")))
}

fn columns(path: &Path, file: &str) -> Result<Vec<(String, Cells)>, RecordingError> {
    let damaged = |e: ParquetError| RecordingError::format(file, e);
    let opened = open(path, file)?;
    let schema = opened.metadata().file_metadata().schema_descr();
    bounded(&opened, file, schema.num_columns())?;
    let mut columns = Vec::new();
    for (at, column) in schema.columns().iter().enumerate() {
        let Ok(kind) = Kind::of(column) else { continue };
        let (mut values, mut words, mut first) = (Vec::new(), Vec::new(), None);
        for group in 0..opened.metadata().num_row_groups() {
            let take = |value: f64| {
                let value = if kind.is_stamp() { value - *first.get_or_insert(value) } else { value };
                values.push(value * kind.scale());
            };
            let chunk = || opened.chunk(group, at).map_err(damaged);
            if numbers(chunk()?, &kind, take).map_err(damaged)?.is_none() {
                texts(chunk()?, |text| words.push(text.to_string())).map_err(damaged)?;
            }
        }
        let cells = match (words.is_empty(), kind.is_stamp()) {
            (false, _) => Cells::Texts(words),
            (true, true) => Cells::Stamps(values),
            (true, false) => Cells::Numbers(values),
        };
        columns.push((column.path().string(), cells));
    }
    Ok(columns)
}

/// The columns for somebody who does not know yet what is in the file.
pub(super) fn table(path: &Path) -> Result<Table, RecordingError> {
    let content = |cells: Cells| match cells {
        Cells::Numbers(values) if values.iter().any(|v| v.is_finite()) => Content::Numbers(values),
        Cells::Stamps(values) => Content::Stamps(values, "the first row".into()),
        Cells::Texts(texts) => {
            let mut distinct: Vec<String> = Vec::new();
            for text in texts {
                if distinct.len() < 1000 && !text.is_empty() && !distinct.contains(&text) {
                    distinct.push(text);
                }
            }
            if distinct.is_empty() { Content::Empty } else { Content::Texts(distinct) }
        }
        Cells::Numbers(_) => Content::Empty,
    };
    let column = |(header, cells)| RawColumn { group: String::new(), header, unit: None, content: content(cells) };
    Ok(Table { columns: read_parquet(path)?.into_iter().map(column).collect(), ..Table::default() })
}

thread_local! {
    /// Whether a panic of this thread is about to become a message.
    static SILENCED: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Runs `work` without the report that a panic prints.
fn silenced<T>(work: impl FnOnce() -> T) -> T {
    static HOOK: std::sync::Once = std::sync::Once::new();
    HOOK.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !SILENCED.get() {
                usual(info);
            }
        }));
    });
    SILENCED.set(true);
    let result = work();
    SILENCED.set(false);
    result
}

fn read_trusting(path: &Path, file: &str, map: &[Mapping]) -> Result<Rows, RecordingError> {
    let damaged = |e: ParquetError| RecordingError::format(file, e);
    let opened = open(path, file)?;
    let metadata = opened.metadata();
    let schema = metadata.file_metadata().schema_descr();
    let names: Vec<String> = schema.columns().iter().map(|c| c.path().string()).collect();
    let sources = resolve(file, &names, map, false)?;
    bounded(&opened, file, sources.len())?;
    let mut rows = Rows::new(file, &sources, false);
    rows.input = stated_input(metadata.file_metadata());

    for source in &sources {
        let column = schema.column(source.column);
        let kind = Kind::of(&column).map_err(|what| cell_error(file, source, &names, 0, &what))?;
        let mut first_stamp = None;
        let mut row = 0;
        for group in 0..metadata.num_row_groups() {
            let chunk = opened.chunk(group, source.column).map_err(damaged)?;
            let expected = chunk.rows;
            let read = match (source.role, chunk) {
                (Role::Run, chunk) => texts(chunk, |text| {
                    let new = rows.segments.last().is_none_or(|s| s.0.as_deref() != Some(text).filter(|t| !t.is_empty()));
                    if new {
                        rows.segments.push(((!text.is_empty()).then(|| text.to_string()), row));
                    }
                    row += 1;
                }),
                (role, chunk) => {
                    let Some(values) = rows.values(role) else { continue };
                    numbers(chunk, &kind, |value| {
                        // Time stamps count from the first: seconds since 1970 leave too few digits for a step.
                        let value = if kind.is_stamp() { value - *first_stamp.get_or_insert(value) } else { value };
                        let value = value * kind.scale();
                        values.push(if value.is_finite() { value * source.scale + source.offset } else { f64::NAN });
                        row += 1;
                    })
                }
            };
            let count = read.map_err(damaged)?.ok_or_else(|| cell_error(file, source, &names, 0, "numbers are wanted"))?;
            if count != expected {
                return Err(RecordingError::format(
                    file,
                    format!("column `{}` has {count} values where {expected} are said", names[source.column]),
                ));
            }
        }
    }
    let lengths = rows.channels.iter().flatten().map(Vec::len).chain([rows.time_s.len()]);
    if lengths.clone().min() != lengths.max() {
        return Err(RecordingError::format(file, "its columns are not equally long"));
    }
    Ok(rows)
}

/// What the command does between its samples, where the file states that.
fn stated_input(metadata: &FileMetaData) -> Option<Input> {
    let value = metadata.key_value_metadata()?.iter().find(|stated| stated.key == INPUT_KEY)?.value.as_deref()?;
    [Input::Held, Input::Ramp].into_iter().find(|input| input.name() == value)
}

fn cell_error(file: &str, source: &Source, names: &[String], row: usize, what: &str) -> RecordingError {
    RecordingError::Cell {
        file: file.into(),
        place: format!("row {}", row + 1),
        number: source.column + 1,
        column: names[source.column].clone(),
        what: what.into(),
    }
}

/// What the integers of a column stand for.
enum Kind {
    Plain,
    Unsigned,
    /// A time stamp in this part of a second.
    Stamp(f64),
    /// A decimal number with this factor.
    Decimal(f64),
}

impl Kind {
    fn of(column: &ColumnDescriptor) -> Result<Self, String> {
        if column.max_rep_level() > 0 {
            return Err("a list in every row is no channel".into());
        }
        Ok(match (column.logical_type_ref(), column.converted_type()) {
            (Some(LogicalType::Timestamp(stamp)), _) => Self::Stamp(match stamp.unit {
                TimeUnit::MILLIS => 1e-3,
                TimeUnit::MICROS => 1e-6,
                TimeUnit::NANOS => 1e-9,
            }),
            (Some(LogicalType::Integer(integer)), _) if !integer.is_signed => Self::Unsigned,
            (_, ConvertedType::TIMESTAMP_MILLIS) => Self::Stamp(1e-3),
            (_, ConvertedType::TIMESTAMP_MICROS) => Self::Stamp(1e-6),
            (_, ConvertedType::UINT_32 | ConvertedType::UINT_64) => Self::Unsigned,
            (_, ConvertedType::DECIMAL) => Self::Decimal(10f64.powi(-column.type_scale())),
            _ => Self::Plain,
        })
    }
    fn is_stamp(&self) -> bool {
        matches!(self, Self::Stamp(_))
    }
    fn scale(&self) -> f64 {
        match self {
            Self::Stamp(scale) | Self::Decimal(scale) => *scale,
            _ => 1.0,
        }
    }
}

/// Feeds every row's value, NaN for null, to `take`; `None` where the column holds no numbers.
fn numbers(chunk: Chunk, kind: &Kind, take: impl FnMut(f64)) -> Result<Option<usize>, ParquetError> {
    let unsigned = matches!(kind, Kind::Unsigned);
    let shape = (chunk.levels, chunk.rows);
    match chunk.reader {
        ColumnReader::DoubleColumnReader(r) => batches(r, shape, |v| *v, f64::NAN, take),
        ColumnReader::FloatColumnReader(r) => batches(r, shape, |v| f64::from(*v), f64::NAN, take),
        ColumnReader::Int32ColumnReader(r) => {
            batches(r, shape, |v| if unsigned { f64::from(*v as u32) } else { f64::from(*v) }, f64::NAN, take)
        }
        ColumnReader::Int64ColumnReader(r) => batches(r, shape, |v| if unsigned { *v as u64 as f64 } else { *v as f64 }, f64::NAN, take),
        _ => Ok(None),
    }
}

/// Feeds every row's text, empty for null, to `take`; numbers are names too.
fn texts(chunk: Chunk, mut take: impl FnMut(&str)) -> Result<Option<usize>, ParquetError> {
    let take = |text: String| take(&text);
    let shape = (chunk.levels, chunk.rows);
    match chunk.reader {
        ColumnReader::ByteArrayColumnReader(r) => {
            batches(r, shape, |v| String::from_utf8_lossy(v.data()).into_owned(), String::new(), take)
        }
        ColumnReader::Int32ColumnReader(r) => batches(r, shape, |v| v.to_string(), String::new(), take),
        ColumnReader::Int64ColumnReader(r) => batches(r, shape, |v| v.to_string(), String::new(), take),
        _ => Ok(None),
    }
}

fn batches<T: DataType, V: Clone>(
    mut reader: ColumnReaderImpl<T>,
    (levels, rows): (i16, usize),
    value: impl Fn(&T::T) -> V,
    null: V,
    mut take: impl FnMut(V),
) -> Result<Option<usize>, ParquetError> {
    let (mut definitions, mut values, mut count) = (Vec::new(), Vec::new(), 0);
    loop {
        definitions.clear();
        values.clear();
        let (records, _, read) = reader.read_records(BATCH, (levels > 0).then_some(&mut definitions), None, &mut values)?;
        if records == 0 && read == 0 {
            return Ok(Some(count));
        }
        count += read;
        if count > rows {
            return Err(ParquetError::General(format!("a column holds more values than the {rows} that are said")));
        }
        if levels == 0 {
            values.iter().for_each(|v| take(value(v)));
            continue;
        }
        let mut present = values.iter();
        for level in &definitions {
            take(if *level == levels { present.next().map_or(null.clone(), &value) } else { null.clone() });
        }
    }
}
