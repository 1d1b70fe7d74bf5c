//! Named columns as a Parquet file, for recordings and for the trace of a run.
//!
//! A number that is NaN is written as null, so that other tools see a gap as a gap.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;

use super::INPUT_KEY;
use crate::recording::{Column, RecordingError, Values, whole::replace_file};
use crate::valve::Input;

/// Rows of one row group: bounds the memory of whoever reads the file.
const GROUP_ROWS: usize = 1 << 20;

impl From<(ParquetError, std::path::PathBuf)> for RecordingError {
    fn from((error, path): (ParquetError, std::path::PathBuf)) -> Self {
        Self::format(&path.display().to_string(), error)
    }
}

/// Writes tables with equal columns, one below the other, as one Parquet file that is whole or not there.
///
/// # Errors
/// What the file system says; tables whose columns differ or are not equally long.
pub fn write_parquet(path: &Path, tables: &[Vec<Column<'_>>]) -> Result<(), RecordingError> {
    write_parquet_stating(path, tables, None)
}

/// As [`write_parquet`], a file that states what the command does between its samples.
///
/// # Errors
/// As [`write_parquet`].
pub fn write_parquet_stating(path: &Path, tables: &[Vec<Column<'_>>], input: Option<Input>) -> Result<(), RecordingError> {
    let stated = input.map(|input| vec![KeyValue::new(INPUT_KEY.into(), input.name().to_string())]);
    replace_file(path, |file| {
        let Some(first) = tables.first() else { return Err(ParquetError::General("there is no table to write".into())) };
        let schema = Arc::new(schema(first)?);
        let compression = Compression::ZSTD(ZstdLevel::try_new(3)?);
        let properties = WriterProperties::builder().set_compression(compression).set_created_by("hil".into());
        let properties = properties.set_key_value_metadata(stated).build();
        let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
        for table in tables {
            let rows = table.first().map_or(0, |c| c.values.len());
            let alike = table.len() == first.len() && table.iter().zip(first).all(|(a, b)| a.name == b.name && a.values.len() == rows);
            if !alike {
                return Err(ParquetError::General("the columns of the tables differ".into()));
            }
            for from in (0..rows).step_by(GROUP_ROWS) {
                let to = rows.min(from + GROUP_ROWS);
                let mut group = writer.next_row_group()?;
                for column in table {
                    let Some(mut out) = group.next_column()? else { break };
                    write_column(&mut out, column.values, from, to)?;
                    out.close()?;
                }
                group.close()?;
            }
        }
        writer.close()?;
        Ok(())
    })
}

fn schema(columns: &[Column<'_>]) -> Result<Type, ParquetError> {
    let field = |column: &Column<'_>| {
        let kind = match column.values {
            Values::Numbers(_) | Values::Absent(_) => {
                Type::primitive_type_builder(column.name, PhysicalType::DOUBLE).with_repetition(Repetition::OPTIONAL)
            }
            Values::Integers(_) => Type::primitive_type_builder(column.name, PhysicalType::INT64).with_repetition(Repetition::REQUIRED),
            Values::Texts(_) | Values::Same(..) => Type::primitive_type_builder(column.name, PhysicalType::BYTE_ARRAY)
                .with_repetition(Repetition::REQUIRED)
                .with_logical_type(Some(LogicalType::String)),
        };
        kind.build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    Type::group_type_builder("recording").with_fields(fields).build()
}

fn write_column(out: &mut SerializedColumnWriter<'_>, values: Values<'_>, from: usize, to: usize) -> Result<(), ParquetError> {
    match values {
        Values::Numbers(all) => {
            let some: Vec<f64> = all[from..to].iter().copied().filter(|v| !v.is_nan()).collect();
            let levels: Vec<i16> = all[from..to].iter().map(|v| i16::from(!v.is_nan())).collect();
            out.typed::<DoubleType>().write_batch(&some, Some(&levels), None)?;
        }
        Values::Absent(_) => drop(out.typed::<DoubleType>().write_batch(&[], Some(&vec![0; to - from]), None)?),
        Values::Integers(all) => drop(out.typed::<Int64Type>().write_batch(&all[from..to], None, None)?),
        Values::Texts(all) => {
            let texts: Vec<ByteArray> = all[from..to].iter().map(|t| ByteArray::from(*t)).collect();
            out.typed::<ByteArrayType>().write_batch(&texts, None, None)?;
        }
        Values::Same(text, _) => {
            let text = ByteArray::from(text);
            out.typed::<ByteArrayType>().write_batch(&vec![text; to - from], None, None)?;
        }
    }
    Ok(())
}
