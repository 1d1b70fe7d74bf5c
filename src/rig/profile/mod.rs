//! Driver profiles: everything that `hil` knows of a device is data in `drivers/*.toml`, checked as a whole when it
//! is loaded, so that nothing moves on a profile that cannot work.

use std::path::{Path, PathBuf};

mod blocks;
mod budget;
mod check;
mod context;
mod cycle_file;
mod file;
mod guards;
mod parts;
mod signal;
mod template;

pub use budget::{Budget, LARGEST_SHARE, frame_bytes, silence_s};
pub use cycle_file::*;
pub use file::*;
pub use parts::*;
pub use signal::{FaultBit, Signal, SignalName};
pub use template::{NumberFormat, Piece, Template, crc16};

impl Profile {
    /// Finds a profile by path, or by the bare name of a file in `drivers/` or of one that ships with the program.
    pub fn find(name_or_path: &str) -> Result<PathBuf, ProfileError> {
        Ok(crate::shipped::find(crate::shipped::Kind::Driver, name_or_path, None)?)
    }

    /// Reads and checks a profile file.
    pub fn load(path: &Path) -> Result<Self, ProfileError> {
        let file = path.display().to_string();
        let text = crate::document::read(path).map_err(|e| ProfileError::Read { reason: e.to_string() })?;
        Self::from_toml(&text, &file)
    }

    /// Reads and checks a profile from its text; `source_name` stands for the file in messages.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, ProfileError> {
        let wrong = |e: crate::document::DocumentError| ProfileError::Syntax { message: e.to_string() };
        crate::document::expect_schema(text, source_name, "hil.driver/1", "a driver profile").map_err(wrong)?;
        let file: ProfileFile = crate::document::parse(text, source_name).map_err(wrong)?;
        check::check(file, text, source_name)
    }

    /// The signal of that name, with its index.
    pub fn signal(&self, name: SignalName) -> Option<(usize, &Signal)> {
        self.signals.iter().enumerate().find(|(_, s)| s.name == name)
    }

    /// Whether a reply in every slot proves the measured values fresh.
    pub fn proves_freshness(&self) -> bool {
        self.cycle.transactions.iter().all(|t| t.freshness != Freshness::None)
    }
}

#[cfg(test)]
mod tests;
