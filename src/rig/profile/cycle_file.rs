//! What is exchanged in every slot, as it is typed: the transactions and their proofs of freshness.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::units::Time;

/// What is exchanged in every slot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CycleFile {
    /// Longest wait for the reply to one transaction.
    pub timeout: Time,
    /// The transactions in their order.
    pub transaction: Vec<TransactionFile>,
}

/// One request with its reply.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransactionFile {
    /// Modbus function code: 3, 4, 6, 16 or 23; not for a line driver.
    #[serde(default)]
    pub function: Option<u8>,
    /// Signals that are written, one gapless block.
    #[serde(default)]
    pub write: Vec<String>,
    /// Signals that are read, one gapless block.
    #[serde(default)]
    pub read: Vec<String>,
    /// How the reply is shown to belong to this request.
    pub freshness: Freshness,
    /// Readable registers behind the block, for `freshness = "quantity"`: 3 or more.
    #[serde(default)]
    pub spare: u16,
    /// Request of a line driver: text with `{signal}` in the unit and digits of its format.
    #[serde(default)]
    pub request: Option<String>,
    /// Reply of a line driver.
    #[serde(default)]
    pub reply: Option<String>,
    /// End of a line, default CR LF.
    #[serde(default)]
    pub terminator: Option<String>,
    /// Checksum behind the text of a line.
    #[serde(default)]
    pub checksum: Checksum,
}

/// Checksum behind the text of a line, written as upper-case hex digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Checksum {
    /// None.
    #[default]
    None,
    /// `*` and the exclusive or of all bytes, two digits.
    Xor,
    /// The sum of all bytes modulo 256, two digits.
    Sum8,
    /// CRC-16/MODBUS, four digits.
    Crc16,
}

/// How a reply is shown to belong to its request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Freshness {
    /// A written value comes back in the reply, and differs from those of the last requests.
    Echo,
    /// The number of registers asked for differs from that of the last requests.
    Quantity,
    /// A counter in the reply has moved, and is not one seen before.
    Counter,
    /// The transaction id of Modbus TCP.
    TransactionId,
    /// None: every sample is stale, and a verdict from it INVALID.
    None,
}
