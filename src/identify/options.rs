//! What a user may fix of an identification.

use crate::valve::Input;

/// Whether the model has a hysteresis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum HysteresisChoice {
    /// As the data show it.
    #[default]
    Auto,
    /// The hyperbola of Eqs. (5)-(8).
    Hyperbolic,
    /// A stack of plays between the curves.
    Free,
    /// None: the average of the curves.
    None,
}

/// What a user may fix.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Name of the valve; the recording's name where `None`.
    pub name: Option<String>,
    /// Order of the curves; by held-out error where `None`.
    pub order: Option<usize>,
    /// Whether there is a hysteresis.
    pub hysteresis: HysteresisChoice,
    /// What the command does between its samples; as the data show it where `None`.
    pub input: Option<Input>,
    /// Whether a falling characteristic is meant.
    pub falling: bool,
    /// SHA-256 of each recording's bytes, hex.
    pub sha256: Vec<String>,
}

/// Highest order of the curves.
pub const MAX_ORDER: usize = 9;
