//! The journal against cuts, flips, deletions and insertions.

use super::*;

fn line(position: usize) -> Line {
    let dut = Dut { serial: format!("V{position}"), ..Dut::default() };
    Line { event: Kind::Started, position, attempt: 1, at: "2026-01-01T00:00:00Z".into(), dut: Some(dut), record: None }
}

fn all(batch: &Path) -> (Vec<Line>, Vec<Damage>) {
    let mut lines = Vec::new();
    let damage = read(batch, |_, line| {
        lines.push(line);
        Ok(())
    });
    (lines, damage.unwrap())
}

/// A journal of two segments with three lines each, confirmed.
fn two_segments(batch: &Path) {
    for segment in 0..2 {
        let mut journal = Journal::begin(batch).unwrap();
        for i in 0..3 {
            journal.append(&encode(&line(3 * segment + i))).unwrap();
        }
        journal.confirm().unwrap();
    }
}

/// Bytes behind the end of a segment, as a process leaves them that is killed while it writes.
fn append_raw(batch: &Path, segment: u32, bytes: &[u8]) {
    let mut file = OpenOptions::new().append(true).open(segment_path(batch, segment)).unwrap();
    file.write_all(bytes).unwrap();
}

#[test]
fn what_is_confirmed_reads_back_at_its_place() {
    let dir = tempfile::tempdir().unwrap();
    let mut journal = Journal::begin(dir.path()).unwrap();
    let places: Vec<Place> = (0..3).map(|i| journal.append(&encode(&line(i))).unwrap()).collect();
    journal.confirm().unwrap();
    assert_eq!(read_at(dir.path(), places[1]).unwrap(), line(1));
    assert_eq!(all(dir.path()), ((0..3).map(line).collect(), vec![]));
}

/// Cut at every byte of the last line: the lines before it are read, the torn one is named, and a new writer adds behind it.
#[test]
fn a_cut_at_any_byte_loses_nothing_that_was_whole() {
    let framed = frame(&encode(&line(1)), FIRST);
    for cut in 0..framed.len() {
        let dir = tempfile::tempdir().unwrap();
        let mut journal = Journal::begin(dir.path()).unwrap();
        journal.append(&encode(&line(0))).unwrap();
        append_raw(dir.path(), 1, &framed[..cut]);
        let mut second = Journal::begin(dir.path()).unwrap();
        second.append(&encode(&line(2))).unwrap();
        second.confirm().unwrap();
        let (lines, damage) = all(dir.path());
        assert_eq!(lines, [line(0), line(2)]);
        assert_eq!(damage.len(), usize::from(cut > 0));
        assert!(damage.iter().all(|d| d.what == "torn"));
    }
}

#[test]
fn a_flipped_bit_is_found_by_confirm_and_by_read() {
    let dir = tempfile::tempdir().unwrap();
    let mut journal = Journal::begin(dir.path()).unwrap();
    journal.append(&encode(&line(0))).unwrap();
    journal.append(&encode(&line(1))).unwrap();
    let path = segment_path(dir.path(), 1);
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.len() - 20;
    bytes[at] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    assert!(matches!(journal.confirm(), Err(BatchError::NotReadBack { .. })));
    let (lines, damage) = all(dir.path());
    assert_eq!((lines.len(), damage.len(), damage[0].what.as_str()), (1, 1, "damaged"));
}

#[test]
fn every_writer_has_a_segment_of_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let (mut a, mut b) = (Journal::begin(dir.path()).unwrap(), Journal::begin(dir.path()).unwrap());
    for i in 0..50 {
        a.append(&encode(&line(2 * i))).unwrap();
        b.append(&encode(&line(2 * i + 1))).unwrap();
    }
    assert_eq!(segments(dir.path()).unwrap(), [1, 2]);
    assert_eq!(all(dir.path()).0.len(), 100);
}

/// Every line taken out, changed with a right check sum, doubled, and put elsewhere, in both segments: each is named.
#[test]
fn a_lost_changed_or_inserted_line_is_found_and_named() {
    let dir = tempfile::tempdir().unwrap();
    two_segments(dir.path());
    assert_eq!(all(dir.path()).1, []);
    for segment in [1, 2] {
        let path = segment_path(dir.path(), segment);
        let whole = std::fs::read(&path).unwrap();
        let lines: Vec<Vec<u8>> = whole.split_inclusive(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
        let with = |change: &dyn Fn(&mut Vec<Vec<u8>>)| {
            let mut lines = lines.clone();
            change(&mut lines);
            std::fs::write(&path, lines.concat()).unwrap();
            let damage = all(dir.path()).1;
            std::fs::write(&path, &whole).unwrap();
            damage
        };
        for k in 0..3 {
            let forged = |lines: &[Vec<u8>]| {
                let previous = unframe(&lines[k]).unwrap().0.unwrap();
                frame(&encode(&Line { attempt: 9, ..line(k) }), previous)
            };
            type Change<'a> = &'a dyn Fn(&mut Vec<Vec<u8>>);
            let changes: [(&str, Change); 4] = [
                ("lost", &|l| drop(l.remove(k))),
                ("changed", &|l| l[k] = forged(l)),
                ("doubled", &|l| l.insert(k, l[k].clone())),
                ("put in", &|l| l.insert(k, forged(l))),
            ];
            for (what, change) in changes {
                let damage = with(change);
                assert!(!damage.is_empty(), "segment {segment}, line {k}: {what}");
                assert!(damage.iter().all(|d| ["unchained", "lost"].contains(&d.what.as_str())), "{damage:?}");
            }
        }
        assert!(!with(&|l| l.clear()).is_empty(), "a segment without its lines");
    }
    std::fs::remove_file(segment_path(dir.path(), 2)).unwrap();
    let text = all(dir.path()).1[0].text();
    assert!(text.ends_with(" of 000002.jsonl, and what stood there is lost or changed"), "{text}");
}

/// Lines without a digest, as the first version wrote them, are read, and a chain begins behind them.
#[test]
fn a_journal_of_the_first_version_opens_and_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder(dir.path())).unwrap();
    let old: Vec<u8> = (0..3)
        .flat_map(|i| {
            let json = encode(&line(i));
            [format!("{:08x} ", crc(&json)).into_bytes(), json, b"\n".to_vec()].concat()
        })
        .collect();
    std::fs::write(segment_path(dir.path(), 1), &old).unwrap();
    let mut journal = Journal::begin(dir.path()).unwrap();
    journal.append(&encode(&line(3))).unwrap();
    journal.confirm().unwrap();
    assert_eq!(all(dir.path()), ((0..4).map(line).collect(), vec![]));
    std::fs::write(segment_path(dir.path(), 1), &old[..old.len() / 3 + 1]).unwrap();
    assert!(all(dir.path()).1.iter().any(|d| d.what == "unchained"), "the end of the old lines is in the chain");
}

#[test]
fn a_link_in_the_place_of_the_journal_is_not_followed() {
    let (dir, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    std::os::unix::fs::symlink(elsewhere.path(), folder(dir.path())).unwrap();
    assert!(Journal::begin(dir.path()).unwrap_err().to_string().contains("link"));
    assert_eq!(std::fs::read_dir(elsewhere.path()).unwrap().count(), 0);
}
