//! The safe state is the last word: every command that moves a valve, every format and every way out, on a device that
//! falls silent for good. And an emulated valve is said to be one, everywhere.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use hil::rig::emulator::{Emulator, Faults, Listening};

use super::fake::Fake;
use super::metronome::BUSY;
use super::wire::{driver, listen, simple_valve};

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "last-word"
rate = "50 Hz"
[[phase]]
name = "hold"
stimulus.hold = { at = "8 bar", for = "1 s" }
measure = [{ metric.rmse = {}, limit = { max = "30 bar" } }]
"#;

const STATION: &str = r#"
schema = "hil.station/1"
id = "b"
[master]
max_age = "8 h"
[[master.valve]]
serial = "GOOD"
expect = "pass"
"#;

/// A device that says nothing more after the second set-point that is not zero; `slots` requests suffice where none comes.
fn silent_after(slots: u64) -> Fake {
    silent_after_then(slots, || ())
}

/// The same; `then` is called when it falls silent.
pub fn silent_after_then(slots: u64, then: impl Fn() + Send + 'static) -> Fake {
    let (seen, currents) = (AtomicU64::new(0), AtomicU64::new(0));
    Fake::start(&driver("emulator-tcp"), move |turn| {
        let current = turn.is_slot() && turn.request.get(10..14).is_some_and(|bytes| bytes != [0; 4]);
        let seen = seen.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
        if currents.fetch_add(u64::from(current), Ordering::Relaxed) > 1 || seen > slots {
            then();
            turn.reply = None;
        }
    })
}

pub struct Said {
    pub code: i32,
    pub out: String,
    pub err: String,
}

/// A command line in a folder with plan, station and list of valves; `before` is put before the program by a shell.
fn hil(folder: &Path, line: &str, before: &str) -> Said {
    let out = prepared(folder, line, before).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Said { code: out.status.code().unwrap_or(-1), out: text(&out.stdout), err: text(&out.stderr) }
}

