//! Recordings as text: CSV with a header, `#` comments, and what exporters make of it.
//!
//! The separator is the one that the header uses (`,` `;` or tab). Cells are numbers with a decimal point, or
//! with a decimal comma where the comma does not separate. Lines are read one by one into columns, so a day at
//! 100 Hz needs the memory of its columns and no more.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use super::cell::{Cell, bare, decimals, number, shown};
use super::header::{self, split};
use super::mapping::Role;
use super::source::{Rows, Source, Tally, resolve};
use super::stamps::Stamps;
use super::{Encoding, Reading, RecordingError};

/// A line longer than this is no line of a recording.
const LINE_LIMIT: u64 = 1 << 20;

pub(super) fn read(path: &Path, file: &str, reading: &Reading) -> Result<Rows, RecordingError> {
    let handle = File::open(path).map_err(RecordingError::io(path))?;
    let size = handle.metadata().map_or(0, |m| m.len());
    read_from(handle, size, path, file, reading)
}

/// Lines with their numbers, without their ends.
pub(super) struct Lines<R> {
    input: R,
    pub buffer: Vec<u8>,
    number: usize,
    /// Whether the last line read had an end.
    ended: bool,
    /// Lines that were read before their turn, to find the header.
    ahead: VecDeque<Line>,
    /// Whether comments and empty lines count, too.
    comments: bool,
}

/// A line that waits for its turn.
struct Line {
    bytes: Vec<u8>,
    number: usize,
    ended: bool,
}

impl<R: BufRead> Lines<R> {
    /// Reads the next line that is neither empty nor a comment into `buffer`; false at the end of the file.
    pub fn next(&mut self, path: &Path, file: &str) -> Result<bool, RecordingError> {
        if let Some(line) = self.ahead.pop_front() {
            (self.buffer, self.number, self.ended) = (line.bytes, line.number, line.ended);
            return Ok(true);
        }
        self.fetch(path, file)
    }

    /// Reads the first lines before their turn. A line that is too long ends the look, and is told in its turn.
    fn look_ahead(&mut self, path: &Path, file: &str) -> Result<(), RecordingError> {
        while self.ahead.len() < header::LOOK_AHEAD && self.fetch(path, file)? {
            self.ahead.push_back(Line { bytes: std::mem::take(&mut self.buffer), number: self.number, ended: self.ended });
        }
        Ok(())
    }

    fn fetch(&mut self, path: &Path, file: &str) -> Result<bool, RecordingError> {
        loop {
            self.buffer.clear();
            let read = self.input.by_ref().take(LINE_LIMIT).read_until(b'\n', &mut self.buffer).map_err(RecordingError::io(path))?;
            if read == 0 {
                return Ok(false);
            }
            self.number += 1;
            if read as u64 == LINE_LIMIT {
                return Err(row_error(file, self.number, "the line is longer than a megabyte: this is no text of comma-separated values"));
            }
            self.ended = self.buffer.last() == Some(&b'\n');
            while matches!(self.buffer.last(), Some(b'\n' | b'\r')) {
                self.buffer.pop();
            }
            if self.comments {
                return Ok(true);
            }
            let start = self.buffer.iter().position(|b| !b.is_ascii_whitespace());
            if start.is_some_and(|at| self.buffer[at] != b'#') {
                return Ok(true);
            }
        }
    }
}

fn row_error(file: &str, line: usize, what: impl ToString) -> RecordingError {
    RecordingError::Row { file: file.into(), place: format!("line {line}"), what: what.to_string() }
}

/// The names of a header.
fn names(line: &[u8], separator: u8, file: &str, at: usize) -> Result<Vec<String>, RecordingError> {
    let mut cells = Vec::new();
    split(line, separator, &mut cells);
    if line.contains(&b'\r') {
        return Err(row_error(file, at, "a carriage return stands within the line; lines end with LF or CR LF"));
    }
    if cells.iter().all(|c| matches!(number(bare(&line[c.0..c.1])), Cell::Number(_) | Cell::Gap)) {
        return Err(row_error(file, at, "the first line holds no names; a header is wanted, for instance time_s,current_a,pressure_bar"));
    }
    Ok(cells.iter().map(|c| decoded(bare(&line[c.0..c.1])).replace("\"\"", "\"")).collect())
}

