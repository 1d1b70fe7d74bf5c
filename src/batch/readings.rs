//! The readings of a gauge study as a CSV file: `part,appraiser,trial,value`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use super::BatchError;
use super::msa::Study;
use crate::output::{inert, original};

/// Reads a study. `trial` may be missing: then the order of the rows counts.
///
/// # Errors
/// [`BatchError::Input`] with file and row.
pub fn read(path: &Path) -> Result<Study, BatchError> {
    let name = path.display().to_string();
    let wrong = |problem: String| BatchError::Input(format!("{name}: {problem}"));
    let text = crate::document::read_table(path).map_err(|e| BatchError::Input(e.to_string()))?;
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text);
    let headers = reader.headers().map_err(|e| wrong(e.to_string()))?.clone();
    let column = |wanted: &str| {
        let found = headers.iter().position(|h| h == wanted);
        found.ok_or_else(|| wrong(format!("row 1: no column `{wanted}`; part, appraiser and value are needed, trial may be there")))
    };
    let (part, appraiser, value) = (column("part")?, column("appraiser")?, column("value")?);
    let trial = headers.iter().position(|h| h == "trial");
    let mut parts: Vec<String> = Vec::new();
    let mut appraisers: Vec<String> = Vec::new();
    let mut cells: BTreeMap<(usize, usize), Vec<(f64, f64)>> = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|e| wrong(e.to_string()))?;
        let row = record.position().map_or(0, csv::Position::line);
        let field = |k: usize| record.get(k).unwrap_or_default();
        let number = |k: usize, what: &str| {
            let parsed = field(k).parse::<f64>().ok().filter(|v| v.is_finite());
            parsed.ok_or_else(|| wrong(format!("row {row}: {what} `{}` is no number", field(k))))
        };
        if field(part).is_empty() || field(appraiser).is_empty() {
            return Err(wrong(format!("row {row}: part or appraiser is blank")));
        }
        let place = |names: &mut Vec<String>, name: &str| {
            names.iter().position(|n| n == name).unwrap_or_else(|| {
                names.push(name.into());
                names.len() - 1
            })
        };
        let (i, j) = (place(&mut parts, original(field(part))), place(&mut appraisers, original(field(appraiser))));
        let order = trial.map(|k| number(k, "trial")).transpose()?.unwrap_or(row as f64);
        cells.entry((i, j)).or_default().push((order, number(value, "value")?));
    }
    let cell = |i: usize, j: usize| {
        let mut readings = cells.get(&(i, j)).cloned().unwrap_or_default();
        readings.sort_by(|a, b| a.0.total_cmp(&b.0));
        readings.into_iter().map(|r| r.1).collect()
    };
    let values = (0..parts.len()).map(|i| (0..appraisers.len()).map(|j| cell(i, j)).collect()).collect();
    Ok(Study { parts, appraisers, values })
}

/// The study as CSV.
pub fn write(study: &Study) -> String {
    let mut out = String::from("part,appraiser,trial,value\n");
    for (part, rows) in study.parts.iter().zip(&study.values) {
        for (appraiser, cell) in study.appraisers.iter().zip(rows) {
            for (k, value) in cell.iter().enumerate() {
                let _ = writeln!(out, "{},{},{},{value}", cell_text(part), cell_text(appraiser), k + 1);
            }
        }
    }
    out
}

/// A name as a cell: no formula of a spreadsheet, and in quotes where it holds what would end it.
fn cell_text(name: &str) -> String {
    let name = inert(name);
    if name.contains(['"', ',', '\n', '\r', '#']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.into_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_study_reads_back_and_a_wrong_row_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("readings.csv");
        let values = vec![vec![vec![1.0, 2.0], vec![3.0, 4.0]], vec![vec![5.0, 6.0], vec![7.0, 8.5]]];
        let study = Study { parts: vec!["p1".into(), "p2".into()], appraisers: vec!["a".into(), "b".into()], values };
        std::fs::write(&path, write(&study)).unwrap();
        assert_eq!(read(&path).unwrap(), study);
        std::fs::write(&path, "part,appraiser,value\np1,a,1\np1,a,x\n").unwrap();
        assert!(read(&path).unwrap_err().to_string().ends_with("row 3: value `x` is no number"));
        std::fs::write(&path, "part,value\n").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("no column `appraiser`"));
    }
}
