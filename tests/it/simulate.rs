//! `hil simulate` from outside: known answers, runs, formats, exit codes.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use hil::recording::Recording;
use predicates::str::contains;

/// The paper's curves with a hyperbola and without any delay.
const STATIC: &str = r#"schema = "hil.valve/1"
name = "static"
current_limits = ["0 A", "1 A"]
hysteresis.hyperbolic.a = "0.8 bar^2"

[curve]
ascending = [-42.65, 92.5, -8.4, -2.03]
descending = [-40.01, 83.32, -1.3, -2.41]
"#;

struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        bench.put("static.toml", STATIC);
        bench.put("delayed.toml", &STATIC.replace("[curve]", "delay = \"20 ms\"\nlag = \"15 ms\"\n\n[curve]"));
        bench
    }
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn put(&self, name: &str, text: &str) {
        std::fs::write(self.at(name), text).unwrap();
    }
    fn hil(&self, arguments: &[&str]) -> assert_cmd::assert::Assert {
        Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(self.0.path()).args(arguments).assert()
    }
    fn read(&self, name: &str) -> Recording {
        Recording::read(&self.at(name), &[]).unwrap()
    }
}

/// A drive up and down with a measured channel that is not the model's.
fn drive(samples: u32) -> String {
    let rows = (0..samples).map(|k| {
        let t = f64::from(k) / 100.0;
        format!("{t},{:.5},{:.3}\n", 0.5 + 0.3 * (3.0 * t).sin(), 12.0 + 8.0 * (3.0 * t).sin())
    });
    format!("time_s,current_a,pressure_bar\n{}", rows.collect::<String>())
}

#[test]
fn the_first_samples_are_those_of_the_equations() {
    let bench = Bench::new();
    bench.put("two.csv", "time_s,current_a\n0,0.5\n0.01,0.6\n0.02,0.6\n");
    let out = bench.hil(&["simulate", "two.csv", "--model", "static.toml"]).success().stderr(contains("no measured pressure_bar"));
    let text = String::from_utf8(out.get_output().stdout.clone()).unwrap();
    let simulated = Recording::from_csv(text, "stdout", &[]).unwrap();
    let pressure = simulated.runs[0].pressure_bar.clone().unwrap();

    // Eq. (3) at 0.5 A and 0.6 A, Eq. (10), then Eqs. (5)-(8) upwards from the average curve.
    let (up, down) = (|i: f64| ((-42.65 * i + 92.5) * i - 8.4) * i - 2.03, |i: f64| ((-40.01 * i + 83.32) * i - 1.3) * i - 2.41);
    let start = (up(0.5) + down(0.5)) / 2.0;
    let t = start + 0.8 / (up(0.5) - start);
    let next = (t + up(0.6) + ((t - up(0.6)).powi(2) + 4.0 * 0.8).sqrt()) / 2.0;
    assert!((start - 12.16625).abs() < 1e-9);
    for (simulated, expected) in pressure.iter().zip([start, next, next]) {
        assert!((simulated - expected).abs() < 1e-6, "{simulated} is not {expected}");
    }
}

#[test]
fn parquet_holds_what_the_library_simulates_to_the_last_digit() {
    let bench = Bench::new();
    bench.put("drive.csv", &drive(600));
    bench.hil(&["simulate", "drive.csv", "--model", "delayed.toml", "--input", "held", "-o", "out.parquet"]).success();
    let run = bench.read("out.parquet").runs.remove(0);
    let valve = hil::valve::Valve::load(&bench.at("delayed.toml")).unwrap();
    let expected = hil::physics::simulate(&valve, hil::valve::Input::Held, &run.time_s, &run.current_a).unwrap();
    let off = run.pressure_bar.unwrap().iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-12, "{off:e} bar");
}

#[test]
fn every_format_carries_the_same_simulation() {
    let bench = Bench::new();
    bench.put("drive.csv", &drive(600));
    for format in ["csv", "parquet", "mf4"] {
        let out = format!("out.{format}");
        let summary = contains("1 run, 600 samples; each run starts on the average curve at its first current").and_rmse();
        bench.hil(&["simulate", "drive.csv", "--model", "delayed.toml", "-o", &out]).success().stdout(summary);
        // Text holds whole microbars, a binary file the numbers as they are.
        let (written, text) = (bench.read(&out).runs, bench.read("out.csv").runs);
        let pressure = |runs: &[hil::recording::Run]| runs[0].pressure_bar.clone().unwrap();
        let off = pressure(&written).iter().zip(pressure(&text)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off <= 5.001e-7 && (off > 0.0) == (format != "csv"), "{format}: {off:e} bar");
        assert_eq!((&written[0].time_s, &written[0].current_a), (&text[0].time_s, &text[0].current_a), "{format}");
        // What was simulated simulates to itself: the model without error, the average model with one.
        let again = bench.hil(&["simulate", &out, "--model", "delayed.toml", "--format", "json"]).success();
        let json: serde_json::Value = serde_json::from_slice(&again.get_output().stdout).unwrap();
        assert!(json["rmse_bar"].as_f64().unwrap() < 1e-6, "{json}");
        assert!(json["rmse_average_model_bar"].as_f64().unwrap() > 0.05, "{json}");
    }
}

