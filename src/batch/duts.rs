//! The valves of a batch: from a CSV file, by count, or entered one by one.

use std::collections::BTreeMap;
use std::io::BufRead;
use std::path::Path;

use super::BatchError;
use crate::document::nearest;
use crate::plan::SerialForm;
use crate::record::Dut;

/// Longest list that is read.
const MAX_DUTS: usize = 1_000_000;
const COLUMNS: [&str; 4] = ["serial", "part_number", "revision", "lot"];

/// The valves in a CSV file with the columns `serial`, `part_number`, `revision`, `lot` (the last three optional). `form` gives the
/// form of the serial numbers of a part number and revision.
///
/// # Errors
/// [`BatchError::Input`] with file and row: an unknown column, a blank or repeated serial number, one of the wrong form.
pub fn read_csv(path: &Path, form: impl Fn(&Dut) -> SerialForm) -> Result<Vec<Dut>, BatchError> {
    let name = path.display().to_string();
    let wrong = |problem: String| BatchError::Input(format!("{name}: {problem}"));
    if path.is_dir() {
        return Err(wrong("is a directory; a CSV file with a column `serial` is wanted".into()));
    }
    let text = crate::document::read_table(path).map_err(|e| BatchError::Input(e.to_string()))?;
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    let first = text.split(|b| *b == b'\n').next().unwrap_or_default();
    let delimiter = if first.contains(&b';') { b';' } else { b',' };
    let mut reader = csv::ReaderBuilder::new().delimiter(delimiter).comment(Some(b'#')).trim(csv::Trim::All).from_reader(text);
    let headers = reader.headers().map_err(|e| wrong(e.to_string()))?.clone();
    for header in &headers {
        if !COLUMNS.contains(&header) {
            let meant = nearest(header, COLUMNS).map_or_else(String::new, |n| format!("; meant `{n}`?"));
            return Err(wrong(format!("row 1: unknown column `{header}`{meant} (allowed: {})", COLUMNS.join(", "))));
        }
    }
    let column = |name: &str| headers.iter().position(|h| h == name);
    let Some(serial_column) = column("serial") else {
        return Err(wrong("row 1: no column `serial`".into()));
    };
    let mut duts = Vec::new();
    let mut rows: BTreeMap<String, u64> = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|e| wrong(e.to_string()))?;
        let row = record.position().map_or(0, csv::Position::line);
        let field = |name: &str| column(name).and_then(|k| record.get(k)).filter(|v| !v.is_empty()).map(String::from);
        let mut dut = Dut { serial: String::new(), part_number: field("part_number"), revision: field("revision"), lot: field("lot") };
        let typed = record.get(serial_column).unwrap_or_default();
        dut.serial = form(&dut).check(typed).map_err(|e| wrong(format!("row {row}: {e}")))?;
        if let Some(before) = rows.insert(dut.serial.clone(), row) {
            return Err(wrong(format!("row {row}: serial `{}` stands in row {before} already", dut.serial)));
        }
        duts.push(dut);
        if duts.len() > MAX_DUTS {
            return Err(wrong(format!("more than {MAX_DUTS} valves")));
        }
    }
    if duts.is_empty() {
        return Err(wrong("no valve: the file has a header and no row".into()));
    }
    Ok(duts)
}

/// `count` valves of a simulated population: `SIM-000001` and so on.
pub fn counted(count: usize) -> Result<Vec<Dut>, BatchError> {
    if count == 0 || count > MAX_DUTS {
        return Err(BatchError::Input(format!("--count {count}: 1 to {MAX_DUTS} are allowed")));
    }
    Ok((1..=count).map(|i| Dut { serial: format!("SIM-{i:06}"), ..Dut::default() }).collect())
}

/// What an entry at the prompt comes to.
#[derive(Debug, Clone, PartialEq)]
pub enum Entry {
    /// A valve to test.
    Dut(Dut),
    /// A line that cannot be used, and why; it is asked again.
    Refused(String),
    /// No further valve.
    End,
}

/// What a scanned or typed serial number comes to; blank is refused. `seen` says what is known of it already.
pub fn entry(typed: &str, common: &Dut, form: &SerialForm, seen: impl Fn(&str) -> Option<String>) -> Entry {
    match form.check(typed) {
        Err(e) => Entry::Refused(e.to_string()),
        Ok(serial) => match seen(&serial) {
            Some(what) => Entry::Refused(format!("`{serial}` {what}")),
            None => Entry::Dut(Dut { serial, ..common.clone() }),
        },
    }
}

/// Reads one entry of a scanner or a keyboard: a serial number and the end of the line, which `entry` judges. `.` or the end of
/// the input ends the batch.
pub fn prompt(input: &mut dyn BufRead, entry: impl Fn(&str) -> Entry) -> std::io::Result<Entry> {
    let mut line = String::new();
    if input.read_line(&mut line)? == 0 || line.trim() == "." {
        return Ok(Entry::End);
    }
    Ok(entry(&line))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::CheckCharacter;

    fn read(text: &str) -> Result<Vec<Dut>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("duts.csv");
        std::fs::write(&path, text).unwrap();
        let form = SerialForm { pattern: Some("V##".into()), check: CheckCharacter::None };
        read_csv(&path, |_| form.clone()).map_err(|e| e.to_string().replace(&dir.path().display().to_string(), ""))
    }

    #[test]
    fn a_list_is_read_with_its_optional_columns() {
        let duts = read("\u{feff}lot;serial;part_number\r\nL1; V01 ;P7\r\n;V02;\r\n").unwrap();
        assert_eq!(duts[0], Dut { serial: "V01".into(), part_number: Some("P7".into()), revision: None, lot: Some("L1".into()) });
        assert_eq!(duts[1].part_number, None);
    }

    #[test]
    fn a_wrong_list_is_refused_with_its_row() {
        insta::assert_snapshot!(read("serial,lott\nV01,1\n").unwrap_err(), @"/duts.csv: row 1: unknown column `lott`; meant `lot`? (allowed: serial, part_number, revision, lot)");
        insta::assert_snapshot!(read("serial\nV01\nV02\nV01\n").unwrap_err(), @"/duts.csv: row 4: serial `V01` stands in row 2 already");
        insta::assert_snapshot!(read("serial,lot\nV01,a\n,b\n").unwrap_err(), @"/duts.csv: row 3: the serial number is blank");
        insta::assert_snapshot!(read("serial\nX1\n").unwrap_err(), @"/duts.csv: row 2: `X1` is not of the form `V##` (# digit, @ letter, ? either)");
        insta::assert_snapshot!(read("serial\n").unwrap_err(), @"/duts.csv: no valve: the file has a header and no row");
        insta::assert_snapshot!(read("lot\n1\n").unwrap_err(), @"/duts.csv: row 1: no column `serial`");
    }

    #[test]
    fn blank_and_known_entries_are_asked_again() {
        let mut input = "\nV01\nV02\n.\n".as_bytes();
        let common = Dut { lot: Some("L".into()), ..Dut::default() };
        let form = SerialForm::default();
        let mut next =
            || prompt(&mut input, |typed| entry(typed, &common, &form, |s| (s == "V01").then(|| "has passed already".into()))).unwrap();
        assert_eq!(next(), Entry::Refused("the serial number is blank".into()));
        assert_eq!(next(), Entry::Refused("`V01` has passed already".into()));
        assert_eq!(next(), Entry::Dut(Dut { serial: "V02".into(), lot: Some("L".into()), ..Dut::default() }));
        assert_eq!(next(), Entry::End);
    }
}
