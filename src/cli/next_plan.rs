//! The plan of the next experiment, and the valve that it names. A plan reads files of its project alone: a model that lies
//! elsewhere is laid beside the plan.

use std::fs;
use std::path::{Component, Path, PathBuf};

use super::{CliError, note};
use crate::diagnose::Diagnosed;
use crate::plan::project;
use crate::shipped;

/// Where a plan is to be written, and which valve it names.
#[derive(Debug)]
pub(super) struct NextPlan {
    /// The plan.
    pub(super) path: PathBuf,
    /// What the plan calls its valve.
    valve: String,
    /// The copy beside the plan, and of what; `None` where the plan may read the model in its place.
    copy: Option<(PathBuf, PathBuf)>,
}

impl NextPlan {
    /// A plan at `path` that drives the valve in `model`, a file that exists or that is written before the plan.
    pub(super) fn of(path: &Path, model: &Path) -> Self {
        let made = |valve: String, copy| Self { path: path.into(), valve, copy };
        if shipped::is_shipped(model) {
            return made(model.display().to_string(), None);
        }
        let folder = settled(path.parent().unwrap_or(Path::new("")));
        let file = settled(model);
        if file.starts_with(project(&folder)) {
            return made(between(&folder, &file), None);
        }
        let name = format!("{}-valve.toml", path.file_stem().unwrap_or_default().to_string_lossy());
        let copy = path.with_file_name(&name);
        made(name, Some((copy, model.into())))
    }

    /// The copy of the model that is written with the plan.
    pub(super) fn copy(&self) -> Option<&Path> {
        self.copy.as_ref().map(|(copy, _)| copy.as_path())
    }

    /// Writes the plan and what it needs, or says why there is none.
    pub(super) fn write(&self, found: &Diagnosed, store: impl Fn(&Path, &str) -> Result<(), CliError>) -> Result<(), CliError> {
        let Some(next) = &found.diagnosis.next_experiment else {
            note(&format!("this recording leaves nothing open that an experiment could decide; {} is not written", self.path.display()));
            return Ok(());
        };
        if let Some((copy, model)) = &self.copy {
            let text = fs::read_to_string(model).map_err(|e| CliError::input(format!("{}: {e}", model.display())))?;
            store(copy, &text)?;
            note(&format!("{} is a copy of {}: a plan reads files of its project alone", copy.display(), model.display()));
        }
        store(&self.path, &next.plan(&self.valve, &found.augmented))
    }
}

/// A path with its links followed, of a file that may be still to be written.
fn settled(path: &Path) -> PathBuf {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    path.canonicalize().unwrap_or_else(|_| match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) => settled(folder).join(name),
        _ => path.into(),
    })
}

/// The way from a folder to a file, both settled.
fn between(folder: &Path, file: &Path) -> String {
    let shared = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let steps = up.chain(file.components().skip(shared)).map(|c| c.as_os_str().to_string_lossy());
    steps.collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_names_the_valve_from_its_place_or_takes_a_copy() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for path in ["project/plans", "project/valves", "elsewhere"] {
            fs::create_dir_all(at(path)).unwrap();
        }
        for file in ["project/valves/v.toml", "elsewhere/v.toml"] {
            fs::write(at(file), "x").unwrap();
        }
        std::os::unix::fs::symlink(at("elsewhere/v.toml"), at("project/plans/link.toml")).unwrap();
        let of = |plan: &str, model: &Path| {
            let next = NextPlan::of(&at(plan), model);
            (next.valve.clone(), next.copy().map(Path::to_path_buf))
        };
        let copied = |plan: &str| (format!("{plan}-valve.toml"), Some(at(&format!("project/plans/{plan}-valve.toml"))));
        assert_eq!(of("project/plans/next.toml", &at("project/valves/v.toml")), copied("next"), "without a mark the project is the folder");
        fs::write(at("project/hil.toml"), "").unwrap();
        assert_eq!(of("project/plans/next.toml", &at("project/valves/v.toml")), ("../valves/v.toml".into(), None));
        assert_eq!(of("project/next.toml", &at("project/valves/not-yet.toml")), ("valves/not-yet.toml".into(), None));
        assert_eq!(of("project/plans/next.toml", &at("elsewhere/v.toml")), copied("next"));
        assert_eq!(of("project/plans/more.toml", &at("project/plans/link.toml")), copied("more"));
        let shipped = Path::new("hil:valves/paper.toml");
        assert_eq!(of("elsewhere/next.toml", shipped), ("hil:valves/paper.toml".into(), None));
    }
}
