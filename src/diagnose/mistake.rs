//! What was likely done wrong where model and recording do not belong together, and what mends it.

use serde::{Deserialize, Serialize};

/// A valve answers within this time [s].
pub const SECOND_S: f64 = 1.0;

/// The likely mistake.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Mistake {
    /// The pressure is in another unit: it is `factor` times what it should be.
    Pressure {
        /// Pressure recorded over pressure expected.
        factor: f64,
    },
    /// The current is in another unit or has another sign: times `factor` it fits.
    Current {
        /// What the current has to be multiplied by.
        factor: f64,
    },
    /// The time is in another unit: times `factor` it fits.
    Clock {
        /// What the time has to be multiplied by.
        factor: f64,
    },
    /// The pressure has the other sign.
    Sign,
    /// The pressure falls where the model's rises.
    Falling,
    /// Current and pressure have changed places.
    Exchanged,
    /// The pressure comes before the current, or longer than a second after it.
    Shifted {
        /// How much later than the model it comes [s]; negative: earlier.
        by_s: f64,
    },
    /// A valve with another characteristic.
    OtherValve {
        /// Its gain over that of the model.
        gain: f64,
        /// Its pressure less the model's in the middle of the range [bar].
        zero_bar: f64,
    },
    /// The pressure does not follow the current.
    Unrelated {
        /// Share of circular shifts of the pressure that fit as well.
        chance: f64,
    },
    /// The current does not move enough.
    NoExcitation,
    /// The pressure does not move although the current does.
    PressureRests,
}

impl Mistake {
    /// What was likely done wrong, and what would mend it.
    pub fn text(&self) -> String {
        match self {
            Self::Pressure { factor } => {
                let (unit, map) = match *factor {
                    f if (f - 14.5).abs() < 0.1 => ("psi", "pressure_bar [psi]".to_string()),
                    100.0 => ("kPa", "pressure_bar [kPa]".into()),
                    1e3 => ("mbar", "pressure_bar [mbar]".into()),
                    1e5 => ("Pa", "pressure_bar [Pa]".into()),
                    0.1 => ("MPa", "pressure_bar [MPa]".into()),
                    f => ("another unit", format!("{} * pressure_bar", 1.0 / f)),
                };
                format!("the pressure is about {factor:.4} times what the model gives: it is likely in {unit} (--map pressure_bar=\"{map}\")")
            }
            Self::Current { factor } if *factor == -1.0 => {
                "with the current reversed it fits: its sign is likely wrong (--map current_a=\"-1 * current_a\")".into()
            }
            Self::Current { factor } => {
                let (unit, map) = match *factor {
                    1e-3 => ("mA", "current_a [mA]".to_string()),
                    1e-6 => ("uA", "current_a [uA]".into()),
                    f => ("another unit", format!("{f} * current_a")),
                };
                format!("with the current times {factor} it fits: it is likely in {unit} (--map current_a=\"{map}\")")
            }
            Self::Clock { factor } => {
                let (unit, map) = match *factor {
                    1e-3 => ("milliseconds", "time_s [ms]"),
                    1e-6 => ("microseconds", "time_s [us]"),
                    _ => ("minutes", "time_s [min]"),
                };
                format!("with the time times {factor} it fits: it is likely in {unit} (--map time_s=\"{map}\")")
            }
            Self::Sign => "the pressure has the other sign (--map pressure_bar=\"-1 * pressure_bar\")".into(),
            Self::Falling => {
                "the pressure falls where the model's rises: a valve with a falling characteristic, which `hil identify --falling` takes, or a pressure with the other sign (--map pressure_bar=\"-1 * pressure_bar\")".into()
            }
            Self::Exchanged => {
                "with current and pressure exchanged it fits (--map current_a=pressure_bar --map pressure_bar=current_a)".into()
            }
            Self::Shifted { by_s } if *by_s < 0.0 => format!(
                "the pressure leads the current: {:.3} s earlier than the model it fits best, and no valve answers before it is asked; the channels likely have different clocks",
                -by_s
            ),
            Self::Shifted { by_s } => format!(
                "the pressure follows the current {by_s:.2} s later than the model, and a valve answers within a second: the channels likely have different clocks, or the pressure is that of another run"
            ),
            Self::OtherValve { gain, zero_bar } => format!(
                "the pressure follows the current, but with {gain:.2} times the gain of the model and a zero {zero_bar:+.2} bar off: another valve, beyond what wear or a recalibration can be; identify it from a recording of its own"
            ),
            Self::Unrelated { chance } => format!(
                "the pressure does not follow the current: {:.0} % of the circular shifts of the pressure fit as well or better. Likely the current is that of another run, the samples are out of order, or the channel is no pressure of this valve",
                100.0 * chance
            ),
            Self::NoExcitation => "the current hardly moves: over this recording the pressure of the model stays within its noise, so that nothing can be told apart".into(),
            Self::PressureRests => {
                "the pressure stands still while the current moves: a dead sensor, a valve without supply, or the wrong channel".into()
            }
        }
    }
}
