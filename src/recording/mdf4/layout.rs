//! What an MDF4 file holds: channel groups with their channels, and how a value stands in a record.
//!
//! # Source
//! ASAM MDF 4.1, "Header block", "Data group block", "Channel group block", "Channel block".

use std::io::{Read, Seek};

use super::block::{Block, Blocks, Visited};

/// A channel group: one record per sample.
#[derive(Debug, Default)]
pub(super) struct Group {
    pub name: String,
    pub channels: Vec<Channel>,
    /// Number of records that the file says.
    pub cycles: u64,
    /// Id of its records, where groups share their data.
    pub record_id: u64,
    /// Bytes of values in a record.
    pub data_bytes: usize,
    /// Bytes of invalidation bits behind them.
    pub invalid_bytes: usize,
    /// Whether its records hold values of varying length.
    pub varying: bool,
    /// Bytes of the record id.
    pub id_bytes: usize,
    /// Where the data begin.
    pub data: u64,
    /// Record ids of all groups that share the data, with the bytes of their records; `None` where they vary.
    pub shared: Vec<(u64, Option<usize>)>,
}

/// A channel of a group.
#[derive(Debug)]
pub(super) struct Channel {
    pub name: String,
    pub unit: String,
    /// Address of the conversion.
    pub conversion: u64,
    kind: u8,
    sync: u8,
    data_type: u8,
    bit_offset: u32,
    byte_offset: usize,
    bit_count: u32,
    flags: u32,
    invalid_bit: usize,
    /// Whether it is an array.
    array: bool,
}

/// Reads all channel groups.
pub(super) fn groups<F: Read + Seek>(blocks: &mut Blocks<F>) -> Result<Vec<Group>, String> {
    let mut groups = Vec::new();
    let mut visited = Visited::default();
    let mut next = blocks.block(64, &[b"##HD"])?.link(0);
    while next != 0 {
        visited.add(next)?;
        let data_group = blocks.block(next, &[b"##DG"])?;
        next = data_group.link(0);
        let id_bytes = usize::from(data_group.u8(0));
        if ![0, 1, 2, 4, 8].contains(&id_bytes) {
            return Err(format!("record ids of {id_bytes} bytes; allowed: 0, 1, 2, 4, 8"));
        }
        let (from, mut next_group) = (groups.len(), data_group.link(1));
        while next_group != 0 {
            visited.add(next_group)?;
            let block = blocks.block(next_group, &[b"##CG"])?;
            next_group = block.link(0);
            groups.push(group(blocks, &block, &mut visited, id_bytes, data_group.link(2))?);
        }
        let shared: Vec<_> = groups[from..].iter().map(|g| (g.record_id, (!g.varying).then_some(g.data_bytes + g.invalid_bytes))).collect();
        groups[from..].iter_mut().for_each(|g| g.shared.clone_from(&shared));
    }
    Ok(groups)
}

fn group<F: Read + Seek>(
    blocks: &mut Blocks<F>,
    block: &Block,
    visited: &mut Visited,
    id_bytes: usize,
    data: u64,
) -> Result<Group, String> {
    let mut group = Group {
        name: blocks.text(block.link(2))?,
        record_id: block.u64(0),
        cycles: block.u64(8),
        varying: block.u16(16) & 1 != 0,
        data_bytes: block.u32(24) as usize,
        invalid_bytes: block.u32(28) as usize,
        id_bytes,
        data,
        ..Group::default()
    };
    // Channels within a structure stand in the same record: they are channels like all others.
    let mut waiting = vec![block.link(1)];
    while let Some(address) = waiting.pop() {
        if address == 0 {
            continue;
        }
        visited.add(address)?;
        let block = blocks.block(address, &[b"##CN"])?;
        waiting.push(block.link(0));
        let inner = block.link(1);
        let mut array = false;
        if inner != 0 {
            array = blocks.header(inner)?.id != *b"##CN";
            waiting.extend((!array).then_some(inner));
        }
        group.channels.push(Channel {
            name: blocks.text(block.link(2))?,
            unit: blocks.text(block.link(6))?.trim().to_string(),
            conversion: block.link(4),
            kind: block.u8(0),
            sync: block.u8(1),
            data_type: block.u8(2),
            bit_offset: u32::from(block.u8(3)),
            byte_offset: block.u32(4) as usize,
            bit_count: block.u32(8),
            flags: block.u32(12),
            invalid_bit: block.u32(16) as usize,
            array,
        });
    }
    Ok(group)
}

impl Group {
    /// How the group is called before a `/`: by its name, or by its number where it has none of its own.
    pub fn label(&self, number: usize, all: &[Self]) -> String {
        let own = !self.name.is_empty() && all.iter().filter(|g| g.name == self.name).count() == 1;
        if own { self.name.clone() } else { (number + 1).to_string() }
    }

    /// The channel that holds the time of each record.
    pub fn master(&self) -> Option<usize> {
        self.channels.iter().position(|c| matches!(c.kind, 2 | 3) && c.sync == 1)
    }
}

/// How a value stands in a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Raw {
    /// The number of the record itself.
    Index,
    Integer {
        at: usize,
        bytes: usize,
        shift: u32,
        bits: u32,
        signed: bool,
        big: bool,
    },
    Half {
        at: usize,
        big: bool,
    },
    Single {
        at: usize,
        big: bool,
    },
    Double {
        at: usize,
        big: bool,
    },
}

/// Whether a value counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Validity {
    Always,
    Never,
    /// Unless this bit of this byte is set.
    Unless(usize, u8),
}

