//! The list of jobs: CSV, JSON lines or Parquet with `id`, `recording`, `model`, and free columns that stay with the row.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};

#[cfg(feature = "parquet")]
use parquet::{
    file::reader::{FileReader, SerializedFileReader},
    record::Field,
};

use super::FleetError;
use crate::recording::{Group, Mapping, Reading, Recording, groups};

/// One recording to work on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Names the job in every answer.
    pub id: String,
    /// The recording, as a path that can be opened from here.
    pub recording: PathBuf,
    /// Where the model comes from.
    pub model: ModelSource,
    /// The free columns: serial, lot, date, mileage, whatever the owner has.
    pub tags: BTreeMap<String, String>,
    /// The rows of `recording` that are meant, where it holds many recordings.
    pub group: Option<Group>,
}

impl Job {
    /// Reads the recording.
    ///
    /// # Errors
    /// The words for the row.
    pub fn read(&self, reading: &Reading) -> Result<Recording, String> {
        let read = match &self.group {
            None => Recording::read_as(&self.recording, reading),
            Some(group) => {
                let all = group.read(&self.recording, &reading.map).and_then(|all| all.selected(&reading.select));
                all.map(|recording| Recording { input: reading.input, ..recording })
            }
        };
        read.map_err(|e| e.to_string())
    }
}

/// Where the model of a job comes from.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum ModelSource {
    /// A valve file.
    File(PathBuf),
    /// Identified from a recording of the good valve.
    Identify(PathBuf),
    /// There is none: the reason is the row's.
    Missing(String),
}

impl ModelSource {
    /// As it stands in a row.
    pub fn text(&self) -> String {
        match self {
            Self::File(path) => path.display().to_string(),
            Self::Identify(path) => format!("identify:{}", path.display()),
            Self::Missing(_) => String::new(),
        }
    }
}

/// Reads a list; `-` is standard input (CSV or JSON lines). Paths in it are relative to the list's folder.
///
/// # Errors
/// [`FleetError::List`] where a row has no id or recording, an id comes twice, or the file is no list.
pub fn read(list: &str, models: Option<&Path>) -> Result<Vec<Job>, FleetError> {
    let wrong = |what: String| FleetError::List(format!("{list}: {what}"));
    let (rows, base) = if list == "-" {
        let mut text = String::new();
        std::io::stdin().read_to_string(&mut text).map_err(|e| wrong(e.to_string()))?;
        (of_text(&text).map_err(wrong)?, PathBuf::new())
    } else {
        let path = Path::new(list);
        let rows = if path.extension().is_some_and(|e| e == "parquet") {
            of_parquet(path).map_err(wrong)?
        } else {
            of_text(&std::fs::read_to_string(path).map_err(|e| wrong(e.to_string()))?).map_err(wrong)?
        };
        (rows, path.parent().map(Path::to_path_buf).unwrap_or_default())
    };
    let mut seen = BTreeSet::new();
    rows.into_iter()
        .enumerate()
        .map(|(k, row)| {
            let job = job(row, &base, models).map_err(|what| wrong(format!("row {}: {what}", k + 1)))?;
            if !seen.insert(job.id.clone()) {
                return Err(wrong(format!("row {}: the id `{}` comes twice; ids are unique in a list", k + 1, job.id)));
            }
            Ok(job)
        })
        .collect()
}

/// The jobs of a Parquet file that holds many recordings: one for each value of `column`, which is its id. Columns that
/// hold one value in all rows of a job are its free columns, `model` among them as in a list.
///
/// # Errors
/// [`FleetError::List`] where the file cannot be read or has no such column.
pub fn read_groups(list: &str, column: &str, map: &[Mapping], models: Option<&Path>) -> Result<Vec<Job>, FleetError> {
    let wrong = |what: String| FleetError::List(what);
    let path = Path::new(list);
    let base = path.parent().map(Path::to_path_buf).unwrap_or_default();
    let groups = groups(path, column, map).map_err(|e| wrong(e.to_string()))?;
    let one = |group: Group| {
        let mut cells = group.facts.clone();
        cells.insert(column.into(), group.value.clone());
        let model = model(&mut cells, &base, models);
        Job { id: group.value.clone(), recording: path.to_path_buf(), model, tags: cells, group: Some(group) }
    };
    Ok(groups.into_iter().map(one).collect())
}

type Cells = BTreeMap<String, String>;

fn of_text(text: &str) -> Result<Vec<Cells>, String> {
    let text = text.trim_start_matches('\u{feff}');
    if text.trim_start().starts_with('{') {
        let line = |(k, line): (usize, &str)| {
            let object: serde_json::Map<String, serde_json::Value> =
                serde_json::from_str(line).map_err(|e| format!("line {}: {e}; a line is one JSON object", k + 1))?;
            Ok(object.into_iter().filter_map(|(key, value)| Some((key, plain(value)?))).collect())
        };
        return text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()).map(line).collect();
    }
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let names = reader.headers().map_err(|e| e.to_string())?.clone();
    let cells = |row: csv::StringRecord| names.iter().zip(row.iter()).map(|(n, v)| (n.to_owned(), v.to_owned())).collect();
    reader.records().map(|row| row.map(cells).map_err(|e| e.to_string())).collect()
}

fn plain(value: serde_json::Value) -> Option<String> {
    match value {
        serde_json::Value::Null => None,
        serde_json::Value::String(text) => Some(text),
        other => Some(other.to_string()),
    }
}

