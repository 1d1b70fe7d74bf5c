//! Files that are whole under their name or not there, also after a power cut.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// End of the name of a file that is being written.
const PART: &str = ".part";

/// Why a file was not written.
#[derive(Debug)]
pub enum WriteError<E> {
    /// The file system refused.
    Io(io::Error),
    /// What was to be written could not be made.
    Content(E),
}

impl WriteError<io::Error> {
    /// What the file system said, wherever it said it.
    pub fn into_io(self) -> io::Error {
        let (Self::Io(e) | Self::Content(e)) = self;
        e
    }
}

/// Writes a file through `write` under a name of its own beside `path`, puts it on the disk, renames it, and puts the
/// name on the disk. A link at `path` is replaced, not followed.
///
/// # Errors
/// What the file system or `write` says; nothing is left behind then, and an older file stays as it was.
pub fn whole_file<E>(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>) -> Result<(), WriteError<E>> {
    let (part, file) = part_of(path).map_err(WriteError::Io)?;
    let result = (|| {
        let mut file = BufWriter::with_capacity(1 << 18, file);
        write(&mut file).map_err(WriteError::Content)?;
        let file = file.into_inner().map_err(|e| WriteError::Io(e.into_error()))?;
        file.sync_all().and_then(|()| fs::rename(&part, path)).and_then(|()| sync_folder(folder_of(path))).map_err(WriteError::Io)
    })();
    if result.is_err() {
        // The reason is already told; a part that cannot be removed changes nothing about it.
        let _ = fs::remove_file(&part);
    }
    result
}

/// Opens a part that no other process and no other thread writes. Its lock says that the writer lives.
pub(super) fn part_of(path: &Path) -> io::Result<(PathBuf, File)> {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "names no file"))?;
    // A name of 255 bytes, the most there is, leaves no room for more: its beginning tells enough.
    let short: String = name.to_string_lossy().chars().take(40).collect();
    let mut own = OsString::from(".");
    own.push(short);
    own.push(format!(".{}-{}{PART}", std::process::id(), NUMBER.fetch_add(1, Ordering::Relaxed)));
    let part = path.with_file_name(own);
    let file = OpenOptions::new().write(true).create_new(true).open(&part)?;
    // Where the file system knows no locks, leftovers stay, which harms nobody.
    let _ = file.try_lock();
    Ok((part, file))
}

/// The folder that a file lies in.
pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Puts the names in a folder on the disk.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

/// Makes a folder and those above it, and puts their names on the disk.
pub fn make_folder(folder: &Path) -> io::Result<()> {
    let mut missing: Vec<&Path> = folder.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).collect();
    missing.reverse();
    for each in missing {
        match fs::create_dir(each) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(e),
            _ => sync_folder(folder_of(each))?,
        }
    }
    if folder.is_dir() { Ok(()) } else { Err(io::Error::new(io::ErrorKind::NotADirectory, "is not a folder")) }
}

/// Makes a folder below `root`, which may be reached over a link; below it none is followed.
///
/// # Errors
/// What the file system says, or that a link stands in the way.
pub fn make_folder_within(root: &Path, below: &Path) -> io::Result<()> {
    let mut place = root.to_path_buf();
    for part in below.components() {
        let std::path::Component::Normal(part) = part else {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{} leads out of the folder", below.display())));
        };
        place.push(part);
        if fs::symlink_metadata(&place).is_ok_and(|m| m.is_symlink()) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("{} is a link; links in a store are not followed", place.display()),
            ));
        }
    }
    make_folder(&place)
}

/// The name of a folder for a text of a person, one to one: no two texts share a name, also where a disk tells no case. Capitals,
/// digits and a few signs stand as they are; whatever else the text holds shows in a digest behind its readable part.
pub fn folder_name(text: &str) -> String {
    let plain = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || "-_+#".contains(c);
    // Names that some systems keep for devices.
    let device = ["CON", "PRN", "AUX", "NUL", "COM", "LPT"].iter().any(|d| text.starts_with(d) && text.len() <= 4);
    if !text.is_empty() && text.len() <= 64 && !device && text.chars().all(plain) {
        return text.into();
    }
    let readable: String = text.chars().take(32).map(|c| if c.is_ascii_alphanumeric() || "-_+#".contains(c) { c } else { '_' }).collect();
    format!("{readable}~{}", &crate::digest::sha256(text)[..16])
}

