//! `hil diagnose` from outside: what it finds, the keys of its JSON, page and plan, exit codes, bad input.

use std::path::PathBuf;

use assert_cmd::Command;
use hil::physics::simulate;
use hil::valve::{Input, Valve};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use rand::{RngExt, SeedableRng};
use serde_json::Value;

const PAPER: &str = include_str!("../../valves/paper.toml");

struct Bench(tempfile::TempDir);

impl Bench {
    /// A folder with the paper's valve, and a drive of it with `effect` added.
    fn new(effect: &str) -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        std::fs::write(bench.at("valve.toml"), PAPER).unwrap();
        let truth = Valve::from_toml(&format!("{PAPER}\n{effect}\n"), "truth").unwrap();
        std::fs::write(bench.at("drive.csv"), drive(&truth)).unwrap();
        bench
    }
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn hil(&self, arguments: &[&str]) -> assert_cmd::assert::Assert {
        Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(self.0.path()).args(arguments).assert()
    }
    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.at(name)).unwrap()
    }
}

/// Thirty seconds of steps and ramps at 100 Hz, with 20 mbar of noise.
fn drive(valve: &Valve) -> String {
    let mut random = rand_pcg::Pcg64::seed_from_u64(11);
    let mut current_a = vec![0.4];
    while current_a.len() < 3000 {
        let from = *current_a.last().unwrap();
        let to: f64 = random.random_range(0.3..0.8);
        let (over, hold) = (random.random_range(5..80), random.random_range(20..60));
        current_a.extend((1..=over).map(|k| from + (to - from) * f64::from(k) / f64::from(over)));
        current_a.extend((0..hold).map(|_| to));
    }
    let time_s: Vec<f64> = (0..current_a.len()).map(|k| k as f64 * 0.01).collect();
    let pressure = simulate(valve, Input::Held, &time_s, &current_a).unwrap();
    let mut out = String::from("time_s,current_a,pressure_bar\n");
    for ((t, i), p) in time_s.iter().zip(&current_a).zip(pressure) {
        // The sum of twelve uniform numbers is nearly normal, with a variance of one.
        let noise: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        out += &format!("{t:.2},{i:.5},{:.4}\n", p + 0.02 * noise);
    }
    out
}

