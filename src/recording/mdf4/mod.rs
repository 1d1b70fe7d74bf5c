//! Recordings as ASAM MDF 4 (`.mf4`), read and written.
//!
//! Every channel group that holds the command is a run; its master channel is the time. A pressure that was recorded in
//! another group keeps the times of its own: between two readings nothing is known, and the mean of two has less noise
//! than one. Other channels of other groups are interpolated. Compressed data are read block by block, so that memory
//! grows with the channels that are asked for and not with the file.

mod block;
mod conversion;
mod data;
mod layout;
mod table;
mod write;

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

pub(super) use table::table;
pub(super) use write::write;

use super::mapping::Role;
use super::source::{Rows, Source, resolve, unknown_unit};
use super::{Channel as Known, Mapping, RecordingError};
use block::Blocks;
use conversion::Conversion;
use data::Stream;
use layout::{Group, Raw, Validity};

/// Bytes of records decoded at a time.
const BATCH_BYTES: usize = 1 << 18;
/// A record longer than this is damaged.
const RECORD_LIMIT: usize = 16 << 20;

pub(super) fn read(path: &Path, file: &str, map: &[Mapping]) -> Result<Rows, RecordingError> {
    let handle = File::open(path).map_err(RecordingError::io(path))?;
    read_from(BufReader::with_capacity(1 << 16, handle), file, map)
}

pub(super) fn read_from(input: impl Read + Seek, file: &str, map: &[Mapping]) -> Result<Rows, RecordingError> {
    let damaged = |what: String| RecordingError::format(file, what);
    let mut blocks = Blocks::open(input).map_err(damaged)?;
    let groups = layout::groups(&mut blocks).map_err(damaged)?;
    let labels: Vec<String> = groups.iter().enumerate().map(|(n, g)| g.label(n, &groups)).collect();
    let label = |group: &Group| groups.iter().position(|g| std::ptr::eq(g, group)).map_or("", |at| labels[at].as_str());
    let has = |group: &Group, role: Role| {
        let mapping = map.iter().find(|m| m.role == role);
        let named = |name: &str| match mapping {
            Some(m) => is_named(m, label(group), name),
            None => name == role.name(),
        };
        group.channels.iter().any(|c| named(&c.name))
    };
    if map.iter().any(|m| m.role == Role::Run) {
        return Err(damaged("the runs of an MDF file are its channel groups: `run` cannot be mapped".into()));
    }
    let command = Role::Channel(Known::Current);
    let with_command: Vec<&Group> = groups.iter().filter(|g| has(g, command)).collect();
    let mut reader = Reader { blocks, file, map, notes: Vec::new() };
    if with_command.is_empty() {
        // Says which channels there are.
        resolve(file, &all_channels(&groups), map, true)?;
        return Err(damaged("no channel group holds the command".into()));
    }

    let mut rows = Rows { file: file.into(), ..Rows::default() };
    let single = with_command.len() == 1;
    for (number, group) in with_command.iter().enumerate() {
        let mut columns = reader.columns(group, label(group), Role::all().filter(|r| *r != Role::Run && has(group, *r)))?;
        for role in Role::all().filter(|r| *r != Role::Run && *r != Role::Time && !has(group, *r)) {
            let mut elsewhere = groups.iter().filter(|g| has(g, role));
            let other = match (elsewhere.next(), elsewhere.next()) {
                (Some(other), None) if single => other,
                (Some(_), Some(_)) if single => {
                    let name = map.iter().find(|m| m.role == role).map_or(role.name(), |m| m.column.as_str());
                    let places: Vec<String> = groups.iter().filter(|g| has(g, role)).map(|g| format!("`{}/{name}`", label(g))).collect();
                    return Err(damaged(format!(
                        "`{}` is there in several channel groups; map one of them as group/channel: {}",
                        role.name(),
                        places.join(", ")
                    )));
                }
                (None, _) if map.iter().any(|m| m.role == role) => {
                    return Err(resolve(file, &all_channels(&groups), map, true)
                        .err()
                        .unwrap_or_else(|| damaged(format!("no `{}`", role.name()))));
                }
                _ => continue,
            };
            let found = reader.columns(other, label(other), [role].into_iter())?;
            if role == Role::Channel(Known::Pressure) {
                let shared = columns.time_s == found.time_s;
                columns =
                    columns.beside(found).ok_or_else(|| damaged("`pressure_bar`: the time of a channel group does not increase".into()))?;
                if !shared {
                    reader.notes.push("pressure_bar was recorded in another channel group: its readings keep their own times".into());
                }
                continue;
            }
            let hold = role == Role::Channel(Known::Target);
            let values = at_times(&columns.time_s, &found.time_s, &found.values[0].1, hold)
                .ok_or_else(|| damaged(format!("`{}`: the time of its channel group does not increase", role.name())))?;
            reader.notes.push(format!("{} was recorded in another channel group: interpolated at the times of current_a", role.name()));
            columns.values.push((role, values));
        }
        let from = rows.time_s.len();
        let name = if group.name.is_empty() && !single { (number + 1).to_string() } else { group.name.clone() };
        rows.segments.push(((!name.is_empty()).then_some(name), from));
        rows.append(columns);
    }
    if !single {
        reader.notes.push(format!("{} channel groups hold current_a: taken as so many runs", with_command.len()));
    }
    rows.notes = reader.notes;
    rows.notes.dedup();
    Ok(rows)
}