/// Removes what killed writers left in a folder; a part whose writer lives is locked and stays.
pub fn clear_leftovers(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        if !is_part(&name.to_string_lossy()) || !entry.file_type().is_ok_and(|t| t.is_file()) {
            continue;
        }
        let path = entry.path();
        // What cannot be opened or removed is somebody else's.
        if File::open(&path).is_ok_and(|file| file.try_lock().is_ok()) {
            let _ = fs::remove_file(&path);
        }
    }
}

/// Whether a name is that of a part: `.name.123-4.part`, or as the first version wrote them, `.name.123.part` and `name.part123`.
fn is_part(name: &str) -> bool {
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit() || b == b'-');
    let new = name.starts_with('.') && name.strip_suffix(PART).and_then(|n| n.rsplit_once('.')).is_some_and(|(_, number)| digits(number));
    new || name.rsplit_once(PART).is_some_and(|(_, number)| digits(number))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        whole_file(&path, |f| f.write_all(b"old")).unwrap();
        let failed = whole_file(&path, |f| {
            f.write_all(b"half").unwrap();
            Err::<(), _>("full")
        });
        assert!(matches!(failed, Err(WriteError::Content("full"))));
        assert_eq!((fs::read(&path).unwrap(), fs::read_dir(folder.path()).unwrap().count()), (b"old".to_vec(), 1));
    }

    #[test]
    fn the_longest_name_is_written_and_a_link_is_replaced_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let long = folder.path().join("n".repeat(255));
        whole_file(&long, |f| f.write_all(b"x")).unwrap();
        let (target, link) = (folder.path().join("target"), folder.path().join("link"));
        fs::write(&target, "theirs").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        whole_file(&link, |f| f.write_all(b"ours")).unwrap();
        assert_eq!((fs::read(&target).unwrap(), fs::read(&link).unwrap()), (b"theirs".to_vec(), b"ours".to_vec()));
    }

    #[test]
    fn leftovers_go_and_the_part_of_a_living_writer_stays() {
        let folder = tempfile::tempdir().unwrap();
        let keep = ["x.toml", ".hidden", "x.part", "x.parts1", ".x.1a.part"];
        for name in keep.iter().chain(&[".x.17-0.part", ".x.17.part", "batch.part17"]) {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let (living, _file) = part_of(&folder.path().join("y")).unwrap();
        clear_leftovers(folder.path());
        let mut left: Vec<String> =
            fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        left.sort();
        let mut wanted: Vec<String> = keep.iter().map(|n| n.to_string()).collect();
        wanted.push(living.file_name().unwrap().to_string_lossy().into_owned());
        wanted.sort();
        assert_eq!(left, wanted);
    }

    #[test]
    fn names_are_one_to_one_also_where_case_does_not_count() {
        let long = "A".repeat(300);
        let texts = [
            "a/b",
            "a_b",
            "A/B",
            "A_B",
            "a b",
            "..",
            ".",
            "",
            "V-1",
            "v-1",
            "V-1 ",
            "NUL",
            "nul",
            "COM1",
            &long,
            &long[..299],
            "\u{e9}",
            "e\u{301}",
            "\u{1f600}",
            "V~1",
            "a_b~0011223344556677",
            "#1",
            "x\0y",
            "C:X",
            "trailing.",
        ];
        let mut names: Vec<String> = texts.iter().map(|t| folder_name(t).to_lowercase()).collect();
        for name in &names {
            assert!(!name.is_empty() && name.len() <= 64 && !name.contains(['/', '\\', '\0', ':', '.']), "{name}");
        }
        names.sort();
        names.dedup();
        assert_eq!(names.len(), texts.len());
        assert_eq!((folder_name("SIM-000017"), folder_name("V-1")), ("SIM-000017".into(), "V-1".into()));
    }

    #[test]
    fn a_link_below_a_store_is_not_followed() {
        let (folder, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        make_folder_within(folder.path(), Path::new("a/b")).unwrap();
        std::os::unix::fs::symlink(elsewhere.path(), folder.path().join("link")).unwrap();
        for below in ["link", "link/x", "../x", "a/../../x"] {
            assert!(make_folder_within(folder.path(), Path::new(below)).is_err(), "{below}");
        }
        assert_eq!(fs::read_dir(elsewhere.path()).unwrap().count(), 0);
    }

    #[test]
    fn folders_are_made_to_any_depth_and_a_file_in_the_way_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        make_folder(&folder.path().join("a/b/c")).unwrap();
        make_folder(&folder.path().join("a/b/c")).unwrap();
        fs::write(folder.path().join("f"), "").unwrap();
        assert!(make_folder(&folder.path().join("f")).is_err() && make_folder(&folder.path().join("f/g")).is_err());
    }
}
