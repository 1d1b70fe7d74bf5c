//! The files that ship with the program, and where a name is looked for.
//!
//! Plans, valves and driver profiles are part of the binary. A bare name (`tipin`, `paper`) is looked for beside the
//! plan that is at work, then in the current folder, then in the project (the folder with a `hil.toml` in or above the
//! current one), and last among the shipped files. A shipped file has the path `hil:plans/tipin.toml`: it can be typed
//! to mean that very file, whatever lies in the folder.

use std::path::{Path, PathBuf};

/// What the path of a shipped file begins with.
pub const PREFIX: &str = "hil:";
/// The file that makes a folder a project.
pub const PROJECT_FILE: &str = "hil.toml";

/// Path below the repository, and text.
static FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// A kind of file that is found by its bare name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A test plan.
    Plan,
    /// A valve model.
    Valve,
    /// A driver profile.
    Driver,
    /// What a batch needs beside its plan: population, limits, station.
    Batch,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::Plan, Self::Valve, Self::Driver, Self::Batch];

    /// The folder that holds files of this kind.
    pub fn folder(self) -> &'static str {
        match self {
            Self::Plan => "plans",
            Self::Valve => "valves",
            Self::Driver => "drivers",
            Self::Batch => "examples/batch",
        }
    }

    /// As a message names it.
    fn name(self) -> &'static str {
        match self {
            Self::Plan => "plan",
            Self::Valve => "valve",
            Self::Driver => "driver profile",
            Self::Batch => "file of a batch",
        }
    }

    /// Bare names of the shipped files of this kind.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let folder = self.folder();
        FILES.iter().filter_map(move |(path, _)| path.strip_prefix(folder)?.strip_prefix('/')?.strip_suffix(".toml"))
    }
}

/// No file of a name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct NotFound(pub String);

/// The text of a shipped file by its path `hil:plans/tipin.toml`; `None` for any other path.
pub fn text(path: &Path) -> Option<&'static str> {
    let place = path.to_str()?.strip_prefix(PREFIX)?;
    FILES.iter().find(|f| f.0 == place).map(|f| f.1)
}

/// Whether a path means a shipped file, there or not.
pub fn is_shipped(path: &Path) -> bool {
    path.to_str().is_some_and(|p| p.starts_with(PREFIX))
}

/// Whether a name is bare: neither a path nor a file name with its extension.
pub fn is_bare(name: &str) -> bool {
    !name.contains(['/', '\\', ':']) && !name.ends_with(".toml")
}

/// The project that the current folder belongs to: the nearest folder in or above it with a `hil.toml`.
pub fn project() -> Option<PathBuf> {
    let here = std::env::current_dir().ok()?;
    here.ancestors().find(|folder| folder.join(PROJECT_FILE).is_file()).map(Path::to_path_buf)
}

/// Finds the file of a kind that `name` means: a path, or a bare name.
///
/// `beside` is the folder of the plan that is at work; it goes first. A name that is no path is also looked for in the
/// folder of its kind (`valves/`), beside the plan's own folder, too.
///
/// # Errors
/// What was looked for, the nearest name, and what there is.
pub fn find(kind: Kind, name: &str, beside: Option<&Path>) -> Result<PathBuf, NotFound> {
    if let Some(place) = name.strip_prefix(PREFIX) {
        let there = FILES.iter().any(|f| f.0 == place);
        return if there { Ok(name.into()) } else { Err(not_found(kind, name)) };
    }
    let is_file = |path: &PathBuf| path.exists() && !path.is_dir();
    let direct = |folder: &Path| [folder.join(name), folder.join(format!("{name}.toml"))];
    let in_kind = |folder: &Path| direct(&folder.join(kind.folder()));
    for folder in &folders(beside) {
        let paths = if Path::new(name).is_absolute() || name.contains(['/', '\\']) {
            vec![folder.join(name)]
        } else {
            direct(folder).into_iter().chain(in_kind(folder)).collect()
        };
        if let Some(path) = paths.into_iter().find(is_file) {
            return Ok(path);
        }
    }
    let bare = name.strip_suffix(".toml").unwrap_or(name);
    match kind.names().find(|n| *n == bare) {
        Some(bare) => Ok(PathBuf::from(format!("{PREFIX}{}/{bare}.toml", kind.folder()))),
        None => Err(not_found(kind, name)),
    }
}

