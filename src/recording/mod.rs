//! Channels over time, from a file or from a rig.
//!
//! A [`Recording`] holds one or more [`Run`]s; each run starts from its own initial state. Values are in the
//! canonical units of [`crate::units`]; a value that was not recorded is NaN, never zero.

mod cell;
mod clean;
mod columns;
mod csv;
mod error;
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
mod reading;
mod scan;
mod source;
mod stamps;
mod table;
mod write;

use std::path::Path;

/// Most values of all channels of a recording together: a day of five channels at 100 Hz, 350 MB while they are read.
pub const MOST_VALUES: u64 = 45_000_000;

pub use columns::ColumnValues;
pub use error::RecordingError;
pub use inspect::{ChannelSurvey, Content, Proposal, Survey, inspect};
pub use mapping::{Mapping, Role};
pub use parquet::{Group, groups, read_parquet, write_parquet};
pub use reading::{Encoding, MAPPING_SCHEMA, MappingFile, ReadFile, Reading, SelectFile, Selection};
pub use table::{Cells, Column, Values};
pub use write::replace_file;

use crate::units::{self, Unit};
use crate::valve::Input;

/// The channels that `hil` knows, by the names of the recording format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// `current_a`: the commanded current [A].
    Current,
    /// `pressure_bar`: the measured pressure [bar].
    Pressure,
    /// `target_bar`: the pressure that the controller was asked for [bar].
    Target,
    /// `current_meas_a`: the measured current [A].
    MeasuredCurrent,
    /// `oil_temp_c`: oil temperature [degC].
    OilTemperature,
    /// `supply_bar`: supply pressure [bar].
    Supply,
}

impl Channel {
    /// Number of channels.
    pub const COUNT: usize = 6;
    /// Every channel, in the order of the columns of a recording that is written.
    pub const ALL: [Self; Self::COUNT] =
        [Self::Current, Self::Pressure, Self::Target, Self::MeasuredCurrent, Self::OilTemperature, Self::Supply];

    /// Name of the column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Current => "current_a",
            Self::Pressure => "pressure_bar",
            Self::Target => "target_bar",
            Self::MeasuredCurrent => "current_meas_a",
            Self::OilTemperature => "oil_temp_c",
            Self::Supply => "supply_bar",
        }
    }
    /// Unit that its values are kept in.
    pub fn unit(self) -> &'static Unit {
        match self {
            Self::Current | Self::MeasuredCurrent => &units::CURRENT,
            Self::Pressure | Self::Target | Self::Supply => &units::PRESSURE,
            Self::OilTemperature => &units::TEMPERATURE,
        }
    }
    /// Place in [`Channel::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }
}

/// One run: samples from its own start.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Run {
    /// Name from the `run` column; `None` where the file holds one nameless run.
    pub name: Option<String>,
    /// Time of each sample [s], strictly increasing.
    pub time_s: Vec<f64>,
    /// Commanded current [A], NaN where not recorded.
    pub current_a: Vec<f64>,
    /// Measured pressure [bar], NaN where not recorded; `None` where the file has no such channel.
    pub pressure_bar: Option<Vec<f64>>,
    /// Target pressure [bar].
    pub target_bar: Option<Vec<f64>>,
    /// Measured current [A].
    pub current_meas_a: Option<Vec<f64>>,
    /// Oil temperature [degC].
    pub oil_temp_c: Option<Vec<f64>>,
    /// Supply pressure [bar].
    pub supply_bar: Option<Vec<f64>>,
}

/// A recording: its runs, and what was noticed while it was read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// File name, for messages.
    pub source: String,
    /// The runs in the order of the file; never empty.
    pub runs: Vec<Run>,
    /// What was handled while reading, for instance "3 rows with a repeated time were dropped (first: row 17)".
    pub notes: Vec<String>,
    /// What the command does between its samples, where that was stated.
    pub input: Option<Input>,
}

/// A file format of recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Text with a header: `.csv`, `.tsv`, `.txt`.
    Csv,
    /// Apache Parquet: `.parquet`, `.pq`.
    Parquet,
    /// ASAM MDF 4: `.mf4`, `.mdf`.
    Mdf4,
}

