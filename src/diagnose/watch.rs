//! What is seen of the diagnoses of this process while they work.

use std::sync::OnceLock;

use serde::Serialize;

use crate::physics::Effect;

/// Whoever hears of every candidate; nobody unless asked for.
static TOLD: OnceLock<fn(&Tried)> = OnceLock::new();

/// A candidate whose fit has ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tried {
    /// What was added.
    pub candidate: &'static str,
    /// The effects that the model had before.
    pub beside: Vec<&'static str>,
    /// How many are tried beside them.
    pub of: usize,
    /// RMS of the error without it [bar].
    pub before_bar: f64,
    /// RMS of the error with it [bar].
    pub rmse_bar: f64,
}

/// Has `told` hear of every candidate, from whichever thread has fitted it. The first who asks is heard, for as long as the process
/// lives.
pub fn tell_of_candidates(told: fn(&Tried)) {
    let _ = TOLD.set(told);
}

/// A candidate's fit has ended.
pub(super) fn tried(effect: &'static dyn Effect, beside: &[&'static dyn Effect], of: usize, (before_bar, rmse_bar): (f64, f64)) {
    if let Some(told) = TOLD.get() {
        told(&Tried { candidate: effect.id(), beside: beside.iter().map(|e| e.id()).collect(), of, before_bar, rmse_bar });
    }
}
