//! Damaged files: whatever the bytes, a reader answers with a recording or with a message, and never panics.
//!
//! Valid files are changed at random from fixed seeds (bits, bytes, numbers of the format, cuts, swaps), a
//! bounded number of times per run of the tests. `HIL_FUZZ_ROUNDS` asks for more rounds.

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{Mapping, Recording, RecordingError, clean, mdf4};

/// Numbers that formats stumble over.
const TRAPS: [u64; 12] = [0, 1, 7, 8, 0x7F, 0xFF, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFF, 0x7FFF_FFFF_FFFF_FFFF, u64::MAX, 1 << 40];
/// Texts that a reader of numbers stumbles over.
const TEXTS: [&str; 16] =
    ["nan", "inf", "-", "1e999", "\"", "\n", "\r", "\0", ",", ";", "\t", "#", "\u{feff}", "time_s", "0x1F", "9999999999999999999999"];

fn rounds(usual: usize) -> usize {
    std::env::var("HIL_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

/// Changes `bytes` at one to four places.
fn mutate(bytes: &mut Vec<u8>, random: &mut Pcg64, text: bool) {
    for _ in 0..random.random_range(1..5) {
        if bytes.is_empty() {
            return;
        }
        let at = random.random_range(0..bytes.len());
        match random.random_range(0..8) {
            0 => bytes[at] ^= 1 << random.random_range(0..8),
            1 => bytes[at] = random.random(),
            2 if text => {
                let insert = TEXTS[random.random_range(0..TEXTS.len())];
                bytes.splice(at..at, insert.bytes());
            }
            2 | 3 => {
                let width = [1, 2, 4, 8][random.random_range(0..4)];
                let trap = TRAPS[random.random_range(0..TRAPS.len())].to_le_bytes();
                let end = bytes.len().min(at + width);
                bytes[at..end].copy_from_slice(&trap[..end - at]);
            }
            4 => bytes.truncate(at),
            5 => {
                let end = bytes.len().min(at + random.random_range(1..64));
                bytes.drain(at..end);
            }
            6 => {
                let end = bytes.len().min(at + random.random_range(1..64));
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            _ => {
                // Another address of the same file, as a link.
                let other = (random.random_range(0..bytes.len()) as u64 & !7).to_le_bytes();
                let at = at & !7;
                let end = bytes.len().min(at + 8);
                bytes[at..end].copy_from_slice(&other[..end - at]);
            }
        }
    }
}

/// A recording with all that a file can hold, as it comes in many files: two runs, gaps, a temperature.
fn seed() -> Recording {
    let mut text = String::from("run,time_s,current_a,pressure_bar,oil_temp_c\n");
    for k in 0..60 {
        text += &format!(
            "a,{},{},{},80\n",
            f64::from(k) / 100.0,
            0.1 * f64::from(k % 10),
            if k % 9 == 4 { String::new() } else { k.to_string() }
        );
    }
    for k in 0..40 {
        text += &format!("b,{},{},{},\n", f64::from(k) / 50.0, 1.0 - 0.01 * f64::from(k), f64::from(k) / 3.0);
    }
    Recording::from_csv(text, "seed.csv", &[]).unwrap()
}

/// Reads changed versions of `seeds`; that some still read shows that the changes are not all fatal.
fn rounds_never_panic(
    seeds: &[Vec<u8>],
    usual: usize,
    text: bool,
    read: impl Fn(Vec<u8>, &[Mapping]) -> Result<Recording, RecordingError>,
) {
    let map = [Mapping::parse("current_meas_a=2 * current_a [mA] + 1").unwrap()];
    let (mut well, mut refused) = (0, 0);
    for round in 0..rounds(usual) {
        let mut random = Pcg64::seed_from_u64(round as u64);
        let mut bytes = seeds[round % seeds.len()].clone();
        mutate(&mut bytes, &mut random, text);
        let map = if random.next_u32() % 4 == 0 { &map[..] } else { &[] };
        match read(bytes, map) {
            Ok(recording) => {
                well += 1;
                for run in &recording.runs {
                    assert!(run.time_s.windows(2).all(|w| w[0] < w[1]), "round {round}");
                    assert!(super::Channel::ALL.iter().all(|c| run.channel(*c).is_none_or(|v| v.len() == run.len())), "round {round}");
                }
            }
            Err(error) => {
                refused += 1;
                assert!(!error.to_string().is_empty());
            }
        }
    }
    assert!(well > 0 && refused > 0, "{well} read, {refused} refused");
}

fn bytes_as(extension: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("seed.{extension}"));
    seed().write(&path).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn damaged_csv_never_panics() {
    let plain = bytes_as("csv");
    let european = String::from_utf8(plain.clone()).unwrap().replace(',', ";").replace('.', ",").replace('\n', "\r\n");
    rounds_never_panic(&[plain, european.into_bytes()], 10_000, true, |bytes, map| Recording::from_csv(bytes, "fuzz.csv", map));
}

#[test]
fn damaged_parquet_never_panics() {
    // The library wants a file, which costs more than the reading.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fuzz.parquet");
    rounds_never_panic(&[bytes_as("parquet")], 500, false, |bytes, map| {
        std::fs::write(&path, bytes).unwrap();
        Recording::read(&path, map)
    });
}

#[test]
fn damaged_mdf4_never_panics() {
    let seeds = [bytes_as("mf4"), mdf4::tests::compressed(false), mdf4::tests::compressed(true)];
    rounds_never_panic(&seeds, 20_000, false, |bytes, map| {
        clean::recording(mdf4::read_from(std::io::Cursor::new(bytes), "fuzz.mf4", map)?)
    });
}
