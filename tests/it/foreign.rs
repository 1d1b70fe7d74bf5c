//! `hil diagnose` against a model that is not ours: an FMU of other physics, compiled here from C, and a pressure that was
//! simulated elsewhere.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};

use assert_cmd::Command;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use rand::{RngExt, SeedableRng};
use serde_json::Value;

const SOURCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/it/foreign/plant.c");
const STEP_S: f64 = 0.01;

/// A folder with what was compiled, and a user's own state.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn hil(&self, arguments: &[&str]) -> assert_cmd::assert::Assert {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hil"));
        command.current_dir(self.0.path()).env("XDG_STATE_HOME", self.at("state")).args(arguments).assert()
    }
    fn json(&self, arguments: &[&str]) -> Value {
        let out = self.hil(arguments).success().get_output().stdout.clone();
        serde_json::from_slice(&out).unwrap()
    }
    fn compiled(&self, output: &Path, flags: &[&str]) {
        let done = Process::new("cc").args(["-O2", "-w", SOURCE, "-lm", "-o"]).arg(output).args(flags).status().unwrap();
        assert!(done.success());
    }
    /// The plant as an FMU of this version.
    fn fmu(&self, name: &str, version: u8, flags: &[&str]) {
        let library = self.at("plant.so");
        self.compiled(&library, &[&["-shared", "-fPIC"], flags].concat());
        let mut zip = zip::ZipWriter::new(std::fs::File::create(self.at(name)).unwrap());
        let folder = if version == 2 { "linux64" } else { "x86_64-linux" };
        for (name, bytes) in [
            ("modelDescription.xml", description(version).into_bytes()),
            (&format!("binaries/{folder}/plant.so"), std::fs::read(&library).unwrap()),
        ] {
            zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            zip.write_all(&bytes).unwrap();
        }
        zip.finish().unwrap();
    }
    /// What the plant does with a current, by itself [bar].
    fn plant(&self, current_a: &[f64]) -> Vec<f64> {
        let program = self.at("plant");
        if !program.exists() {
            self.compiled(&program, &["-DPROGRAM"]);
        }
        let mut child = Process::new(program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let text: String = current_a.iter().map(|i| format!("{i:.17}\n")).collect();
        let mut pipe = child.stdin.take().unwrap();
        let writer = std::thread::spawn(move || pipe.write_all(text.as_bytes()));
        let out = child.wait_with_output().unwrap();
        writer.join().unwrap().unwrap();
        String::from_utf8(out.stdout).unwrap().lines().map(|l| l.parse().unwrap()).collect()
    }
    /// A recording of a current and a pressure with noise, and with the pressure that a simulation gave.
    fn record(&self, name: &str, current_a: &[f64], pressure_bar: &[f64], simulated_bar: &[f64]) {
        let mut random = rand_pcg::Pcg64::seed_from_u64(5);
        let mut out = String::from("time_s,current_a,pressure_bar,p_sim [bar]\n");
        for (k, ((i, p), s)) in current_a.iter().zip(pressure_bar).zip(simulated_bar).enumerate() {
            // The sum of twelve uniform numbers is nearly normal, with a variance of one.
            let noise: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            out += &format!("{:.2},{i:.6},{:.5},{s:.5}\n", k as f64 * STEP_S, p + 0.02 * noise);
        }
        std::fs::write(self.at(name), out).unwrap();
    }
}

fn description(version: u8) -> String {
    let units = r#"<UnitDefinitions><Unit name="mA"><BaseUnit A="1" factor="0.001"/></Unit>
      <Unit name="Pa"><BaseUnit kg="1" m="-1" s="-2"/></Unit></UnitDefinitions>"#;
    if version == 2 {
        format!(
            r#"<fmiModelDescription fmiVersion="2.0" modelName="orifice valve" guid="g"><CoSimulation modelIdentifier="plant"/>{units}
            <ModelVariables><ScalarVariable name="cmd" valueReference="7" causality="input"><Real unit="mA"/></ScalarVariable>
            <ScalarVariable name="p" valueReference="9" causality="output"><Real unit="Pa"/></ScalarVariable></ModelVariables></fmiModelDescription>"#
        )
    } else {
        format!(
            r#"<fmiModelDescription fmiVersion="3.0" modelName="orifice valve" instantiationToken="g"><CoSimulation modelIdentifier="plant"/>{units}
            <ModelVariables><Float64 name="cmd" valueReference="7" causality="input" unit="mA"/>
            <Float64 name="p" valueReference="9" causality="output" unit="Pa"/></ModelVariables></fmiModelDescription>"#
        )
    }
}

