//! What can keep a station from serving.

/// What can keep a station from serving its page.
#[derive(Debug, thiserror::Error)]
pub enum StationError {
    /// The address cannot be listened on.
    #[error("--listen {address}: {source}")]
    Listen {
        /// As typed.
        address: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// A token is too easy to guess.
    #[error("{what}: a token has at least {least} letters and digits, and no blanks", least = SHORTEST)]
    Token {
        /// Where it came from.
        what: String,
    },
}

/// Shortest token that is taken.
pub(super) const SHORTEST: usize = 16;
