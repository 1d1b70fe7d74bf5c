//! Many recordings in one Parquet file: the rows of each value of a column, such as a serial number, read by row groups.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use parquet::errors::ParquetError;

use super::pages::Opened;
use super::{Cells, Kind, guarded, numbers, open, texts};
use crate::recording::mapping::Role;
use crate::recording::{ColumnValues, Mapping, Recording, RecordingError};

/// The rows of one value of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// The column.
    pub column: String,
    /// Its value.
    pub value: String,
    /// The row groups that hold such rows.
    pub row_groups: Vec<usize>,
    /// Other columns that hold one value in all these rows and are no channel.
    pub facts: BTreeMap<String, String>,
}

/// The groups of a file in the order in which they begin. `map` says which columns are channels under foreign names.
///
/// # Errors
/// [`RecordingError`] where the file cannot be read or has no such column.
pub fn groups(path: &Path, column: &str, map: &[Mapping]) -> Result<Vec<Group>, RecordingError> {
    let file = path.display().to_string();
    guarded(&file, || found(path, &file, column, map))
}

fn found(path: &Path, file: &str, column: &str, map: &[Mapping]) -> Result<Vec<Group>, RecordingError> {
    let damaged = |e: ParquetError| RecordingError::format(file, e);
    let opened = open(path, file)?;
    let names: Vec<String> = opened.metadata().file_metadata().schema_descr().columns().iter().map(|c| c.path().string()).collect();
    let at = names
        .iter()
        .position(|n| n == column)
        .ok_or_else(|| RecordingError::format(file, format!("has no column `{column}` to group by; it has: {}", names.join(", "))))?;
    let channel =
        |name: &String| Role::all().any(|r| r.name() == name) || map.iter().any(|m| m.column == *name || m.second.as_ref() == Some(name));
    let facts: Vec<usize> = (0..names.len()).filter(|k| *k != at && !channel(&names[*k])).collect();
    let mut groups: Vec<Group> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for number in 0..opened.metadata().num_row_groups() {
        let values = words(&opened, number, at, damaged)?;
        let mut of_row = Vec::with_capacity(values.len());
        for value in values {
            let group = *known.entry(value).or_insert_with_key(|value| {
                groups.push(Group { column: column.into(), value: value.clone(), row_groups: Vec::new(), facts: BTreeMap::new() });
                groups.len() - 1
            });
            if groups[group].row_groups.last() != Some(&number) {
                groups[group].row_groups.push(number);
            }
            of_row.push(group);
        }
        for fact in &facts {
            for (word, group) in words(&opened, number, *fact, damaged)?.into_iter().zip(&of_row) {
                // A second value takes the column out; an empty text is no name of anything.
                let kept = groups[*group].facts.entry(names[*fact].clone()).or_insert_with(|| word.clone());
                if *kept != word {
                    kept.clear();
                    kept.push('\0');
                }
            }
        }
    }
    for group in &mut groups {
        group.facts.retain(|_, word| !word.is_empty() && word != "\0");
    }
    // Rows without a value belong to nobody.
    groups.retain(|group| !group.value.is_empty());
    Ok(groups)
}

/// The values of a column in one row group as words.
fn words(
    opened: &Opened,
    group: usize,
    at: usize,
    damaged: impl Fn(ParquetError) -> RecordingError + Copy,
) -> Result<Vec<String>, RecordingError> {
    let column = opened.metadata().file_metadata().schema_descr().column(at);
    let mut out = Vec::new();
    let chunk = || opened.chunk(group, at).map_err(damaged);
    if texts(chunk()?, |text| out.push(text.to_owned())).map_err(damaged)?.is_none()
        && let Ok(kind) = Kind::of(&column)
    {
        let word = |v: f64| if v.is_finite() { v.to_string() } else { String::new() };
        numbers(chunk()?, &kind, |v| out.push(word(v * kind.scale()))).map_err(damaged)?;
    }
    Ok(out)
}