/// A text; what is no UTF-8 is taken as Windows-1252, in which every byte is a letter.
pub(super) fn decoded(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => encoding_rs::WINDOWS_1252.decode_without_bom_handling(bytes).0.into_owned(),
    }
}

/// The lines behind a file's own encoding, as UTF-8 where that is asked for or the file begins with a mark of UTF-16.
pub(super) fn utf8(input: impl Read, encoding: Option<Encoding>) -> impl BufRead {
    let encoding = match encoding {
        None => None,
        Some(Encoding::Utf8) => Some(encoding_rs::UTF_8),
        Some(Encoding::Utf16) => Some(encoding_rs::UTF_16LE),
        Some(Encoding::Latin1) => Some(encoding_rs::WINDOWS_1252),
    };
    // Without an encoding and without a mark the bytes pass as they are.
    let decoder = encoding_rs_io::DecodeReaderBytesBuilder::new().encoding(encoding).bom_sniffing(true).strip_bom(true).build(input);
    BufReader::with_capacity(1 << 18, decoder)
}

/// A text that is open behind its header.
pub(super) struct Open<R> {
    pub lines: Lines<R>,
    pub separator: u8,
    pub names: Vec<String>,
    pub notes: Vec<String>,
    pub header_row: usize,
}

/// Finds the header, or takes the line that is said to be it.
pub(super) fn open<R: BufRead>(input: R, path: &Path, file: &str, header_row: Option<usize>) -> Result<Open<R>, RecordingError> {
    let mut lines = Lines { input, buffer: Vec::new(), number: 0, ended: true, ahead: VecDeque::new(), comments: header_row.is_some() };
    let mut notes = Vec::new();
    if let Some(row) = header_row {
        while lines.number < row {
            if !lines.next(path, file)? {
                return Err(RecordingError::format(file, format!("--header-row {row}: the file has {} lines", lines.number)));
            }
        }
        lines.comments = false;
        let start = lines.buffer.iter().position(|b| *b != b'#' && !b.is_ascii_whitespace()).unwrap_or(0);
        lines.buffer.drain(..start);
    } else {
        lines.look_ahead(path, file)?;
        if lines.ahead.is_empty() {
            return Err(RecordingError::format(file, "the file is empty; a header is wanted, for instance time_s,current_a,pressure_bar"));
        }
        let texts: Vec<&[u8]> = lines.ahead.iter().map(|l| l.bytes.as_slice()).collect();
        // Spreadsheets write the separator into a line of its own; the header shows it anyway.
        let spreadsheet = usize::from(texts[0].len() == 5 && texts[0].starts_with(b"sep="));
        let found = header::find(&texts[spreadsheet..]).map_or(spreadsheet, |at| at + spreadsheet);
        if found >= texts.len() {
            return Err(RecordingError::format(file, "there is no header"));
        }
        let skipped = found - spreadsheet;
        for _ in 0..=found {
            lines.next(path, file)?;
        }
        if skipped > 0 {
            notes.push(format!(
                "{skipped} line{} before the header skipped (the header is line {})",
                if skipped == 1 { "" } else { "s" },
                lines.number
            ));
        }
    }
    let separator = header::separator(&lines.buffer);
    if std::str::from_utf8(&lines.buffer).is_err() {
        notes.push("the header is no UTF-8: read as Windows-1252 (latin-1)".into());
    }
    let names = names(&lines.buffer, separator, file, lines.number)?;
    let header_row = lines.number;
    Ok(Open { lines, separator, names, notes, header_row })
}

