//! Stability of the pressure loop `(K_P + K_I/s) k e^(-T_d s) / (tau s + 1)`.
//!
//! Three views of the same loop, from the roughest to the truest: [`routh`] with the first-order Pade form that the
//! paper uses, [`exact`] with the exact delay, [`sampled`] at the loop rate with zero-order hold and one period of
//! computation. [`margins`] puts them into the one value that commands and records show.

pub mod exact;
pub mod margins;
pub mod routh;
pub mod sampled;
mod search;

pub use margins::{Margins, StabilityError, margins};

/// The plant that the loop is closed around: gain, lag and delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopPlant {
    /// Gain k: slope of the pressure over the current [bar/mA].
    pub gain_bar_per_ma: f64,
    /// Lag tau of the valve [s].
    #[doc(alias = "tau")]
    pub lag_s: f64,
    /// Transport delay T_d [s].
    #[doc(alias("dead time of the loop", "T_d"))]
    pub delay_s: f64,
}

/// Margins of one loop in the frequency domain. What does not exist is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct FrequencyMargins {
    /// Factor on the loop gain, in dB, that brings the loop to its stability boundary; negative when it is unstable.
    pub gain_margin_db: Option<f64>,
    /// Phase lag, in deg, that brings the loop to its stability boundary; negative when it is unstable.
    pub phase_margin_deg: Option<f64>,
    /// Further delay that a stable loop bears [s].
    pub delay_margin_s: Option<f64>,
    /// Largest magnitude of the sensitivity 1/(1+L) of a stable loop.
    #[doc(alias("max. sensitivity", "maximum sensitivity", "worst sensitivity", "sensitivity", "Ms"))]
    pub max_sensitivity: Option<f64>,
    /// Frequency at which the loop gain falls through one [rad/s].
    pub gain_crossover_rad_s: Option<f64>,
    /// Frequency at which the phase falls through -180 deg [rad/s].
    pub phase_crossover_rad_s: Option<f64>,
    /// Whether the closed loop is stable.
    pub stable: bool,
}

#[cfg(test)]
mod laws;
