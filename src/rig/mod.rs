//! What a plan runs against: one small trait, with a simulated valve, a replayed recording, Modbus and serial
//! current drivers behind it.

use serde::{Deserialize, Serialize};

#[cfg(feature = "wire")]
pub mod emulator;
#[cfg(feature = "wire")]
pub mod line;
#[cfg(feature = "wire")]
pub mod loop_thread;
#[cfg(feature = "wire")]
pub mod modbus;
mod outside;
pub mod paced;
pub mod profile;
#[cfg(feature = "wire")]
pub mod realtime;
pub mod replay;
#[cfg(feature = "wire")]
pub mod signals;
pub mod simulated;
#[cfg(feature = "wire")]
pub mod wire;

pub use outside::OutsideLimits;
#[cfg(feature = "wire")]
pub use wire::{Endpoint, Options, open};

/// How far a sample can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// Fresh, complete and plausible.
    Good,
    /// No reply in this slot: the last value is held.
    Held,
    /// A reply came, but its freshness could not be shown.
    Stale,
    /// The device answered with an exception.
    Exception,
    /// A reply came with a value outside what the sensor or the device can deliver.
    Implausible,
}

impl Quality {
    /// The quality of a name in a trace.
    pub fn by_name(name: &str) -> Option<Self> {
        [Self::Good, Self::Held, Self::Stale, Self::Exception, Self::Implausible].into_iter().find(|q| q.name() == name)
    }

    /// As traces name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Held => "held",
            Self::Stale => "stale",
            Self::Exception => "exception",
            Self::Implausible => "implausible",
        }
    }
}

/// What is known of a rig before the first step; goes into the record.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RigIdentity {
    /// `sim`, `modbus`, `serial` or `replay`.
    pub kind: String,
    /// Valve file (simulation), driver profile (hardware) or recording (replay) by name.
    pub name: String,
    /// SHA-256 of that file's bytes, hex.
    pub sha256: String,
    /// Whether an emulator stands for driver and valve; such a record never enters statistics of real valves.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub emulated: bool,
    /// Further facts, in the order in which they are printed (real-time priority granted, memory locked, ...).
    pub details: Vec<(String, String)>,
}

/// One sample, taken at the end of a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time since the start of the run [s], on the rig's clock.
    pub time_s: f64,
    /// Measured pressure [bar].
    pub pressure_bar: f64,
    /// Measured current [A], where the rig has such a channel.
    pub current_a: Option<f64>,
    /// Oil temperature [degC], where the rig has such a channel.
    pub oil_temp_c: Option<f64>,
    /// Supply pressure [bar], where the rig has such a channel.
    pub supply_bar: Option<f64>,
    /// Whether the sample is fresh and plausible.
    pub quality: Quality,
    /// How late the slot began against its absolute deadline [s]; 0 in simulation.
    pub lateness_s: f64,
    /// Round-trip time of the transaction [s]; 0 in simulation.
    pub round_trip_s: f64,
    /// Slots skipped since the previous sample; 0 when on time.
    pub missed_slots: u32,
}

impl Sample {
    /// A good reading of the pressure alone, on time, as a simulation gives it.
    pub fn simulated(time_s: f64, pressure_bar: f64) -> Self {
        Self {
            time_s,
            pressure_bar,
            current_a: None,
            oil_temp_c: None,
            supply_bar: None,
            quality: Quality::Good,
            lateness_s: 0.0,
            round_trip_s: 0.0,
            missed_slots: 0,
        }
    }
}

/// The outcome of an attempt to reach the safe state.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SafeState {
    /// Whether the measured current (or what the profile names) confirmed it within its budget.
    pub confirmed: bool,
    /// What was written and read back, for the report.
    pub evidence: String,
    /// Latest fresh reading of the current [A], where the rig measures it.
    pub current_a: Option<f64>,
    /// Time from the first write to the confirmation, or until it was given up [s].
    pub within_s: Option<f64>,
    /// What was found wrong at the end beside the safe state: a watchdog that forgot its time.
    pub fault: Option<String>,
}

impl SafeState {
    /// Confirmed, or not, by `evidence` alone.
    pub fn of(confirmed: bool, evidence: impl Into<String>) -> Self {
        Self { confirmed, evidence: evidence.into(), ..Self::default() }
    }
}

/// Whether an interlock trips on a value: above its limit, or no number, which shows nothing of what it should guard.
pub fn exceeds(value: f64, most: f64) -> bool {
    value.is_nan() || value > most
}

/// A bench: one coil current out, one pressure in.
pub trait Rig {
    /// What the rig is.
    fn identity(&self) -> RigIdentity;
    /// Applies `command_a` until rig time `until_s`, then samples. Simulation computes; hardware waits.
    fn step(&mut self, command_a: f64, until_s: f64) -> Result<Sample, RigError>;
    /// Brings the rig to its safe state and reads that back; must not depend on earlier success.
    fn make_safe(&mut self) -> Result<SafeState, RigError>;
}

/// Why a rig could not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The recording or the simulation has no further sample.
    #[error("{source_name}: no further sample after {time_s:.3} s")]
    Exhausted {
        /// The rig's name.
        source_name: String,
        /// The rig time.
        time_s: f64,
    },
    /// A port or a connection cannot be opened.
    #[error("{place}: {reason}")]
    Open {
        /// The port or the address.
        place: String,
        /// Why, and what to do.
        reason: String,
    },
    /// A driver profile does not fit what is asked of it.
    #[error("{name}: {reason}")]
    Profile {
        /// The profile.
        name: String,
        /// Why, with the arithmetic where there is one.
        reason: String,
    },
    /// The device is not what the profile says, or does not do what it must.
    #[error("{name}: {reason}")]
    Device {
        /// The profile.
        name: String,
        /// What was found, and what to do.
        reason: String,
    },
    /// Nothing would take the current away if this program died.
    #[error(
        "{name}: {why}, so the current stays on when this program or its computer dies; with a person at the emergency stop, run with --without-watchdog, which the record shows"
    )]
    NoWatchdog {
        /// The profile.
        name: String,
        /// What is missing.
        why: String,
    },
    /// A current outside the limits was asked for.
    #[error(transparent)]
    Refused(OutsideLimits),
    /// The current was asked to change too fast.
    #[error("a change of the current of {change_a_per_s:.3} A/s is above the limit of {limit_a_per_s:.3} A/s; it was not sent")]
    Slew {
        /// What was asked for [A/s].
        change_a_per_s: f64,
        /// The limit [A/s].
        limit_a_per_s: f64,
    },
    /// A measured value passed an interlock.
    #[error("interlock: {what}")]
    Interlock {
        /// The value, its limit and the time.
        what: String,
    },
    /// Too many samples in a row were lost.
    #[error("{name}: {count} samples in a row without a good reply; the last: {last}")]
    Lost {
        /// The profile.
        name: String,
        /// How many.
        count: u32,
        /// What the last loss was.
        last: String,
    },
    /// The run was asked to stop.
    #[error("stopped by {signal}")]
    Stopped {
        /// The signal.
        signal: &'static str,
    },
}
