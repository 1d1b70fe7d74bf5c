//! What can be wrong with an export.

/// An export that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ExchangeError {
    /// The batch cannot be read.
    #[error(transparent)]
    Batch(#[from] crate::batch::BatchError),
    /// The model file is wrong.
    #[error(transparent)]
    Valve(#[from] crate::valve::ValveError),
    /// The model cannot be exported.
    #[error("{0}")]
    Model(String),
    /// The file could not be put together.
    #[error("the FMU could not be put together: {0}")]
    Archive(String),
    /// The library that goes into an FMU is not there.
    #[error(
        "the library that goes into an FMU is not there ({places}); in the repository `cargo build --release -p hil-fmu` builds it, then name it with --library target/release/libhil_fmu.so or lay it beside the program"
    )]
    Library {
        /// Where it was looked for.
        places: String,
    },
    /// No valve of the batch was judged.
    #[error("{batch}: no valve was judged, so there is nothing to hand over")]
    Empty {
        /// The folder.
        batch: String,
    },
    /// One file of this format holds one part number.
    #[error("{batch}: holds the part numbers {found}; a .dfq file holds one of them: choose it with --part")]
    Parts {
        /// The folder.
        batch: String,
        /// The part numbers.
        found: String,
    },
    /// No such part number in the batch.
    #[error("{batch}: holds no part number `{wanted}`; there are: {found}")]
    UnknownPart {
        /// The folder.
        batch: String,
        /// The part number asked for.
        wanted: String,
        /// The part numbers.
        found: String,
    },
}
