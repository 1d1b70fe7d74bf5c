//! Thrift's compact protocol, as far as it takes to look at what a Parquet file claims.
//!
//! Source: Apache Thrift, thrift-compact-protocol.md.

/// Structs, lists and maps within one another; what is deeper is no metadata.
const MOST_DEPTH: usize = 64;

/// Bytes of thrift's compact protocol; `None` where they end too early.
pub struct Compact<'b> {
    left: &'b [u8],
}

impl<'b> Compact<'b> {
    /// Kinds of fields.
    pub const INTEGER: u8 = 5;
    pub const LIST: u8 = 9;
    pub const STRUCT: u8 = 12;

    /// From the first byte on.
    pub fn new(bytes: &'b [u8]) -> Self {
        Self { left: bytes }
    }

    /// How many bytes are left.
    pub fn left(&self) -> usize {
        self.left.len()
    }

    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.left.split_first()?;
        self.left = rest;
        Some(*first)
    }

    fn pass(&mut self, bytes: u64) -> Option<()> {
        self.left = self.left.get(usize::try_from(bytes).ok()?..)?;
        Some(())
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    /// An integer.
    pub fn signed(&mut self) -> Option<i64> {
        let zigzag = self.varint()?;
        Some((zigzag >> 1) as i64 ^ -((zigzag & 1) as i64))
    }

    /// Number and kind of the next field of a struct; the inner `None` at its end.
    pub fn field(&mut self, last: &mut i64) -> Option<Option<(i64, u8)>> {
        let byte = self.byte()?;
        if byte == 0 {
            return Some(None);
        }
        *last = if byte >> 4 == 0 { self.signed()? } else { last.saturating_add(i64::from(byte >> 4)) };
        Some(Some((*last, byte & 0x0f)))
    }

    /// Size of a list and what it is of.
    pub fn list(&mut self) -> Option<(u64, u8)> {
        let byte = self.byte()?;
        let size = if byte >> 4 == 15 { self.varint()? } else { u64::from(byte >> 4) };
        // Each element takes a byte.
        (size <= self.left.len() as u64).then_some((size, byte & 0x0f))
    }

    /// Passes an element of a list or map: other than as a field, a truth takes a byte.
    pub fn element(&mut self, kind: u8, depth: usize) -> Option<()> {
        if matches!(kind, 1 | 2) { self.pass(1) } else { self.skip(kind, depth) }
    }

    /// Passes a field.
    pub fn skip(&mut self, kind: u8, depth: usize) -> Option<()> {
        if depth > MOST_DEPTH {
            return None;
        }
        match kind {
            1 | 2 => Some(()),
            3 => self.pass(1),
            4..=6 => self.varint().map(|_| ()),
            7 => self.pass(8),
            8 => {
                let bytes = self.varint()?;
                self.pass(bytes)
            }
            Self::LIST | 10 => {
                let (size, of) = self.list()?;
                (0..size).try_for_each(|_| self.element(of, depth + 1))
            }
            11 => {
                let size = self.varint()?;
                let kinds = if size > 0 { self.byte()? } else { 0 };
                (0..size).try_for_each(|_| {
                    self.element(kinds >> 4, depth + 1)?;
                    self.element(kinds & 0x0f, depth + 1)
                })
            }
            Self::STRUCT => {
                let mut last = 0;
                while let Some((_, kind)) = self.field(&mut last)? {
                    self.skip(kind, depth + 1)?;
                }
                Some(())
            }
            _ => None,
        }
    }
}
