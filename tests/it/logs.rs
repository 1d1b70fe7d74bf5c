//! Logs as loggers write them: inspected, mapped, read in one command.

use std::fmt::Write as _;
use std::path::Path;

use assert_cmd::Command;
use predicates::prelude::PredicateBooleanExt as _;
use predicates::str::contains;
use serde_json::Value;

struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn put(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.0.path().join(name), bytes).unwrap();
    }
    fn path(&self) -> &Path {
        self.0.path()
    }
    fn hil(&self, arguments: &[&str]) -> assert_cmd::assert::Assert {
        Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(self.path()).args(arguments).assert()
    }
    fn json(&self, arguments: &[&str]) -> Value {
        serde_json::from_slice(&self.hil(arguments).code(0).get_output().stdout).unwrap()
    }
}

/// Four runs of the paper's valve in one file: a preamble, Latin letters, decimal commas, MPa, mA, date and time of day in
/// two columns, over midnight.
fn messy() -> Vec<u8> {
    let valve = hil::valve::Valve::from_toml(&std::fs::read_to_string("valves/paper.toml").unwrap(), "paper").unwrap();
    let mut text =
        String::from("Messger\u{e4}t 12;;\nBediener;N. N.\n\nDatum;Zeit;Lauf;Drehzahl [1/min];Ventilstrom [mA];\u{d6}ldruck [MPa]\n");
    let mut ms: u64 = 86_400_000 - 21_000;
    for run in ["kalt", "warm", "hei\u{df}", "Ende"] {
        let mut plant = hil::physics::Plant::new(&valve, 0.01, 0.2, Some(3)).unwrap();
        for n in 0..1500u32 {
            let t = f64::from(n) * 0.01;
            let current = 0.5 - 0.3 * (0.8 * t).cos();
            let pressure = plant.step(current);
            let (day, of) = (28 + ms / 86_400_000, ms % 86_400_000);
            let (day, month) = if day > 28 { (day - 28, 3) } else { (day, 2) };
            let clock = format!("{:02}:{:02}:{:02},{:03}", of / 3_600_000, of / 60_000 % 60, of / 1000 % 60, of % 1000);
            let comma = |v: f64, d: usize| format!("{v:.d$}").replace('.', ",");
            writeln!(
                text,
                "{day:02}.{month:02}.2026;{clock};{run};{};{};{}",
                800 + n % 7,
                comma(current * 1e3, 1),
                comma(pressure * 0.1, 4)
            )
            .unwrap();
            ms += 10;
        }
        ms += 5000;
    }
    text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect()
}