/// Whether a mapping means the channel `name` of the group `label`.
fn is_named(mapping: &Mapping, label: &str, name: &str) -> bool {
    let of_group = |text: &str| text.strip_prefix(label).and_then(|rest| rest.strip_prefix('/')) == Some(name);
    [mapping.text.as_str(), mapping.column.as_str()].iter().any(|text| *text == name || of_group(text))
}

/// Every channel, with its group where there are several.
fn all_channels(groups: &[Group]) -> Vec<String> {
    let named = |(number, group): (usize, &Group)| {
        let label = if groups.len() > 1 { format!("{}/", group.label(number, groups)) } else { String::new() };
        group.channels.iter().map(|c| format!("{label}{}", c.name)).collect::<Vec<_>>()
    };
    groups.iter().enumerate().flat_map(named).collect()
}

/// What was read from one group.
struct Columns {
    time_s: Vec<f64>,
    values: Vec<(Role, Vec<f64>)>,
}

impl Columns {
    /// With the columns of another group, each at its own times: a value that was not recorded at a time is NaN there.
    /// `None` where a time does not increase.
    fn beside(self, other: Self) -> Option<Self> {
        if self.time_s == other.time_s {
            let values = self.values.into_iter().chain(other.values).collect();
            return Some(Self { time_s: self.time_s, values });
        }
        if [&self, &other].iter().any(|c| c.time_s.windows(2).any(|w| w[1].partial_cmp(&w[0]) != Some(std::cmp::Ordering::Greater))) {
            return None;
        }
        const SAME_S: f64 = 1e-6;
        let (mut time_s, mut places) = (Vec::with_capacity(self.time_s.len() + other.time_s.len()), [Vec::new(), Vec::new()]);
        let (mut a, mut b) = (self.time_s.iter().peekable(), other.time_s.iter().peekable());
        loop {
            let now = match (a.peek(), b.peek()) {
                (Some(x), Some(y)) => x.min(**y),
                (Some(x), None) | (None, Some(x)) => **x,
                (None, None) => break,
            };
            for (column, place) in [&mut a, &mut b].into_iter().zip(&mut places) {
                // Two clocks that count in different steps meet but for their last digits.
                if column.next_if(|t| **t - now <= SAME_S).is_some() {
                    place.push(time_s.len());
                }
            }
            time_s.push(now);
        }
        let spread = |(columns, place): (Vec<(Role, Vec<f64>)>, &Vec<usize>)| {
            let at = |values: Vec<f64>| {
                let mut all = vec![f64::NAN; time_s.len()];
                place.iter().zip(values).for_each(|(row, value)| all[*row] = value);
                all
            };
            columns.into_iter().map(|(role, values)| (role, at(values))).collect::<Vec<_>>()
        };
        let values = [(self.values, &places[0]), (other.values, &places[1])].into_iter().flat_map(spread).collect();
        Some(Self { time_s, values })
    }
}

