//! The guard: every output of a command is claimed before its work begins.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use super::whole::{clear_leftovers, folder_of, make_folder, part_of};
use super::{Mark, OutputError};

/// What makes a folder one that holds a record, or a batch of them.
const RECORDS: [&str; 3] = ["record.json", "batch.json", "journal"];

/// What a command reads and writes. Nothing is touched before [`Outputs::claim`].
#[derive(Debug, Clone, Default)]
#[must_use]
pub struct Outputs {
    force: bool,
    inputs: Vec<PathBuf>,
    files: Vec<(PathBuf, Mark)>,
    folders: Vec<(PathBuf, Vec<(&'static str, Mark)>)>,
}

/// Holds the folders of a command; another process that asks for one of them is refused for as long as this lives.
#[derive(Debug)]
#[must_use]
pub struct Claim {
    _locks: Vec<File>,
}

impl Outputs {
    /// No outputs yet. With `force`, existing files are replaced also where they carry no mark; an input, another output and a
    /// record never.
    pub fn new(force: bool) -> Self {
        Self { force, ..Self::default() }
    }

    /// Files that the command reads.
    pub fn reads<P: AsRef<Path>>(mut self, paths: impl IntoIterator<Item = P>) -> Self {
        self.inputs.extend(paths.into_iter().map(|p| p.as_ref().to_path_buf()));
        self
    }

    /// A file that the command writes, where it was asked for; an existing one with the same mark is replaced.
    pub fn file<P: AsRef<Path>>(mut self, path: Option<P>, mark: Mark) -> Self {
        self.files.extend(path.map(|p| (p.as_ref().to_path_buf(), mark)));
        self
    }

    /// A folder that the command fills with the files `names`, where it was asked for. It is made where it does not exist.
    pub fn folder<P: AsRef<Path>>(mut self, path: Option<P>, names: &[(&'static str, Mark)]) -> Self {
        self.folders.extend(path.map(|p| (p.as_ref().to_path_buf(), names.to_vec())));
        self
    }

    /// Checks every output against the inputs, against the others and against what is there, and that it can be written.
    ///
    /// # Errors
    /// The first [`OutputError`]; nothing was written or made then, but for folders.
    pub fn claim(self) -> Result<Claim, OutputError> {
        for (at, (path, mark)) in self.files.iter().enumerate() {
            if let Some(input) = self.inputs.iter().find(|input| same(path, input)) {
                return Err(OutputError::IsInput { path: path.clone(), input: input.clone() });
            }
            if let Some((other, _)) = self.files[..at].iter().find(|(other, _)| same(path, other)) {
                return Err(OutputError::Twice { path: path.clone(), other: other.clone() });
            }
            self.replaceable(path, *mark, false)?;
        }
        for (at, (folder, names)) in self.folders.iter().enumerate() {
            if let Some((other, _)) = self.folders[..at].iter().find(|(other, _)| same(folder, other)) {
                return Err(OutputError::Twice { path: folder.clone(), other: other.clone() });
            }
            holds_no_record(folder)?;
            for (name, mark) in names {
                let path = folder.join(name);
                if let Some(input) = self.inputs.iter().find(|input| same(&path, input)) {
                    return Err(OutputError::IsInput { path, input: input.clone() });
                }
                self.replaceable(&path, *mark, true)?;
            }
        }
        for (path, _) in &self.files {
            clear_leftovers(folder_of(path));
            writable(path)?;
        }
        let locks = self.folders.iter().map(|(folder, _)| hold(folder)).collect::<Result<Vec<File>, _>>()?;
        Ok(Claim { _locks: locks })
    }

    /// Whether what stands at `path` may be replaced; a name in a folder may be that of a folder too.
    fn replaceable(&self, path: &Path, mark: Mark, in_folder: bool) -> Result<(), OutputError> {
        let Ok(meta) = fs::symlink_metadata(path) else { return Ok(()) };
        let exists = |found: String| OutputError::Exists { path: path.into(), found };
        if meta.is_dir() && in_folder {
            return if self.force { Ok(()) } else { Err(exists("is a folder".into())) };
        }
        if meta.is_dir() {
            return Err(OutputError::Unwritable { path: path.into(), reason: "is a folder; a file is wanted".into() });
        }
        // A device or a pipe would be replaced by a file of its name.
        if !meta.is_file() && !meta.is_symlink() {
            return Err(OutputError::Unwritable { path: path.into(), reason: "is a device or a pipe; a file is wanted".into() });
        }
        if mark != Mark::None && mark.is_on(path) {
            return Ok(());
        }
        let parent = folder_of(path);
        if RECORDS.iter().any(|name| parent.join(name).exists()) {
            return Err(OutputError::Record { path: path.into(), what: "is part of a record".into() });
        }
        if self.force { Ok(()) } else { Err(exists(format!("is not {}", mark.what()))) }
    }
}

/// Whether two paths are the same file: by what the file system says of those that exist, by folder and name of the others. Names
/// that differ by case alone are the same on some disks, and taken so on all.
fn same(a: &Path, b: &Path) -> bool {
    match (fs::metadata(a), fs::metadata(b)) {
        (Ok(a), Ok(b)) => return same_file(&a, &b),
        (Err(_), Err(_)) => {}
        _ => return false,
    }
    let name = |p: &Path| p.file_name().map(|n| n.to_string_lossy().to_lowercase());
    let (Ok(x), Ok(y)) = (fs::canonicalize(folder_of(a)), fs::canonicalize(folder_of(b))) else { return a == b };
    x == y && name(a) == name(b)
}

#[cfg(unix)]
fn same_file(a: &fs::Metadata, b: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn same_file(a: &fs::Metadata, b: &fs::Metadata) -> bool {
    (a.len(), a.modified().ok(), a.created().ok()) == (b.len(), b.modified().ok(), b.created().ok())
}

fn holds_no_record(folder: &Path) -> Result<(), OutputError> {
    match RECORDS.iter().find(|name| folder.join(name).symlink_metadata().is_ok()) {
        Some(name) => Err(OutputError::Record { path: folder.into(), what: format!("holds a record (`{name}`)") }),
        None => Ok(()),
    }
}

/// Whether a file can be made at `path`, tried with a part that goes again.
fn writable(path: &Path) -> Result<(), OutputError> {
    let fail = |reason: String| OutputError::Unwritable { path: path.into(), reason };
    if fs::metadata(path).is_ok_and(|m| m.permissions().readonly()) {
        return Err(fail("is write-protected".into()));
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(fail(format!("there is no folder {}", folder.display())));
    }
    let (part, _file) = part_of(path).map_err(|e| fail(e.to_string()))?;
    fs::remove_file(&part).map_err(|e| fail(e.to_string()))
}

/// Makes the folder, tries that it can be written, and keeps others out of it.
fn hold(folder: &Path) -> Result<File, OutputError> {
    let fail = |e: std::io::Error| OutputError::Unwritable { path: folder.into(), reason: e.to_string() };
    make_folder(folder).map_err(fail)?;
    let lock = File::open(folder).map_err(fail)?;
    // A file system without locks does not keep two apart, but it does not forbid one either.
    if matches!(lock.try_lock(), Err(fs::TryLockError::WouldBlock)) {
        return Err(OutputError::Busy { path: folder.into() });
    }
    // Whoever held it until now may have left a record.
    holds_no_record(folder)?;
    clear_leftovers(folder);
    writable(&folder.join("write-test"))?;
    Ok(lock)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALVE: Mark = Mark::Schema("hil.valve/1");

    fn refused(outputs: Outputs) -> String {
        outputs.claim().unwrap_err().to_string()
    }

    #[test]
    fn an_input_is_never_an_output_whatever_it_is_called() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("in.toml"), "schema = \"hil.valve/1\"\n").unwrap();
        fs::hard_link(at("in.toml"), at("hard.toml")).unwrap();
        std::os::unix::fs::symlink(at("in.toml"), at("soft.toml")).unwrap();
        fs::create_dir(at("sub")).unwrap();
        for name in ["in.toml", "hard.toml", "soft.toml", "sub/../in.toml"] {
            let outputs = Outputs::new(true).reads([at("in.toml")]).file(Some(at(name)), VALVE);
            assert!(refused(outputs).contains("is read by this command"), "{name}");
        }
    }

    #[test]
    fn two_outputs_are_two_files() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| Some(folder.path().join(name));
        for second in ["x.toml", "X.toml", "./x.toml"] {
            let outputs = Outputs::new(true).file(at("x.toml"), VALVE).file(at(second), Mark::Page);
            assert!(refused(outputs).contains("is named twice"), "{second}");
        }
        let _claim = Outputs::new(false).file(at("x.toml"), VALVE).file(at("y.toml"), VALVE).claim().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "a claim leaves nothing behind");
    }

    #[test]
    fn only_the_programs_own_of_the_same_kind_is_replaced_unasked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let claim = |force, mark| Outputs::new(force).file(Some(&path), mark).claim().map(drop).map_err(|e| e.to_string());
        fs::write(&path, "schema = \"hil.valve/1\"\n").unwrap();
        assert!(claim(false, VALVE).is_ok());
        assert!(claim(false, Mark::Schema("hil.plan/1")).unwrap_err().contains("--force"));
        assert!(claim(false, Mark::Page).is_err() && claim(false, Mark::None).is_err());
        assert!(claim(true, Mark::Page).is_ok() && claim(true, Mark::None).is_ok());
    }