pub(super) fn read_from(input: impl Read, size: u64, path: &Path, file: &str, reading: &Reading) -> Result<Rows, RecordingError> {
    let Open { mut lines, separator, mut names, notes, .. } = open(utf8(input, reading.encoding), path, file, reading.header_row)?;
    let mut sources = resolve(file, &names, &reading.map, false)?;
    let mut rows = Rows::new(file, &sources, true);
    rows.notes = notes;
    let needed = sources.iter().flat_map(|s| [Some(s.column), s.second]).flatten().max().unwrap_or(0) + 1;
    // A separator at the end of every line makes a last column without a name.
    if names.last().is_some_and(String::is_empty) {
        names.pop();
    }

    let mut cells = Vec::new();
    let (mut short, mut commas, mut infinite, mut units) = (Tally::default(), Tally::default(), Tally::default(), None);
    let mut cut: Option<String> = None;
    let mut previous_decimals = 0;
    let mut run_name: Vec<u8> = Vec::new();
    let mut stamps = Stamps::default();
    while lines.next(path, file)? {
        let line = &lines.buffer;
        split(line, separator, &mut cells);
        let row = rows.time_s.len();
        if (row as u64 + 1) * sources.len() as u64 > super::MOST_VALUES {
            let most = super::MOST_VALUES;
            return Err(row_error(
                file,
                lines.number,
                format!("more than {most} values of {} channels; at most so many are read", sources.len()),
            ));
        }
        if row == 1 {
            // One row is enough to guess the rest from, so that columns do not grow by doubling.
            let guess = (size / (line.len() as u64 + 1)).min(super::MOST_VALUES / sources.len().max(1) as u64) as usize + (1 << 10);
            let reserve = |values: &mut Vec<f64>| drop(values.try_reserve_exact(guess));
            reserve(&mut rows.time_s);
            rows.channels.iter_mut().flatten().for_each(reserve);
        }
        if cells.len() > names.len() && cells[names.len()..].iter().any(|c| !line[c.0..c.1].trim_ascii().is_empty()) {
            let hint = if separator == b',' { " (with decimal commas, separate the cells by `;`)" } else { "" };
            return Err(row_error(file, lines.number, format!("{} cells where the header has {}{hint}", cells.len(), names.len())));
        }
        if !lines.ended && cells.len() < names.len() {
            cut = Some(format!("the last line is cut: {} of {} cells; dropped (line {})", cells.len(), names.len(), lines.number));
            break;
        }
        if cells.len() < needed {
            short.add(|| format!("line {}", lines.number));
            continue;
        }
        if row == 0
            && units.is_none()
            && let Some(found) = unit_line(line, &cells, &mut sources)
        {
            units = Some(format!("line {} holds units and no values: {found}", lines.number));
            continue;
        }
        for source in &sources {
            let (from, to) = cells[source.column];
            let cell = bare(&line[from..to]);
            let Some(values) = rows.values(source.role) else {
                if row == 0 || cell != run_name {
                    run_name = cell.to_vec();
                    let name = decoded(cell).replace("\"\"", "\"");
                    rows.segments.push(((!name.is_empty()).then_some(name), row));
                }
                continue;
            };
            if let Some(second) = source.second {
                let time = bare(&line[cells[second].0..cells[second].1]);
                match stamps.of_two(cell, time) {
                    Some(since_first_s) => values.push(since_first_s),
                    None if cell.is_empty() && time.is_empty() => values.push(f64::NAN),
                    None => {
                        return Err(RecordingError::Cell {
                            file: file.into(),
                            place: format!("line {}", lines.number),
                            number: source.column + 1,
                            column: names.get(source.column).cloned().unwrap_or_default(),
                            what: format!("`{}` and `{}` are not a date and a time of day", shown(cell), shown(time)),
                        });
                    }
                }
                continue;
            }
            let found = number(cell);
            if source.role == Role::Time
                && matches!(found, Cell::Other)
                && let Some(since_first_s) = stamps.of(cell)
            {
                values.push(since_first_s);
                continue;
            }
            let value = match found {
                Cell::Number(value) => value,
                Cell::CommaNumber(value) => {
                    commas.add(|| format!("line {}", lines.number));
                    value
                }
                Cell::Gap => f64::NAN,
                Cell::Infinite => {
                    infinite.add(|| format!("line {}", lines.number));
                    f64::NAN
                }
                Cell::Other if !lines.ended => {
                    cut = Some(format!("the last line is cut within a number; dropped (line {})", lines.number));
                    f64::NAN
                }
                Cell::Other => {
                    return Err(RecordingError::Cell {
                        file: file.into(),
                        place: format!("line {}", lines.number),
                        number: source.column + 1,
                        column: names.get(source.column).cloned().unwrap_or_default(),
                        what: format!("`{}` is not a number; allowed: a number, or an empty cell or NaN for a gap", shown(cell)),
                    });
                }
            };
            values.push(value * source.scale + source.offset);
        }
        rows.places.put(row, lines.number);
        let (from, to) = cells[names.len().min(cells.len()) - 1];
        let decimals = decimals(&line[from..to]);
        if !lines.ended {
            last_line(&mut rows, &sources, names.len() - 1, decimals < previous_decimals, lines.number, &mut cut);
        }
        previous_decimals = decimals;
    }
    if short.count > 3 && short.count * 100 > rows.time_s.len() {
        let first = short.first.unwrap_or_default();
        return Err(RecordingError::format(file, format!("{} lines have fewer cells than the header (first: {first})", short.count)));
    }
    if let Some((count, first)) = stamps.count.checked_sub(1).map(|_| (stamps.count, &stamps.first)) {
        if count + rows.time_s.iter().filter(|t| t.is_nan()).count() < rows.time_s.len() {
            return Err(RecordingError::format(file, "time_s holds numbers in some lines and time stamps in others"));
        }
        rows.notes.push(format!("time stamps are counted from the first, {first}"));
    }
    rows.notes.extend(units);
    rows.notes.extend(commas.note("number has", "numbers have", "a decimal comma"));
    rows.notes.extend(short.note("line", "lines", "with too few cells: dropped"));
    rows.notes.extend(infinite.note("infinite value", "infinite values", "taken as gaps"));
    rows.notes.extend(cut);
    Ok(rows)
}