impl Channel {
    /// Where the value stands in a record of `group`, or why it cannot be read.
    pub fn raw(&self, group: &Group) -> Result<(Raw, Validity), String> {
        if self.array {
            return Err("every record holds an array; one number is wanted".into());
        }
        let validity = match self.flags & 3 {
            flags if flags & 1 != 0 => Validity::Never,
            flags if flags & 2 != 0 && group.invalid_bytes > 0 => {
                if self.invalid_bit / 8 >= group.invalid_bytes {
                    return Err("its invalidation bit stands outside of the record".into());
                }
                Validity::Unless(group.data_bytes + self.invalid_bit / 8, 1 << (self.invalid_bit % 8))
            }
            _ => Validity::Always,
        };
        let raw = match self.kind {
            3 | 6 => return Ok((Raw::Index, validity)),
            1 => return Err("its values vary in length; numbers are wanted".into()),
            _ => {
                let at = self.byte_offset;
                let bytes = self.bit_offset.saturating_add(self.bit_count).div_ceil(8) as usize;
                let big = self.data_type % 2 == 1;
                let raw = match (self.data_type, self.bit_count) {
                    (0..=3, 1..=64) if self.bit_offset < 8 => {
                        Raw::Integer { at, bytes, shift: self.bit_offset, bits: self.bit_count, signed: self.data_type >= 2, big }
                    }
                    (4 | 5, 16) => Raw::Half { at, big },
                    (4 | 5, 32) => Raw::Single { at, big },
                    (4 | 5, 64) => Raw::Double { at, big },
                    (6..=9, _) => return Err("its values are texts; numbers are wanted".into()),
                    (kind, bits) => return Err(format!("values of the data type {kind} with {bits} bits are no numbers that can be read")),
                };
                if at.checked_add(bytes).is_none_or(|end| end > group.data_bytes) {
                    return Err("its values stand outside of the record".into());
                }
                raw
            }
        };
        Ok((raw, validity))
    }
}

impl Raw {
    /// The raw value in `record` (without its id), the `index`-th of the group.
    pub fn value(self, record: &[u8], index: u64) -> f64 {
        match self {
            Self::Index => index as f64,
            Self::Double { at, big } => {
                let bytes = array(record, at);
                if big { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) }
            }
            Self::Single { at, big } => {
                let bytes = array(record, at);
                f64::from(if big { f32::from_be_bytes(bytes) } else { f32::from_le_bytes(bytes) })
            }
            Self::Half { at, big } => {
                let bytes = array(record, at);
                half(if big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
            }
            Self::Integer { at, bytes, shift, bits, signed, big } => {
                let of = record.get(at..at + bytes).unwrap_or(&[]);
                let join = |word: u128, byte: &u8| word << 8 | u128::from(*byte);
                let word = if big { of.iter().fold(0, join) } else { of.iter().rev().fold(0, join) };
                let value = (word >> shift) as u64 & (u64::MAX >> (64 - bits));
                if signed { ((value << (64 - bits)) as i64 >> (64 - bits)) as f64 } else { value as f64 }
            }
        }
    }
}

impl Validity {
    pub fn holds(self, record: &[u8]) -> bool {
        match self {
            Self::Always => true,
            Self::Never => false,
            Self::Unless(at, bit) => record.get(at).is_some_and(|b| b & bit == 0),
        }
    }
}

fn array<const N: usize>(record: &[u8], at: usize) -> [u8; N] {
    record.get(at..at + N).and_then(|b| b.try_into().ok()).unwrap_or([0; N])
}

/// IEEE 754 half precision.
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2f64.powi(exponent - 25),
    };
    if bits & 0x8000 != 0 { -size } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_of_more_bits_than_can_be_counted_is_refused() {
        let channel = Channel {
            name: "P".into(),
            unit: String::new(),
            conversion: 0,
            kind: 0,
            sync: 0,
            data_type: 0,
            bit_offset: 7,
            byte_offset: 0,
            bit_count: u32::MAX,
            flags: 0,
            invalid_bit: 0,
            array: false,
        };
        let refused = channel.raw(&Group { data_bytes: 8, ..Group::default() });
        assert!(refused.is_err_and(|why| why.contains("bits are no numbers")));
    }

    #[test]
    fn known_raw_values() {
        let record = [0xFE, 0xFF, 0x34, 0x12, 0x00, 0x3C, 0x40, 0x49, 0x0F, 0xDB];
        let integer = |at, bytes, shift, bits, signed, big| Raw::Integer { at, bytes, shift, bits, signed, big }.value(&record, 7);
        assert_eq!(integer(0, 2, 0, 16, true, false), -2.0);
        assert_eq!(integer(0, 2, 0, 16, false, false), 65534.0);
        assert_eq!(integer(0, 2, 0, 16, true, true), -257.0);
        assert_eq!(integer(2, 2, 4, 8, false, false), f64::from(0x23));
        assert_eq!(integer(2, 1, 2, 3, true, false), -3.0);
        assert_eq!(Raw::Half { at: 4, big: false }.value(&record, 7), 1.0);
        assert!((Raw::Single { at: 6, big: true }.value(&record, 7) - std::f64::consts::PI).abs() < 1e-6);
        assert_eq!(Raw::Index.value(&record, 7), 7.0);
        assert_eq!([0x0001, 0xFBFF, 0x7C00].map(half), [2f64.powi(-24), -65504.0, f64::INFINITY]);
    }
}
