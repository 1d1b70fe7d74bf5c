//! What a bus can do for the loop: one transaction with its values, single registers, recovery, and a trace of the
//! raw frames.

use crate::rig::profile::{RegisterValue, SignalName, Transaction};

/// What is sent in one transaction, as raw numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outgoing {
    /// The set-point in the device's counts, or in A for a line driver.
    pub setpoint: f64,
    /// The control word.
    pub control: u16,
    /// The token that the device gives back.
    pub token: u16,
    /// Steps by which more registers are asked for than the block has.
    pub extra: u16,
}

impl Outgoing {
    /// The raw number written for a signal.
    pub fn raw(&self, name: SignalName) -> f64 {
        match name {
            SignalName::Setpoint => self.setpoint,
            SignalName::Control => f64::from(self.control),
            SignalName::Token => f64::from(self.token),
            _ => 0.0,
        }
    }
}

/// The raw numbers that came back, by signal.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Incoming([Option<f64>; 9]);

impl Incoming {
    /// The raw number of a signal, where the reply had it.
    pub fn get(&self, name: SignalName) -> Option<f64> {
        self.0[name as usize]
    }
    /// Notes the raw number of a signal.
    pub fn set(&mut self, name: SignalName, raw: f64) {
        self.0[name as usize] = Some(raw);
    }
}

/// Why a transaction gave no usable reply.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Loss {
    /// Nothing came in time.
    #[error("no reply in time")]
    Timeout,
    /// The device refused.
    #[error("exception {0:#04x} ({name})", name = exception_name(*.0))]
    Exception(u8),
    /// A reply came that does not belong to this request.
    #[error("a reply to another request: {0}")]
    Stale(String),
    /// A reply came that is not one: other unit, function, length.
    #[error("not a reply to this request: {0}")]
    Malformed(String),
    /// The port or the connection failed.
    #[error("{0}")]
    Transport(String),
}

/// What an exception code of the protocol means.
pub fn exception_name(code: u8) -> &'static str {
    match code {
        1 => "illegal function",
        2 => "illegal data address",
        3 => "illegal data value",
        4 => "server device failure",
        5 => "acknowledge",
        6 => "server device busy",
        8 => "memory parity error",
        10 => "gateway path unavailable",
        11 => "gateway target device failed to respond",
        _ => "of the maker",
    }
}

/// A frame as it went over the line.
#[derive(Debug, Clone, PartialEq)]
pub struct TracedFrame {
    /// Time on the loop's clock [s].
    pub time_s: f64,
    /// Whether it was sent or received.
    pub sent: bool,
    /// Its bytes, at most [`TRACED_BYTES`].
    pub bytes: Vec<u8>,
}

/// Bytes of a frame that the trace keeps.
pub const TRACED_BYTES: usize = 40;

/// A line to a device.
pub trait Bus: Send {
    /// One request with its reply, within `timeout_s`.
    fn transact(&mut self, transaction: &Transaction, out: &Outgoing, timeout_s: f64, into: &mut Incoming) -> Result<(), Loss>;
    /// Reads one register.
    fn read_register(&mut self, register: &RegisterValue, timeout_s: f64) -> Result<u16, Loss>;
    /// Writes one register and checks that the device repeats it.
    fn write_register(&mut self, register: &RegisterValue, timeout_s: f64) -> Result<(), Loss>;
    /// What the device holds instead of the registers that the last transaction wrote; `None` where it holds them, or where the
    /// line has no way to ask.
    fn holds_last_write(&mut self, _timeout_s: f64) -> Result<Option<String>, Loss> {
        Ok(None)
    }
    /// Registers of the table in which an emulator identifies itself; `None` where the line has no way to ask.
    fn read_block(&mut self, _address: u16, _count: u16, _timeout_s: f64) -> Result<Vec<u16>, Loss> {
        Ok(Vec::new())
    }
    /// Makes the line usable again after a loss; `within_s` bounds it. True where that took a new connection.
    fn recover(&mut self, within_s: f64) -> bool;
    /// The latest frames, the oldest first.
    fn trace(&self) -> Vec<TracedFrame>;
    /// What is known of the line: low latency granted and the like.
    fn details(&self) -> Vec<(String, String)>;
}