impl Format {
    /// The format that a file's extension names.
    ///
    /// # Errors
    /// [`RecordingError::UnknownFormat`] with what is allowed.
    pub fn of(path: &Path) -> Result<Self, RecordingError> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match extension.as_str() {
            "csv" | "tsv" | "txt" => Ok(Self::Csv),
            "parquet" | "pq" => Ok(Self::Parquet),
            "mf4" | "mdf" => Ok(Self::Mdf4),
            _ => Err(RecordingError::UnknownFormat { path: path.into(), extension }),
        }
    }
}

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
        Ok(Self { input: reading.input, ..selected })
    }

    /// Reads a recording from text in memory, see [`Recording::read`]; `source` names it in messages.
    pub fn from_csv(text: impl AsRef<[u8]>, source: &str, map: &[Mapping]) -> Result<Self, RecordingError> {
        let bytes = text.as_ref();
        let reading = Reading { map: map.to_vec(), ..Reading::default() };
        clean::recording(csv::read_from(bytes, bytes.len() as u64, Path::new(source), source, &reading)?)
    }

    /// Whether any run holds the channel.
    pub fn has(&self, channel: Channel) -> bool {
        self.runs.iter().any(|run| run.channel(channel).is_some())
    }
}

impl Run {
    /// The values of a channel, `None` where the file has no such channel.
    pub fn channel(&self, channel: Channel) -> Option<&[f64]> {
        match channel {
            Channel::Current => Some(&self.current_a),
            Channel::Pressure => self.pressure_bar.as_deref(),
            Channel::Target => self.target_bar.as_deref(),
            Channel::MeasuredCurrent => self.current_meas_a.as_deref(),
            Channel::OilTemperature => self.oil_temp_c.as_deref(),
            Channel::Supply => self.supply_bar.as_deref(),
        }
    }
    /// Sets the values of a channel; a current that is taken away leaves an empty channel.
    pub fn set(&mut self, channel: Channel, values: Option<Vec<f64>>) {
        match channel {
            Channel::Current => self.current_a = values.unwrap_or_default(),
            Channel::Pressure => self.pressure_bar = values,
            Channel::Target => self.target_bar = values,
            Channel::MeasuredCurrent => self.current_meas_a = values,
            Channel::OilTemperature => self.oil_temp_c = values,
            Channel::Supply => self.supply_bar = values,
        }
    }
    /// Whether a channel never changes over the values that it holds; false where it holds none.
    pub fn is_constant(&self, channel: Channel) -> bool {
        let Some(values) = self.channel(channel) else { return false };
        let mut finite = values.iter().filter(|v| v.is_finite());
        finite.next().is_some_and(|first| finite.all(|v| v == first))
    }
    /// Every vector of the run, time first.
    fn columns_mut(&mut self) -> impl Iterator<Item = &mut Vec<f64>> {
        let optional = [&mut self.pressure_bar, &mut self.target_bar, &mut self.current_meas_a, &mut self.oil_temp_c, &mut self.supply_bar];
        [&mut self.time_s, &mut self.current_a].into_iter().chain(optional.into_iter().flatten())
    }
    /// Keeps the samples that `keep` marks.
    fn retain(&mut self, keep: &[bool]) {
        for values in self.columns_mut() {
            let mut marks = keep.iter();
            values.retain(|_| marks.next().copied().unwrap_or(true));
        }
    }
    /// Cuts the run at a sample and returns what stands behind it.
    fn split_off(&mut self, sample: usize) -> Self {
        let mut behind = Self { name: self.name.clone(), time_s: self.time_s.split_off(sample), ..Self::default() };
        for channel in Channel::ALL {
            let cut = match channel {
                Channel::Current => Some(self.current_a.split_off(sample)),
                Channel::Pressure => self.pressure_bar.as_mut().map(|v| v.split_off(sample)),
                Channel::Target => self.target_bar.as_mut().map(|v| v.split_off(sample)),
                Channel::MeasuredCurrent => self.current_meas_a.as_mut().map(|v| v.split_off(sample)),
                Channel::OilTemperature => self.oil_temp_c.as_mut().map(|v| v.split_off(sample)),
                Channel::Supply => self.supply_bar.as_mut().map(|v| v.split_off(sample)),
            };
            behind.set(channel, cut);
        }
        behind
    }
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }
    /// Whether the run has no sample.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }
    /// Median time step [s]; 0 for a run of fewer than two samples.
    pub fn step_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.time_s.windows(2).map(|w| w[1] - w[0]).collect();
        if steps.is_empty() {
            return 0.0;
        }
        let middle = steps.len() / 2;
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    }
}
