//! Channels over time, from a file or from a rig.
//!
//! A [`Recording`] holds one or more [`Run`]s; each run starts from its own initial state. Values are in the
//! canonical units of [`crate::units`]; a value that was not recorded is NaN, never zero.

mod cell;
mod channel;
mod clean;
mod columns;
mod csv;
mod error;
mod format;
#[cfg(test)]
mod fuzz;
mod header;
mod inspect;
mod likely;
mod mapping;
mod mdf4;
#[cfg_attr(not(feature = "parquet"), path = "without_parquet.rs")]
mod parquet;
mod part;
mod raw;
mod reading;
mod run;
mod scan;
mod source;
mod stamps;
mod table;
mod whole;
mod write;

use std::path::Path;

pub use channel::Channel;
pub use columns::ColumnValues;
pub use error::RecordingError;
pub use format::Format;
pub use inspect::{ChannelSurvey, Proposal, Survey, inspect};
pub use mapping::{Mapping, Role};
pub use parquet::{Group, groups, read_parquet, write_parquet, write_parquet_stating};
pub use raw::Content;
pub use reading::{Encoding, MAPPING_SCHEMA, MappingFile, ReadFile, Reading, SelectFile, Selection};
pub use run::{MOST_VALUES, Recording, Run};
pub use table::{Cells, Column, Values};
pub use whole::replace_file;

impl Recording {
    /// Reads a recording; the format follows from the extension.
    ///
    /// Columns bear the names of [`Channel::name`] beside `time_s` and `run`, or are taken by `map`. What is
    /// handled (gaps, rounded or repeated times, a cut last line) is said in [`Recording::notes`].
    ///
    /// # Errors
    /// What cannot be read is refused with its line or row and its column, see [`RecordingError`].
    pub fn read(path: &Path, map: &[Mapping]) -> Result<Self, RecordingError> {
        Self::read_as(path, &Reading { map: map.to_vec(), ..Reading::default() })
    }

    /// Reads a foreign recording: mapped, with its header and its encoding, and only what is selected.
    ///
    /// # Errors
    /// As [`Recording::read`]; a selection that leaves nothing.
    pub fn read_as(path: &Path, reading: &Reading) -> Result<Self, RecordingError> {
        let file = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
        if path.is_dir() {
            return Err(RecordingError::format(&file, "is a directory; a recording is wanted"));
        }
        let rows = match Format::of(path)? {
            Format::Csv => csv::read(path, &file, reading)?,
            Format::Parquet => parquet::read(path, &file, &reading.map)?,
            Format::Mdf4 => mdf4::read(path, &file, &reading.map)?,
        };
        let selected = clean::recording(rows)?.selected(&reading.select)?;
        Ok(Self { input: reading.input.or(selected.input), ..selected })
    }

    /// Reads a recording from text in memory, see [`Recording::read`]; `source` names it in messages.
    pub fn from_csv(text: impl AsRef<[u8]>, source: &str, map: &[Mapping]) -> Result<Self, RecordingError> {
        let bytes = text.as_ref();
        let reading = Reading { map: map.to_vec(), ..Reading::default() };
        clean::recording(csv::read_from(bytes, bytes.len() as u64, Path::new(source), source, &reading)?)
    }
}
