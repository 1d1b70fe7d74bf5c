//! The clock on the wall.

/// The present, as the journal writes it.
pub fn now() -> String {
    jiff::Timestamp::now().to_string()
}
