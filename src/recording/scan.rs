//! Every column of a text with what it holds: numbers, time stamps, dates, texts.

use std::fs::File;
use std::path::Path;

use super::cell::{Cell, bare, number};
use super::csv::{Open, decoded, open, utf8};
use super::header::split;
use super::mapping::Role;
use super::raw::{Content, RawColumn, Table};
use super::stamps::Stamps;
use super::{Reading, RecordingError};

/// Every column with all its values, for somebody who does not know yet what is in the file.
pub(super) fn table(path: &Path, file: &str, reading: &Reading) -> Result<Table, RecordingError> {
    let handle = File::open(path).map_err(RecordingError::io(path))?;
    let Open { mut lines, separator, mut names, notes, header_row } = open(utf8(handle, reading.encoding), path, file, reading.header_row)?;
    if names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    let mut columns: Vec<Scan> = names.iter().map(|_| Scan::default()).collect();
    let mut cells = Vec::new();
    while lines.next(path, file)? {
        split(&lines.buffer, separator, &mut cells);
        for (column, &(from, to)) in columns.iter_mut().zip(&cells) {
            column.add(bare(&lines.buffer[from..to]));
        }
    }
    let columns = columns.into_iter().zip(names).map(|(scan, header)| scan.column(header)).collect();
    Ok(Table { columns, header_row: Some(header_row), notes })
}

/// A column on its way to what it holds.
#[derive(Default)]
struct Scan {
    numbers: Vec<f64>,
    stamps: Stamps,
    texts: Vec<String>,
    count: [usize; 3],
    date: Option<String>,
    unit: Option<String>,
}

impl Scan {
    fn add(&mut self, cell: &[u8]) {
        let value = match number(cell) {
            Cell::Number(value) | Cell::CommaNumber(value) => {
                self.count[0] += 1;
                value
            }
            Cell::Gap | Cell::Infinite => f64::NAN,
            Cell::Other => match self.stamps.of(cell) {
                Some(seconds) => {
                    self.count[1] += 1;
                    seconds
                }
                None => {
                    self.text(decoded(cell));
                    return;
                }
            },
        };
        self.numbers.push(value);
    }

    fn text(&mut self, text: String) {
        self.count[2] += 1;
        if super::stamps::is_date(&text) {
            self.date.get_or_insert(text);
            return;
        }
        let unit = text.trim_matches(|c: char| "[]() ".contains(c));
        if self.numbers.is_empty() && self.texts.is_empty() && Role::all().any(|r| r.conversion(unit).is_ok()) {
            // The line of units below the header.
            self.unit = Some(unit.into());
            self.count[2] -= 1;
        } else if self.texts.len() < 1000 && !self.texts.contains(&text) {
            self.texts.push(text);
        }
    }

    fn column(self, header: String) -> RawColumn {
        let [numbers, stamps, texts] = self.count;
        let content = match self.date {
            Some(date) if texts > numbers + stamps => Content::Dates(date),
            _ if texts > numbers + stamps => Content::Texts(self.texts),
            _ if stamps > numbers => Content::Stamps(self.numbers, self.stamps.first),
            _ if numbers > 0 => Content::Numbers(self.numbers),
            _ => Content::Empty,
        };
        RawColumn { group: String::new(), header, unit: self.unit, content }
    }
}