trait AndRmse: predicates::Predicate<str> + Sized {
    /// Also the line of errors of both models.
    fn and_rmse(self) -> impl predicates::Predicate<str> {
        use predicates::prelude::PredicateBooleanExt;
        self.and(contains("RMSE against pressure_bar: ").and(contains(" bar (hyperbolic model), ")).and(contains(" bar (average model)")))
    }
}
impl<P: predicates::Predicate<str>> AndRmse for P {}

#[test]
fn each_run_starts_from_its_own_start() {
    let bench = Bench::new();
    let rows = |name: &str, skip: usize| -> String { drive(300).lines().skip(1 + skip).map(|l| format!("{name},{l}\n")).collect() };
    let header = "run,time_s,current_a,pressure_bar\n";
    bench.put("both.csv", &format!("{header}{}{}", rows("a", 0), rows("b", 120)));
    bench.put("b.csv", &format!("{header}{}", rows("b", 120)));
    bench.hil(&["simulate", "both.csv", "--model", "delayed.toml", "-o", "both.out.csv"]).success().stdout(contains("\n  b: "));
    bench.hil(&["simulate", "b.csv", "--model", "delayed.toml", "-o", "b.out.csv"]).success();
    let both = bench.read("both.out.csv");
    assert_eq!(both.runs.iter().map(|r| r.name.as_deref().unwrap()).collect::<Vec<_>>(), ["a", "b"]);
    assert_eq!(both.runs[1], bench.read("b.out.csv").runs[0]);
    let text = std::fs::read_to_string(bench.at("both.out.csv")).unwrap();
    assert_eq!(text.lines().next(), Some("run,time_s,current_a,pressure_bar"));
}

#[test]
fn foreign_channels_are_mapped_and_what_lies_beyond_the_model_is_said() {
    let bench = Bench::new();
    bench.put("log.csv", "t [ms];I_cmd [mA]\r\n0;500\r\n10;1200\r\n20;500\r\n");
    bench
        .hil(&["simulate", "log.csv", "--model", "static.toml", "--map", "time_s=t [ms]", "--map", "current_a=I_cmd [mA]", "-o", "out.csv"])
        .success()
        .stderr(contains("log.csv: 1 sample with a current outside of the model's"));
    assert_eq!(bench.read("out.csv").runs[0].current_a, [0.5, 1.2, 0.5]);
}

#[test]
fn what_cannot_be_is_refused_by_its_exit_code_and_writes_nothing() {
    let bench = Bench::new();
    bench.put("drive.csv", &drive(50));
    bench.put("bad.csv", "time_s,current_a\n0,0.5\n0.01,oops\n0.02,0.5\n");
    let refused = |arguments: &[&str], code: i32, message: &str| {
        bench.hil(arguments).code(code).stdout("").stderr(contains(message));
        assert!(!Path::new(&bench.at("out.csv")).exists());
    };
    let to = ["--model", "static.toml", "-o", "out.csv"];
    refused(&[&["simulate", "bad.csv"][..], &to].concat(), 3, "bad.csv: line 3, column 2 (`current_a`): `oops` is not a number");
    refused(&[&["simulate", "none.csv"][..], &to].concat(), 3, "none.csv");
    refused(&["simulate", "drive.csv", "--model", "none", "-o", "out.csv"], 3, "none");
    refused(&[&["simulate", "drive.csv", "--map", "current=x"][..], &to].concat(), 2, "did you mean `current_a`?");
    refused(&["simulate", "drive.csv", "--model", "static.toml", "-o", "out.xlsx"], 2, "allowed: .csv, .tsv, .txt, .parquet, .mf4");
    refused(&["simulate", "drive.csv", "--model", "static.toml", "-o", "nowhere/out.csv"], 7, "nowhere");
}