#[cfg(not(feature = "parquet"))]
fn of_parquet(_path: &Path) -> Result<Vec<Cells>, String> {
    Err("this library was built without the feature `parquet`; CSV and JSON lines are read".into())
}

#[cfg(feature = "parquet")]
fn of_parquet(path: &Path) -> Result<Vec<Cells>, String> {
    let file = std::fs::File::open(path).map_err(|e| e.to_string())?;
    let reader = SerializedFileReader::new(file).map_err(|e| e.to_string())?;
    let rows = reader.get_row_iter(None).map_err(|e| e.to_string())?;
    rows.map(|row| {
        let row = row.map_err(|e| e.to_string())?;
        let cell = |(name, field): (&String, &Field)| match field {
            Field::Null => None,
            Field::Str(text) => Some((name.clone(), text.clone())),
            other => Some((name.clone(), other.to_string())),
        };
        Ok(row.get_column_iter().filter_map(cell).collect())
    })
    .collect()
}

fn job(mut cells: Cells, base: &Path, models: Option<&Path>) -> Result<Job, String> {
    let mut needed = |key: &str| {
        cells
            .remove(key)
            .filter(|v| !v.is_empty())
            .ok_or_else(|| format!("no `{key}`; a list has the columns id, recording, model and free ones"))
    };
    let (id, recording) = (needed("id")?, base.join(needed("recording")?));
    let model = model(&mut cells, base, models);
    Ok(Job { id, recording, model, tags: cells, group: None })
}

/// Where the model comes from: what the column says, or the part number's file.
fn model(cells: &mut Cells, base: &Path, models: Option<&Path>) -> ModelSource {
    match cells.remove("model").unwrap_or_default() {
        m if m.is_empty() => of_part(cells, models),
        m => match m.strip_prefix("identify:") {
            Some(sweep) => ModelSource::Identify(base.join(sweep)),
            None => ModelSource::File(base.join(m)),
        },
    }
}

/// The file of the part number in the folder of models.
fn of_part(cells: &Cells, models: Option<&Path>) -> ModelSource {
    let part = ["part_number", "part"].iter().find_map(|key| cells.get(*key)).filter(|p| !p.is_empty());
    match (models, part) {
        (None, _) => ModelSource::Missing("no model: give one in the column `model`, or --models DIR and a column `part_number`".into()),
        (_, None) => ModelSource::Missing("no model, and no `part_number` to look one up by".into()),
        (Some(_), Some(part)) if part.contains(['/', '\\']) || part.starts_with('.') => {
            ModelSource::Missing(format!("`{part}` is no part number that could name a file"))
        }
        (Some(folder), Some(part)) => ModelSource::File(folder.join(format!("{part}.toml"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(name: &str, text: &str) -> Result<(tempfile::TempDir, String), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join(name);
        std::fs::write(&path, text)?;
        Ok((folder, path.display().to_string()))
    }

    #[test]
    fn csv_and_json_lines_give_the_same_jobs() -> Result<(), Box<dyn std::error::Error>> {
        let (folder, csv) = written("a.csv", "id,recording,model,lot,mileage\n1,r/1.csv,identify:s.csv,L7,1200\n2,r/2.csv,,L8,\n")?;
        let jobs = read(&csv, None)?;
        assert_eq!((jobs[0].id.as_str(), &jobs[0].recording), ("1", &folder.path().join("r/1.csv")));
        assert_eq!(jobs[0].model, ModelSource::Identify(folder.path().join("s.csv")));
        assert_eq!(jobs[0].tags.get("mileage").map(String::as_str), Some("1200"));
        assert!(matches!(jobs[1].model, ModelSource::Missing(_)));
        let (other, lines) = written(
            "a.jsonl",
            "{\"id\":1,\"recording\":\"r/1.csv\",\"model\":\"identify:s.csv\",\"lot\":\"L7\",\"mileage\":1200}\n{\"id\":\"2\",\"recording\":\"r/2.csv\",\"lot\":\"L8\",\"mileage\":\"\"}\n",
        )?;
        let same: Vec<Job> = read(&lines, None)?;
        assert_eq!(same.iter().map(|j| (&j.id, &j.tags)).collect::<Vec<_>>(), jobs.iter().map(|j| (&j.id, &j.tags)).collect::<Vec<_>>());
        drop(other);
        Ok(())
    }

    #[test]
    fn a_part_number_finds_its_model_and_never_leaves_the_folder() -> Result<(), Box<dyn std::error::Error>> {
        let (_folder, csv) = written("a.csv", "id,recording,part_number\n1,a.csv,P1\n2,b.csv,../secret\n")?;
        let jobs = read(&csv, Some(Path::new("m")))?;
        assert_eq!(jobs[0].model, ModelSource::File(PathBuf::from("m/P1.toml")));
        assert!(matches!(&jobs[1].model, ModelSource::Missing(why) if why.contains("../secret")));
        Ok(())
    }

    #[test]
    fn a_wrong_list_is_refused_with_its_row() -> Result<(), Box<dyn std::error::Error>> {
        for (text, word) in [
            ("id,recording\n1,a.csv\n1,b.csv\n", "row 2: the id `1` comes twice"),
            ("id,recording\n1,\n", "row 1: no `recording`"),
            ("{\"id\":1}\n{oops\n", "line 2"),
        ] {
            let (_folder, path) = written("a.csv", text)?;
            assert!(read(&path, None).is_err_and(|e| e.to_string().contains(word)), "{text}");
        }
        Ok(())
    }
}
