//! Damaged input for every reader and every parser of frames: an answer or a message, never a panic, never a gigabyte.
//!
//! Each target takes `HIL_FUZZ_SECONDS` (a fifth of a second with the other tests, 20 in CI, 600 for the long run:
//! `HIL_FUZZ_SECONDS=600 cargo test --release --test it fuzz:: -- --nocapture`). Inputs that gave a new message are kept
//! and changed further, so that the search goes where the reader goes. `HIL_FUZZ_SEED` begins elsewhere. `tests/fuzz.sh` gives the same
//! targets to AFL++, which follows the reader's branches.

mod targets;

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use hil::recording::{Recording, Run};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Numbers and texts that readers stumble over.
const TRAPS: [u64; 12] = [0, 1, 7, 8, 0x7F, 0xFF, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFF, 0x7FFF_FFFF_FFFF_FFFF, u64::MAX, 1 << 40];
const TEXTS: [&str; 24] = [
    "nan",
    "inf",
    "-",
    "1e999",
    "1e93",
    "-86400",
    "\"",
    "\n",
    "\r\n",
    "\0",
    ",",
    ";",
    "\t",
    "#",
    "\u{feff}",
    "[[",
    "]]",
    "=",
    "{}",
    "0x1F",
    "1e-320",
    "18446744073709551616",
    "schema",
    "\"\"\"",
];

fn mutate(bytes: &mut Vec<u8>, random: &mut Pcg64) {
    for _ in 0..random.random_range(1..5) {
        let at = random.random_range(0..=bytes.len().saturating_sub(1));
        let end = bytes.len().min(at + random.random_range(1..64));
        match random.random_range(0..8) {
            _ if bytes.is_empty() => bytes.push(random.random()),
            0 => bytes[at] ^= 1 << random.random_range(0..8),
            1 => bytes[at] = random.random(),
            2 => drop(bytes.splice(at..at, TEXTS[random.random_range(0..TEXTS.len())].bytes())),
            3 => {
                let width = [1, 2, 4, 8][random.random_range(0..4)];
                let trap = TRAPS[random.random_range(0..TRAPS.len())].to_le_bytes();
                let end = bytes.len().min(at + width);
                bytes[at..end].copy_from_slice(&trap[..end - at]);
            }
            4 => bytes.truncate(at),
            5 => drop(bytes.drain(at..end)),
            6 => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            _ => {
                // Digits become others: limits, counts, times.
                for byte in bytes[at..end].iter_mut().filter(|b| b.is_ascii_digit()) {
                    *byte = b'0' + random.random_range(0..10u8);
                }
            }
        }
    }
}

/// Largest memory that this process ever had [bytes].
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("0 kB");
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap_or(0) * 1024
}

