//! A set-point outside the limits of driver, station or plan.

/// A set-point that may not be sent.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("a current of {asked_a:.4} A is outside the limits of {min_a:.4} A to {max_a:.4} A; it was not sent")]
pub struct OutsideLimits {
    /// The current that was asked for [A].
    pub asked_a: f64,
    /// The smallest that may be sent [A].
    pub min_a: f64,
    /// The largest that may be sent [A].
    pub max_a: f64,
}
