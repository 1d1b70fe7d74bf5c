//! What can be wrong with a plan.

use crate::document::{DocumentError, underline};

/// Why a plan or a limits file cannot be used. The message is complete: file, line, key, what is allowed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The file cannot be read, is not TOML, or a value is wrong; the message shows the place.
    #[error("{0}")]
    Document(#[from] DocumentError),
    /// An override names what does not exist or has another type.
    #[error("--set {key}={value}: {problem}")]
    Override {
        /// The key as typed.
        key: String,
        /// The value as typed.
        value: String,
        /// What is wrong, and what is allowed.
        problem: String,
    },
}

/// A place in the text and what is wrong there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Wrong {
    pub span: std::ops::Range<usize>,
    pub message: String,
}

impl Wrong {
    pub fn new(span: std::ops::Range<usize>, message: impl Into<String>) -> Self {
        Self { span, message: message.into() }
    }

    /// The message with the place underlined.
    pub fn shown(self, text: &str, source_name: &str) -> PlanError {
        PlanError::Document(underline(text, source_name, self.span, &self.message))
    }
}