/// Feeds changed seeds to the reader of a target.
fn fuzz(name: &str) {
    let target = targets::TARGETS.iter().find(|t| t.name == name).unwrap();
    let reader = target.read;
    let seconds: f64 = std::env::var("HIL_FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(0.2);
    let seed: u64 = std::env::var("HIL_FUZZ_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    let mut random = Pcg64::seed_from_u64(seed);
    let mut corpus: Vec<Vec<u8>> = (target.seeds)();
    let mut known: HashSet<String> = HashSet::new();
    let (began, mut count) = (Instant::now(), 0u64);
    while began.elapsed() < Duration::from_secs_f64(seconds) {
        let mut input = corpus[random.random_range(0..corpus.len())].clone();
        mutate(&mut input, &mut random);
        count += 1;
        let one = Instant::now();
        let Ok(answer) = catch_unwind(AssertUnwindSafe(|| reader(&input))) else {
            panic!(
                "{name}: a panic, seed {seed}, input {count}: {}",
                String::from_utf8_lossy(&input).chars().take(4000).collect::<String>()
            );
        };
        assert!(one.elapsed() < Duration::from_secs(10), "{name}: {:?} for one input", one.elapsed());
        if peak() >= 1 << 30 {
            let kept = std::env::temp_dir().join(format!("hil-fuzz-{name}-{seed}-{count}"));
            std::fs::write(&kept, &input).unwrap();
            panic!("{name}: {} bytes of memory for one input, seed {seed}, kept as {}", peak(), kept.display());
        }
        // Messages without their numbers and names tell the places of the reader apart.
        let shape: String = answer.unwrap_or_default().chars().filter(|c| c.is_ascii_lowercase() || *c == ' ').take(200).collect();
        if corpus.len() < 4000 && input.len() < 100_000 && known.insert(shape) {
            corpus.push(input);
        }
    }
    println!("{name:<16} {count:>9} inputs, {:>4} kinds of answers, 0 panics, peak {} MB", known.len(), peak() >> 20);
}

/// One test for each target, by its name.
macro_rules! fuzzed {
    ($($name:ident),+ $(,)?) => {
        $(#[test]
        fn $name() {
            fuzz(stringify!($name));
        })+

        #[test]
        fn every_target_is_fuzzed() {
            let names: Vec<&str> = targets::TARGETS.iter().map(|t| t.name).collect();
            assert_eq!(names, [$(stringify!($name)),+]);
        }
    };
}

fuzzed!(csv, parquet, mdf4, plans, valves, driver_profiles, stations, fault_scripts, records, journals, frames_rtu, frames_tcp, lines);

/// A few megabytes that claim hundreds of millions of rows; a line of quotes; times that no clock shows; each in its command.
#[test]
fn hostile_files_are_refused_in_bounded_time_and_memory() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let refused = |name: &str| Recording::read(&at(name), &[]).unwrap_err().to_string();
    std::fs::write(at("quotes.csv"), [b"time_s,current_a,pressure_bar\n".to_vec(), vec![b'"'; 100_000_000]].concat()).unwrap();
    let began = Instant::now();
    assert!(refused("quotes.csv").contains("longer than a megabyte"));
    std::fs::write(at("time.csv"), "time_s,current_a,pressure_bar\n0,0.1,1\n0.01,0.1,1\n0.02,0.2,2\n0.03,0.3,3\n1e93,0.4,4\n").unwrap();
    assert!(refused("time.csv").contains("at most 1e13 s"));
    // Forty thousand runs of the same value: dictionary pages make nothing of them.
    let rows = 16_000_000usize;
    let run = Run {
        time_s: (0..rows).map(|k| k as f64).collect(),
        current_a: vec![0.5; rows],
        pressure_bar: Some(vec![1.0; rows]),
        ..Run::default()
    };
    let bomb = Recording { source: "bomb".into(), runs: vec![run], notes: Vec::new(), input: None };
    bomb.write(&at("bomb.parquet")).unwrap();
    drop(bomb);
    assert!(refused("bomb.parquet").contains("values in all are read"));
    assert!(began.elapsed() < Duration::from_secs(60), "{:?}", began.elapsed());
}

/// Its footer says half the rows that its pages hold: what is beyond them is not read.
#[test]
fn pages_that_hold_more_than_the_footer_says_are_not_read_to_their_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("more.parquet");
    let rows = 200_000usize;
    let run = Run {
        time_s: (0..rows).map(|k| k as f64).collect(),
        current_a: vec![0.5; rows],
        pressure_bar: Some(vec![1.0; rows]),
        ..Run::default()
    };
    Recording { source: "more".into(), runs: vec![run], notes: Vec::new(), input: None }.write(&path).unwrap();
    // 200,000 and 100,000 as thrift's zigzag varints, in the footer alone.
    let (all, half) = ([0x80, 0xb5, 0x18], [0xc0, 0x9a, 0x0c]);
    let mut bytes = std::fs::read(&path).unwrap();
    let length = u32::from_le_bytes(bytes[bytes.len() - 8..bytes.len() - 4].try_into().unwrap()) as usize;
    let from = bytes.len() - 8 - length;
    let places: Vec<usize> = (from..bytes.len() - 3).filter(|at| bytes[*at..at + 3] == all).collect();
    assert!(places.len() > 3, "{places:?}");
    places.iter().for_each(|at| bytes[*at..at + 3].copy_from_slice(&half));
    std::fs::write(&path, bytes).unwrap();
    let said = Recording::read(&path, &[]).unwrap_err().to_string();
    assert!(said.contains("holds more values than the 100000 that are said"), "{said}");
}
