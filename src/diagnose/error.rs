//! What a diagnosis cannot use.

use crate::course::CourseError;

/// Why a recording cannot be diagnosed.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// The recording cannot carry a diagnosis.
    #[error("{source_name}: {problem}")]
    Recording {
        /// The recording.
        source_name: String,
        /// What is missing, and what is wanted.
        problem: String,
    },
    /// It cannot be compared with any model.
    #[error(transparent)]
    Course(#[from] CourseError),
    /// The model cannot be simulated.
    #[error("{model}: {source}")]
    Model {
        /// The model's name.
        model: String,
        /// What is wrong.
        source: Box<crate::physics::PhysicsError>,
    },
    /// A foreign model cannot be run.
    #[error("{model}: {problem}")]
    Foreign {
        /// The model's name.
        model: String,
        /// What it refused.
        problem: String,
    },
}
