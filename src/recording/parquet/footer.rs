//! Opening a file: what its footer claims is held against what it can hold, before the library makes room for it.
//!
//! Source: Apache Parquet, parquet.thrift (FileMetaData, SchemaElement).

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use parquet::file::reader::SerializedFileReader;

use super::compact::Compact;
use super::pages::Opened;
use crate::recording::{MOST_VALUES, RecordingError};

/// Most bytes of a footer: a hundred thousand row groups of ten channels need about as many.
const MOST_BYTES: u32 = 1 << 28;
/// Most columns within columns.
const MOST_DEPTH: usize = 64;
/// `schema` in a file's metadata, and `num_children` in an element of it.
const SCHEMA: i64 = 2;
const CHILDREN: i64 = 5;

/// Opens a file.
pub fn open(path: &Path, file: &str) -> Result<Opened, RecordingError> {
    let mut handle = File::open(path).map_err(RecordingError::io(path))?;
    let length = footer_length(&mut handle).map_err(RecordingError::io(path))?;
    if length > MOST_BYTES {
        return Err(RecordingError::format(file, format!("its footer has {length} bytes; at most {MOST_BYTES} are read")));
    }
    if length > 0 {
        let mut footer = vec![0; length as usize];
        handle.seek(SeekFrom::End(-8 - i64::from(length))).map_err(RecordingError::io(path))?;
        handle.read_exact(&mut footer).map_err(RecordingError::io(path))?;
        checked(&footer).map_err(|what| RecordingError::format(file, what))?;
    }
    let reader = SerializedFileReader::new(handle.try_clone().map_err(RecordingError::io(path))?);
    Ok(Opened { reader: reader.map_err(|e| RecordingError::format(file, e))?, handle })
}

/// Refuses more rows of so many columns than are read: rows cost memory, whatever the bytes of the file say. A column of one
/// value is a few bytes for a billion rows.
pub fn bounded(opened: &Opened, file: &str, columns: usize) -> Result<(), RecordingError> {
    let metadata = opened.metadata();
    let summed: u64 = metadata.row_groups().iter().map(|g| g.num_rows().max(0) as u64).sum();
    let rows = summed.max(metadata.file_metadata().num_rows().max(0) as u64);
    if rows.saturating_mul(columns.max(1) as u64) > MOST_VALUES {
        let what = format!("has {rows} rows of {columns} channels; at most {MOST_VALUES} values in all are read");
        return Err(RecordingError::format(file, what));
    }
    Ok(())
}

/// Bytes of the footer as the file says; 0 where it says nothing that can be, which the library tells.
fn footer_length(handle: &mut File) -> std::io::Result<u32> {
    let size = handle.seek(SeekFrom::End(0))?;
    let mut tail = [0; 8];
    if size < 12 {
        return Ok(0);
    }
    handle.seek(SeekFrom::End(-8))?;
    handle.read_exact(&mut tail)?;
    let [a, b, c, d, magic @ ..] = tail;
    let length = u32::from_le_bytes([a, b, c, d]);
    Ok(if magic == *b"PAR1" && u64::from(length) <= size - 8 { length } else { 0 })
}

/// Looks at what the schema claims.
fn checked(footer: &[u8]) -> Result<(), String> {
    let mut bytes = Compact::new(footer);
    let (mut claims, mut last) = (Vec::new(), 0);
    let damaged = || "the file is damaged: its footer ends too early".to_string();
    while let Some((field, kind)) = bytes.field(&mut last).ok_or_else(damaged)? {
        if field == SCHEMA && kind == Compact::LIST {
            let (count, of) = bytes.list().ok_or_else(damaged)?;
            for _ in 0..count {
                claims.push(children(&mut bytes, of).ok_or_else(damaged)?);
            }
        } else {
            bytes.skip(kind, 0).ok_or_else(damaged)?;
        }
    }
    // Each element takes its place below the ones that are still open.
    let mut open: Vec<i64> = Vec::new();
    for (at, claimed) in claims.iter().enumerate() {
        while open.last() == Some(&0) {
            open.pop();
        }
        if let Some(left) = open.last_mut() {
            *left -= 1;
        }
        if *claimed > (claims.len() - at - 1) as i64 {
            return Err(format!("the file is damaged: its schema of {} elements claims {claimed} in one", claims.len()));
        }
        if *claimed > 0 {
            open.push(*claimed);
        }
        if open.len() > MOST_DEPTH {
            return Err(format!("its columns stand more than {MOST_DEPTH} deep in one another"));
        }
    }
    Ok(())
}

/// How many children an element of the schema claims.
fn children(bytes: &mut Compact<'_>, kind: u8) -> Option<i64> {
    if kind != Compact::STRUCT {
        bytes.element(kind, 0)?;
        return Some(0);
    }
    let (mut claimed, mut last) = (0, 0);
    while let Some((field, kind)) = bytes.field(&mut last)? {
        if field == CHILDREN && kind == Compact::INTEGER {
            claimed = bytes.signed()?;
        } else {
            bytes.skip(kind, 0)?;
        }
    }
    Some(claimed)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of nothing but a footer whose schema is one chain: each element claims the given number of children.
    fn claiming(children: impl Iterator<Item = u32>) -> Vec<u8> {
        let mut elements = Vec::new();
        let mut count = 0u32;
        let varint = |out: &mut Vec<u8>, mut value: u32| {
            while value > 0x7f {
                out.push(value as u8 | 0x80);
                value >>= 7;
            }
            out.push(value as u8);
        };
        for claimed in children {
            // Optional (field 3), the name `m` (field 4), its children (field 5).
            elements.extend([0x35, 2, 0x18, 1, b'm', 0x15]);
            varint(&mut elements, 2 * claimed);
            elements.push(0);
            count += 1;
        }
        // The version (field 1), the schema (field 2), no rows (field 3), no row groups (field 4).
        let mut footer = vec![0x15, 2, 0x19, 0xfc];
        varint(&mut footer, count);
        footer.extend(elements);
        footer.extend([0x16, 0, 0x19, 0x0c, 0]);
        let length = (footer.len() as u32).to_le_bytes();
        [b"PAR1".to_vec(), footer, length.to_vec(), b"PAR1".to_vec()].concat()
    }

    fn refused(bytes: &[u8]) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("claims.parquet");
        std::fs::write(&path, bytes).unwrap();
        open(&path, "claims.parquet").map(|_| ()).unwrap_err().to_string()
    }

    #[test]
    fn a_schema_that_claims_more_than_it_has_is_refused_before_room_is_made() {
        let text = refused(&claiming([500_000_000].into_iter()));
        assert!(text.contains("its schema of 1 elements claims 500000000 in one"), "{text}");
    }

    #[test]
    fn columns_within_columns_without_end_are_refused_before_they_are_followed() {
        let deep = 100_000;
        let text = refused(&claiming((0..deep).map(|k| u32::from(k + 1 < deep))));
        assert!(text.contains("more than 64 deep"), "{text}");
    }

    #[test]
    fn a_footer_that_ends_early_is_said() {
        let mut bytes = claiming([1, 0].into_iter());
        let at = bytes.len() - 9;
        bytes[at] = 0x19;
        let text = refused(&bytes);
        assert!(text.contains("its footer ends too early"), "{text}");
    }
}
