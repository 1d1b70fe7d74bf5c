//! Why no model can be identified from a recording.

/// Why no model can be identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// The recording cannot be compared with any model.
    #[error(transparent)]
    Course(#[from] crate::course::CourseError),
    /// An option that cannot be.
    #[error("{option}: {problem}")]
    Option {
        /// The option as typed.
        option: &'static str,
        /// What is wrong and what is allowed.
        problem: String,
    },
    /// The fit left the numbers.
    #[error("{source_name}: the fit did not converge to finite values; check the units of current and pressure")]
    NotFinite {
        /// Name of the recording.
        source_name: String,
    },
    /// The pressure falls while the current rises.
    #[error(
        "{source_name}: the pressure falls while the current rises. A sign turned on the way is mended by --map current_a=\"-1 * current_a\" (or by -1 before the pressure); a valve that is meant to fall is identified with --falling"
    )]
    Falls {
        /// Recording.
        source_name: String,
    },
}