/// A last line without its end may be cut within its last number: that number is then no measurement.
fn last_line(rows: &mut Rows, sources: &[Source], last: usize, shorter: bool, line: usize, cut: &mut Option<String>) {
    let row = rows.time_s.len() - 1;
    let doubtful = sources.iter().find(|s| s.column == last && shorter).map(|s| s.role);
    match doubtful {
        Some(role @ Role::Channel(_)) if cut.is_none() => {
            if let Some(value) = rows.values(role).and_then(|v| v.last_mut()) {
                *value = f64::NAN;
            }
            *cut = Some(format!("the last line has no end and its last number may be cut: taken as a gap (line {line})"));
        }
        None if cut.is_none() => {}
        _ => {
            rows.time_s.truncate(row);
            rows.channels.iter_mut().flatten().for_each(|v| v.truncate(row));
            while rows.segments.last().is_some_and(|s| s.1 >= row && row > 0) {
                rows.segments.pop();
            }
            cut.get_or_insert_with(|| format!("the last line has no end and may be cut: dropped (line {line})"));
        }
    }
}

/// Takes the units from a line below the header (`s,mA,bar`) that holds not one number.
///
/// A channel whose mapping names a unit or a factor keeps that.
fn unit_line(line: &[u8], cells: &[(usize, usize)], sources: &mut [Source]) -> Option<String> {
    let mut found = Vec::new();
    for (at, source) in sources.iter().enumerate().filter(|s| s.1.role != Role::Run) {
        let (from, to) = cells[source.column];
        let cell = bare(&line[from..to]);
        match number(cell) {
            Cell::Number(_) | Cell::CommaNumber(_) | Cell::Infinite => return None,
            Cell::Gap => {}
            Cell::Other => {
                let text = String::from_utf8_lossy(cell);
                let unit = text.trim_matches(|c: char| "[]() ".contains(c)).to_string();
                found.push((at, source.role.conversion(&unit).ok()?, unit));
            }
        }
    }
    let mut said = Vec::new();
    for (at, (scale, offset), unit) in found {
        let source = &mut sources[at];
        if source.bare {
            (source.scale, source.offset) = (scale, offset);
            said.push(format!("{} in {unit}", source.role.name()));
        } else {
            said.push(format!("{} as mapped, not in {unit}", source.role.name()));
        }
    }
    (!said.is_empty()).then(|| said.join(", "))
}

#[cfg(test)]
mod tests {
    use crate::recording::{Channel, Mapping, Recording};

    fn read(text: &str) -> Recording {
        Recording::from_csv(text, "x.csv", &[]).unwrap()
    }
    fn mapped(text: &str, map: &[&str]) -> Recording {
        let map: Vec<Mapping> = map.iter().map(|m| Mapping::parse(m).unwrap()).collect();
        Recording::from_csv(text, "x.csv", &map).unwrap()
    }
    fn refusal(text: &str) -> String {
        Recording::from_csv(text, "x.csv", &[]).unwrap_err().to_string()
    }

    const PLAIN: &str = "time_s,current_a,pressure_bar\n0,0.1,1.5\n0.01,0.2,2.5\n0.02,0.3,3.5\n";