impl Group {
    /// The rows of this group as a recording: only its row groups are read.
    ///
    /// # Errors
    /// [`RecordingError`] as for a file of its own.
    pub fn read(&self, path: &Path, map: &[Mapping]) -> Result<Recording, RecordingError> {
        let file = path.display().to_string();
        let columns = guarded(&file, || self.columns(path, &file))?;
        let source = format!("{file}, {} {}", self.column, self.value);
        let values: Vec<(&str, ColumnValues<'_>)> = columns
            .iter()
            .map(|(name, cells)| {
                let values = match cells {
                    Cells::Numbers(values) | Cells::Stamps(values) => ColumnValues::Numbers(values),
                    Cells::Texts(texts) => ColumnValues::Texts(texts),
                };
                (name.as_str(), values)
            })
            .collect();
        Recording::from_columns(&source, &values, map)
    }

    fn columns(&self, path: &Path, file: &str) -> Result<Vec<(String, Cells)>, RecordingError> {
        let damaged = |e: ParquetError| RecordingError::format(file, e);
        let opened = open(path, file)?;
        let schema = opened.metadata().file_metadata().schema_descr();
        let at = schema.columns().iter().position(|c| c.path().string() == self.column);
        let at = at.ok_or_else(|| RecordingError::format(file, format!("has no column `{}` any more", self.column)))?;
        let mine: Vec<Vec<bool>> = self
            .row_groups
            .iter()
            .map(|group| Ok(words(&opened, *group, at, damaged)?.into_iter().map(|word| word == self.value).collect()))
            .collect::<Result<_, RecordingError>>()?;
        let mut columns = Vec::new();
        for (place, column) in schema.columns().iter().enumerate().filter(|(k, _)| *k != at) {
            let Ok(kind) = Kind::of(column) else { continue };
            let (mut values, mut names, mut first) = (Vec::new(), Vec::new(), None);
            for (group, mine) in self.row_groups.iter().zip(&mine) {
                let mut rows = mine.iter();
                let take = |value: f64| {
                    if *rows.next().unwrap_or(&false) {
                        // Time stamps count from the first: seconds since 1970 leave too few digits for a step.
                        let value = if kind.is_stamp() { value - *first.get_or_insert(value) } else { value };
                        values.push(value * kind.scale());
                    }
                };
                let chunk = || opened.chunk(*group, place).map_err(damaged);
                if numbers(chunk()?, &kind, take).map_err(damaged)?.is_none() {
                    let mut rows = mine.iter();
                    let take = |text: &str| {
                        if *rows.next().unwrap_or(&false) {
                            names.push(text.to_owned());
                        }
                    };
                    texts(chunk()?, take).map_err(damaged)?;
                }
            }
            columns.push((column.path().string(), if names.is_empty() { Cells::Numbers(values) } else { Cells::Texts(names) }));
        }
        Ok(columns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{Column, Values, write_parquet};

    #[test]
    fn the_rows_of_each_value_are_a_recording_of_their_own() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all.parquet");
        // Two row groups; the first holds rows of both valves, the second of one.
        let table = |serials: &[&'static str], from: usize| -> (Vec<&'static str>, Vec<String>, [Vec<f64>; 4]) {
            let number = |of: &dyn Fn(usize) -> f64| (0..serials.len()).map(|k| of(from + k)).collect::<Vec<f64>>();
            let mileage = serials.iter().map(|s| if *s == "A" { 1200.0 } else { 77.5 }).collect();
            let columns = [mileage, number(&|k| k as f64 * 0.01), number(&|k| 300.0 + k as f64), number(&|k| k as f64 / 8.0)];
            (serials.to_vec(), (0..serials.len()).map(|k| k.to_string()).collect(), columns)
        };
        let (first, second) = (table(&[["A"; 300], ["B"; 300]].concat(), 0), table(&["B"; 200], 600));
        let columns = |t: &'static (Vec<&'static str>, Vec<String>, [Vec<f64>; 4])| {
            let notes: &'static [&'static str] = Box::leak(t.1.iter().map(String::as_str).collect::<Vec<_>>().into_boxed_slice());
            let number = |name, values: &'static [f64]| Column { name, values: Values::Numbers(values) };
            vec![
                Column { name: "serial", values: Values::Texts(&t.0) },
                Column { name: "note", values: Values::Texts(notes) },
                number("mileage", &t.2[0]),
                number("time_s", &t.2[1]),
                number("I", &t.2[2]),
                number("pressure_bar", &t.2[3]),
            ]
        };
        let tables = [columns(Box::leak(Box::new(first))), columns(Box::leak(Box::new(second)))];
        write_parquet(&path, &tables).unwrap();
        let map = [Mapping::parse("current_a=I [mA]").unwrap()];
        let found = groups(&path, "serial", &map).unwrap();
        let named: Vec<(&str, &[usize])> = found.iter().map(|g| (g.value.as_str(), g.row_groups.as_slice())).collect();
        assert_eq!(named, [("A", &[0][..]), ("B", &[0, 1][..])]);
        let facts: Vec<(&str, &str)> = found[1].facts.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        assert_eq!(facts, [("mileage", "77.5")], "what differs from row to row is no fact");
        let second = found[1].read(&path, &map).unwrap();
        assert_eq!((second.runs.len(), second.runs[0].len()), (1, 500));
        assert!((second.runs[0].current_a[1] - 0.601).abs() < 1e-12 && second.runs[0].pressure_bar.as_ref().unwrap()[2] == 302.0 / 8.0);
        let error = groups(&path, "vin", &map).unwrap_err().to_string();
        assert!(error.contains("no column `vin`") && error.contains("serial, note"), "{error}");
    }
}