/// The same, not yet begun.
pub fn prepared(folder: &Path, line: &str, before: &str) -> Command {
    for (name, text) in [("plan.toml", [BUSY, PLAN].concat().as_str()), ("station.toml", STATION), ("lot.csv", "serial\nA-1\nA-2\n")] {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let root = env!("CARGO_MANIFEST_DIR");
    for shipped in ["valves", "drivers"] {
        if !folder.join(shipped).exists() {
            std::os::unix::fs::symlink(format!("{root}/{shipped}"), folder.join(shipped)).unwrap();
        }
    }
    let mut command = Command::new("sh");
    command.current_dir(folder).args(["-c", &format!("{before} exec {} {line}", env!("CARGO_BIN_EXE_hil"))]);
    command.stdin(Stdio::null());
    command
}

pub fn told(line: &str, said: &Said) {
    let all = format!("{line}: exit {}\n{}\n{}", said.code, said.out, said.err);
    assert_eq!(said.code, 4, "{all}");
    assert!(said.err.contains("SAFE STATE NOT CONFIRMED - REMOVE POWER"), "not on the console: {all}");
}

#[test]
fn every_command_and_every_format_says_that_the_safe_state_was_not_confirmed() {
    let mut lines: Vec<String> = Vec::new();
    for format in ["text", "json", "markdown", "html", "junit"] {
        lines.push(format!("run plan.toml --format {format} --out run-{format}"));
        lines.push(format!("batch plan.toml --duts lot.csv --format {format} --out batch-{format}"));
    }
    lines.push("master plan.toml --station station.toml --serial GOOD".into());
    lines.push("msa plan.toml --metric hold/rmse --parts 2 --appraisers 2 --trials 2".into());
    let folder = tempfile::tempdir().unwrap();
    for line in &lines {
        let device = silent_after(150);
        let said = hil(folder.path(), &format!("{line} --driver emulator-tcp --tcp {}", device.address), "");
        told(line, &said);
        if line.starts_with("run") || line.starts_with("batch") {
            let shown =
                if line.contains("json") { said.out.contains("SAFE STATE NOT CONFIRMED") } else { said.out.contains("NOT CONFIRMED") };
            assert!(shown, "{line}: not on stdout: {}", said.out);
        }
        if line.starts_with("batch") {
            assert!(!said.err.contains("A-2"), "nothing else is tried on that bench: {}", said.err);
        }
    }
    let record = std::fs::read_to_string(folder.path().join("run-text/record.json")).unwrap();
    let record: serde_json::Value = serde_json::from_str(&record).unwrap();
    assert_eq!((&record["safe_state"]["confirmed"], &record["outcome"]), (&false.into(), &"ERROR".into()));
    assert!(record["safe_state"]["within_s"].as_f64().is_some());
    for page in ["run-text/report.html", "batch-text/report.html"] {
        assert!(std::fs::read_to_string(folder.path().join(page)).unwrap().contains("role=\"alert\""), "{page}");
    }
    let device = silent_after(150);
    told("probe", &hil(folder.path(), &format!("probe --driver emulator-tcp --tcp {}", device.address), ""));
}

/// No file can hold a byte: nothing can be stored, and what matters is said all the same.
#[test]
fn a_full_disk_does_not_hide_it() {
    let folder = tempfile::tempdir().unwrap();
    for line in ["run plan.toml --out run", "batch plan.toml --duts lot.csv --out batch --valve-reports all"] {
        let device = silent_after(150);
        // The batch needs its head and its journal before the valve moves; the run's folder is empty until its end.
        let before = if line.starts_with("run") { "ulimit -f 0;" } else { "ulimit -f 8;" };
        told(line, &hil(folder.path(), &format!("{line} --driver emulator-tcp --tcp {}", device.address), before));
    }
}

#[test]
fn a_device_that_answers_again_is_confirmed_and_leaves_no_banner() {
    let folder = tempfile::tempdir().unwrap();
    let device = Fake::start(&driver("emulator-tcp"), |_| ());
    let said = hil(folder.path(), &format!("run plan.toml --out run --driver emulator-tcp --tcp {}", device.address), "");
    assert!(said.code <= 1 && !said.err.contains("REMOVE POWER") && !said.out.contains("REMOVE POWER"), "{} {}", said.out, said.err);
    assert!(said.out.contains("EMULATED"), "{}", said.out);
    let said = hil(folder.path(), &format!("probe --driver emulator-tcp --tcp {}", device.address), "");
    assert!(said.code == 0 && said.out.contains("safe state confirmed"), "{} {}", said.out, said.err);
}

/// Under its own profiles, and under one of a real device that it stands for.
#[test]
fn an_emulated_valve_is_no_real_one() {
    for (name, extra) in [("emulator-tcp", ""), ("beckhoff-kl2535", "--without-watchdog")] {
        let profile = driver(name);
        let emulator = Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(&profile), Faults::none(), false).unwrap();
        let Listening::Tcp(address) = emulator.listening() else { panic!("TCP") };
        let folder = tempfile::tempdir().unwrap();
        let wire = format!("--driver {name} --tcp {address} {extra}");
        let said = hil(folder.path(), &format!("run plan.toml --out run --format markdown {wire}"), "");
        assert!(said.out.contains("EMULATED"), "{name}: {} {}", said.out, said.err);
        let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).unwrap();
        let record: serde_json::Value = serde_json::from_str(&read("run/record.json")).unwrap();
        assert_eq!((&record["rig"]["emulated"], &record["simulated"]), (&true.into(), &false.into()), "{name}");
        assert!(read("run/report.html").contains("EMULATED") && read("run/junit.xml").contains("emulated"), "{name}");
        let said = hil(folder.path(), &format!("batch plan.toml --duts lot.csv --out batch {wire}"), "");
        assert!(said.out.contains("EMULATED"), "{name}: {} {}", said.out, said.err);
        assert!(read("batch/report.html").contains("EMULATED"), "{name}");
        let said = hil(folder.path(), "history . --serial A-1", "");
        assert!(said.out.contains("(EMULATED)"), "{name}: {}", said.out);
    }
}
