//! Modbus frames by hand, as a server sees them: RTU with CRC, TCP with its header.
//!
//! Written apart from the driver's codec, so that a mistake in one is not repeated in the other, and so that a frame
//! can be wrong on purpose.

use crate::rig::profile::crc16;

/// A request as it arrived.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// Unit id.
    pub unit: u8,
    /// Function code and data.
    pub pdu: Vec<u8>,
    /// Transaction id of Modbus TCP; 0 on RTU.
    pub transaction: u16,
    /// Bytes of the whole frame.
    pub length: usize,
}

/// What the start of a buffer holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Parsed {
    /// A whole request of this many bytes.
    Request(Request),
    /// More bytes are needed.
    Incomplete,
    /// Not a request; this many bytes can be dropped.
    Garbage(usize),
}

/// Length of the request PDU that begins with these bytes; `None` where more are needed, 0 where it is unknown.
fn pdu_length(pdu: &[u8]) -> Option<usize> {
    match pdu.first()? {
        1..=6 => Some(5),
        15 | 16 => pdu.get(5).map(|n| 6 + usize::from(*n)),
        23 => pdu.get(9).map(|n| 10 + usize::from(*n)),
        _ => Some(0),
    }
}

/// Reads an RTU request from the start of `bytes`.
pub fn parse_rtu(bytes: &[u8]) -> Parsed {
    let Some(length) = bytes.get(1..).and_then(pdu_length) else { return Parsed::Incomplete };
    // Of an unknown function the length is unknown: take what came, if its CRC is right.
    let end = if length == 0 { bytes.len() } else { 1 + length + 2 };
    if bytes.len() < end {
        return Parsed::Incomplete;
    }
    if end < 4 || crc16(&bytes[..end]) != 0 {
        return Parsed::Garbage(1);
    }
    Parsed::Request(Request { unit: bytes[0], pdu: bytes[1..end - 2].to_vec(), transaction: 0, length: end })
}

/// Reads a TCP request from the start of `bytes`.
pub fn parse_tcp(bytes: &[u8]) -> Parsed {
    let [t0, t1, p0, p1, l0, l1, ..] = *bytes else { return Parsed::Incomplete };
    let length = usize::from(u16::from_be_bytes([l0, l1]));
    if (p0, p1) != (0, 0) || !(2..=254).contains(&length) {
        return Parsed::Garbage(bytes.len());
    }
    let Some(body) = bytes.get(6..6 + length) else { return Parsed::Incomplete };
    Parsed::Request(Request { unit: body[0], pdu: body[1..].to_vec(), transaction: u16::from_be_bytes([t0, t1]), length: 6 + length })
}

/// An RTU frame; `crc_error` turns a bit of its CRC.
pub fn rtu(unit: u8, pdu: &[u8], crc_error: bool) -> Vec<u8> {
    let mut frame = Vec::with_capacity(pdu.len() + 3);
    frame.push(unit);
    frame.extend_from_slice(pdu);
    let crc = crc16(&frame) ^ u16::from(crc_error);
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

/// A TCP frame; `header_error` gives it a foreign protocol id.
pub fn tcp(transaction: u16, unit: u8, pdu: &[u8], header_error: bool) -> Vec<u8> {
    let mut frame = Vec::with_capacity(pdu.len() + 7);
    frame.extend_from_slice(&transaction.to_be_bytes());
    frame.extend_from_slice(&u16::from(header_error).to_be_bytes());
    frame.extend_from_slice(&(pdu.len() as u16 + 1).to_be_bytes());
    frame.push(unit);
    frame.extend_from_slice(pdu);
    frame
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_published_request_is_read() {
        // Unit 17 reads holding registers 107 to 109; the example of the protocol's own documents.
        let frame = [0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87];
        let request = Request { unit: 0x11, pdu: vec![0x03, 0x00, 0x6B, 0x00, 0x03], transaction: 0, length: 8 };
        assert_eq!(parse_rtu(&frame), Parsed::Request(request));
        assert_eq!(parse_rtu(&frame[..7]), Parsed::Incomplete);
        assert_eq!(rtu(0x11, &[0x03, 0x00, 0x6B, 0x00, 0x03], false), frame);
        assert_eq!(parse_rtu(&rtu(0x11, &[0x03, 0x00, 0x6B, 0x00, 0x03], true)), Parsed::Garbage(1));
    }

    #[test]
    fn a_tcp_request_is_read() {
        let frame = tcp(7, 1, &[3, 0, 0, 0, 2], false);
        assert_eq!(frame, [0, 7, 0, 0, 0, 6, 1, 3, 0, 0, 0, 2]);
        assert_eq!(parse_tcp(&frame), Parsed::Request(Request { unit: 1, pdu: vec![3, 0, 0, 0, 2], transaction: 7, length: 12 }));
        assert_eq!(parse_tcp(&tcp(7, 1, &[3, 0, 0, 0, 2], true)), Parsed::Garbage(12));
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _ = parse_rtu(&bytes);
            let _ = parse_tcp(&bytes);
        }
    }
}
