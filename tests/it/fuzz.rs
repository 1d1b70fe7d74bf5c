//! Damaged input for every reader and every parser of frames: an answer or a message, never a panic, never a gigabyte.
//!
//! Each target takes `HIL_FUZZ_SECONDS` (a fifth of a second with the other tests, 20 in CI, 600 for the long run:
//! `HIL_FUZZ_SECONDS=600 cargo test --release --test it fuzz:: -- --nocapture`). Inputs that gave a new message are kept
//! and changed further, so that the search goes where the reader goes. `HIL_FUZZ_SEED` begins elsewhere.

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
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

/// Feeds changed seeds to a reader, whose answer is a message or nothing.
fn fuzz(name: &str, seeds: &[Vec<u8>], mut reader: impl FnMut(&[u8]) -> Option<String>) {
    let seconds: f64 = std::env::var("HIL_FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(0.2);
    let seed: u64 = std::env::var("HIL_FUZZ_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    let mut random = Pcg64::seed_from_u64(seed);
    let mut corpus: Vec<Vec<u8>> = seeds.to_vec();
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
        // Messages without their numbers and names tell the places of the reader apart.
        let shape: String = answer.unwrap_or_default().chars().filter(|c| c.is_ascii_lowercase() || *c == ' ').take(200).collect();
        if corpus.len() < 4000 && input.len() < 100_000 && known.insert(shape) {
            corpus.push(input);
        }
    }
    assert!(peak() < 1 << 30, "{name}: {} bytes of memory", peak());
    println!("{name:<16} {count:>9} inputs, {:>4} kinds of answers, 0 panics, peak {} MB", known.len(), peak() >> 20);
}

fn recording(extension: &str) {
    let runs = ["", "second"].map(|name| Run {
        name: (!name.is_empty()).then(|| name.to_string()),
        time_s: (0..200).map(|k| f64::from(k) * 0.01).collect(),
        current_a: (0..200).map(|k| 0.1 + 0.003 * f64::from(k)).collect(),
        pressure_bar: Some((0..200).map(|k| 0.1 * f64::from(k)).collect()),
        ..Run::default()
    });
    let recording = Recording { source: "seed".into(), runs: runs.to_vec(), notes: Vec::new(), input: None };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("seed.{extension}"));
    recording.write(&path).unwrap();
    let mut seeds = vec![std::fs::read(&path).unwrap()];
    if extension == "csv" {
        seeds.push(b"time_s;current_a;pressure_bar\n0,00;0,1;1\n0,01;0,2;2\n0,02;0,3;3\n0,03;0,4;4\n".to_vec());
        seeds.push(b"# c\ntime_s,current_a,pressure_bar,run\n2026-01-01T00:00:00Z,0.1,1,a\n2026-01-01T00:00:01Z,0.2,2,a\n".to_vec());
    }
    fuzz(extension, &seeds, |bytes| {
        std::fs::write(&path, bytes).unwrap();
        Recording::read(&path, &[]).err().map(|e| e.to_string())
    });
}

fn shipped(folder: &str) -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let files = std::fs::read_dir(root).unwrap().map(|e| e.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "toml"));
    files.map(|p| std::fs::read(p).unwrap()).collect()
}

fn text<E: std::fmt::Display, T>(bytes: &[u8], read: impl Fn(&str) -> Result<T, E>) -> Option<String> {
    read(&String::from_utf8_lossy(bytes)).err().map(|e| e.to_string())
}

#[test]
fn csv() {
    recording("csv");
}

#[test]
fn parquet() {
    recording("parquet");
}

#[test]
fn mdf4() {
    recording("mf4");
}

#[test]
fn plans() {
    fuzz("plan", &shipped("plans"), |b| text(b, |t| hil::plan::Plan::from_toml(t, "fuzz.toml", Path::new("plans"), &[])));
}

#[test]
fn valves() {
    fuzz("valve", &shipped("valves"), |b| text(b, |t| hil::valve::Valve::from_toml(t, "fuzz.toml")));
}

#[test]
fn driver_profiles() {
    fuzz("driver", &shipped("drivers"), |b| text(b, |t| hil::rig::profile::Profile::from_toml(t, "fuzz.toml")));
}

#[test]
fn stations() {
    fuzz("station", &shipped("examples/batch"), |b| text(b, |t| hil::batch::station::Station::from_toml(t, "fuzz.toml")));
}

#[test]
fn fault_scripts() {
    let seed = b"schema = \"hil.faults/1\"\n[[fault]]\nkind = \"late\"\ncycle = 50\ncount = 3\nby = \"8 ms\"\n[random]\nseed = 7\nrate = \"2 %\"\nkinds = [\"late\"]\n";
    fuzz("faults", &[seed.to_vec()], |b| text(b, |t| hil::rig::emulator::Faults::from_toml(t, "fuzz.toml").map(drop)));
}

#[test]
fn records() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record.json");
    let seed = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("reports/tipin/record.json")).unwrap();
    fuzz("record", &[seed], |bytes| {
        std::fs::write(&path, bytes).unwrap();
        hil::record::TestRecord::load(&path).map(|r| hil::report::text(&r)).err().map(|e| e.to_string())
    });
}

#[test]
fn journals() {
    use hil::batch::journal::{Journal, Kind, Line, encode, read, segment_path};
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::begin(folder.path()).unwrap();
    for position in 0..3 {
        let line = Line {
            event: Kind::Started,
            position,
            attempt: 1,
            at: "2026-01-01T00:00:00Z".into(),
            dut: Some(Default::default()),
            record: None,
        };
        journal.append(&encode(&line)).unwrap();
    }
    journal.confirm().unwrap();
    let path = segment_path(folder.path(), 1);
    fuzz("journal", &[std::fs::read(&path).unwrap()], |bytes| {
        std::fs::write(&path, bytes).unwrap();
        read(folder.path(), |_, _| Ok(())).map(|d| d.iter().map(|d| d.what.clone()).collect::<String>()).ok()
    });
}

#[test]
fn frames() {
    use hil::rig::emulator::{Parsed, parse_rtu, parse_tcp, rtu, tcp};
    let pdu = [23, 0, 0, 0, 6, 0, 0, 0, 2, 4, 1, 2, 3, 4];
    let name = |parsed: Parsed| match parsed {
        Parsed::Request(r) => format!("request of function {}", "x".repeat(usize::from(r.pdu.first().copied().unwrap_or(0)))),
        Parsed::Incomplete => "incomplete".into(),
        Parsed::Garbage(_) => "garbage".into(),
    };
    fuzz("frames rtu", &[rtu(1, &pdu, false), rtu(1, &[3, 0, 0, 0, 6], false)], |b| Some(name(parse_rtu(b))));
    fuzz("frames tcp", &[tcp(7, 1, &pdu, false), tcp(8, 1, &[3, 0, 0, 0, 6], false)], |b| Some(name(parse_tcp(b))));
}

#[test]
fn lines_of_a_driver() {
    use hil::rig::profile::{Checksum, Template};
    let template =
        Template::parse("#{token x4} S={status d} N={counter d} I={current mA .1} P={pressure bar .3}", "\r\n", Checksum::Xor).unwrap();
    let mut seed = Vec::new();
    template.write(&mut seed, |_| 12.0);
    let seed = seed.strip_suffix(b"\r\n").unwrap().to_vec();
    fuzz("line", &[seed], |bytes| {
        let mut values = Vec::new();
        template.read(bytes, |name, value| values.push((name, value))).map(|()| format!("{values:?}"))
    });
}

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