/// Forty seconds of steps and ramps at 100 Hz [A].
fn drive() -> Vec<f64> {
    let mut random = rand_pcg::Pcg64::seed_from_u64(11);
    let mut current_a = vec![0.4];
    while current_a.len() < 4000 {
        let from = *current_a.last().unwrap();
        let to: f64 = random.random_range(0.3..0.8);
        let (over, hold) = (random.random_range(5..80), random.random_range(20..60));
        current_a.extend((1..=over).map(|k| from + (to - from) * f64::from(k) / f64::from(over)));
        current_a.extend((0..hold).map(|_| to));
    }
    current_a.iter().map(|i| (i * 1e6).round() / 1e6).collect()
}

/// A first-order lag, its input on straight lines from sample to sample.
fn lagged(input: &[f64], tau_s: f64) -> Vec<f64> {
    let mut y = input[0];
    let mut out = vec![y];
    for w in input.windows(2) {
        for part in 0..100 {
            let x = w[0] + (w[1] - w[0]) * (f64::from(part) + 0.5) / 100.0;
            y += (x - y) * (1.0 - (-STEP_S / 100.0 / tau_s).exp());
        }
        out.push(y);
    }
    out
}

/// A play that lets the current reverse by `width_a` before anything moves.
fn loose(current_a: &[f64], width_a: f64) -> Vec<f64> {
    let mut at = current_a[0];
    let half = 0.5 * width_a;
    current_a
        .iter()
        .map(|i| {
            at = at.clamp(i - half, i + half);
            at
        })
        .collect()
}

fn effect<'j>(found: &'j Value, id: &str) -> &'j Value {
    found["effects"].as_array().unwrap().iter().find(|e| e["id"] == id).unwrap_or_else(|| panic!("{id}: {}", found["effects"]))
}

#[test]
fn a_lag_behind_a_foreign_fmu_is_found_written_and_then_nothing_more_is() {
    let bench = Bench::new();
    let current_a = drive();
    let own = bench.plant(&current_a);
    bench.fmu("plant.fmu", 2, &["-DPRINTS"]);
    bench.record("drive.csv", &current_a, &lagged(&own, 0.06), &own);
    let asked =
        ["diagnose", "drive.csv", "--model", "plant.fmu", "--trust-fmu", "-o", "found.toml", "--report", "page.html", "--format", "json"];
    let found = bench.json(&asked);
    assert_eq!(found["verdict"], "explained", "{found:#}");
    assert_eq!(found["model"], "orifice valve");
    let first = &found["effects"][0];
    assert!(["first_order_lag", "sensor_lag"].contains(&first["id"].as_str().unwrap()), "{first}");
    let tau = first["parameters"]["tau"]["value"].as_f64().unwrap();
    assert!((0.054..0.066).contains(&tau), "{tau}");
    assert!(found["rmse_bar"]["augmented_heldout"].as_f64().unwrap() < 0.2 * found["rmse_bar"]["base_heldout"].as_f64().unwrap());
    assert!(found["notes"].to_string().contains("recalibrated by gain, zero and delay only"), "{}", found["notes"]);
    // The same with the pressure that a simulation gave, as a column and as a file; nothing can be run again there.
    let column = bench.json(&["diagnose", "drive.csv", "--simulated", "p_sim [bar]", "--format", "json"]);
    assert_eq!(column["effects"][0]["id"], first["id"], "{column:#}");
    assert!(column["notes"].to_string().contains("known for the recorded current only"));
    let mut file = String::from("time_s,pressure_bar\n");
    own.iter().enumerate().for_each(|(k, p)| file += &format!("{:.2},{p:.5}\n", k as f64 * STEP_S));
    std::fs::write(bench.at("simulated.csv"), file).unwrap();
    let from_file = bench.json(&["diagnose", "drive.csv", "--simulated", "simulated.csv", "--format", "json"]);
    assert_eq!(from_file["effects"][0]["id"], first["id"]);
    // The page, and the answer as a model: trusted by now, and without anything missing.
    assert!(std::fs::read_to_string(bench.at("page.html")).unwrap().contains("orifice valve"));
    let text = std::fs::read_to_string(bench.at("found.toml")).unwrap();
    assert!(text.contains("schema = \"hil.attached/1\"") && text.contains("fmu = \"plant.fmu\""), "{text}");
    bench.hil(&["check", "found.toml"]).success().stdout(contains("orifice valve"));
    let again = bench.json(&["diagnose", "drive.csv", "--model", "found.toml", "--format", "json"]);
    assert_eq!(again["verdict"], "match", "{again:#}");
}