impl Rows {
    fn append(&mut self, columns: Columns) {
        let (from, to) = (self.time_s.len(), self.time_s.len() + columns.time_s.len());
        if from == 0 {
            self.time_s = columns.time_s;
        } else {
            self.time_s.extend(columns.time_s);
        }
        for (role, values) in columns.values {
            let Role::Channel(channel) = role else { continue };
            let all = self.channels[channel.index()].get_or_insert_default();
            if from == 0 {
                *all = values;
            } else {
                all.resize(from, f64::NAN);
                all.extend(values);
            }
        }
        self.channels.iter_mut().flatten().for_each(|v| v.resize(to, f64::NAN));
    }
}

/// Reads columns of one file.
struct Reader<'a, F> {
    blocks: Blocks<F>,
    file: &'a str,
    map: &'a [Mapping],
    notes: Vec<String>,
}

/// A channel on its way from the record to a column.
struct Tap {
    raw: Raw,
    validity: Validity,
    conversion: Conversion,
    scale: f64,
    offset: f64,
    out: Vec<f64>,
}

impl<F: Read + Seek> Reader<'_, F> {
    /// The time and the columns of `roles` of a group.
    fn columns(&mut self, group: &Group, label: &str, roles: impl Iterator<Item = Role>) -> Result<Columns, RecordingError> {
        let names: Vec<String> = group.channels.iter().map(|c| c.name.clone()).collect();
        let wanted: Vec<Role> = roles.collect();
        // Within its group a channel goes by its own name.
        let own = |m: &Mapping| match names.iter().find(|n| is_named(m, label, n)) {
            Some(name) => Mapping { text: name.clone(), column: name.clone(), ..m.clone() },
            None => m.clone(),
        };
        let map: Vec<Mapping> = self.map.iter().map(own).collect();
        let mut sources = sources(self.file, &names, &map, &wanted)?;
        if !sources.iter().any(|s| s.role == Role::Time) {
            let column = group.master().ok_or_else(|| {
                RecordingError::format(self.file, format!("the channel group `{}` has no time: no master channel", group.name))
            })?;
            sources.insert(0, Source { role: Role::Time, column, second: None, scale: 1.0, offset: 0.0, bare: true });
        }
        let mut taps = Vec::new();
        for source in &mut sources {
            let channel = &group.channels[source.column];
            let refused = |what: String| RecordingError::format(self.file, format!("channel `{}`: {what}", channel.name));
            if source.bare && !channel.unit.is_empty() {
                let conversion = source.role.conversion(&channel.unit);
                (source.scale, source.offset) = conversion.map_err(|what| unknown_unit(self.file, &channel.name, source.role, &what))?;
            }
            let (raw, validity) = channel.raw(group).map_err(refused)?;
            let conversion = Conversion::read(&mut self.blocks, channel.conversion, 0).map_err(refused)?;
            taps.push(Tap { raw, validity, conversion, scale: source.scale, offset: source.offset, out: Vec::new() });
        }
        self.decode(group, &mut taps).map_err(|what| RecordingError::format(self.file, what))?;
        let mut columns = Columns { time_s: Vec::new(), values: Vec::new() };
        for (source, tap) in sources.iter().zip(taps) {
            match source.role {
                Role::Time => columns.time_s = tap.out,
                role => columns.values.push((role, tap.out)),
            }
        }
        Ok(columns)
    }

    fn decode(&mut self, group: &Group, taps: &mut [Tap]) -> Result<(), String> {
        let unfinished = self.blocks.unfinished;
        let most = if unfinished && group.cycles == 0 { u64::MAX } else { group.cycles };
        let size = group.data_bytes + group.invalid_bytes;
        if size == 0 {
            return Err(format!("the records of channel group `{}` hold nothing", group.name));
        }
        if size > RECORD_LIMIT {
            return Err(format!("the records of channel group `{}` say a length of {size} bytes", group.name));
        }
        if group.varying {
            return Err(format!("the records of channel group `{}` vary in length", group.name));
        }
        // A cycle count that the file cannot hold must not reserve memory.
        let guess = most.min(self.blocks.length) as usize;
        taps.iter_mut().for_each(|t| drop(t.out.try_reserve_exact(guess)));
        let mut stream = Stream::new(&mut self.blocks, group.data);
        let mut index = 0;
        if group.id_bytes == 0 || group.shared.len() == 1 {
            let step = group.id_bytes + size;
            let batch = (BATCH_BYTES / step).max(1);
            let mut buffer = vec![0; step * batch];
            while index < most {
                let want = usize::try_from(most - index).unwrap_or(batch).min(batch) * step;
                let read = stream.read(&mut buffer[..want])?;
                for record in buffer[..read].chunks_exact(step) {
                    take(taps, &record[group.id_bytes..], index);
                    index += 1;
                }
                if read < want {
                    break;
                }
            }
        } else {
            index = unsorted(&mut stream, group, taps, most)?;
        }
        let notes = std::mem::take(&mut stream.notes);
        self.notes.extend(notes);
        if most != u64::MAX && index < most {
            self.notes.push(format!("channel group `{}`: {index} of {most} records are there", group.name));
        }
        if unfinished {
            self.notes.push("the file was not closed by the logger".into());
        }
        Ok(())
    }
}