#[test]
fn a_drift_is_named_shown_and_planned_for() {
    let bench = Bench::new("[[effect]]\nsensor_drift = { offset = \"0.4 bar\", tau = \"20 s\" }");
    let arguments = ["diagnose", "drive.csv", "--model", "valve.toml", "-o", "augmented.toml", "--report", "page.html"];
    std::fs::create_dir(bench.at("plans")).unwrap();
    let more = ["--next-plan", "plans/next.toml", "--format", "json", "--fail-on", "mismatch"];
    let out = bench.hil(&[&arguments[..], &more].concat()).code(1);
    let json: Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
    for key in ["schema", "verdict", "summary", "rmse_bar", "effects", "where", "candidates", "unexplained", "next_experiment"] {
        assert!(json.get(key).is_some(), "no key `{key}`");
    }
    for key in ["base", "base_heldout", "refit_heldout", "augmented_heldout", "noise_floor"] {
        assert!(json["rmse_bar"][key].as_f64().unwrap() > 0.0, "rmse_bar.{key}");
    }
    // A drift of the curves follows this record as well; from the empty clutch, where the valve cannot err, the two part.
    assert_eq!((json["verdict"].as_str(), json["unexplained"].is_null()), (Some("partly_explained"), true), "{json:#}");
    assert_eq!(json["other_drives"]["most_on"], "shifts from the empty clutch", "{json:#}");
    assert!(json["other_drives"]["open_bar"].as_f64().unwrap() > json["rmse_bar"]["noise_floor"].as_f64().unwrap(), "{json:#}");
    let first = &json["effects"][0];
    let named = [first["id"].as_str().unwrap(), first["indistinguishable"][0].as_str().unwrap_or_default()];
    assert!(named.contains(&"sensor_drift"), "{named:?}");
    for key in ["parameters", "claim", "share", "class", "heldout_gain_bar", "heldout_gain_ci_bar", "p_value", "evidence"] {
        assert!(first.get(key).is_some(), "no key `effects[0].{key}`");
    }

    let page = bench.text("page.html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("EXPLAINED") && page.contains("The signature"));
    assert!(!page.contains("<link") && !page.contains(" src="), "the page fetches something");
    // What was written runs: the augmented model simulates, the plan passes its check and drives the valve. That lies outside of the
    // plan's project, so a copy lies beside the plan.
    bench.hil(&["simulate", "drive.csv", "--model", "augmented.toml", "-o", "out.csv"]).success();
    assert!(json["next_experiment"]["separation_sigma"].as_f64().unwrap() > 0.0);
    assert!(String::from_utf8_lossy(&out.get_output().stderr).contains("plans/next-valve.toml is a copy of augmented.toml"));
    assert_eq!(bench.text("plans/next-valve.toml"), bench.text("augmented.toml"));
    bench.hil(&["check", "plans/next.toml", "augmented.toml"]).success();
    bench.hil(&["run", "plans/next.toml", "--sim", "--out", "run"]).success().stdout(contains("DONE"));
}

/// Models and recordings lie in folders of their own, as `hil init` lays them: the drive of the good valve is found all the same, and
/// where it is gone the answer falls back to what the model lacks, and says what is missing.
#[test]
fn what_a_model_was_identified_from_is_found_beside_the_recording_and_missed_aloud() {
    let bench = Bench::new("[[effect]]\nsensor_drift = { offset = \"0.4 bar\", tau = \"20 s\" }");
    for folder in ["valves", "recordings"] {
        std::fs::create_dir(bench.at(folder)).unwrap();
    }
    std::fs::rename(bench.at("drive.csv"), bench.at("recordings/drive.csv")).unwrap();
    std::fs::write(bench.at("recordings/good.csv"), drive(&Valve::from_toml(PAPER, "good").unwrap())).unwrap();
    bench.hil(&["identify", "recordings/good.csv", "-o", "valves/valve.toml"]).success();
    let claim = || {
        let out = bench.hil(&["diagnose", "recordings/drive.csv", "--model", "valves/valve.toml", "--format", "json"]).success();
        let json: Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
        (json["effects"][0]["claim"].as_str().unwrap().to_owned(), String::from_utf8_lossy(&out.get_output().stderr).into_owned())
    };
    let (found, said) = claim();
    assert_eq!(found, "changed");
    assert!(!said.contains("good.csv"), "{said}");
    std::fs::remove_file(bench.at("recordings/good.csv")).unwrap();
    let (left, said) = claim();
    assert_eq!(left, "lacks");
    assert!(said.contains("good.csv lies neither beside the model nor beside the recording"), "{said}");
}

/// One lag acts before the other, and after a curve that is nearly straight no current tells them apart.
#[test]
fn a_lag_that_no_experiment_tells_from_another_one_is_named_with_it_and_needs_no_plan() {
    let bench = Bench::new("[[effect]]\nfirst_order_lag = { tau = \"60 ms\" }");
    let out = bench.hil(&["diagnose", "drive.csv", "--model", "valve.toml", "--next-plan", "next.toml", "--format", "json"]);
    let json: Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
    let first = &json["effects"][0];
    let mut named = [first["id"].as_str().unwrap(), first["indistinguishable"][0].as_str().unwrap()];
    named.sort_unstable();
    assert_eq!(named, ["first_order_lag", "sensor_lag"]);
    assert!(json["next_experiment"].is_null() && !bench.at("next.toml").exists(), "{json:#}");
}

#[test]
fn nothing_wrong_is_a_match_and_needs_no_plan() {
    let bench = Bench::new("");
    let arguments = ["diagnose", "drive.csv", "--model", "valve.toml", "--next-plan", "next.toml", "--report", "page.html"];
    bench
        .hil(&[&arguments[..], &["--fail-on", "mismatch"]].concat())
        .success()
        .stdout(contains("MATCH"))
        .stderr(contains("next.toml is not written"));
    assert!(!bench.at("next.toml").exists());
    assert!(bench.text("page.html").contains("Nothing is missing"));
}

/// The valve stands on its ascending curve at first and is not moved far enough to forget that for a quarter of the run: a start
/// that is taken for something else looks like a fill phase.
#[test]
fn the_program_s_own_run_of_a_healthy_valve_is_a_match() {
    let bench = Bench::new("");
    bench.hil(&["run", "tipin", "--sim", "--out", "run"]).success();
    for input in [&["--input", "held"][..], &[]] {
        let arguments = [&["diagnose", "run/trace.parquet", "--model", "paper", "--fail-on", "mismatch"], input].concat();
        bench.hil(&arguments).success().stdout(contains("MATCH"));
    }
}

#[test]
fn a_part_that_is_taken_out_is_missed() {
    let bench = Bench::new("");
    let out = bench.hil(&["diagnose", "drive.csv", "--model", "valve.toml", "--without", "hysteresis", "--format", "json"]).success();
    let json: Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
    // A loop that is missing is a correction of form: no fault, and no part of a good model either.
    let found: Vec<&Value> = ["effects", "form"].iter().flat_map(|key| json[key].as_array().unwrap()).collect();
    assert!(!found.is_empty(), "{json:#}");
    let unknown = contains("--without gravity: is no part; the model has: hysteresis, delay");
    bench.hil(&["diagnose", "drive.csv", "--model", "valve.toml", "--without", "gravity"]).code(2).stderr(unknown);
}

#[test]
fn bad_input_gets_an_answer_instead_of_a_diagnosis() {
    let bench = Bench::new("");
    let rows = |count: usize, change: &dyn Fn(f64, f64) -> (f64, f64)| {
        let mut out = String::from("time_s,current_a,pressure_bar\n");
        for line in bench.text("drive.csv").lines().skip(1).take(count) {
            let values: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            let (current, pressure) = change(values[1], values[2]);
            out += &format!("{},{current},{pressure}\n", values[0]);
        }
        out
    };
    let cases: [(&str, String, &str); 3] = [
        ("short.csv", rows(60, &|i, p| (i, p)), "at least 200 are needed"),
        ("still.csv", rows(900, &|_, p| (0.5, p)), "constant"),
        ("blind.csv", String::from("time_s,current_a\n0,0.1\n0.01,0.2\n0.02,0.3\n"), "pressure_bar"),
    ];
    for (name, text, answer) in cases {
        std::fs::write(bench.at(name), text).unwrap();
        let arguments = ["diagnose", name, "--model", "valve.toml", "-o", "augmented.toml", "--report", "page.html"];
        bench.hil(&arguments).code(3).stdout("").stderr(contains(answer));
        assert!(!bench.at("augmented.toml").exists() && !bench.at("page.html").exists(), "{name} left something");
    }
    // What can be read, but does not belong to the model, is an answer of its own: no cause, no model, no plan.
    std::fs::write(bench.at("milliampere.csv"), rows(900, &|i, p| (1e3 * i, p))).unwrap();
    let arguments = ["diagnose", "milliampere.csv", "--model", "valve.toml", "-o", "augmented.toml", "--next-plan", "next.toml"];
    let written = contains("no model and no plan is written");
    bench.hil(&arguments).success().stdout(contains("NOT COMPARABLE").and(contains("[mA]"))).stderr(written);
    assert!(!bench.at("augmented.toml").exists() && !bench.at("next.toml").exists());
    // Nothing was fitted, so the page shows nothing of a fit; and a pressure of tens of thousands of bar has no thousandths.
    bench.hil(&[&arguments[..4], &["--report", "strangers.html"]].concat()).success();
    let page = bench.text("strangers.html");
    let shown = ["recalibrated", "What was tried", "held out"].map(|of_a_fit| page.contains(of_a_fit));
    assert!(page.contains("NOT COMPARABLE") && shown == [false; 3], "{shown:?}");
    let figure = page.split("model as given</div><div class=\"value\">").nth(1).unwrap().split(' ').next().unwrap();
    assert!(figure.parse::<f64>().unwrap() > 1e4 && !figure.contains('.'), "{figure}");
    let out = bench.hil(&[&arguments[..4], &["--format", "json", "--fail-on", "mismatch"]].concat()).code(1);
    let json: Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
    assert_eq!((json["verdict"].as_str(), json["mistake"]["kind"].as_str()), (Some("not_comparable"), Some("current")));
    assert_eq!(json["effects"].as_array().map(Vec::len), Some(0));
}