    #[test]
    fn a_plain_file() {
        let recording = read(PLAIN);
        assert_eq!(recording.notes, Vec::<String>::new());
        let [run] = recording.runs.as_slice() else { panic!("one run") };
        assert_eq!((run.name.as_deref(), &run.time_s[..], &run.current_a[..]), (None, &[0.0, 0.01, 0.02][..], &[0.1, 0.2, 0.3][..]));
        assert_eq!(run.pressure_bar.as_deref(), Some(&[1.5, 2.5, 3.5][..]));
        assert_eq!(run.channel(Channel::Supply), None);
    }

    #[test]
    fn exporters_habits_change_nothing() {
        let plain = read(PLAIN);
        let crlf = PLAIN.replace('\n', "\r\n");
        let semicolons = PLAIN.replace(',', ";").replace('.', ",");
        for text in [
            crlf.clone(),
            format!("\u{feff}{crlf}"),
            PLAIN.replace('\n', "\n\n"),
            format!("# a bench\n\n{}# end\n", PLAIN.replace('\n', "\n# c\n")),
            PLAIN.replace(',', "\t"),
            PLAIN.replace(',', " , "),
            PLAIN.replace('\n', ",\n"),
            PLAIN.trim_end().to_string(),
            PLAIN.replace("current_a", "\"current_a\"").replace("0.2", "\"0.2\""),
        ] {
            assert_eq!(read(&text), plain, "{text:?}");
        }
        let recording = read(&semicolons);
        assert_eq!(recording.runs, plain.runs);
        assert_eq!(recording.notes, ["8 numbers have a decimal comma (first: line 2)"]);
        let quoted = "time_s,current_a,pressure_bar\n0,\"0,1\",\"1,5\"\n\"0,01\",\"0,2\",\"2,5\"\n\"0,02\",\"0,3\",\"3,5\"\n";
        assert_eq!(read(quoted).runs, plain.runs);
    }

    #[test]
    fn foreign_channels_are_taken_and_converted() {
        let text = "t [ms];I_cmd [mA];Druck / bar;duty\n0;100;1.5;10\n10;200;2.5;20\n20;300;3.5;30\n";
        let expected = read(PLAIN).runs;
        let close = |recording: Recording| {
            let run = &recording.runs[0];
            run.time_s.iter().zip(&expected[0].time_s).all(|(a, b)| (a - b).abs() < 1e-12)
                && run.current_a.iter().zip(&expected[0].current_a).all(|(a, b)| (a - b).abs() < 1e-12)
                && run.pressure_bar == expected[0].pressure_bar
        };
        assert!(close(mapped(text, &["time_s=t [ms]", "current_a=I_cmd [mA]", "pressure_bar=\"Druck / bar\""])));
        assert!(close(mapped(text, &["time_s=t [ms]", "current_a=0.01 * duty", "pressure_bar='Druck / bar' [bar]"])));
    }

    #[test]
    fn time_stamps_count_from_the_first() {
        let text = |stamps: [&str; 3]| format!("sep=;\ntime_s;current_a\n{};1\n{};2\n{};3\n", stamps[0], stamps[1], stamps[2]);
        for stamps in [
            ["2026-03-01T23:59:59.990", "2026-03-02T00:00:00.000", "2026-03-02T00:00:00.010"],
            ["2026-03-01 23:59:59.990", "2026-03-02 00:00:00.000", "2026-03-02 00:00:00.010"],
            ["2026-03-01T23:59:59.99+01:00", "2026-03-01T23:00:00Z", "2026-03-02T00:00:00.01+01:00"],
            ["12:00:00,000", "12:00:00,010", "12:00:00,020"],
        ] {
            let recording = read(&text(stamps));
            let time = &recording.runs[0].time_s;
            assert!(time.iter().zip([0.0, 0.01, 0.02]).all(|(a, b)| (a - b).abs() < 1e-9), "{time:?}");
            assert_eq!(recording.notes[0], format!("time stamps are counted from the first, {}", stamps[0]));
        }
        insta::assert_snapshot!(refusal(&text(["12:00:00", "7", "12:00:02"])), @"x.csv: time_s holds numbers in some lines and time stamps in others");
        insta::assert_snapshot!(refusal(&text(["12:00:00", "soon", "12:00:02"])), @"x.csv: line 4, column 1 (`time_s`): `soon` is not a number; allowed: a number, or an empty cell or NaN for a gap");
    }

