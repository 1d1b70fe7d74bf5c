//! Which files a plan may name: those of its project, and those that ship with the program. A plan comes from a pull
//! request or a mail; what lies elsewhere on this machine is not its business.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use crate::shipped;
use crate::valve::Valve;

/// Set by the person at the command line, for the whole process.
static ANYWHERE: AtomicBool = AtomicBool::new(false);

/// Lets plans read files outside of their projects.
pub fn allow_anywhere() {
    ANYWHERE.store(true, Ordering::Relaxed);
}

/// The project of a plan in `folder`: the nearest folder up with `hil.toml` or `.git`, else the folder itself.
pub fn project(folder: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let marked = |p: &&Path| p.join("hil.toml").is_file() || p.join(".git").exists();
    folder.ancestors().find(marked).unwrap_or(&folder).to_path_buf()
}

/// Refuses the file that is read where a plan in `folder` names it, if it lies outside of the plan's project, links followed. A bare name
/// means what lies about the person at work, too: the projects of the folders where such names are looked for count as well.
///
/// What does not exist cannot be read; that it does not is told by whoever looks for it.
pub(super) fn check(folder: &Path, name: &str, file: &Path) -> Result<(), String> {
    let Ok(file) = file.canonicalize() else { return Ok(()) };
    let roots = if shipped::is_bare(name) { shipped::folders(Some(folder)) } else { vec![folder.into()] };
    if ANYWHERE.load(Ordering::Relaxed) || roots.iter().any(|root| file.starts_with(project(root))) {
        return Ok(());
    }
    Err(format!(
        "`{name}` lies outside of the plan's project ({}); --allow-outside lets plans read files elsewhere",
        project(folder).display()
    ))
}

/// The same for a valve, which is looked for by its name.
pub(super) fn check_valve(folder: &Path, name: &str) -> Result<(), String> {
    Valve::find_beside(name, Some(folder)).map_or(Ok(()), |file| check(folder, name, &file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_reads_its_project_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for path in ["project/plans", "project/valves", "elsewhere"] {
            std::fs::create_dir_all(at(path)).unwrap();
        }
        for file in ["project/valves/v.toml", "elsewhere/secret.toml", "project/plans/own.toml"] {
            std::fs::write(at(file), "x").unwrap();
        }
        std::os::unix::fs::symlink(at("elsewhere/secret.toml"), at("project/plans/link.toml")).unwrap();
        let plans = at("project/plans");
        let asked = |name: &str| check_valve(&plans, name).is_ok();
        assert!(asked("own.toml") && asked("paper") && asked("no-such.toml"));
        assert!(!asked("../valves/v.toml"), "without a mark, the project is the plan's own folder");
        assert!(!asked("Cargo.toml"), "in the current folder");
        std::fs::write(at("project/plans/Cargo.toml"), "").unwrap();
        assert!(asked("Cargo.toml"), "the one beside the plan is read");
        std::fs::write(at("project/hil.toml"), "").unwrap();
        assert!(asked("../valves/v.toml"));
        let secret = at("elsewhere/secret.toml");
        for name in ["../../elsewhere/secret.toml", "link.toml", "/etc/passwd", secret.to_str().unwrap()] {
            let refused = check_valve(&plans, name).unwrap_err();
            assert!(refused.contains("--allow-outside"), "{name}: {refused}");
        }
        // By a name of which the path is made, too: a link beside the plan, one in the folder of valves, and one behind a folder of its name.
        for (link, name) in [("plans/near.toml", "near"), ("valves/far.toml", "far"), ("valves/hidden.toml", "hidden.toml")] {
            std::os::unix::fs::symlink(&secret, at("project").join(link)).unwrap();
            std::fs::create_dir_all(at("project/plans/hidden.toml")).unwrap();
            assert!(check_valve(&plans, name).unwrap_err().contains("--allow-outside"), "{name}");
        }
        assert!(asked("v") && asked("own"));
    }
}
