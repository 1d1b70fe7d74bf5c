//! Every channel of every group with all its values, for somebody who does not know yet what is in the file.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::block::Blocks;
use super::conversion::Conversion;
use super::layout;
use super::{Reader, Tap};
use crate::recording::RecordingError;
use crate::recording::raw::{Content, RawColumn, Table};

pub(in crate::recording) fn table(path: &Path, file: &str) -> Result<Table, RecordingError> {
    let damaged = |what: String| RecordingError::format(file, what);
    let handle = File::open(path).map_err(RecordingError::io(path))?;
    let mut blocks = Blocks::open(BufReader::with_capacity(1 << 16, handle)).map_err(damaged)?;
    let groups = layout::groups(&mut blocks).map_err(damaged)?;
    let mut reader = Reader { blocks, file, map: &[], notes: Vec::new() };
    let mut columns = Vec::new();
    for (number, group) in groups.iter().enumerate() {
        let mut taps = Vec::new();
        let mut names = Vec::new();
        for channel in &group.channels {
            let label = (group.label(number, &groups), channel.name.clone(), (!channel.unit.is_empty()).then(|| channel.unit.clone()));
            match channel.raw(group).and_then(|raw| Ok((raw, Conversion::read(&mut reader.blocks, channel.conversion, 0)?))) {
                Ok(((raw, validity), conversion)) => {
                    taps.push(Tap { raw, validity, conversion, scale: 1.0, offset: 0.0, out: Vec::new() });
                    names.push(label);
                }
                // A text, an array: shown, and nothing more is known of it.
                Err(_) => columns.push(RawColumn { group: label.0, header: label.1, unit: label.2, content: Content::Empty }),
            }
        }
        reader.decode(group, &mut taps).map_err(damaged)?;
        for ((group, header, unit), tap) in names.into_iter().zip(taps) {
            let content = if tap.out.iter().any(|v| v.is_finite()) { Content::Numbers(tap.out) } else { Content::Empty };
            columns.push(RawColumn { group, header, unit, content });
        }
    }
    Ok(Table { columns, header_row: None, notes: reader.notes })
}
