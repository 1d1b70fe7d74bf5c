//! Between a file format and the runs: which column becomes what, and the columns as they stand in the file.

use super::{Channel, Mapping, RecordingError, likely, mapping::Role};
use crate::valve::Input;

/// Where each role comes from: column, factor, offset.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Source {
    pub role: Role,
    pub column: usize,
    /// Column of the time of day, where `column` holds the date.
    pub second: Option<usize>,
    pub scale: f64,
    pub offset: f64,
    /// Whether the file's own unit of the column counts: neither a unit nor a factor was given.
    pub bare: bool,
}

/// Finds the column of each role: the mapped ones first, then those that bear a channel's own name.
///
/// # Errors
/// A column that is there twice, two mappings for one channel; mapped columns that are not there, no time, no current:
/// all of them at once, with the columns that are likely to be meant.
pub(super) fn resolve(file: &str, columns: &[String], map: &[Mapping], time_is_known: bool) -> Result<Vec<Source>, RecordingError> {
    let mut sources = Vec::new();
    let mut missing: Vec<(Role, Option<&str>)> = Vec::new();
    for role in Role::all() {
        let mut wanted = map.iter().filter(|m| m.role == role);
        let mapping = wanted.next();
        if let Some(second) = wanted.next() {
            return Err(RecordingError::Mapping { text: second.text.clone(), what: format!("`{}` is mapped twice", role.name()) });
        }
        match mapping {
            Some(mapping) => {
                // A header such as `I_cmd [mA]` is matched as a whole before it is taken apart.
                let whole = find(file, columns, &mapping.text)?;
                let (column, second) = match (whole, &mapping.second) {
                    (Some(column), _) => (Some(column), None),
                    (None, None) => (find_without_unit(file, columns, &mapping.column)?, None),
                    (None, Some(second)) => (find(file, columns, &mapping.column)?, Some(second)),
                };
                let second = match second {
                    Some(name) => match find(file, columns, name)? {
                        None => {
                            missing.push((role, Some(name)));
                            None
                        }
                        there => there,
                    },
                    None => None,
                };
                match column {
                    Some(column) => {
                        let mut source =
                            Source { role, column, second, scale: mapping.scale, offset: mapping.offset, bare: mapping.is_bare() };
                        if source.bare && second.is_none() {
                            source.take_unit(file, &columns[column])?;
                        }
                        sources.push(source);
                    }
                    None => missing.push((role, Some(&mapping.column))),
                }
            }
            None => match find(file, columns, role.name())? {
                Some(column) => sources.push(Source { role, column, second: None, scale: 1.0, offset: 0.0, bare: true }),
                None if role == Role::Time && !time_is_known || role == Role::Channel(Channel::Current) => missing.push((role, None)),
                None => {}
            },
        }
    }
    if missing.is_empty() {
        return Ok(sources);
    }
    // Whoever has to map one channel has to map the pressure, too.
    let pressure = Role::Channel(Channel::Pressure);
    if !sources.iter().any(|s| s.role == pressure) && !missing.iter().any(|m| m.0 == pressure) {
        missing.push((pressure, None));
    }
    Err(refusal(file, columns, &missing))
}

/// The column of a name, or the one whose header is that name with a unit behind it.
fn find_without_unit(file: &str, columns: &[String], name: &str) -> Result<Option<usize>, RecordingError> {
    if let Some(column) = find(file, columns, name)? {
        return Ok(Some(column));
    }
    let mut at = columns.iter().enumerate().filter(|c| likely::named(c.1).name == name).map(|c| c.0);
    Ok(at.next().filter(|_| at.next().is_none()))
}

impl Source {
    /// The unit that stands in a header, `I_cmd [mA]`, counts where neither a unit nor a factor was typed.
    fn take_unit(&mut self, file: &str, header: &str) -> Result<(), RecordingError> {
        let (Some(unit), false) = (likely::named(header).unit, header == self.role.name()) else { return Ok(()) };
        if self.role == Role::Run {
            return Ok(());
        }
        let (scale, offset) = self.role.conversion(&unit).map_err(|what| unknown_unit(file, header, self.role, &what))?;
        (self.scale, self.offset, self.bare) = (scale, offset, false);
        Ok(())
    }
}

/// A unit that is none of the role's: numbers whose unit nobody knows are never taken as if they had the right one.
pub(super) fn unknown_unit(file: &str, header: &str, role: Role, what: &str) -> RecordingError {
    let own = role.units().map_or("", |u| u.symbol);
    let name = likely::named(header).name;
    RecordingError::format(
        file,
        format!("`{header}` as {}: {what}. Say the unit, or the factor to {own}: --map {}=\"0.98 * {name}\"", role.name(), role.name()),
    )
}

/// Whether a column is a channel's already, by its name.
fn bears_its_own_name(column: &str) -> bool {
    Role::all().any(|r| r.name() == column)
}

/// Every channel that was not found, each with the nearest or the likely columns.
fn refusal(file: &str, columns: &[String], missing: &[(Role, Option<&str>)]) -> RecordingError {
    let named: Vec<_> = columns.iter().map(|c| likely::named(c)).collect();
    let wanted: Vec<String> = missing
        .iter()
        .map(|(role, typed)| {
            let name = typed.unwrap_or(role.name());
            let near = columns.iter().min_by_key(|c| strsim::osa_distance(c, name)).filter(|c| strsim::osa_distance(c, name) <= 2);
            let own = columns.iter().any(|c| c == role.name());
            let hint = match near {
                Some(near) => format!(" (did you mean `{near}`?)"),
                None if own && typed.is_some() => String::new(),
                None => {
                    let likely: Vec<String> = likely::likely(*role, &named)
                        .iter()
                        .filter(|l| !bears_its_own_name(&columns[l.0]))
                        .take(3)
                        .map(|l| format!("`{}`", columns[l.0]))
                        .collect();
                    if likely.is_empty() { String::new() } else { format!(" (likely: {})", likely.join(", ")) }
                }
            };
            match typed {
                Some(typed) => format!("column `{typed}` for {}{hint}", role.name()),
                None => format!("`{name}`{hint}"),
            }
        })
        .collect();
    let mut found = columns.iter().take(40).map(|c| format!("`{c}`")).collect::<Vec<_>>().join(", ");
    if columns.len() > 40 {
        found += &format!(" and {} more", columns.len() - 40);
    }
    RecordingError::MissingChannels { file: file.into(), wanted: wanted.join(", no "), found }
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
    /// What the command does between its samples, where the file states that.
    pub input: Option<Input>,
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
