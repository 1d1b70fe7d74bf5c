//! The driver profile as it is typed: one TOML file per device (`schema = "hil.driver/1"`).
//!
//! Only the shape is here; what belongs together is checked in [`super::check`].

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cycle_file::CycleFile;
use crate::units::{Current, CurrentRate, Frequency, Pressure, PressureRate, Time};

/// A driver profile: how a current driver, or a pressure transmitter, is spoken to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProfileFile {
    /// `hil.driver/1`.
    pub schema: String,
    /// What the device is and where its map was read.
    pub device: DeviceFile,
    /// The line to the device.
    pub transport: TransportFile,
    /// The values that the device holds, by name.
    #[serde(default)]
    pub signal: SignalsFile,
    /// What is exchanged in every slot of the loop.
    pub cycle: CycleFile,
    /// The device's own communication watchdog.
    pub watchdog: WatchdogFile,
    /// Measured values at which the run is stopped and the rig made safe.
    #[serde(default)]
    pub interlock: InterlockFile,
    /// How the safe state is written and confirmed; absent only for a pressure transmitter.
    #[serde(default)]
    pub safe_state: Option<SafeStateFile>,
    /// What is checked and set before the first current.
    #[serde(default)]
    pub start: StartFile,
}

/// What the device is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeviceFile {
    /// Maker.
    pub vendor: String,
    /// Type.
    pub model: String,
    /// The public texts that the map was read from; never empty.
    pub sources: Vec<String>,
    /// How far the profile has been tried.
    pub verified: Verified,
    /// How often the device renews its measured values; a faster loop is refused.
    pub update: Frequency,
    /// Whether this is an emulator's own map: records say so, and never count as those of a real valve.
    #[serde(default)]
    pub emulated: bool,
    /// Remarks for people.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// How far a profile has been tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verified {
    /// Read from a data sheet, never run.
    Unverified,
    /// Run against the emulator only.
    Emulated,
    /// Run against the real device.
    Bench,
}

/// The line to the device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransportFile {
    /// How frames travel.
    pub kind: TransportKind,
    /// Modbus unit id, 1 to 247; on TCP also 0 and 255, which mean "the device at this address".
    #[serde(default)]
    pub unit: Option<u8>,
    /// Bits per second of a serial line.
    #[serde(default)]
    pub baud: Option<u32>,
    /// Parity of a serial line.
    #[serde(default)]
    pub parity: Parity,
    /// Stop bits of a serial line: 1 or 2.
    #[serde(default)]
    pub stop_bits: Option<u8>,
    /// Ask the operating system for the serial port's low-latency mode; the outcome is recorded.
    #[serde(default)]
    pub low_latency: bool,
    /// The adapter returns every sent byte: the own bytes are stripped.
    #[serde(default)]
    pub local_echo: bool,
    /// The device's longest documented answer time, for the wire budget.
    pub turnaround: Time,
    /// Modbus function codes that the device documents.
    #[serde(default)]
    pub functions: Vec<u8>,
}

/// How frames travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TransportKind {
    /// Modbus RTU on a serial line.
    Rtu,
    /// Modbus TCP, spoken by the device itself.
    Tcp,
    /// Modbus TCP to a gateway with the device on a serial line behind it: the transaction id is the gateway's and proves nothing.
    TcpGateway,
    /// Modbus RTU frames through a TCP serial server.
    RtuOverTcp,
    /// Lines of text on a serial line, or through a TCP serial server.
    Line,
}

/// Parity of a serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Parity {
    /// No parity bit.
    #[default]
    None,
    /// Even parity.
    Even,
    /// Odd parity.
    Odd,
}

/// The values that the device holds. The names are fixed, and each fixes the dimension of its unit.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SignalsFile {
    /// The commanded current.
    pub setpoint: Option<SignalFile>,
    /// A word written with every set-point, for instance an enable bit; `constant` gives its value.
    pub control: Option<SignalFile>,
    /// A word that the device gives back as it was written: proves that a reply is fresh.
    pub token: Option<SignalFile>,
    /// Status bits.
    pub status: Option<SignalFile>,
    /// Counts the device's conversions: proves that the measured values are fresh.
    pub counter: Option<SignalFile>,
    /// The measured current.
    pub current: Option<SignalFile>,
    /// The measured pressure.
    pub pressure: Option<SignalFile>,
    /// The supply pressure.
    pub supply: Option<SignalFile>,
    /// The oil temperature.
    pub oil_temp: Option<SignalFile>,
}