fn take(taps: &mut [Tap], record: &[u8], index: u64) {
    for tap in taps {
        let value = if tap.validity.holds(record) { tap.conversion.apply(tap.raw.value(record, index)) } else { f64::NAN };
        let value = if value.is_finite() { value * tap.scale + tap.offset } else { f64::NAN };
        tap.out.push(value);
    }
}

/// Records of several groups in turn, each behind the id of its group.
fn unsorted<F: Read + Seek>(stream: &mut Stream<'_, F>, group: &Group, taps: &mut [Tap], most: u64) -> Result<u64, String> {
    let mut index = 0;
    let mut id = [0; 8];
    let mut record = Vec::new();
    while index < most {
        if stream.read(&mut id[..group.id_bytes])? < group.id_bytes {
            break;
        }
        let id = u64::from_le_bytes(id);
        let Some((_, size)) = group.shared.iter().find(|s| s.0 == id) else {
            return Err(format!("a record has the id {id}, which no channel group has"));
        };
        let size = match size {
            Some(size) => *size,
            None => {
                let mut length = [0; 4];
                stream.read(&mut length)?;
                u32::from_le_bytes(length) as usize
            }
        };
        if size > RECORD_LIMIT {
            return Err(format!("a record says a length of {size} bytes"));
        }
        record.resize(size, 0);
        if stream.read(&mut record)? < size {
            break;
        }
        if id == group.record_id {
            take(taps, &record, index);
            index += 1;
        }
    }
    Ok(index)
}

/// The sources of `wanted` among the channels of one group.
fn sources(file: &str, names: &[String], map: &[Mapping], wanted: &[Role]) -> Result<Vec<Source>, RecordingError> {
    let command = Role::Channel(Known::Current);
    let map: Vec<Mapping> = map.iter().filter(|m| wanted.contains(&m.role)).cloned().collect();
    let mut names = names.to_vec();
    // `resolve` asks for a command; a group that only lends another channel has none.
    let lends = !wanted.contains(&command);
    if lends {
        names.push(command.name().into());
    }
    let mut sources = resolve(file, &names, &map, true)?;
    sources.retain(|s| wanted.contains(&s.role));
    Ok(sources)
}

