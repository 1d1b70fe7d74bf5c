//! Writes MDF 4.10: one data group with one channel group per run, values as 64-bit floats, gaps as NaN.
//!
//! Blocks of descriptions come first, each after the blocks that it links to; then the records.
//!
//! # Source
//! ASAM MDF 4.1, lengths and order of the fields of each block.

use std::io::Write;

use crate::recording::{Channel, Recording, Run};

/// Length of the blocks that stand at fixed places: identification, then header.
const IDENTIFICATION: usize = 64;
const HEAD: usize = 104;
/// Offset of the data link in a data group block.
const DATA_LINK: usize = 24 + 2 * 8;

pub(in crate::recording) fn write(recording: &Recording, out: &mut impl Write) -> std::io::Result<()> {
    let mut meta = Meta(vec![0; IDENTIFICATION + HEAD]);
    let xml = "<FHcomment><TX>written</TX><tool_id>hil</tool_id><tool_vendor>hil</tool_vendor><tool_version>1</tool_version></FHcomment>";
    let comment = meta.text(b"##MD", xml);
    let history = meta.block(b"##FH", &[0, comment], &[0; 16]);
    let channels = recording.channels();
    // The chain of data groups is built from its end, so that every link leads to a block that is there.
    let mut next = 0;
    let mut groups = Vec::new();
    for run in recording.runs.iter().rev() {
        next = meta.data_group(run, &channels, next);
        groups.push(next);
    }
    groups.reverse();

    let mut at = meta.0.len() as u64;
    for (run, group) in recording.runs.iter().zip(&groups) {
        let link = *group as usize + DATA_LINK;
        meta.0[link..link + 8].copy_from_slice(&at.to_le_bytes());
        at += 24 + record_bytes(run, &channels) as u64 * run.len() as u64;
        at = at.next_multiple_of(8);
    }
    let head = Meta::bytes(b"##HD", &[next, history, 0, 0, 0, 0], &[0; 32]);
    meta.0[..8].copy_from_slice(b"MDF     ");
    meta.0[8..16].copy_from_slice(b"4.10    ");
    meta.0[16..24].copy_from_slice(b"hil     ");
    meta.0[28..30].copy_from_slice(&410u16.to_le_bytes());
    meta.0[IDENTIFICATION..IDENTIFICATION + HEAD].copy_from_slice(&head);
    out.write_all(&meta.0)?;
    recording.runs.iter().try_for_each(|run| records(run, &channels, out))
}

/// The columns of a run that are there, time first.
fn columns<'a>(run: &'a Run, channels: &[Channel]) -> Vec<&'a [f64]> {
    std::iter::once(&run.time_s[..]).chain(channels.iter().filter_map(|c| run.channel(*c))).collect()
}

fn record_bytes(run: &Run, channels: &[Channel]) -> usize {
    8 * columns(run, channels).len()
}

fn records(run: &Run, channels: &[Channel], out: &mut impl Write) -> std::io::Result<()> {
    let columns = columns(run, channels);
    let length = 24 + 8 * columns.len() as u64 * run.len() as u64;
    out.write_all(b"##DT\0\0\0\0")?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(&[0; 8])?;
    for sample in 0..run.len() {
        for values in &columns {
            out.write_all(&values.get(sample).copied().unwrap_or(f64::NAN).to_le_bytes())?;
        }
    }
    Ok(())
}

/// Blocks of descriptions, at the addresses that they will have in the file.
struct Meta(Vec<u8>);

impl Meta {
    fn bytes(id: &[u8; 4], links: &[u64], data: &[u8]) -> Vec<u8> {
        let length = 24 + 8 * links.len() + data.len();
        let mut bytes = Vec::with_capacity(length);
        bytes.extend_from_slice(id);
        bytes.extend_from_slice(&[0; 4]);
        bytes.extend_from_slice(&(length as u64).to_le_bytes());
        bytes.extend_from_slice(&(links.len() as u64).to_le_bytes());
        links.iter().for_each(|l| bytes.extend_from_slice(&l.to_le_bytes()));
        bytes.extend_from_slice(data);
        bytes
    }

    /// Appends a block and returns its address.
    fn block(&mut self, id: &[u8; 4], links: &[u64], data: &[u8]) -> u64 {
        let address = self.0.len() as u64;
        self.0.extend(Self::bytes(id, links, data));
        self.0.resize(self.0.len().next_multiple_of(8), 0);
        address
    }

    fn text(&mut self, id: &[u8; 4], text: &str) -> u64 {
        let mut data = text.as_bytes().to_vec();
        data.push(0);
        data.resize(data.len().next_multiple_of(8), 0);
        self.block(id, &[], &data)
    }

    fn data_group(&mut self, run: &Run, channels: &[Channel], next: u64) -> u64 {
        let mut all = vec![("time_s", "s", true)];
        all.extend(channels.iter().filter(|c| run.channel(**c).is_some()).map(|c| (c.name(), c.unit().symbol, false)));
        let mut next_channel = 0;
        for (at, (name, unit, master)) in all.iter().enumerate().rev() {
            let (name, unit) = (self.text(b"##TX", name), self.text(b"##TX", unit));
            let mut data = vec![0; 72];
            // Channel type 2 is a master, its synchronisation 1 is time; data type 4 is a little-endian float.
            (data[0], data[1], data[2]) = if *master { (2, 1, 4) } else { (0, 0, 4) };
            data[4..8].copy_from_slice(&(8 * at as u32).to_le_bytes());
            data[8..12].copy_from_slice(&64u32.to_le_bytes());
            next_channel = self.block(b"##CN", &[next_channel, 0, name, 0, 0, 0, unit, 0], &data);
        }
        let name = run.name.as_ref().map_or(0, |name| self.text(b"##TX", name));
        let mut data = vec![0; 32];
        data[8..16].copy_from_slice(&(run.len() as u64).to_le_bytes());
        data[24..28].copy_from_slice(&(8 * all.len() as u32).to_le_bytes());
        let group = self.block(b"##CG", &[0, next_channel, name, 0, 0, 0], &data);
        self.block(b"##DG", &[next, group, 0, 0], &[0; 8])
    }
}