/// One value of the device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SignalFile {
    /// Modbus table; not for a line driver.
    #[serde(default)]
    pub table: Option<Table>,
    /// Zero-based protocol address, never the 4xxxx form; not for a line driver.
    #[serde(default)]
    pub address: Option<u16>,
    /// Unit id where it differs from that of the transport: a second module on the same line.
    #[serde(default)]
    pub unit: Option<u8>,
    /// Type of the raw value.
    #[serde(default, rename = "type")]
    pub kind: RawType,
    /// Order of the words of a 32-bit value.
    #[serde(default)]
    pub word_order: WordOrder,
    /// What one count of the raw value is worth, with its unit: `"0.1 mA"`.
    #[serde(default)]
    pub scale: Option<String>,
    /// What a raw value of 0 is worth, with its unit.
    #[serde(default)]
    pub offset: Option<String>,
    /// Two points instead of scale and offset.
    #[serde(default)]
    pub map: Option<TwoPointFile>,
    /// Raw values outside this window are a sensor fault (live zero).
    #[serde(default)]
    pub valid_raw: Option<(f64, f64)>,
    /// Values outside this window, with their units, are implausible.
    #[serde(default)]
    pub valid: Option<(String, String)>,
    /// Limits of the set-point; a value outside is refused, never clamped.
    #[serde(default)]
    pub limit: Option<LimitFile>,
    /// The value written by every cycle (`control` only).
    #[serde(default)]
    pub constant: Option<u16>,
    /// The value written by the safe state (`control` only).
    #[serde(default)]
    pub safe: Option<u16>,
    /// Bits of a status word by name, 0 the lowest.
    #[serde(default)]
    pub bits: BTreeMap<String, u8>,
    /// The states of bits that mean a fault.
    #[serde(default)]
    pub fault_when: BTreeMap<String, bool>,
    /// The same raw value for longer than this, while the set-point moved by more than 50 mA, is a frozen sensor.
    #[serde(default)]
    pub frozen_after: Option<Time>,
    /// Counts a second (`counter` only); `device.update` where it is not given.
    #[serde(default)]
    pub rate: Option<Frequency>,
}

/// Modbus table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Table {
    /// Holding registers: read with 3 and 23, written with 6, 16 and 23.
    Holding,
    /// Input registers: read with 4.
    Input,
}

/// Type of a raw value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum RawType {
    /// One register, 0 to 65535.
    #[default]
    U16,
    /// One register, two's complement.
    I16,
    /// Two registers, unsigned.
    U32,
    /// Two registers, two's complement.
    I32,
    /// Two registers, IEEE 754 single precision.
    F32,
}

/// Order of the words of a 32-bit value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum WordOrder {
    /// The high word at the lower address.
    #[default]
    Big,
    /// The low word at the lower address.
    Little,
}

/// Two points of a straight line from raw counts to a value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TwoPointFile {
    /// Two raw values.
    pub raw: (f64, f64),
    /// Their values with units.
    pub value: (String, String),
}

/// Limits of the set-point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitFile {
    /// Smallest current that may be sent.
    pub min: Current,
    /// Largest current that may be sent.
    pub max: Current,
    /// Fastest change that may be sent.
    #[serde(default)]
    pub slew: Option<CurrentRate>,
}

/// The device's own communication watchdog.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WatchdogFile {
    /// Whether there is one.
    pub kind: WatchdogKind,
    /// Time after which the device acts on silence.
    #[serde(default)]
    pub time: Option<Time>,
    /// What the device does then.
    #[serde(default)]
    pub on_trip: OnTrip,
    /// Registers that arm it.
    #[serde(default)]
    pub set: Vec<RegisterValue>,
    /// Registers that show that it is armed.
    #[serde(default)]
    pub check: Vec<RegisterValue>,
    /// Registers that clear it after a trip.
    #[serde(default)]
    pub reset: Vec<RegisterValue>,
}

/// Whether the device has a communication watchdog.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum WatchdogKind {
    /// Armed by registers.
    Register,
    /// Always on, cannot be set from here.
    Fixed,
    /// None documented: a run needs an explicit override, which is recorded.
    None,
}

/// What the device does when its watchdog trips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum OnTrip {
    /// The current goes to zero.
    Zero,
    /// The outputs stay as they are: no protection.
    Freeze,
    /// Not documented.
    #[default]
    Unknown,
}

/// A register with the value that is written to it or expected in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterValue {
    /// Modbus table.
    pub table: Table,
    /// Zero-based protocol address.
    pub address: u16,
    /// Raw value.
    pub value: u16,
    /// Unit id where it differs from that of the transport.
    #[serde(default)]
    pub unit: Option<u8>,
}

/// Measured values at which the run is stopped.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InterlockFile {
    /// Largest pressure.
    #[serde(default)]
    pub pressure_max: Option<Pressure>,
    /// Largest rate of the pressure, over two good samples; by default half of the largest pressure from one sample to the next.
    #[serde(default)]
    pub pressure_rate_max: Option<PressureRate>,
    /// Largest measured current.
    #[serde(default)]
    pub current_max: Option<Current>,
    /// Largest difference of measured and commanded current: a broken wire, or a coil that takes no current.
    #[serde(default)]
    pub current_deviation: Option<Current>,
    /// For how long the current may differ by more.
    #[serde(default)]
    pub current_deviation_for: Option<Time>,
    /// Lost samples in a row, default 3.
    #[serde(default)]
    pub lost_max: Option<u32>,
}

/// How the safe state is confirmed. It is written as set-point 0 and then, where there is one, `control.safe`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SafeStateFile {
    /// The signal that confirms it: `current`, or `pressure` where the device measures no current.
    pub confirm: String,
    /// It must fall below this value with its unit.
    pub below: String,
    /// Time from the first write to the confirmation.
    pub within: Time,
}

/// What is checked and set before the first current.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StartFile {
    /// Registers that identify the device.
    #[serde(default)]
    pub identity: Vec<RegisterValue>,
    /// Registers written before the run.
    #[serde(default)]
    pub init: Vec<RegisterValue>,
}
