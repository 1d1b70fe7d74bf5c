//! Recordings that are columns in memory already: data frames, arrays.

use super::mapping::Role;
use super::source::{Rows, resolve};
use super::{Mapping, Recording, RecordingError, clean};

/// The values of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ColumnValues<'a> {
    /// Numbers; NaN is a gap.
    Numbers(&'a [f64]),
    /// Texts, for the names of runs.
    Texts(&'a [String]),
    /// Neither; such a column may be there and cannot be taken.
    Other,
}

impl ColumnValues<'_> {
    fn len(&self) -> Option<usize> {
        match self {
            Self::Numbers(values) => Some(values.len()),
            Self::Texts(texts) => Some(texts.len()),
            Self::Other => None,
        }
    }
}

impl Recording {
    /// A recording from named columns, by the same rules as from a file; `source` stands in the messages.
    ///
    /// # Errors
    /// [`RecordingError`] as for files: a column that is missing, not equally long, or no numbers.
    pub fn from_columns(source: &str, columns: &[(&str, ColumnValues<'_>)], map: &[Mapping]) -> Result<Self, RecordingError> {
        let names: Vec<String> = columns.iter().map(|(name, _)| (*name).to_string()).collect();
        let sources = resolve(source, &names, map, false)?;
        let mut rows = Rows::new(source, &sources, false);
        let mut length = None;
        for wanted in &sources {
            let (name, values) = columns[wanted.column];
            if let (Some(first), Some(here)) = (*length.get_or_insert(values.len()), values.len())
                && first != here
            {
                return Err(RecordingError::format(source, format!("column `{name}` has {here} values, others have {first}")));
            }
            match (wanted.role, values) {
                (Role::Run, ColumnValues::Texts(texts)) => name_runs(&mut rows, texts.iter().cloned()),
                (Role::Run, ColumnValues::Numbers(numbers)) => name_runs(&mut rows, numbers.iter().map(f64::to_string)),
                (role, ColumnValues::Numbers(numbers)) => {
                    let Some(into) = rows.values(role) else { continue };
                    let taken = |v: &f64| if v.is_finite() { v * wanted.scale + wanted.offset } else { f64::NAN };
                    *into = numbers.iter().map(taken).collect();
                }
                (..) => return Err(RecordingError::format(source, format!("column `{name}` holds no numbers"))),
            }
        }
        clean::recording(rows)
    }
}

/// A run begins wherever the name changes.
fn name_runs(rows: &mut Rows, names: impl Iterator<Item = String>) {
    for (row, name) in names.enumerate() {
        let name = Some(name).filter(|n| !n.is_empty());
        if rows.segments.last().is_none_or(|(last, _)| *last != name) {
            rows.segments.push((name, row));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_give_what_the_same_file_gives() {
        let mut text = String::from("run,t,I,pressure_bar\n");
        let (mut runs, mut time, mut current, mut pressure) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for k in 0..300 {
            let run = if k < 100 { "up" } else { "down" };
            let (t, i) = (f64::from(k) / 64.0, 300.0 + f64::from(k));
            let p = if k == 17 { f64::NAN } else { f64::from(k) / 16.0 };
            text += &format!("{run},{t},{i},{}\n", if p.is_nan() { String::new() } else { p.to_string() });
            runs.push(run.to_string());
            time.push(t);
            current.push(i);
            pressure.push(p);
        }
        let map = ["time_s=t", "current_a=I [mA]"].map(|m| Mapping::parse(m).unwrap());
        let columns = [
            ("run", ColumnValues::Texts(&runs)),
            ("t", ColumnValues::Numbers(&time)),
            ("note", ColumnValues::Other),
            ("I", ColumnValues::Numbers(&current)),
            ("pressure_bar", ColumnValues::Numbers(&pressure)),
        ];
        let ours = Recording::from_columns("frame", &columns, &map).unwrap();
        let file = Recording::from_csv(text, "frame", &map).unwrap();
        // NaN is not equal to itself; the printed form is.
        assert_eq!(format!("{:?}", ours.runs), format!("{:?}", file.runs));
    }

    #[test]
    fn what_cannot_be_taken_is_named() {
        let time = [0.0, 0.1];
        let wrong = |columns: &[(&str, ColumnValues<'_>)]| Recording::from_columns("frame", columns, &[]).unwrap_err().to_string();
        let short = wrong(&[("time_s", ColumnValues::Numbers(&time)), ("current_a", ColumnValues::Numbers(&time[..1]))]);
        assert!(short.contains("`current_a` has 1 values, others have 2"), "{short}");
        let other = wrong(&[("time_s", ColumnValues::Numbers(&time)), ("current_a", ColumnValues::Other)]);
        assert!(other.contains("`current_a` holds no numbers"), "{other}");
    }
}
