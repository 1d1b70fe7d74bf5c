//! `hil identify` from outside: a recording made from a shipped valve gives a model that every other command reads.

use std::fmt::Write;

use assert_cmd::Command;
use hil::physics::simulate;
use hil::valve::{Input, Polynomial, Valve};

/// A sweep of shrinking amplitude through the paper's valve, with a delay of 20 ms, as CSV with the given header.
fn sweep(header: &str, scale: f64) -> (Valve, String) {
    let mut valve = Valve::load(&Valve::find("paper").unwrap()).unwrap();
    valve.delay_s = 0.02;
    let mut current: Vec<f64> = vec![0.1];
    for (seconds, to) in [(12.0, 0.95), (12.0, 0.15), (8.0, 0.8), (0.01, 0.5), (6.0, 0.75), (6.0, 0.4)] {
        let (from, n) = (current[current.len() - 1], (seconds / 0.01) as usize);
        current.extend((1..=n.max(1)).map(|k| from + (to - from) * k as f64 / n.max(1) as f64));
    }
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * 0.01).collect();
    let pressure = simulate(&valve, Input::Held, &time, &current).unwrap();
    let mut text = format!("{header}\n");
    for ((t, i), p) in time.iter().zip(&current).zip(&pressure) {
        writeln!(text, "{t:.2},{:.6},{p:.4}", i * scale).unwrap();
    }
    (valve, text)
}

fn hil(folder: &std::path::Path, arguments: &[&str]) -> std::process::Output {
    Command::cargo_bin("hil").unwrap().current_dir(folder).args(arguments).output().unwrap()
}

#[test]
fn from_a_recording_to_a_model_that_other_commands_read() {
    let folder = tempfile::tempdir().unwrap();
    let (truth, text) = sweep("time_s,current_a,pressure_bar", 1.0);
    std::fs::write(folder.path().join("sweep.csv"), text).unwrap();
    let output = hil(folder.path(), &["identify", "sweep.csv", "-o", "valve.toml", "--report", "page.html", "--format", "json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!((found["delay_s"].as_f64().unwrap() - 0.02).abs() < 5e-4, "{found}");
    assert!(found["rmse_bar"].as_f64().unwrap() < 0.01 && found["rmse_average_model_bar"].as_f64().unwrap() > 0.1, "{found}");
    assert!(found["a_bar2"].as_f64().unwrap() > 0.0 && found["warnings"].is_array(), "{found}");
    for key in ["ascending", "descending"] {
        let coefficients: Vec<f64> = found["curve"][key].as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).collect();
        let (curve, known) =
            (Polynomial::new(coefficients), if key == "ascending" { &truth.curves.ascending } else { &truth.curves.descending });
        assert!((curve.eval(0.6) - known.eval(0.6)).abs() < 0.01, "{key} {found}");
        assert!(found["curve"][format!("r2_{key}")].as_f64().unwrap() > 0.9999, "{found}");
    }
    let page = std::fs::read_to_string(folder.path().join("page.html")).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("Residual over current"));
    for arguments in [&["check", "valve.toml"][..], &["simulate", "sweep.csv", "--model", "valve.toml", "-o", "out.csv"]] {
        let output = hil(folder.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_duty_comes_in_by_mapping_and_the_text_keeps_to_80_columns() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("log.csv"), sweep("time_s,duty_pct,pressure_bar", 100.0).1).unwrap();
    let output = hil(folder.path(), &["identify", "log.csv", "--map", "current_a=0.01 * duty_pct"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("delay"), "{text}");
    assert!(text.lines().all(|l| l.chars().count() <= 80), "{text}");
}

#[test]
fn what_cannot_be_identified_ends_with_3_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..100).map(|k| format!("{},0.5,20\n", f64::from(k) * 0.01)).collect();
    std::fs::write(folder.path().join("still.csv"), format!("time_s,current_a,pressure_bar\n{rows}")).unwrap();
    let output = hil(folder.path(), &["identify", "still.csv", "-o", "valve.toml"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&output.stderr).contains("a sweep is wanted"));
    assert!(!folder.path().join("valve.toml").exists());
    let output = hil(folder.path(), &["identify", "still.csv", "--order", "40"]);
    assert_eq!(output.status.code(), Some(2));
}

/// The trace of a run states that its command is held. `HIL_SEEDS=30 cargo test --release --test it own_runs -- --nocapture` prints
/// what docs/identify.md says, with the drive of 800 s.
#[test]
fn on_the_programs_own_runs_the_command_is_held_and_a_lies_in_its_interval() {
    let seeds: usize = std::env::var("HIL_SEEDS").ok().and_then(|n| n.parse().ok()).unwrap_or(2);
    let plans = ["tipin", "gain-comparison", "drive-800s"];
    for plan in &plans[..if seeds > 2 { 3 } else { 2 }] {
        let mut inside = 0;
        for seed in 1..=seeds {
            let folder = tempfile::tempdir().unwrap();
            hil(folder.path(), &["run", plan, "--sim", "--seed", &seed.to_string(), "--out", "run"]);
            let output = hil(folder.path(), &["identify", "run/trace.parquet", "--format", "json"]);
            let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!(found["input"], "held", "{plan} {seed}");
            let bound = |k: usize| found["parameters"]["a"]["interval"][k].as_f64().unwrap();
            inside += usize::from((bound(0)..=bound(1)).contains(&1.0));
        }
        println!("{plan}: a inside its interval in {inside} of {seeds}");
        // One in ten may miss, and of few seeds one more.
        assert!(10 * (seeds - inside) <= seeds + 9, "{plan}: {inside} of {seeds}");
    }
}
