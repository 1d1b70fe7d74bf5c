//! Questions of a plan at a terminal and in a batch.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "asks"
[[setup]]
name = "mounted"
prompt = { text = "Is the hose tight?" }
[[setup]]
name = "oil"
prompt = { text = "Oil temperature", answer.number = { unit = "degC", limit = { min = "35 degC", max = "45 degC" } } }
[[phase]]
name = "hold"
stimulus.hold = { at = "8 bar", for = "600 ms" }
measure = [{ metric.rmse = {}, limit = { max = "5 bar" } }]
"#;

/// What a person reads and types: `script` of util-linux gives the program a terminal of its own.
#[test]
fn questions_are_asked_and_answered_at_a_terminal() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("plan.toml"), PLAN).unwrap();
    let line = format!("{} run plan.toml --sim --out out --color never", env!("CARGO_BIN_EXE_hil"));
    let mut child = Command::new("script")
        .args(["--quiet", "--return", "--command", &line, "/dev/null"])
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("`script` of util-linux");
    let (mut keys, mut screen) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut bytes = [0; 512];
        while let Ok(n @ 1..) = screen.read(&mut bytes) {
            if tell.send(String::from_utf8_lossy(&bytes[..n]).into_owned()).is_err() {
                break;
            }
        }
    });
    let mut text = String::new();
    let mut wait_for = |wanted: &str| {
        let began = Instant::now();
        while !text.contains(wanted) {
            assert!(began.elapsed() < Duration::from_secs(60), "no `{wanted}` in: {text}");
            text += &told.recv_timeout(Duration::from_millis(200)).unwrap_or_default();
        }
        text.clear();
    };
    wait_for("Is the hose tight?");
    keys.write_all(b"maybe\n").unwrap();
    wait_for("yes or no is wanted");
    keys.write_all(b"y\n").unwrap();
    wait_for("Oil temperature");
    keys.write_all(b"40,5\n").unwrap();
    wait_for("PASS");
    drop(keys);
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let record: Value = serde_json::from_str(&std::fs::read_to_string(folder.path().join("out/record.json")).unwrap()).unwrap();
    let answers: Vec<(&str, &str)> = record["phases"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|p| Some((p["prompt"]["answer"].as_str()?, p["prompt"]["by"].as_str()?)))
        .collect();
    assert_eq!(answers, [("yes", "terminal"), ("40.5 degC", "terminal")]);
}

fn batch(folder: &Path, more: &[&str]) -> (Option<i32>, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_hil"))
        .args(["batch", "plan.toml", "--sim", "--count", "3", "--out", "lot"])
        .args(more)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
}

#[test]
fn a_batch_is_answered_from_a_file_for_every_valve_or_does_not_begin() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("plan.toml"), PLAN).unwrap();
    let (code, message) = batch(folder.path(), &[]);
    assert!(code == Some(2) && message.contains("give --answers FILE"), "{message}");
    assert!(!folder.path().join("lot/valves").exists(), "nothing began");
    std::fs::write(folder.path().join("a.toml"), "schema = \"hil.answers/1\"\n[answers]\nmounted = true\noil = 40\n").unwrap();
    let (code, message) = batch(folder.path(), &["--answers", "a.toml"]);
    assert_eq!(code, Some(0), "{message}");
    for valve in 1..=3 {
        let path = folder.path().join(format!("lot/valves/SIM-{valve:06}/attempt-1/record.json"));
        let record: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let by: Vec<&str> = record["phases"].as_array().unwrap().iter().filter_map(|p| p["prompt"]["by"].as_str()).collect();
        assert_eq!(by, ["file", "file"], "valve {valve}");
    }
}
