//! The files that a command works with: found by name, with the defaults of the project (`hil.toml`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Deserialize;

use super::CliError;
use super::valves::checked_valve;
use crate::document;
use crate::plan::{Override, Plan};
use crate::shipped::{self, Kind, PROJECT_FILE};
use crate::valve::Valve;

/// The schema key of a project file.
pub const SCHEMA: &str = "hil.project/1";

/// A project: the folder of this file is where names are looked for, whatever folder below it a command runs in.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProjectFile {
    /// `hil.project/1`.
    pub schema: String,
    /// What is tested here.
    pub name: String,
    /// Valve that is simulated where neither the command nor the plan names one.
    pub valve: Option<String>,
    /// Limits file that `run` and `batch` apply to a plan, by the plan's name, where the command names none.
    #[serde(default)]
    pub limits: BTreeMap<String, PathBuf>,
}

impl ProjectFile {
    /// Reads and checks a project file.
    pub fn load(path: &Path) -> Result<Self, CliError> {
        let text = document::read(path).map_err(CliError::input)?;
        let name = path.display().to_string();
        document::expect_schema(&text, &name, SCHEMA, "a project file").map_err(CliError::input)?;
        let file: Self = document::parse(&text, &name).map_err(CliError::input)?;
        debug_assert_eq!(file.schema, SCHEMA);
        let root = path.parent().unwrap_or(Path::new(""));
        for (plan, limits) in &file.limits {
            if !root.join(limits).is_file() {
                let problem = format!("{}: no such file", limits.display());
                return Err(CliError::input(document::underline_key(&text, &name, &format!("limits.{plan}"), &problem)));
            }
        }
        Ok(file)
    }
}

/// The project of the current folder with its root, where there is one.
fn project() -> Result<Option<(PathBuf, ProjectFile)>, CliError> {
    let Some(root) = shipped::project() else { return Ok(None) };
    Ok(Some((root.clone(), ProjectFile::load(&root.join(PROJECT_FILE))?)))
}

/// The path that is meant by a plan's path or bare name.
pub fn find_plan(typed: &Path) -> Result<PathBuf, CliError> {
    // A name that is no text can only be a path.
    let Some(name) = typed.to_str().filter(|_| !typed.is_file()) else { return Ok(typed.into()) };
    shipped::find(Kind::Plan, name, None).map_err(CliError::input)
}

/// The plan behind a path or a bare name.
pub fn plan(typed: &Path, set: &[Override]) -> Result<Plan, CliError> {
    Plan::load(&find_plan(typed)?, set).map_err(CliError::input)
}

/// A file of a batch by path, or by the bare name of a shipped one; `what` and its schema key tell the kinds of them apart.
fn batch_file(typed: &Path, what: &str, schema: &str) -> Result<PathBuf, CliError> {
    let Some(name) = typed.to_str().filter(|_| !typed.is_file()) else { return Ok(typed.into()) };
    shipped::find(Kind::Batch, name, None).map_err(|_| {
        if typed.is_dir() {
            return CliError::input(format!("{name}: is a directory; a {what} is wanted"));
        }
        let key = format!("schema = \"{schema}\"");
        let folder = Kind::Batch.folder();
        let of_kind =
            |n: &&str| shipped::text(Path::new(&format!("{}{folder}/{n}.toml", shipped::PREFIX))).is_some_and(|t| t.contains(&key));
        let known: Vec<&str> = Kind::Batch.names().filter(of_kind).collect();
        let near = document::nearest(name, known.iter().copied()).map_or_else(String::new, |n| format!(" (did you mean `{n}`?)"));
        let there = known.join(", ");
        CliError::input(format!("no {what} `{name}`: no such file, and none that ships with the program{near}; there are: {there}"))
    })
}

/// A population by path, or by the bare name of a shipped one.
pub fn population(typed: &Path) -> Result<PathBuf, CliError> {
    batch_file(typed, "population", crate::batch::population::SCHEMA)
}

/// A station by path, or by the bare name of a shipped one.
pub fn station(typed: &Path) -> Result<PathBuf, CliError> {
    batch_file(typed, "station", crate::batch::station::SCHEMA)
}

