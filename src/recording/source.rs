//! Between a file format and the runs: which column becomes what, and the columns as they stand in the file.

use super::{Channel, Mapping, RecordingError, mapping::Role};

/// Where each role comes from: column, factor, offset.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Source {
    pub role: Role,
    pub column: usize,
    pub scale: f64,
    pub offset: f64,
    /// Whether the file's own unit of the column counts: neither a unit nor a factor was given.
    pub bare: bool,
}

/// Finds the column of each role: the mapped ones first, then those that bear a channel's own name.
///
/// # Errors
/// A mapped column that is not there or is there twice, two mappings for one channel, no time, no current.
pub(super) fn resolve(file: &str, columns: &[String], map: &[Mapping], time_is_known: bool) -> Result<Vec<Source>, RecordingError> {
    let mut sources = Vec::new();
    for role in Role::all() {
        let mut wanted = map.iter().filter(|m| m.role == role);
        let mapping = wanted.next();
        if let Some(second) = wanted.next() {
            return Err(RecordingError::Mapping { text: second.text.clone(), what: format!("`{}` is mapped twice", role.name()) });
        }
        match mapping {
            Some(mapping) => {
                // A header such as `I_cmd [mA]` is matched as a whole before it is taken apart.
                let column = match find(file, columns, &mapping.text)? {
                    Some(column) => Some(column),
                    None => find(file, columns, &mapping.column)?,
                };
                let column = column.ok_or_else(|| missing(file, columns, &mapping.column, String::new()))?;
                let bare = !mapping.scaled && mapping.unit.is_none();
                sources.push(Source { role, column, scale: mapping.scale, offset: mapping.offset, bare });
            }
            None => match find(file, columns, role.name())? {
                Some(column) => sources.push(Source { role, column, scale: 1.0, offset: 0.0, bare: true }),
                None if role == Role::Time && !time_is_known || role == Role::Channel(Channel::Current) => {
                    let example = if role == Role::Time { "time_s=\"t [ms]\"" } else { "current_a=\"I_cmd [mA]\"" };
                    return Err(missing(file, columns, role.name(), format!(" (a foreign name is taken by --map {example})")));
                }
                None => {}
            },
        }
    }
    Ok(sources)
}

fn missing(file: &str, columns: &[String], column: &str, hint: String) -> RecordingError {
    let near = columns.iter().min_by_key(|c| strsim::osa_distance(c, column)).filter(|c| strsim::osa_distance(c, column) <= 2);
    let hint = near.map(|n| format!(" (did you mean `{n}`?)")).unwrap_or_default() + &hint;
    let mut found = columns.iter().take(40).map(|c| format!("`{c}`")).collect::<Vec<_>>().join(", ");
    if columns.len() > 40 {
        found += &format!(" and {} more", columns.len() - 40);
    }
    RecordingError::MissingColumn { file: file.into(), column: column.into(), hint, found }
}

fn find(file: &str, columns: &[String], name: &str) -> Result<Option<usize>, RecordingError> {
    let mut at = columns.iter().enumerate().filter(|c| c.1 == name).map(|c| c.0);
    match (at.next(), at.next()) {
        (Some(a), Some(b)) => {
            Err(RecordingError::format(file, format!("the column `{name}` is there twice (columns {} and {})", a + 1, b + 1)))
        }
        (first, _) => Ok(first),
    }
}

/// Rows as they stand in the file, before time is looked at.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// File name, for messages.
    pub file: String,
    /// Time of each row [s]; NaN where the cell is empty.
    pub time_s: Vec<f64>,
    /// The values of each channel that the file has, in the channel's unit.
    pub channels: [Option<Vec<f64>>; Channel::COUNT],
    /// Run names, each with the row that it begins at; one entry at row 0 at least.
    pub segments: Vec<(Option<String>, usize)>,
    /// How rows are named in a message.
    pub places: Places,
    /// What was noticed so far.
    pub notes: Vec<String>,
}

/// From the index of a row to how a message names it.
#[derive(Debug, Clone, Default)]
pub(super) struct Places {
    /// Whether rows are lines of a text.
    pub lines: bool,
    /// Row index and the number to add to it, wherever that number changes.
    shifts: Vec<(usize, usize)>,
}

impl Places {
    /// Says that row `row` stands in line `line`.
    pub fn put(&mut self, row: usize, line: usize) {
        let shift = line - row;
        if self.shifts.last().is_none_or(|last| last.1 != shift) {
            self.shifts.push((row, shift));
        }
    }
    /// `line 17` or `row 17`, counted from 1.
    pub fn of(&self, row: usize) -> String {
        if !self.lines {
            return format!("row {}", row + 1);
        }
        let after = self.shifts.partition_point(|s| s.0 <= row);
        let shift = after.checked_sub(1).map_or(1, |at| self.shifts[at].1);
        format!("line {}", row + shift)
    }
}

impl Rows {
    /// Empty columns for the channels of `sources`.
    pub fn new(file: &str, sources: &[Source], lines: bool) -> Self {
        let mut rows = Self { file: file.into(), places: Places { lines, shifts: Vec::new() }, ..Self::default() };
        for source in sources {
            if let Role::Channel(channel) = source.role {
                rows.channels[channel.index()] = Some(Vec::new());
            }
        }
        rows
    }
    /// The vector that a role's values go to; `None` for the name of the run.
    pub fn values(&mut self, role: Role) -> Option<&mut Vec<f64>> {
        match role {
            Role::Time => Some(&mut self.time_s),
            Role::Run => None,
            Role::Channel(channel) => self.channels[channel.index()].as_mut(),
        }
    }
}

/// Counts what was handled and remembers the first place, so that a long file gives one note and not thousands.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub count: usize,
    pub first: Option<String>,
}

impl Tally {
    /// One more, at a place that is named only if it is the first.
    pub fn add(&mut self, place: impl FnOnce() -> String) {
        self.count += 1;
        if self.first.is_none() {
            self.first = Some(place());
        }
    }
    /// `3 rows ...what... (first: line 17)`.
    pub fn note(&self, one: &str, many: &str, what: &str) -> Option<String> {
        let first = self.first.as_deref()?;
        Some(match self.count {
            1 => format!("1 {one} {what} ({first})"),
            n => format!("{n} {many} {what} (first: {first})"),
        })
    }
}