/// Values at `times`, on a straight line between the neighbours, or the last one where it is held; NaN outside.
///
/// `None` where `known` does not increase.
fn at_times(times: &[f64], known: &[f64], values: &[f64], hold: bool) -> Option<Vec<f64>> {
    if known.windows(2).any(|w| w[0].partial_cmp(&w[1]) != Some(std::cmp::Ordering::Less)) {
        return None;
    }
    let at = |t: &f64| {
        let after = known.partition_point(|k| k < t);
        match (after.checked_sub(1), known.get(after)) {
            (_, Some(k)) if k == t => values[after],
            (Some(before), Some(_)) if hold => values[before],
            (Some(before), Some(k)) => {
                let share = (t - known[before]) / (k - known[before]);
                values[before] + share * (values[after] - values[before])
            }
            _ => f64::NAN,
        }
    };
    Some(times.iter().map(at).collect())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::io::{Cursor, Write};

    fn zipped(bytes: &[u8], transposed: bool) -> Vec<u8> {
        let columns = 24;
        let rows = bytes.len() / columns;
        let mut plain = bytes.to_vec();
        if transposed {
            for (at, byte) in plain.iter_mut().enumerate().take(rows * columns) {
                *byte = bytes[at % rows * columns + at / rows];
            }
        }
        let mut zip = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        zip.write_all(&plain).unwrap();
        let packed = zip.finish().unwrap();
        let mut block = b"##DZ\0\0\0\0".to_vec();
        block.extend((48 + packed.len() as u64).to_le_bytes());
        block.extend([0; 8]);
        block.extend([b'D', b'T', u8::from(transposed), 0]);
        block.extend((columns as u32).to_le_bytes());
        block.extend((bytes.len() as u64).to_le_bytes());
        block.extend((packed.len() as u64).to_le_bytes());
        block.extend(packed);
        block
    }

    fn block(id: &[u8; 4], links: &[u64], data: &[u8]) -> Vec<u8> {
        let mut block = id.to_vec();
        block.extend([0; 4]);
        block.extend((24 + 8 * links.len() as u64 + data.len() as u64).to_le_bytes());
        block.extend((links.len() as u64).to_le_bytes());
        links.iter().for_each(|l| block.extend(l.to_le_bytes()));
        block.extend(data);
        block
    }

    fn table() -> Recording {
        let rows: String =
            (0..200).map(|k| format!("{},{},{}\n", f64::from(k) / 64.0, 0.5 + f64::from(k) / 512.0, f64::from(k * k) / 8.0)).collect();
        Recording::from_csv(format!("time_s,current_a,pressure_bar\n{rows}"), "r.csv", &[]).unwrap()
    }

    use crate::recording::Recording;

    /// A file whose records stand in three blocks, the first two compressed, cut in the middle of a record.
    pub(in crate::recording) fn compressed(transposed: bool) -> Vec<u8> {
        let mut file = Vec::new();
        write(&table(), &mut file).unwrap();
        let link = |file: &[u8], at: usize| u64::from_le_bytes(file[at..at + 8].try_into().unwrap()) as usize;
        let group = link(&file, 64 + 24);
        let data = link(&file, group + 40);
        let records = file.split_off(data)[24..].to_vec();
        let mut links = vec![0];
        let pieces =
            [zipped(&records[..1000], transposed), zipped(&records[1000..3001], transposed), block(b"##DT", &[], &records[3001..])];
        for piece in pieces {
            links.push(file.len() as u64);
            file.extend(piece);
            file.resize(file.len().next_multiple_of(8), 0);
        }
        let list = file.len() as u64;
        file.extend(block(b"##DL", &links, &[0; 40]));
        let head = file.len() as u64;
        file.extend(block(b"##HL", &[list], &[0; 8]));
        file[group + 40..group + 48].copy_from_slice(&head.to_le_bytes());
        file
    }

    fn read(bytes: Vec<u8>, map: &[&str]) -> Result<Recording, RecordingError> {
        let map: Vec<Mapping> = map.iter().map(|m| Mapping::parse(m).unwrap()).collect();
        crate::recording::clean::recording(read_from(Cursor::new(bytes), "r.mf4", &map)?)
    }

    #[test]
    fn compressed_blocks_that_cut_a_record_read_as_one() {
        for transposed in [false, true] {
            assert_eq!(read(compressed(transposed), &[]).unwrap().runs, table().runs);
        }
    }

    #[test]
    fn a_cut_file_gives_what_is_there_and_says_so() {
        let mut file = Vec::new();
        write(&table(), &mut file).unwrap();
        file.truncate(file.len() - 100);
        let recording = read(file, &[]).unwrap();
        assert_eq!(recording.runs[0].time_s, table().runs[0].time_s[..195]);
        assert_eq!(
            recording.notes,
            ["the file is cut: 4700 of 4800 bytes of records are there", "channel group ``: 195 of 200 records are there"]
        );
    }

    #[test]
    fn what_is_no_mdf4_file_is_refused() {
        let message = |bytes: Vec<u8>, map: &[&str]| read(bytes, map).unwrap_err().to_string();
        let mut file = Vec::new();
        write(&table(), &mut file).unwrap();
        insta::assert_snapshot!(message(Vec::new(), &[]), @"r.mf4: shorter than the head of an MDF file");
        insta::assert_snapshot!(message(vec![b'x'; 100], &[]), @"r.mf4: not an MDF file: it does not begin with `MDF`");
        insta::assert_snapshot!(message(file.clone(), &["current_a=I_cmd [mA]"]), @r#"
        r.mf4: there is no column `I_cmd` for current_a
        the file has: `time_s`, `current_a`, `pressure_bar`
        `hil inspect` shows what is in it and writes a mapping; a foreign name is taken by --map current_a="I_cmd [mA]"
        "#);
        insta::assert_snapshot!(message(file.clone(), &["supply_bar=p_s"]), @r#"
        r.mf4: there is no column `p_s` for supply_bar
        the file has: `time_s`, `current_a`, `pressure_bar`
        `hil inspect` shows what is in it and writes a mapping; a foreign name is taken by --map current_a="I_cmd [mA]"
        "#);
        file[28] = 74;
        file[29] = 1;
        insta::assert_snapshot!(message(file, &[]), @"r.mf4: MDF version 3.30; only MDF 4 is read: convert it, for instance with asammdf");
    }

    #[test]
    fn readings_of_another_group_keep_their_own_times() {
        let role = |channel| Role::Channel(channel);
        let command = Columns { time_s: vec![0.0, 0.01, 0.02], values: vec![(role(Known::Current), vec![0.1, 0.2, 0.3])] };
        let of = |time_s: &[f64]| Columns { time_s: time_s.to_vec(), values: vec![(role(Known::Pressure), vec![1.0, 2.0, 3.0])] };
        let both =
            Columns { time_s: command.time_s.clone(), values: command.values.clone() }.beside(of(&[0.0, 0.010_000_000_1, 0.013])).unwrap();
        assert_eq!(both.time_s, [0.0, 0.01, 0.013, 0.02]);
        let texts = |k: usize| both.values[k].1.iter().map(f64::to_string).collect::<Vec<_>>();
        assert_eq!(
            (texts(0), texts(1)),
            (["0.1", "0.2", "NaN", "0.3"].map(String::from).to_vec(), ["1", "2", "3", "NaN"].map(String::from).to_vec())
        );
        assert!(command.beside(of(&[0.0, 0.02, 0.01])).is_none());
    }

    #[test]
    fn another_rate_is_interpolated_and_a_target_is_held() {
        let (known, values) = ([0.0, 1.0, 2.0], [0.0, 10.0, f64::NAN]);
        let at = |hold| {
            at_times(&[-1.0, 0.0, 0.5, 1.0, 1.5, 3.0], &known, &values, hold).unwrap().iter().map(f64::to_string).collect::<Vec<_>>()
        };
        assert_eq!(at(false), ["NaN", "0", "5", "10", "NaN", "NaN"]);
        assert_eq!(at(true), ["NaN", "0", "0", "10", "10", "NaN"]);
        assert_eq!(at_times(&[0.0], &[1.0, 1.0], &[0.0, 0.0], false), None);
    }
}
