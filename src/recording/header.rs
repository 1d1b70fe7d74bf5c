//! Where the header of a text stands: behind what a logger writes before it.

use super::cell::{Cell, bare, number};
use super::mapping::Role;
use super::stamps::Stamps;

/// Lines that are looked through for a header.
pub(super) const LOOK_AHEAD: usize = 200;

/// Splits a line at `separator`; a cell in double quotes may hold it.
pub(super) fn split(line: &[u8], separator: u8, cells: &mut Vec<(usize, usize)>) {
    cells.clear();
    let (mut start, mut quoted) = (0, false);
    for (at, &byte) in line.iter().enumerate() {
        if byte == separator && !quoted {
            cells.push((start, at));
            start = at + 1;
        } else if byte == b'"' {
            quoted = !quoted;
        }
    }
    cells.push((start, line.len()));
}

/// The separator of a header: the most frequent one; a name may hold a comma where `;` or a tab separates.
pub(super) fn separator(line: &[u8]) -> u8 {
    let mut cells = Vec::new();
    let mut count = |separator: u8| {
        split(line, separator, &mut cells);
        cells.len()
    };
    [b';', b'\t', b','].into_iter().rev().max_by_key(|s| count(*s)).unwrap_or(b',')
}

/// What the cells of a line hold.
struct Kinds {
    cells: usize,
    /// Numbers and time stamps.
    values: usize,
    /// Texts, which a name is and a value is not.
    texts: usize,
}

fn kinds(line: &[u8], separator: u8) -> Kinds {
    let mut cells = Vec::new();
    split(line, separator, &mut cells);
    // A separator at the end of a line makes no cell.
    if cells.len() > 1 && cells.last().is_some_and(|c| line[c.0..c.1].trim_ascii().is_empty()) {
        cells.pop();
    }
    let mut kinds = Kinds { cells: cells.len(), values: 0, texts: 0 };
    for &(from, to) in &cells {
        let cell = bare(&line[from..to]);
        match number(cell) {
            Cell::Number(_) | Cell::CommaNumber(_) | Cell::Infinite => kinds.values += 1,
            Cell::Gap => {}
            Cell::Other if Stamps::default().of(cell).is_some() => kinds.values += 1,
            Cell::Other => kinds.texts += 1,
        }
    }
    kinds
}

/// Which of the first lines is the header: the names right before the first row of values that has as many cells. A line
/// of units may stand between. `None` where no line is one.
pub(super) fn find(lines: &[&[u8]]) -> Option<usize> {
    let is_header = |at: usize, row: usize| {
        let separator = separator(lines[at]);
        let (own, row) = (kinds(lines[at], separator), kinds(lines[row], separator));
        own.cells >= 2 && own.texts > own.values && row.cells == own.cells && row.values >= 2
    };
    (1..lines.len()).find_map(|row| {
        let above = row - 1;
        if !is_header(above, row) {
            return None;
        }
        Some(if above > 0 && is_units(lines[above]) && is_header(above - 1, row) { above - 1 } else { above })
    })
}

/// Whether most cells of a line are units.
fn is_units(line: &[u8]) -> bool {
    let mut cells = Vec::new();
    split(line, separator(line), &mut cells);
    let texts: Vec<String> = cells.iter().map(|c| String::from_utf8_lossy(bare(&line[c.0..c.1])).into_owned()).collect();
    let unit = |text: &&String| {
        let text = text.trim_matches(|c: char| "[]() ".contains(c));
        Role::all().any(|r| r.conversion(text).is_ok())
    };
    let filled = texts.iter().filter(|t| !t.is_empty() && t.as_str() != "-");
    2 * texts.iter().filter(unit).count() > filled.count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> Option<usize> {
        let lines: Vec<&[u8]> = text.lines().map(str::as_bytes).collect();
        find(&lines)
    }

    #[test]
    fn what_a_logger_writes_before_the_header_is_none() {
        assert_eq!(at("time_s,current_a\n0,1\n1,2"), Some(0));
        assert_eq!(at("Logger 5\nOperator;N.N.;x\nDatum;Zeit;I [mA]\n01.03.2026;12:00:00,010;1,5"), Some(2));
        assert_eq!(at("Rate,100\nChannels,2\nt,I,p\ns,mA,bar\n0,1,2\n1,2,3"), Some(2));
        // Texts among the values: the name of the run.
        assert_eq!(at("run,time_s,current_a\na,0,1\na,1,2"), Some(0));
        assert_eq!(at("0,1\n1,2"), None);
        assert_eq!(at("one column\n1\n2"), None);
        assert_eq!(at(""), None);
    }
}
