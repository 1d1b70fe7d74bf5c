//! The records of a data group as one stream of bytes.
//!
//! They stand in one `##DT` block or in many that a list (`##DL`, `##HL`) names, each plain or compressed
//! (`##DZ`: deflate, or deflate of the transposed records). A record may be split between two blocks.
//!
//! # Source
//! ASAM MDF 4.1, "Data list block", "Data zipped block".

use std::collections::VecDeque;
use std::io::{Read, Seek};

use super::block::{Blocks, HEADER, Visited};

/// A compressed block that grows to more than this is damaged.
const INFLATED_LIMIT: u64 = 256 << 20;

/// Where the next bytes come from.
enum Chunk {
    Plain { at: u64, left: u64 },
    Inflated { bytes: Vec<u8>, at: usize },
}

/// Bytes of a data group, block after block.
pub(super) struct Stream<'a, F> {
    blocks: &'a mut Blocks<F>,
    /// Data blocks still to come.
    waiting: VecDeque<u64>,
    /// Next list of data blocks, 0 after the last.
    next_list: u64,
    chunk: Chunk,
    visited: Visited,
    /// What was noticed on the way.
    pub notes: Vec<String>,
}

impl<'a, F: Read + Seek> Stream<'a, F> {
    /// The stream that begins at a data group's link to its data.
    pub fn new(blocks: &'a mut Blocks<F>, address: u64) -> Self {
        let chunk = Chunk::Inflated { bytes: Vec::new(), at: 0 };
        let waiting = VecDeque::from_iter((address != 0).then_some(address));
        Self { blocks, waiting, next_list: 0, chunk, visited: Visited::default(), notes: Vec::new() }
    }

    /// Fills `buffer` as far as there are bytes; fewer than its length mean the end.
    pub fn read(&mut self, buffer: &mut [u8]) -> Result<usize, String> {
        let mut filled = 0;
        while filled < buffer.len() {
            let wanted = &mut buffer[filled..];
            let count = match &mut self.chunk {
                Chunk::Plain { at, left } => {
                    let count = wanted.len().min(usize::try_from(*left).unwrap_or(usize::MAX));
                    self.blocks.exactly(*at, &mut wanted[..count])?;
                    *at += count as u64;
                    *left -= count as u64;
                    count
                }
                Chunk::Inflated { bytes, at } => {
                    let count = wanted.len().min(bytes.len() - *at);
                    wanted[..count].copy_from_slice(&bytes[*at..*at + count]);
                    *at += count;
                    count
                }
            };
            filled += count;
            if count == 0 && !self.next_chunk()? {
                break;
            }
        }
        Ok(filled)
    }

    fn next_chunk(&mut self) -> Result<bool, String> {
        loop {
            let Some(address) = self.waiting.pop_front() else {
                if self.next_list == 0 {
                    return Ok(false);
                }
                self.waiting.push_back(std::mem::take(&mut self.next_list));
                continue;
            };
            self.visited.add(address)?;
            let header = self.blocks.header(address)?;
            match &header.id {
                b"##DT" => {
                    let to_the_end = self.blocks.length - address - HEADER;
                    let said = header.length.saturating_sub(HEADER);
                    // A logger that lost its power never wrote the length of its last block.
                    let left = if said == 0 && self.blocks.unfinished { to_the_end } else { said.min(to_the_end) };
                    if left < said {
                        self.notes.push(format!("the file is cut: {left} of {said} bytes of records are there"));
                    }
                    self.chunk = Chunk::Plain { at: address + HEADER, left };
                    return Ok(true);
                }
                b"##DZ" => {
                    self.chunk = Chunk::Inflated { bytes: self.inflate(address, header.length)?, at: 0 };
                    return Ok(true);
                }
                b"##HL" => self.next_list = self.blocks.block(address, &[b"##HL"])?.link(0),
                b"##DL" => {
                    let list = self.blocks.block(address, &[b"##DL"])?;
                    self.next_list = list.link(0);
                    self.waiting.extend(list.links.iter().skip(1).filter(|l| **l != 0));
                }
                other => {
                    let name = String::from_utf8_lossy(other);
                    return Err(format!("records in a block {name} (byte {address}) are not read; allowed: ##DT, ##DZ, ##DL, ##HL"));
                }
            }
        }
    }

    fn inflate(&mut self, address: u64, length: u64) -> Result<Vec<u8>, String> {
        const FIXED: u64 = 24;
        let mut head = [0; FIXED as usize];
        self.blocks.exactly(address + HEADER, &mut head)?;
        let number = |from: usize, to: usize| head[from..to].iter().rev().fold(0u64, |w, b| w << 8 | u64::from(*b));
        let (kind, columns, original, packed) = (head[2], number(4, 8) as usize, number(8, 16), number(16, 24));
        if kind > 1 {
            return Err(format!(
                "the compression {kind} of the block at byte {address} is not known; allowed: 0 (deflate), 1 (transposed)"
            ));
        }
        let room = length.min(self.blocks.length - address).saturating_sub(HEADER + FIXED);
        if packed > room || original > INFLATED_LIMIT {
            return Err(format!("the compressed block at byte {address} says a length that it cannot have"));
        }
        let mut raw = vec![0; packed as usize];
        self.blocks.exactly(address + HEADER + FIXED, &mut raw)?;
        let mut bytes = Vec::new();
        flate2::read::ZlibDecoder::new(&raw[..])
            .take(original)
            .read_to_end(&mut bytes)
            .map_err(|e| format!("the compressed block at byte {address}: {e}"))?;
        if bytes.len() as u64 != original {
            return Err(format!("the compressed block at byte {address} holds {} bytes where {original} are said", bytes.len()));
        }
        Ok(if kind == 1 && columns > 0 { transposed_back(&bytes, columns) } else { bytes })
    }
}

/// Undoes the transposition: the matrix has `columns` bytes in each row; what fills no row stands at the end.
fn transposed_back(bytes: &[u8], columns: usize) -> Vec<u8> {
    let rows = bytes.len() / columns;
    let mut plain = Vec::with_capacity(bytes.len());
    for row in 0..rows {
        plain.extend((0..columns).map(|column| bytes[column * rows + row]));
    }
    plain.extend_from_slice(&bytes[rows * columns..]);
    plain
}

#[cfg(test)]
mod tests {
    use super::transposed_back;

    #[test]
    fn a_transposed_block_comes_back_with_its_tail() {
        // Rows abc, def and the tail g are stored column by column.
        assert_eq!(transposed_back(b"adbecfg", 3), b"abcdefg");
        assert_eq!(transposed_back(b"ab", 3), b"ab");
        assert_eq!(transposed_back(b"", 3), b"");
    }
}
