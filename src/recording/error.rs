//! Why a recording could not be read or written.

use std::path::{Path, PathBuf};

/// What is wrong with a recording or with the wish to map its channels: where, and what is allowed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file name's extension names no known format.
    #[error("{}: the extension `{extension}` names no format of recordings; allowed: .csv, .tsv, .txt, .parquet, .mf4", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its extension, empty where it has none.
        extension: String,
    },
    /// The file is not what its extension says, or is damaged.
    #[error("{file}: {what}")]
    Format {
        /// The file.
        file: String,
        /// What is wrong, and where.
        what: String,
    },
    /// Channels that are needed are not there.
    #[error(
        "{file}: there is no {wanted}\nthe file has: {found}\n`hil inspect` shows what is in it and writes a mapping; a foreign name is taken by --map current_a=\"I_cmd [mA]\""
    )]
    MissingChannels {
        /// The file.
        file: String,
        /// The channels, each with the columns that it may be.
        wanted: String,
        /// The columns that are there.
        found: String,
    },
    /// A mapping file that cannot be used; the message shows the place.
    #[error("{0}")]
    MappingFile(String),
    /// A cell that cannot be read.
    #[error("{file}: {place}, column {number} (`{column}`): {what}")]
    Cell {
        /// The file.
        file: String,
        /// `line 17` of a text file, `row 17` of another; counted from 1.
        place: String,
        /// Number of the column, counted from 1.
        number: usize,
        /// Name of the column.
        column: String,
        /// What is wrong, and what is allowed.
        what: String,
    },
    /// A row that cannot be read.
    #[error("{file}: {place}: {what}")]
    Row {
        /// The file.
        file: String,
        /// `line 17` of a text file, `row 17` of another; counted from 1.
        place: String,
        /// What is wrong, and what is allowed.
        what: String,
    },
    /// A `--map` that cannot be understood.
    #[error("--map {text}: {what}")]
    Mapping {
        /// The mapping as typed.
        text: String,
        /// What is wrong, and what is allowed.
        what: String,
    },
}

impl RecordingError {
    pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Self::Io { path: path.into(), source }
    }
    pub(super) fn format(file: &str, what: impl ToString) -> Self {
        Self::Format { file: file.into(), what: what.to_string() }
    }
}
