//! Blocks of an MDF4 file: every one has an id, links to other blocks and data.
//!
//! All lengths and addresses come from the file and are checked before they are used.
//!
//! # Source
//! ASAM MDF 4.1, "General block structure".

use std::collections::HashSet;
use std::io::{Read, Seek, SeekFrom};

/// A block of descriptions longer than this is damaged.
const BLOCK_LIMIT: u64 = 64 << 20;
/// Length of a block's header: id, reserved, length, number of links.
pub(super) const HEADER: u64 = 24;

/// A file that blocks are read from.
pub(super) struct Blocks<F> {
    input: F,
    /// Length of the file.
    pub length: u64,
    /// Whether the logger did not close the file.
    pub unfinished: bool,
}

/// A block of descriptions.
pub(super) struct Block {
    pub id: [u8; 4],
    pub links: Vec<u64>,
    pub data: Vec<u8>,
}

/// Header of a block.
pub(super) struct Header {
    pub id: [u8; 4],
    pub length: u64,
    pub links: u64,
}

impl Block {
    /// The address behind link `at`, 0 where there is none.
    pub fn link(&self, at: usize) -> u64 {
        self.links.get(at).copied().unwrap_or(0)
    }
    fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        self.data.get(at..at + N).and_then(|b| b.try_into().ok()).unwrap_or([0; N])
    }
    pub fn u8(&self, at: usize) -> u8 {
        u8::from_le_bytes(self.bytes(at))
    }
    pub fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.bytes(at))
    }
    pub fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes(at))
    }
    pub fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.bytes(at))
    }
    pub fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.bytes(at))
    }
}

impl<F: Read + Seek> Blocks<F> {
    /// Opens a file and checks that it is MDF 4.
    pub fn open(mut input: F) -> Result<Self, String> {
        let length = input.seek(SeekFrom::End(0)).map_err(|e| e.to_string())?;
        let mut blocks = Self { input, length, unfinished: false };
        let mut id = [0; 64];
        if length < 64 {
            return Err("shorter than the head of an MDF file".into());
        }
        blocks.exactly(0, &mut id)?;
        match &id[..8] {
            b"MDF     " => {}
            b"UnFinMF " => blocks.unfinished = true,
            _ => return Err("not an MDF file: it does not begin with `MDF`".into()),
        }
        let version = u16::from_le_bytes([id[28], id[29]]);
        if !(400..500).contains(&version) {
            return Err(format!(
                "MDF version {}.{:02}; only MDF 4 is read: convert it, for instance with asammdf",
                version / 100,
                version % 100
            ));
        }
        Ok(blocks)
    }

    /// Fills `buffer` from `address` on.
    pub fn exactly(&mut self, address: u64, buffer: &mut [u8]) -> Result<(), String> {
        let read = self.input.seek(SeekFrom::Start(address)).and_then(|_| self.input.read_exact(buffer));
        read.map_err(|e| format!("at byte {address}: {e}"))
    }

    /// The header of the block at `address`.
    pub fn header(&mut self, address: u64) -> Result<Header, String> {
        if address < 64 || address.checked_add(HEADER).is_none_or(|end| end > self.length) {
            return Err(format!("a link leads to byte {address}, outside of the file"));
        }
        let mut raw = [0; HEADER as usize];
        self.exactly(address, &mut raw)?;
        let word = |at: usize| raw[at..at + 8].iter().rev().fold(0u64, |w, b| w << 8 | u64::from(*b));
        let id = [raw[0], raw[1], raw[2], raw[3]];
        if id[..2] != *b"##" {
            return Err(format!("at byte {address} a block is wanted, but none begins there"));
        }
        let header = Header { id, length: word(8), links: word(16) };
        if header.links.checked_mul(8).and_then(|l| l.checked_add(HEADER)).is_none_or(|l| l > header.length.max(HEADER)) {
            return Err(format!("the block at byte {address} is shorter than its links"));
        }
        Ok(header)
    }

    /// The block of descriptions at `address`, which must be one of `ids`.
    pub fn block(&mut self, address: u64, ids: &[&[u8; 4]]) -> Result<Block, String> {
        let header = self.header(address)?;
        let name = String::from_utf8_lossy(&header.id).into_owned();
        if !ids.contains(&&header.id) {
            let allowed: Vec<_> = ids.iter().map(|id| String::from_utf8_lossy(*id)).collect();
            return Err(format!("at byte {address} stands a block {name} where {} is wanted", allowed.join(" or ")));
        }
        let end = address.checked_add(header.length);
        if header.length < HEADER || header.length > BLOCK_LIMIT || end.is_none_or(|end| end > self.length) {
            return Err(format!("the block {name} at byte {address} says a length of {} bytes, which it cannot have", header.length));
        }
        let mut raw = vec![0; (header.length - HEADER) as usize];
        self.exactly(address + HEADER, &mut raw)?;
        let data = raw.split_off(header.links as usize * 8);
        let links = raw.chunks_exact(8).map(|l| l.iter().rev().fold(0u64, |w, b| w << 8 | u64::from(*b))).collect();
        Ok(Block { id: header.id, links, data })
    }

    /// The text of a `##TX` or `##MD` block; empty where there is none.
    pub fn text(&mut self, address: u64) -> Result<String, String> {
        if address == 0 {
            return Ok(String::new());
        }
        let block = self.block(address, &[b"##TX", b"##MD"])?;
        let end = block.data.iter().position(|b| *b == 0).unwrap_or(block.data.len());
        let text = String::from_utf8_lossy(&block.data[..end]).into_owned();
        if block.id == *b"##MD"
            && let Some((from, to)) = text.find("<TX>").zip(text.find("</TX>"))
        {
            return Ok(text.get(from + 4..to).unwrap_or_default().into());
        }
        Ok(text)
    }
}

/// Refuses a chain of blocks that comes back to itself.
#[derive(Default)]
pub(super) struct Visited(HashSet<u64>);

impl Visited {
    pub fn add(&mut self, address: u64) -> Result<(), String> {
        if self.0.insert(address) { Ok(()) } else { Err(format!("the chain of blocks comes back to byte {address}")) }
    }
}
