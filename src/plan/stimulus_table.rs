//! A stimulus from a CSV file.

use std::path::Path;

use super::LevelKind;

/// Largest table that is read [bytes].
const MAX_BYTES: u64 = 64 << 20;

/// Reads `time_s` and either `target_bar` or `current_a`: the kind, and rows of time and level.
pub fn read(path: &Path) -> Result<(LevelKind, Vec<(f64, f64)>), String> {
    let size = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if size.is_dir() {
        return Err("is a directory; a CSV file is wanted".into());
    }
    if size.len() > MAX_BYTES {
        return Err(format!("has {} bytes; at most {MAX_BYTES} are read", size.len()));
    }
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_path(path).map_err(|e| e.to_string())?;
    let header = reader.headers().map_err(|e| e.to_string())?.clone();
    let column = |name: &str| header.iter().position(|h| h.trim_start_matches('\u{feff}') == name);
    let time =
        column("time_s").ok_or_else(|| format!("has no column `time_s` (columns: {})", header.iter().collect::<Vec<_>>().join(", ")))?;
    let (kind, level) = match (column("target_bar"), column("current_a")) {
        (Some(c), _) => (LevelKind::Pressure, c),
        (None, Some(c)) => (LevelKind::Current, c),
        (None, None) => return Err("has neither a column `target_bar` nor `current_a`".into()),
    };
    let mut rows: Vec<(f64, f64)> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| e.to_string())?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize| {
            let text = record.get(column).unwrap_or("");
            text.parse::<f64>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| format!("line {line}: `{text}` in column `{}` is no number", &header[column]))
        };
        let (t, value) = (number(time)?, number(level)?);
        if rows.last().is_some_and(|last| t <= last.0) {
            return Err(format!("line {line}: the time {t} s does not come after {} s", rows[rows.len() - 1].0));
        }
        rows.push((t, value));
    }
    if rows.len() < 2 {
        return Err(format!("has {} rows; two at least are wanted", rows.len()));
    }
    Ok((kind, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Result<(LevelKind, Vec<(f64, f64)>), String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn the_columns_decide_the_kind() {
        assert_eq!(table("# made by hand\ntime_s,target_bar\n0,2\n1,20\n"), Ok((LevelKind::Pressure, vec![(0.0, 2.0), (1.0, 20.0)])));
        assert_eq!(table("current_a,time_s\n0.2,0\n0.3,1\n").unwrap().0, LevelKind::Current);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        insta::assert_snapshot!(table("time_s,target_bar\n0,2\n1,x\n").unwrap_err(), @"line 3: `x` in column `target_bar` is no number");
        insta::assert_snapshot!(table("time_s,target_bar\n0,2\n0,3\n").unwrap_err(), @"line 3: the time 0 s does not come after 0 s");
        insta::assert_snapshot!(table("t,target_bar\n0,2\n").unwrap_err(), @"has no column `time_s` (columns: t, target_bar)");
        insta::assert_snapshot!(table("time_s,target_bar\n0,2\n").unwrap_err(), @"has 1 rows; two at least are wanted");
    }
}