    #[test]
    fn a_record_is_never_replaced_not_even_by_force() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let names = [("report.html", Mark::Page), ("record.json", Mark::None)];
        let run = |force| Outputs::new(force).folder(Some(folder.path()), &names).claim();
        drop(run(false).unwrap());
        fs::write(at("report.html"), "a page of somebody's").unwrap();
        assert!(run(false).is_err() && run(true).is_ok());
        fs::write(at("record.json"), "{}").unwrap();
        assert!(run(true).unwrap_err().to_string().contains("holds a record"));
        fs::write(at("trace.parquet"), "").unwrap();
        let trace = Outputs::new(true).file(Some(at("trace.parquet")), Mark::None);
        assert!(refused(trace).contains("part of a record"));
        let beside = Outputs::new(false).file(Some(at("augmented.toml")), VALVE);
        assert!(beside.claim().is_ok(), "a new file beside a record harms nothing");
    }

    #[test]
    fn a_folder_has_one_writer() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let ask = || Outputs::new(false).folder(Some(&out), &[]).claim();
        let held = ask().unwrap();
        assert!(matches!(ask(), Err(OutputError::Busy { .. })));
        drop(held);
        assert!(ask().is_ok());
    }

    #[test]
    fn what_cannot_be_written_is_found_before_anything_runs() {
        let file = |path: &str| refused(Outputs::new(true).file(Some(path), Mark::None));
        assert!(file("/no/such/folder/x.csv").contains("there is no folder /no/such/folder"));
        assert!(file("/dev/null").contains("is a device"));
        assert!(file("/proc/x.csv").starts_with("/proc/x.csv: "));
        assert!(file("/").contains("is a folder"));
        assert!(refused(Outputs::new(true).folder(Some("/proc/hil"), &[])).starts_with("/proc/hil: "));
    }
}
