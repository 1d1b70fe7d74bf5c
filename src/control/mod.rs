//! Feed-forward, PI, the controller, and the stability of the loop that it closes.

pub mod stability;

/// Gains of the PI controller, Eq. (12).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gains {
    /// Proportional gain K_P [mA/bar].
    pub kp_ma_per_bar: f64,
    /// Integral gain K_I [mA/(bar s)].
    pub ki_ma_per_bar_s: f64,
}
