//! Feed-forward, PI, the controller, and the stability of the loop that it closes.

mod controller;
mod expectation;
mod feed_forward;
mod linear;
mod pi;
pub mod rules;
mod significance;
pub mod stability;
pub mod tune;

pub use controller::{Addition, Command, Controller, ControllerSettings, Mode, Reference};
pub use feed_forward::{FeedForward, FeedForwardModel};
pub use linear::{LinearLoop, linear_loop};
pub use pi::Pi;

/// Gains of the PI controller, Eq. (12).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gains {
    /// Proportional gain K_P [mA/bar].
    #[doc(alias("K_P", "kp"))]
    pub kp_ma_per_bar: f64,
    /// Integral gain K_I [mA/(bar s)].
    #[doc(alias("K_I", "ki"))]
    pub ki_ma_per_bar_s: f64,
}

impl Gains {
    /// The gains of the paper: K_P = 1 mA/bar, K_I = 5 mA/(bar s).
    pub const PAPER: Self = Self { kp_ma_per_bar: 1.0, ki_ma_per_bar_s: 5.0 };
}

#[cfg(test)]
pub(crate) use controller::tests::valve as test_valve;