    #[test]
    fn a_line_of_units_below_the_header_counts() {
        let recording = read("time_s,current_a,pressure_bar\n[ms],mA,bar\n0,100,1.5\n10,200,2.5\n20,300,3.5\n");
        assert_eq!(recording.notes, ["line 2 holds units and no values: time_s in ms, current_a in mA, pressure_bar in bar"]);
        assert!((recording.runs[0].current_a[1] - 0.2).abs() < 1e-12 && (recording.runs[0].time_s[1] - 0.01).abs() < 1e-12);
    }

    #[test]
    fn empty_cells_and_nan_are_gaps_and_never_zeros() {
        let recording = read("time_s,current_a,pressure_bar\n0,0.1,\n1,NaN,2\n2,0.3,n/a\n3,0.4,inf\n4,0.5,3\n");
        let run = &recording.runs[0];
        assert!(run.current_a[1].is_nan());
        let pressure = run.pressure_bar.as_ref().unwrap();
        assert_eq!(pressure.iter().map(|p| p.is_nan()).collect::<Vec<_>>(), [true, false, true, true, false]);
        insta::assert_snapshot!(recording.notes.join("\n"), @r"
        1 infinite value taken as gaps (line 5)
        current_a: 1 value missing (line 3)
        pressure_bar: 3 values missing (first: line 2)
        ");
    }

    #[test]
    fn a_cut_last_line_is_no_measurement() {
        let cut = |text: &str| {
            let recording = read(text);
            (recording.runs[0].len(), recording.notes.join("; "))
        };
        assert_eq!(cut(&PLAIN[..PLAIN.len() - 6]), (2, "the last line is cut: 2 of 3 cells; dropped (line 4)".into()));
        let (samples, note) = cut(&PLAIN[..PLAIN.len() - 2]);
        assert_eq!(samples, 3);
        insta::assert_snapshot!(note, @"the last line has no end and its last number may be cut: taken as a gap (line 4); pressure_bar: 1 value missing (line 4)");
    }

    #[test]
    fn what_cannot_be_read_is_refused_with_line_and_column() {
        insta::assert_snapshot!(refusal(""), @"x.csv: the file is empty; a header is wanted, for instance time_s,current_a,pressure_bar");
        insta::assert_snapshot!(refusal("0,1,2\n"), @"x.csv: line 1: the first line holds no names; a header is wanted, for instance time_s,current_a,pressure_bar");
        insta::assert_snapshot!(refusal("time_s,current_a\n"), @"x.csv: there is no row of values");
        insta::assert_snapshot!(refusal("time_s,I\n0,1\n"), @r#"
        x.csv: there is no `current_a` (likely: `I`), no `pressure_bar`
        the file has: `time_s`, `I`
        `hil inspect` shows what is in it and writes a mapping; a foreign name is taken by --map current_a="I_cmd [mA]"
        "#);
        insta::assert_snapshot!(refusal("time_s,curent_a\n0,1\n"), @r#"
        x.csv: there is no `current_a` (did you mean `curent_a`?), no `pressure_bar`
        the file has: `time_s`, `curent_a`
        `hil inspect` shows what is in it and writes a mapping; a foreign name is taken by --map current_a="I_cmd [mA]"
        "#);
        insta::assert_snapshot!(refusal("time_s,current_a,current_a\n0,1,1\n"), @"x.csv: the column `current_a` is there twice (columns 2 and 3)");
        insta::assert_snapshot!(refusal("# c\ntime_s,current_a\n0,1\n1,ERR\n2,1\n"), @"x.csv: line 4, column 2 (`current_a`): `ERR` is not a number; allowed: a number, or an empty cell or NaN for a gap");
        insta::assert_snapshot!(refusal("time_s,current_a\n0,0,1,5\n"), @"x.csv: line 2: 4 cells where the header has 2 (with decimal commas, separate the cells by `;`)");
        insta::assert_snapshot!(refusal("time_s,current_a\n0,\n1,\n"), @"x.csv: `current_a` holds no value at all");
        assert!(refusal("\u{0}\u{0}\n").starts_with("x.csv: there is no `time_s`, no `current_a`, no `pressure_bar`\n"));
    }
}
