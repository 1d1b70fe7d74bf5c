//! What a profile says, checked: the types that the loop reads.

use super::cycle_file::*;
use super::file::*;
use super::signal::{Signal, SignalName};
use super::template::Template;

/// Why a driver profile cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// The file cannot be read.
    #[error("{reason}")]
    Read {
        /// The file, and what the operating system says.
        reason: String,
    },
    /// No such profile.
    #[error(transparent)]
    NotFound(#[from] crate::shipped::NotFound),
    /// Not TOML, or not of the shape of a profile.
    #[error("{message}")]
    Syntax {
        /// File, line, column and what is expected.
        message: String,
    },
    /// A value that cannot be, or that does not fit the others.
    #[error("{file}:{line}: `{key}`: {message}")]
    Check {
        /// The file.
        file: String,
        /// Line of the key, or of its table where the key is absent.
        line: usize,
        /// The key.
        key: String,
        /// What is wrong and what is allowed.
        message: String,
    },
}

/// What a profile is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Drives the coil.
    Driver,
    /// Only measures the pressure, beside a driver.
    PressureSource,
}

/// A profile after all checks, in canonical units.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// File name, for messages and the record.
    pub name: String,
    /// SHA-256 of the file's bytes, hex.
    pub sha256: String,
    /// What it is for.
    pub role: Role,
    /// What the device is.
    pub device: Device,
    /// The line.
    pub transport: Transport,
    /// The values of the device.
    pub signals: Vec<Signal>,
    /// What is exchanged in every slot.
    pub cycle: Cycle,
    /// Largest and smallest set-point, and the fastest change.
    pub limit: SetpointLimit,
    /// The device's communication watchdog.
    pub watchdog: Watchdog,
    /// Measured values at which the run is stopped.
    pub interlock: Interlock,
    /// How the safe state is confirmed; `None` for a pressure source.
    pub safe_state: Option<SafeConfirmation>,
    /// What is checked and set before the first current.
    pub start: StartFile,
}

/// What the device is.
#[derive(Debug, Clone, PartialEq)]
pub struct Device {
    /// Maker.
    pub vendor: String,
    /// Type.
    pub model: String,
    /// Texts that the map was read from.
    pub sources: Vec<String>,
    /// How far the profile has been tried.
    pub verified: Verified,
    /// How often the device renews its values [Hz].
    pub update_hz: f64,
    /// Whether this is an emulator's own map.
    pub emulated: bool,
}

/// The line to the device, in canonical units.
#[derive(Debug, Clone, PartialEq)]
pub struct Transport {
    /// How frames travel.
    pub kind: TransportKind,
    /// Unit id of signals that name none.
    pub unit: u8,
    /// Bits per second; 0 on TCP.
    pub baud: u32,
    /// Parity.
    pub parity: Parity,
    /// Stop bits.
    pub stop_bits: u8,
    /// Start, data, parity and stop bits of one character.
    pub bits_per_character: u32,
    /// Whether low-latency mode is asked for.
    pub low_latency: bool,
    /// Whether the adapter returns sent bytes.
    pub local_echo: bool,
    /// Longest documented answer time [s].
    pub turnaround_s: f64,
    /// Function codes that the device documents; none for a line driver.
    pub functions: Vec<u8>,
}

/// A gapless block of registers.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// First register.
    pub address: u16,
    /// Number of registers.
    pub words: u16,
    /// Indices of its signals in the order of their addresses.
    pub signals: Vec<usize>,
}

/// Request and reply of a line driver.
#[derive(Debug, Clone, PartialEq)]
pub struct LineExchange {
    /// What is sent.
    pub request: Template,
    /// What comes back.
    pub reply: Template,
}

/// One request with its reply.
#[derive(Debug, Clone, PartialEq)]
pub struct Transaction {
    /// Modbus function code; 0 for a line driver.
    pub function: u8,
    /// Unit id.
    pub unit_id: u8,
    /// Registers that are written.
    pub write: Option<Block>,
    /// Registers that are read.
    pub read: Option<Block>,
    /// How the reply is shown to belong to the request.
    pub freshness: Freshness,
    /// Readable registers behind the read block.
    pub spare: u16,
    /// Registers by which the quantity grows, so that no value is cut in two.
    pub step: u16,
    /// Lines of a line driver.
    pub line: Option<LineExchange>,
}

/// What is exchanged in every slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Cycle {
    /// Longest wait for one reply [s].
    pub timeout_s: f64,
    /// The transactions in their order.
    pub transactions: Vec<Transaction>,
}

/// Limits of the set-point; all zero for a pressure source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetpointLimit {
    /// Smallest current [A].
    pub min_a: f64,
    /// Largest current [A].
    pub max_a: f64,
    /// Fastest change [A/s].
    pub slew_a_per_s: Option<f64>,
}

/// The device's communication watchdog.
#[derive(Debug, Clone, PartialEq)]
pub struct Watchdog {
    /// Whether there is one.
    pub kind: WatchdogKind,
    /// Time after which it acts [s]; 0 where there is none.
    pub time_s: f64,
    /// What it does.
    pub on_trip: OnTrip,
    /// Registers that arm it.
    pub set: Vec<RegisterValue>,
    /// Registers that show that it is armed.
    pub check: Vec<RegisterValue>,
    /// Registers that clear it.
    pub reset: Vec<RegisterValue>,
}

impl Watchdog {
    /// Whether it takes the current away when the host falls silent.
    pub fn protects(&self) -> bool {
        self.kind != WatchdogKind::None && self.on_trip == OnTrip::Zero
    }
}

/// Measured values at which the run is stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interlock {
    /// Largest pressure [bar].
    pub pressure_max_bar: Option<f64>,
    /// Largest rate of the pressure [bar/s].
    pub pressure_rate_max_bar_per_s: Option<f64>,
    /// Largest step of the pressure from one sample to the next, where the profile names no rate [bar].
    pub pressure_step_max_bar: Option<f64>,
    /// Largest measured current [A].
    pub current_max_a: Option<f64>,
    /// Difference of measured and commanded current [A], and for how long it may last [s].
    pub current_deviation: Option<(f64, f64)>,
    /// Lost samples in a row.
    pub lost_max: u32,
}

/// How the safe state is confirmed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeConfirmation {
    /// The signal: `current`, or `pressure`, which may be that of a pressure source.
    pub name: SignalName,
    /// It must fall below this, in its canonical unit.
    pub below: f64,
    /// Time from the first write [s].
    pub within_s: f64,
}
