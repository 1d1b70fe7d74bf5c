//! Which plant a valve is made of, and how finely it is computed.

/// Fine time step of the plant [s]: an order of magnitude below the fastest lag that it holds.
pub(super) const STEP_S: f64 = 0.0005;

/// Which plant a valve is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anatomy {
    /// A static curve with hysteresis, then blocks one behind the other.
    Blocks,
    /// Differential equations: coil with eddy currents, magnet, spool with friction, chamber, line, piston.
    Equations,
}

impl Anatomy {
    /// The word of the truth file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blocks => "blocks",
            Self::Equations => "equations",
        }
    }
}