#[test]
fn the_messy_log_goes_through_with_the_mapping_that_inspect_wrote() {
    let bench = Bench::new();
    bench.put("log.csv", messy());
    let said = bench.hil(&["inspect", "log.csv", "-o", "log.map.toml"]).code(0);
    let text = String::from_utf8(said.get_output().stdout.clone()).unwrap();
    for wanted in ["names in line 4", "run kalt: 1500 samples", "run hei\u{df}", "Drehzahl", "\u{2588}", "latin-1"] {
        assert!(text.contains(wanted), "{wanted} not in\n{text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    let mapping = std::fs::read_to_string(bench.path().join("log.map.toml")).unwrap();
    for line in [
        "time_s = \"Datum + Zeit\"",
        "current_a = \"Ventilstrom [mA]\"",
        "pressure_bar = \"\u{d6}ldruck [MPa]\"",
        "run = \"Lauf\"",
        "header_row = 4",
    ] {
        assert!(mapping.contains(line), "{line} not in\n{mapping}");
    }
    // One command from here, over midnight within a run.
    let all = bench.json(&["simulate", "log.csv", "--mapping", "log.map.toml", "--model", "paper", "--format", "json", "-o", "all.csv"]);
    assert_eq!((all["samples"].as_u64(), all["runs"].as_array().unwrap().len()), (Some(6000), 4));
    assert!(all["rmse_bar"].as_f64().unwrap() < 0.1, "{all}");
    let written = hil::recording::Recording::read(&bench.path().join("all.csv"), &[]).unwrap();
    let midnight = &written.runs[1];
    assert!((midnight.time_s[1499] - midnight.time_s[0] - 14.99).abs() < 1e-6, "the second run passes midnight");
    let one = bench.json(&[
        "simulate",
        "log.csv",
        "--map",
        "log.map.toml",
        "--model",
        "paper",
        "--format",
        "json",
        "--run",
        "warm",
        "-o",
        "one.csv",
    ]);
    assert_eq!(one["samples"], 1500);
    bench
        .hil(&["simulate", "log.csv", "--mapping", "log.map.toml", "--model", "paper", "--run", "wärm"])
        .code(3)
        .stderr(contains("did you mean `warm`?"));
}

#[test]
fn every_missing_channel_is_named_at_once_with_the_likely_ones() {
    let bench = Bench::new();
    bench.put("log.csv", "t [ms];I_cmd [mA];P_clutch [psi];rpm\n0;500;100;800\n10;510;101;801\n20;520;102;802\n");
    let said = bench.hil(&["identify", "log.csv"]).code(3);
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    for wanted in [
        "no `time_s` (likely: `t [ms]`)",
        "no `current_a` (likely: `I_cmd [mA]`)",
        "no `pressure_bar` (likely: `P_clutch [psi]`)",
        "hil inspect",
    ] {
        assert!(said.contains(wanted), "{wanted} not in {said}");
    }
    // A name alone takes the unit of its header.
    let map = ["--map", "time_s=t", "--map", "current_a=I_cmd", "--map", "pressure_bar=P_clutch", "-o", "out.csv"];
    bench.hil(&[&["simulate", "log.csv", "--model", "paper"][..], &map].concat()).code(0);
    let out = hil::recording::Recording::read(&bench.path().join("out.csv"), &[]).unwrap();
    assert_eq!((out.runs[0].time_s[2], out.runs[0].current_a[1]), (0.02, 0.51));
}

#[test]
fn a_unit_that_nobody_knows_is_refused_with_the_near_ones() {
    let bench = Bench::new();
    bench.put("log.csv", "time_s,current_a,p [kp/cm2],q [Mpa]\n0,0.5,10,1\n0.01,0.51,11,1.1\n");
    let refused = |map: &str, code: i32, says: &str| {
        bench.hil(&["simulate", "log.csv", "--model", "paper", "--map", map]).code(code).stderr(contains(says));
    };
    refused("pressure_bar=p [kp/cm2]", 2, "the unit `kp/cm2` is not one of a pressure");
    refused("pressure_bar=p", 3, "the unit `kp/cm2` is not one of a pressure");
    refused("pressure_bar=q", 3, "did you mean `MPa`?");
    bench.put("slip.csv", "t [s],Ventilstrom [mA],Kupplungsdruck [mbarr]\n0,500,10\n0.01,510,11\n");
    bench.hil(&["inspect", "slip.csv"]).code(0).stdout(contains("# look here").and(contains("did you mean `mbar`?")));
    bench.hil(&["simulate", "log.csv", "--model", "paper", "--map", "pressure_bar=0.980665 * p", "-o", "o.csv"]).code(0);
}

#[test]
fn header_row_encoding_and_stretch_are_options() {
    let bench = Bench::new();
    let rows: String = (0..100).map(|n| format!("{},{:.3}\n", f64::from(n) * 0.01, 0.2 + 0.004 * f64::from(n))).collect();
    // Two lines that could both be the header: the option decides.
    bench.put("two.csv", format!("a,b\n1,2\n# time_s,current_a\n{rows}"));
    bench.hil(&["simulate", "two.csv", "--model", "paper"]).code(3);
    bench.hil(&["simulate", "two.csv", "--model", "paper", "--header-row", "3", "-o", "two.out.csv"]).code(0);
    bench.hil(&["simulate", "two.csv", "--model", "paper", "--header-row", "1000"]).code(3).stderr(contains("the file has 103 lines"));
    let utf16: Vec<u8> =
        [0xFF, 0xFE].into_iter().chain(format!("time_s,current_a\n{rows}").encode_utf16().flat_map(u16::to_le_bytes)).collect();
    bench.put("wide.csv", utf16);
    let arguments =
        ["simulate", "wide.csv", "--model", "paper", "--from", "200 ms", "--to", "0.5", "--format", "json", "-o", "wide.out.csv"];
    assert_eq!(bench.json(&arguments)["samples"], 31);
    bench.hil(&["simulate", "wide.csv", "--model", "paper", "--from", "9", "--to", "3"]).code(2);
    bench
        .hil(&["simulate", "wide.csv", "--model", "paper", "--from", "9"])
        .code(3)
        .stderr(contains("the recording goes from 0 s to 0.99 s"));
    bench.hil(&["simulate", "wide.csv", "--model", "paper", "--encoding", "ebcdic"]).code(2).stderr(contains("latin-1"));
}

#[test]
fn the_example_of_a_diagnosis_goes_from_the_log_to_a_run_with_the_augmented_valve() {
    let bench = Bench::new();
    bench.hil(&["init", "--example", "diagnosis"]).code(0);
    bench.hil(&["inspect", "recordings/logger.csv", "-o", "recordings/logger.map.toml"]).code(0);
    bench.hil(&["identify", "recordings/sweep.csv", "-o", "valves/valve.toml"]).code(0);
    let found = bench.json(&[
        "diagnose",
        "recordings/logger.csv",
        "--mapping",
        "recordings/logger.map.toml",
        "--model",
        "valve",
        "-o",
        "valves/augmented.toml",
        "--report",
        "diagnosis.html",
        "--format",
        "json",
    ]);
    assert_ne!(found["verdict"], "match", "{found}");
    bench.hil(&["check"]).code(0);
    let run = bench.hil(&["run", "acceptance", "--sim", "--valve", "augmented", "--format", "json"]);
    let record: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    assert_eq!(record["schema"], "hil.record/1");
}
