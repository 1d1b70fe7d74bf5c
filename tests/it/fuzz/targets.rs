//! What is fuzzed: each reader of files and each parser of frames, with inputs to begin with. The harness beside it and AFL++
//! (`tests/fuzz`) use this one list.

use std::path::{Path, PathBuf};

use hil::recording::{Recording, Run};

/// A reader, whose answer to an input is a message or nothing.
pub struct Target {
    /// Its name, also that of its test.
    pub name: &'static str,
    /// Inputs that it accepts.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Reads an input.
    pub read: fn(&[u8]) -> Option<String>,
}

/// Every reader and parser.
pub const TARGETS: [Target; 13] = [
    Target { name: "csv", seeds: || recording("csv"), read: |b| read_recording("csv", b) },
    Target { name: "parquet", seeds: || recording("parquet"), read: |b| read_recording("parquet", b) },
    Target { name: "mdf4", seeds: || recording("mf4"), read: |b| read_recording("mf4", b) },
    Target {
        name: "plans",
        seeds: || shipped("plans"),
        read: |b| text(b, |t| hil::plan::Plan::from_toml(t, "fuzz.toml", Path::new("plans"), &[])),
    },
    Target { name: "valves", seeds: || shipped("valves"), read: |b| text(b, |t| hil::valve::Valve::from_toml(t, "fuzz.toml")) },
    Target {
        name: "driver_profiles",
        seeds: || shipped("drivers"),
        read: |b| text(b, |t| hil::rig::profile::Profile::from_toml(t, "fuzz.toml")),
    },
    Target {
        name: "stations",
        seeds: || shipped("examples/batch"),
        read: |b| text(b, |t| hil::batch::station::Station::from_toml(t, "fuzz.toml")),
    },
    Target {
        name: "fault_scripts",
        seeds: || vec![FAULTS.to_vec()],
        read: |b| text(b, |t| hil::rig::emulator::Faults::from_toml(t, "fuzz.toml").map(drop)),
    },
    Target {
        name: "records",
        seeds: || vec![std::fs::read(Path::new(ROOT).join("reports/tipin/record.json")).unwrap()],
        read: |b| {
            let path = written("record.json", b);
            hil::record::TestRecord::load(&path).map(|r| hil::report::text(&r)).err().map(|e| e.to_string())
        },
    },
    Target { name: "journals", seeds: journal, read: read_journal },
    Target {
        name: "frames_rtu",
        seeds: || frames().map(|pdu| hil::rig::emulator::rtu(1, pdu, false)).to_vec(),
        read: |b| Some(name(hil::rig::emulator::parse_rtu(b))),
    },
    Target {
        name: "frames_tcp",
        seeds: || frames().map(|pdu| hil::rig::emulator::tcp(7, 1, pdu, false)).to_vec(),
        read: |b| Some(name(hil::rig::emulator::parse_tcp(b))),
    },
    Target { name: "lines", seeds: line, read: read_line },
];

/// The root of the project, from the package of the tests or from that of the fuzzer.
const ROOT: &str = match option_env!("HIL_ROOT") {
    Some(root) => root,
    None => env!("CARGO_MANIFEST_DIR"),
};
const FAULTS: &[u8] = b"schema = \"hil.faults/1\"\n[[fault]]\nkind = \"late\"\ncycle = 50\ncount = 3\nby = \"8 ms\"\n[random]\nseed = 7\nrate = \"2 %\"\nkinds = [\"late\"]\n";