/// The folders in which [`find`] looks, in its order.
pub fn folders(beside: Option<&Path>) -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = Vec::new();
    if let Some(beside) = beside.filter(|b| !is_shipped(b)) {
        folders.push(beside.into());
        if Kind::ALL.iter().any(|k| beside.ends_with(k.folder())) {
            folders.push(beside.join(".."));
        }
    }
    folders.push(PathBuf::new());
    folders.extend(project());
    folders
}

fn not_found(kind: Kind, name: &str) -> NotFound {
    if Path::new(name).is_dir() {
        return NotFound(format!("{name}: is a directory; a {} is wanted", kind.name()));
    }
    let mut own: Vec<String> = std::fs::read_dir(kind.folder())
        .into_iter()
        .flatten()
        .filter_map(|e| e.ok()?.path().file_name()?.to_str()?.strip_suffix(".toml").map(String::from))
        .collect();
    own.retain(|n| !kind.names().any(|s| s == n));
    own.sort();
    let known: Vec<&str> = own.iter().map(|n| n.as_str()).chain(kind.names().map(|n| n as &str)).collect();
    let stem = Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
    let near = known.iter().min_by_key(|k| strsim::osa_distance(k, stem)).filter(|k| strsim::osa_distance(k, stem) <= 2);
    let hint = match near {
        Some(near) if *near == stem => format!(" (`{near}` alone means the one that ships with the program)"),
        Some(near) => format!(" (did you mean `{near}`?)"),
        None => String::new(),
    };
    NotFound(format!(
        "no {} `{name}`: no such file, and none that ships with the program{hint}; there are: {}",
        kind.name(),
        known.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_repository_is_in_the_binary() {
        for kind in Kind::ALL {
            let mut there = 0;
            for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(kind.folder())).unwrap() {
                let path = entry.unwrap().path();
                if path.extension().is_some_and(|e| e == "toml") {
                    let shipped = PathBuf::from(format!("{PREFIX}{}/{}", kind.folder(), path.file_name().unwrap().to_str().unwrap()));
                    assert_eq!(text(&shipped), Some(std::fs::read_to_string(&path).unwrap().as_str()), "{}", path.display());
                    there += 1;
                }
            }
            assert_eq!(there, kind.names().count(), "{kind:?}");
            assert!(there > 0);
        }
    }

    #[test]
    fn beside_the_plan_goes_before_the_folder_and_that_before_the_shipped() {
        let beside = tempfile::tempdir().unwrap();
        let plans = beside.path().join("plans");
        std::fs::create_dir_all(&plans).unwrap();
        std::fs::create_dir_all(beside.path().join("valves")).unwrap();
        let find = |name: &str| find(Kind::Valve, name, Some(&plans)).map(|p| p.display().to_string());
        let put = |path: &str| std::fs::write(beside.path().join(path), "x").unwrap();
        assert_eq!(find("hil:valves/paper.toml").unwrap(), "hil:valves/paper.toml");
        // The tests run in the repository, whose own valves/ is the current folder's.
        assert_eq!(find("paper").unwrap(), "valves/paper.toml");
        put("valves/paper.toml");
        assert!(find("paper").unwrap().ends_with("plans/../valves/paper.toml"));
        put("plans/paper.toml");
        assert!(find("paper").unwrap().ends_with("plans/paper.toml"));
        assert!(find("../valves/paper.toml").unwrap().ends_with("plans/../valves/paper.toml"));
        // A folder of that name is no file.
        std::fs::create_dir(plans.join("clutch-1")).unwrap();
        assert_eq!(find("clutch-1").unwrap(), "valves/clutch-1.toml");
    }

    #[test]
    fn what_is_not_there_is_answered_with_what_is() {
        let message = |name: &str| find(Kind::Valve, name, None).unwrap_err().to_string();
        assert!(message("papr").contains("(did you mean `paper`?); there are: "), "{}", message("papr"));
        assert!(message("elsewhere/paper.toml").contains("`paper` alone means"), "{}", message("elsewhere/paper.toml"));
        assert!(message("hil:valves/none.toml").contains("no valve `hil:valves/none.toml`"));
        assert!(message("src").contains("is a directory"));
        assert!(text(Path::new("hil:../Cargo.toml")).is_none());
    }
}
