//! Reference curves, hysteresis models and their inverse, the valve model file.
//!
//! The model is that of the paper: two reference curves, Eq. (3), joined by a hyperbola with one parameter `a`,
//! Eqs. (5)-(8); its inverse is the feed-forward, Eq. (11). Where the loop of a valve has another form, a stack of plays
//! between the same curves takes the hyperbola's place.

mod curves;
mod error;
mod file;
mod free;
mod hyperbola;
mod identification;
mod path;
mod polynomial;
mod stretch;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use curves::ReferenceCurves;
pub use error::ValveError;
pub use file::{EffectSpec, MAX_TIME_S, ValveFile};
pub use free::{FreeLoop, FreeState, MOST_PLAYS, WIDEST_PLAY};
pub use hyperbola::{HyperbolaState, InverseState};
pub use identification::{Identification, IdentifiedRecording, ParameterEstimate};
pub use path::{HysteresisInverse, HysteresisState};
pub use polynomial::Polynomial;
pub use stretch::{hyperbola_per_sample, hyperbola_stretches};

/// What a command does between two of its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Input {
    /// It stands until the next message, as behind every driver that gets its set-point in messages.
    #[default]
    Held,
    /// It goes on a straight line to the next sample, as a measured or a continuously driven current does.
    Ramp,
}

impl Input {
    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Held => "held",
            Self::Ramp => "ramp",
        }
    }
}

/// How the pressure depends on the direction of the current.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hysteresis {
    /// No dependence: the pressure follows the average of the two curves, Eq. (10).
    None,
    /// The hyperbola of Eqs. (5)-(8).
    Hyperbolic {
        /// Parameter `a` [bar^2]: how softly the pressure leaves one curve for the other.
        a_bar2: f64,
    },
    /// A stack of plays with weights, where the hyperbola is not the form of the loop.
    Free(FreeLoop),
}

/// A valve model: what `--sim` simulates, the feed-forward inverts and `identify` writes.
#[derive(Debug, Clone, PartialEq)]
pub struct Valve {
    /// Name, from the file.
    pub name: String,
    /// Where the figures come from.
    pub source: String,
    /// Pressure over current for rising and for falling current.
    pub curves: ReferenceCurves,
    /// Path between the curves.
    pub hysteresis: Hysteresis,
    /// Dead time between command and pressure [s].
    pub delay_s: f64,
    /// Range over which the dead time may vary [s]; margins are judged over it.
    pub delay_range_s: (f64, f64),
    /// Time constant of a first-order lag of the pressure [s]; 0 for none.
    pub lag_s: f64,
    /// Smallest and largest current that the valve may see [A].
    pub current_limits_a: (f64, f64),
    /// Tank pressure below which the outlet cannot fall [bar]; `None` for an output that is no pressure.
    pub floor_bar: Option<f64>,
    /// Standard deviation of the sensor noise [bar].
    pub noise_bar: f64,
    /// Further physics, in the order of the file.
    pub effects: Vec<EffectSpec>,
    /// How the model was identified; `None` for a model that was typed.
    pub identification: Option<Identification>,
}
