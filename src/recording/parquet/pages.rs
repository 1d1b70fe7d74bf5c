//! The pages of one column: what their headers claim is looked at before the library makes room for it.
//!
//! Source: Apache Parquet, parquet.thrift (PageHeader).

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use parquet::column::reader::ColumnReader;
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::reader::{FileReader, SerializedFileReader};

use super::compact::Compact;

/// Most bytes of a page once it is unpacked: two may be there at once, and writers make pages of about a megabyte.
const MOST_BYTES: i64 = 1 << 28;
/// What is read of a page for its header at first, and where that is not enough [bytes].
const HEADER: [u64; 2] = [1 << 10, 1 << 24];
/// `uncompressed_page_size` and `compressed_page_size` in the header of a page.
const UNPACKED: i64 = 2;
const PACKED: i64 = 3;

/// A file that was opened.
pub struct Opened {
    /// The library's reader.
    pub reader: SerializedFileReader<File>,
    /// The file itself.
    pub handle: File,
}

/// A column of one row group.
pub struct Chunk {
    /// The library's reader.
    pub reader: ColumnReader,
    /// Definition levels.
    pub levels: i16,
    /// Rows that the group says it has; the pages may say otherwise.
    pub rows: usize,
}

impl Opened {
    /// What the footer says.
    pub fn metadata(&self) -> &ParquetMetaData {
        self.reader.metadata()
    }

    /// Column `at` of row group `group`.
    pub fn chunk(&self, group: usize, at: usize) -> Result<Chunk, ParquetError> {
        let group = self.reader.get_row_group(group)?;
        let column = group.metadata().column(at);
        let (begin, length) = column.byte_range();
        self.checked(begin, begin.saturating_add(length))?;
        let (levels, rows) = (column.column_descr().max_def_level(), usize::try_from(group.metadata().num_rows())?);
        Ok(Chunk { reader: group.get_column_reader(at)?, levels, rows })
    }

    /// Looks at the header of each page between two places.
    fn checked(&self, mut at: u64, end: u64) -> Result<(), ParquetError> {
        while at < end {
            let seen = HEADER.into_iter().find_map(|most| self.header(at, most.min(end - at)).transpose());
            let Some(header) = seen.transpose()? else { return Err(damaged("the header of a page is damaged")) };
            if header.unpacked > MOST_BYTES {
                return Err(damaged(&format!("a page claims {} bytes; at most {MOST_BYTES} are read", header.unpacked)));
            }
            at = at.saturating_add(header.length).saturating_add_signed(header.packed.max(0));
        }
        Ok(())
    }

    /// The header of the page at a place; `None` where it is longer than what is looked at.
    fn header(&self, at: u64, most: u64) -> Result<Option<Header>, ParquetError> {
        let mut bytes = Vec::new();
        let mut handle = &self.handle;
        handle.seek(SeekFrom::Start(at))?;
        handle.take(most).read_to_end(&mut bytes)?;
        Ok(Header::of(&bytes))
    }
}

/// What the header of a page says.
#[derive(Debug, PartialEq)]
struct Header {
    /// Its own bytes.
    length: u64,
    /// Bytes of the page as they stand in the file, and once they are unpacked.
    packed: i64,
    unpacked: i64,
}

impl Header {
    fn of(bytes: &[u8]) -> Option<Self> {
        let mut compact = Compact::new(bytes);
        let (mut packed, mut unpacked, mut last) = (0, 0, 0);
        while let Some((field, kind)) = compact.field(&mut last)? {
            match (field, kind) {
                (UNPACKED, Compact::INTEGER) => unpacked = compact.signed()?,
                (PACKED, Compact::INTEGER) => packed = compact.signed()?,
                _ => compact.skip(kind, 0)?,
            }
        }
        Some(Self { length: (bytes.len() - compact.left()) as u64, packed, unpacked })
    }
}

fn damaged(what: &str) -> ParquetError {
    ParquetError::General(what.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::parquet::footer::open;
    use crate::recording::{Recording, RecordingError, Run};

    /// A data page: its kind, what it claims to be unpacked (zigzag, five bytes of a varint), 100 bytes packed, and a struct of its own.
    fn header(claims: u32) -> Vec<u8> {
        let mut bytes = vec![0x15, 0, 0x15];
        let mut left = u64::from(claims) << 1;
        while left > 0x7f {
            bytes.push(left as u8 | 0x80);
            left >>= 7;
        }
        bytes.push(left as u8);
        bytes.extend([0x15, 0xc8, 1, 0x2c, 0x15, 0x14, 0x15, 0, 0x15, 6, 0x15, 6, 0, 0]);
        bytes
    }

    #[test]
    fn what_a_page_claims_is_read_from_its_header() {
        let bytes = header(2_000_000_000);
        let found = Header::of(&[bytes.as_slice(), &[0; 100]].concat());
        assert_eq!(found, Some(Header { length: bytes.len() as u64, packed: 100, unpacked: 2_000_000_000 }));
        assert_eq!(Header::of(&bytes[..bytes.len() - 1]), None);
    }

    /// The first page of a file says that it is of two gigabytes once it is unpacked.
    #[test]
    fn a_page_that_claims_gigabytes_is_refused_before_room_is_made() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page.parquet");
        let time_s: Vec<f64> = (0..500).map(|k| 0.01 * f64::from(k)).collect();
        let current_a: Vec<f64> = time_s.iter().map(|t| (7.3 * t).sin()).collect();
        let run = Run { pressure_bar: Some(current_a.clone()), time_s, current_a, ..Run::default() };
        Recording { source: "page".into(), runs: vec![run], notes: Vec::new(), input: None }.write(&path).unwrap();
        let opened = open(&path, "page.parquet").unwrap();
        let (begin, _) = opened.metadata().row_group(0).column(0).byte_range();
        assert!(opened.chunk(0, 0).is_ok());
        let mut bytes = std::fs::read(&path).unwrap();
        let claims = header(2_000_000_000);
        bytes[begin as usize..][..claims.len()].copy_from_slice(&claims);
        std::fs::write(&path, bytes).unwrap();
        let said = Recording::read(&path, &[]).map_err(|e: RecordingError| e.to_string()).unwrap_err();
        assert!(said.contains("a page claims 2000000000 bytes; at most 268435456 are read"), "{said}");
    }
}