/// The limits file for a plan: the one that was typed, or the project's.
pub fn limits(typed: Option<&Path>, plan: &str) -> Result<Option<PathBuf>, CliError> {
    if let Some(path) = typed {
        return batch_file(path, "limits file", crate::plan::LIMITS_SCHEMA).map(Some);
    }
    let Some((root, project)) = project()? else { return Ok(None) };
    let Some(path) = project.limits.get(plan) else { return Ok(None) };
    super::say(&format!("limits of {} ({PROJECT_FILE})", path.display()));
    Ok(Some(root.join(path)))
}

/// The valve file behind a path or a bare name.
pub fn valve(name: &str) -> Result<(Valve, PathBuf), CliError> {
    let path = Valve::find(name).map_err(CliError::input)?;
    Ok((checked_valve(&path)?, path))
}

/// The valve that runs under a plan: the one that was typed, the plan's own, the project's, or the paper's.
pub fn valve_under(plan: &Plan, typed: Option<&str>) -> Result<(Valve, PathBuf), CliError> {
    let path = match (typed, &plan.valve) {
        // What was typed as a path is relative to where it was typed.
        (Some(name), _) => Valve::find_beside(name, shipped::is_bare(name).then(|| plan.folder())),
        (None, Some(name)) => Valve::find_beside(name, Some(plan.folder())),
        (None, None) => {
            let of_project = project()?.and_then(|(root, p)| Some((root, p.valve?)));
            match of_project {
                Some((root, name)) => {
                    let found = Valve::find_beside(&name, Some(&root));
                    return match found {
                        Ok(path) => Ok((checked_valve(&path)?, path)),
                        Err(e) => Err(CliError::input(format!("{}: valve: {e}", root.join(PROJECT_FILE).display()))),
                    };
                }
                None => Valve::find("paper"),
            }
        }
    }
    .map_err(CliError::input)?;
    Ok((checked_valve(&path)?, path))
}

/// The path that is meant by a path or by the bare name of any shipped file; what is not found stays as it was typed.
pub fn any(typed: &Path) -> PathBuf {
    let name = typed.to_str().filter(|name| !typed.exists() && shipped::is_bare(name));
    name.and_then(|name| Kind::ALL.into_iter().find_map(|kind| shipped::find(kind, name, None).ok())).unwrap_or_else(|| typed.into())
}

/// What to say of a bare name that no file of any kind has, with the nearest that ships.
pub fn nothing_of(typed: &Path) -> Option<String> {
    let name = typed.to_str().filter(|name| !typed.exists() && shipped::is_bare(name))?;
    let near = document::nearest(name, Kind::ALL.into_iter().flat_map(Kind::names));
    let hint = near.map_or_else(String::new, |n| format!(" (did you mean `{n}`?)"));
    Some(format!("{name}: no such file, and none that ships with the program{hint}"))
}

/// Every file of the project that has a schema: what `hil check` checks where it is given none.
pub fn of_project() -> Result<Vec<PathBuf>, CliError> {
    let Some(root) = shipped::project() else {
        return Err(CliError::usage(format!(
            "name the files to check; without any, the project is checked, and there is no {PROJECT_FILE} here"
        )));
    };
    let mut files = vec![root.join(PROJECT_FILE)];
    // A station, a population; other programs keep their files here, too, and so do logs their mappings.
    let beside = std::fs::read_dir(&root).into_iter().flatten().filter_map(|e| Some(e.ok()?.path()));
    let is_ours = |p: &PathBuf| {
        let is_toml = p.extension().is_some_and(|e| e == "toml") && p.file_name().is_some_and(|n| n != PROJECT_FILE);
        let kinds = [crate::batch::station::SCHEMA, crate::batch::population::SCHEMA];
        let known = |text: String| Some(kinds.contains(&text.parse::<toml::Table>().ok()?.get("schema")?.as_str()?));
        is_toml && std::fs::read_to_string(p).ok().and_then(known).unwrap_or(false)
    };
    let mut beside: Vec<PathBuf> = beside.filter(is_ours).collect();
    beside.sort();
    files.extend(beside);
    for folder in ["plans", "valves", "drivers", "limits"] {
        let entries = std::fs::read_dir(root.join(folder)).into_iter().flatten().filter_map(|e| Some(e.ok()?.path()));
        let mut found: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == "toml")).collect();
        found.sort();
        files.extend(found);
    }
    let here = std::env::current_dir().unwrap_or_default();
    Ok(files.into_iter().map(|f| f.strip_prefix(&here).map(Path::to_path_buf).unwrap_or(f)).collect())
}