/// A folder of this process and thread.
fn place() -> PathBuf {
    let thread = format!("{:?}", std::thread::current().id());
    let number: String = thread.chars().filter(char::is_ascii_digit).collect();
    let folder = std::env::temp_dir().join(format!("hil-fuzz-{}-{number}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn written(name: &str, bytes: &[u8]) -> PathBuf {
    let path = place().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn recording(extension: &str) -> Vec<Vec<u8>> {
    let runs = ["", "second"].map(|name| Run {
        name: (!name.is_empty()).then(|| name.to_string()),
        time_s: (0..200).map(|k| f64::from(k) * 0.01).collect(),
        current_a: (0..200).map(|k| 0.1 + 0.003 * f64::from(k)).collect(),
        pressure_bar: Some((0..200).map(|k| 0.1 * f64::from(k)).collect()),
        ..Run::default()
    });
    let recording = Recording { source: "seed".into(), runs: runs.to_vec(), notes: Vec::new(), input: None };
    let path = place().join(format!("begin.{extension}"));
    recording.write(&path).unwrap();
    let mut seeds = vec![std::fs::read(&path).unwrap()];
    if extension == "csv" {
        seeds.push(b"time_s;current_a;pressure_bar\n0,00;0,1;1\n0,01;0,2;2\n0,02;0,3;3\n0,03;0,4;4\n".to_vec());
        seeds.push(b"# c\ntime_s,current_a,pressure_bar,run\n2026-01-01T00:00:00Z,0.1,1,a\n2026-01-01T00:00:01Z,0.2,2,a\n".to_vec());
    }
    seeds
}

fn read_recording(extension: &str, bytes: &[u8]) -> Option<String> {
    Recording::read(&written(&format!("seed.{extension}"), bytes), &[]).err().map(|e| e.to_string())
}

fn shipped(folder: &str) -> Vec<Vec<u8>> {
    let files = std::fs::read_dir(Path::new(ROOT).join(folder)).unwrap().map(|e| e.unwrap().path());
    files.filter(|p| p.extension().is_some_and(|e| e == "toml")).map(|p| std::fs::read(p).unwrap()).collect()
}

fn text<E: std::fmt::Display, T>(bytes: &[u8], read: impl Fn(&str) -> Result<T, E>) -> Option<String> {
    read(&String::from_utf8_lossy(bytes)).err().map(|e| e.to_string())
}

fn journal() -> Vec<Vec<u8>> {
    use hil::batch::journal::{Journal, Kind, Line, encode, segment_path};
    let folder = place().join("begin");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let mut journal = Journal::begin(&folder).unwrap();
    for position in 0..3 {
        let at = "2026-01-01T00:00:00Z".to_string();
        let line = Line { event: Kind::Started, position, attempt: 1, at, dut: Some(Default::default()), record: None };
        journal.append(&encode(&line)).unwrap();
    }
    journal.confirm().unwrap();
    vec![std::fs::read(segment_path(&folder, 1)).unwrap()]
}

fn read_journal(bytes: &[u8]) -> Option<String> {
    use hil::batch::journal::{read, segment_path};
    let folder = place().join("batch");
    let path = segment_path(&folder, 1);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(&path, bytes).unwrap();
    read(&folder, |_, _| Ok(())).map(|d| d.iter().map(|d| d.what.clone()).collect::<String>()).ok()
}

fn frames() -> [&'static [u8]; 2] {
    [&[23, 0, 0, 0, 6, 0, 0, 0, 2, 4, 1, 2, 3, 4], &[3, 0, 0, 0, 6]]
}

fn name(parsed: hil::rig::emulator::Parsed) -> String {
    use hil::rig::emulator::Parsed;
    match parsed {
        Parsed::Request(r) => format!("request of function {}", "x".repeat(usize::from(r.pdu.first().copied().unwrap_or(0)))),
        Parsed::Incomplete => "incomplete".into(),
        Parsed::Garbage(_) => "garbage".into(),
    }
}

fn template() -> hil::rig::profile::Template {
    use hil::rig::profile::{Checksum, Template};
    Template::parse("#{token x4} S={status d} N={counter d} I={current mA .1} P={pressure bar .3}", "\r\n", Checksum::Xor).unwrap()
}

fn line() -> Vec<Vec<u8>> {
    let mut seed = Vec::new();
    template().write(&mut seed, |_| 12.0);
    vec![seed.strip_suffix(b"\r\n").unwrap().to_vec()]
}

fn read_line(bytes: &[u8]) -> Option<String> {
    let mut values = Vec::new();
    template().read(bytes, |name, value| values.push((name, value))).map(|()| format!("{values:?}"))
}