#[test]
fn play_ahead_of_a_foreign_fmu_is_found_by_running_it_again() {
    let bench = Bench::new();
    let current_a = drive();
    bench.fmu("plant.fmu", 3, &[]);
    let truth = bench.plant(&loose(&current_a, 0.03));
    bench.record("drive.csv", &current_a, &truth, &truth);
    let found = bench.json(&["diagnose", "drive.csv", "--model", "plant.fmu", "--trust-fmu", "-o", "found.toml", "--format", "json"]);
    let width = effect(&found, "reversal_dead_band")["parameters"]["width"]["value"].as_f64().unwrap();
    assert!((0.026..0.034).contains(&width), "{width} {found:#}");
    let again = bench.json(&["diagnose", "drive.csv", "--model", "found.toml", "--format", "json"]);
    assert_eq!(again["verdict"], "match", "{again:#}");
    // A drive of the good valve, another gain than the model's included, tells what has changed from what never was right.
    let own: Vec<f64> = bench.plant(&current_a).iter().map(|p| 1.02 * p).collect();
    bench.record("good.csv", &current_a, &own, &own);
    let truth: Vec<f64> = truth.iter().map(|p| 1.02 * p).collect();
    bench.record("drive.csv", &current_a, &truth, &truth);
    let found = bench.json(&["diagnose", "drive.csv", "--model", "plant.fmu", "--reference", "good.csv", "--format", "json"]);
    assert_eq!(effect(&found, "reversal_dead_band")["claim"], "changed", "{found:#}");
    assert!(found["rmse_bar"]["base"].as_f64().unwrap() > 0.4, "{found:#}");
}

#[test]
fn a_foreign_model_that_is_right_matches_and_is_recalibrated() {
    let bench = Bench::new();
    let current_a = drive();
    let own = bench.plant(&current_a);
    bench.fmu("plant.fmu", 2, &[]);
    let measured: Vec<f64> = own.iter().map(|p| 1.01 * p + 0.1).collect();
    bench.record("drive.csv", &current_a, &measured, &own);
    let found = bench.json(&["diagnose", "drive.csv", "--model", "plant.fmu", "--trust-fmu", "-o", "found.toml", "--format", "json"]);
    assert_eq!(found["verdict"], "match", "{found:#}");
    let text = std::fs::read_to_string(bench.at("found.toml")).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let gain = table["recalibration"]["gain"].as_float().unwrap();
    assert!((gain - 1.01).abs() < 0.003, "{text}");
    // One step of the recording at 1 kHz is less than a step of a model that names 10 ms: it is read between.
    bench.hil(&["diagnose", "drive.csv", "--model", "plant.fmu", "--fmu-step", "5 ms", "--fail-on", "mismatch"]).success();
}

#[test]
fn what_a_foreign_model_may_do_is_a_message() {
    let bench = Bench::new();
    let current_a = drive();
    let own = bench.plant(&current_a);
    bench.record("drive.csv", &current_a, &own, &own);
    bench.fmu("plant.fmu", 2, &[]);
    let refused = bench.hil(&["diagnose", "drive.csv", "--model", "plant.fmu"]).code(3);
    refused.stderr(contains("--trust-fmu").and(contains("SHA-256")));
    for (flag, said) in [("-DCRASH", "crashed (signal"), ("-DHANG", "took longer than 1 s"), ("-DREFUSES", "fmi2DoStep at")] {
        bench.fmu("bad.fmu", 2, &[flag]);
        let asked = ["diagnose", "drive.csv", "--model", "bad.fmu", "--trust-fmu", "--fmu-time-limit", "1 s", "-o", "bad.toml"];
        bench.hil(&asked).code(3).stderr(contains(said).and(contains("orifice valve")));
        assert!(!bench.at("bad.toml").exists());
    }
    let asked = ["diagnose", "drive.csv", "--model", "plant.fmu", "--trust-fmu", "--fmu-pressure", "q"];
    bench.hil(&asked).code(3).stderr(contains("no pressure `q`").and(contains("p [Pa]")));
    std::fs::write(bench.at("no.fmu"), "no archive").unwrap();
    bench.hil(&["diagnose", "drive.csv", "--model", "no.fmu"]).code(3).stderr(contains("is no FMU"));
    bench.hil(&["diagnose", "drive.csv", "--simulated", "q"]).code(3).stderr(contains("q"));
    bench.hil(&["diagnose", "drive.csv", "--simulated", "p_sim [bar]", "--reference", "drive.csv"]).code(2).stderr(contains("--reference"));
    // Simulated for another current, and not for all of the recording.
    let file = |from: usize, to: usize, late: usize| {
        let mut text = String::from("time_s,current_a,pressure_bar\n");
        (from..to).for_each(|k| text += &format!("{:.2},{},{:.5}\n", k as f64 * STEP_S, current_a[k.saturating_sub(late)], own[k]));
        std::fs::write(bench.at("simulated.csv"), text).unwrap();
    };
    file(0, own.len(), 300);
    bench.hil(&["diagnose", "drive.csv", "--simulated", "simulated.csv"]).code(3).stderr(contains("for another current"));
    file(0, 2000, 0);
    bench.hil(&["diagnose", "drive.csv", "--simulated", "simulated.csv"]).code(3).stderr(contains("the recording goes from"));
}
