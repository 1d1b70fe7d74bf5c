//! The file of a foreign FMU, and its parts unpacked for the time of a run.

use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use super::ForeignError;
use super::description::Description;
use crate::digest;

/// Largest file, and most that may be unpacked [bytes].
const LARGEST: u64 = 512 << 20;

/// A foreign FMU, read and not run.
#[derive(Debug)]
pub struct ForeignFmu {
    /// File name, for messages.
    pub file: String,
    /// SHA-256 of the file, hex.
    pub sha256: String,
    /// What its description says.
    pub description: Description,
    bytes: Vec<u8>,
}

impl ForeignFmu {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ForeignError::File`].
    pub fn read(path: &Path) -> Result<Self, ForeignError> {
        let file = path.display().to_string();
        let wrong = |what: String| ForeignError::File { file: file.clone(), what };
        let size = std::fs::metadata(path).map_err(|e| wrong(e.to_string()))?.len();
        if size > LARGEST {
            return Err(wrong(format!("{size} bytes; up to {LARGEST} are read")));
        }
        let bytes = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
        let sha256 = digest::sha256(&bytes);
        let mut zip = zip::ZipArchive::new(Cursor::new(&bytes)).map_err(|e| wrong(format!("is no FMU: {e}")))?;
        let mut text = String::new();
        let entry = zip.by_name("modelDescription.xml").map_err(|_| wrong("holds no modelDescription.xml".into()))?;
        entry.take(LARGEST).read_to_string(&mut text).map_err(|e| wrong(format!("modelDescription.xml: {e}")))?;
        let description = Description::parse(&text).map_err(wrong)?;
        Ok(Self { file, sha256, description, bytes })
    }

    /// Unpacks everything below `folder`; the path of the library and of the resources.
    ///
    /// # Errors
    /// [`ForeignError::File`] where there is no library for this machine, or an entry leads elsewhere.
    pub fn unpack(&self, folder: &Path) -> Result<(PathBuf, PathBuf), ForeignError> {
        let wrong = |what: String| ForeignError::File { file: self.file.clone(), what };
        let mut zip = zip::ZipArchive::new(Cursor::new(&self.bytes)).map_err(|e| wrong(e.to_string()))?;
        let mut left = LARGEST;
        for at in 0..zip.len() {
            let mut entry = zip.by_index(at).map_err(|e| wrong(e.to_string()))?;
            let inside = entry.enclosed_name().ok_or_else(|| wrong(format!("its entry number {at} leads out of the archive")))?;
            let target = folder.join(inside);
            if entry.is_dir() {
                std::fs::create_dir_all(&target).map_err(|e| wrong(e.to_string()))?;
                continue;
            }
            if let Some(parent) = target.parent() {
                std::fs::create_dir_all(parent).map_err(|e| wrong(e.to_string()))?;
            }
            let mut out = std::fs::File::create(&target).map_err(|e| wrong(e.to_string()))?;
            left -= std::io::copy(&mut (&mut entry).take(left), &mut out).map_err(|e| wrong(e.to_string()))?;
            if left == 0 {
                return Err(wrong(format!("unpacks to more than {LARGEST} bytes")));
            }
        }
        let platform = if self.description.version == 2 { "linux64" } else { "x86_64-linux" };
        let library = folder.join("binaries").join(platform).join(format!("{}.so", self.description.identifier));
        if !library.is_file() {
            return Err(wrong(format!("holds no library for this machine (binaries/{platform}/{}.so)", self.description.identifier)));
        }
        let resources = folder.join("resources");
        std::fs::create_dir_all(&resources).map_err(|e| wrong(e.to_string()))?;
        Ok((library, resources))
    }
}
