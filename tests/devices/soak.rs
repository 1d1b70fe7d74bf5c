//! Random runs on devices that misbehave at random, ended at random: signals, kills, a device that falls silent or
//! restarts, a disk that is full. After each, what is promised is looked at from the device's side and from the files.
//!
//! A short share runs with every change. `HIL_SOAK_MINUTES=60 cargo test --release --test devices soak:: -- --nocapture` runs
//! for an hour and prints its table; `HIL_SOAK_SEED` begins elsewhere, `HIL_SOAK_PROGRAM` takes another `hil`.

use std::collections::BTreeMap;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use hil::rig::emulator::{DeviceReport, Emulator, Faults, Listening};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rustix::process::{Pid, Signal, kill_process};

use super::wire::{driver, listen, simple_valve};

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "soak"
rate = "50 Hz"
timing.max_lost = "20 %"
timing.max_stale = "20 %"
timing.max_missed = "50 %"
[[phase]]
name = "up"
stimulus.sequence = [{ ramp = { from = "4 bar", to = "12 bar", over = "500 ms" } }, { hold = { at = "12 bar", for = "500 ms" } }]
measure = [{ metric.rmse = {}, limit = { max = "5 bar" } }]
"#;

const PASSING: [&str; 14] = [
    "late",
    "silent",
    "wrong_crc",
    "truncated",
    "garbage",
    "garbage_header",
    "exception",
    "duplicate",
    "echo_only",
    "local_echo",
    "wrong_unit",
    "wrong_function",
    "previous",
    "missing_register",
];
const LASTING: [&str; 6] = ["silent", "frozen_sensor", "wire_break", "sensor_break", "watchdog_trip", "closed_line"];
const SIGNALS: [Signal; 9] =
    [Signal::INT, Signal::TERM, Signal::HUP, Signal::QUIT, Signal::USR1, Signal::ALARM, Signal::XCPU, Signal::VTALARM, Signal::ABORT];

/// How a run is ended from outside.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ending {
    Itself,
    Signalled(Signal),
    Killed,
    DiskFull,
}

struct One {
    what: String,
    kind: &'static str,
    broken: Vec<String>,
}

fn faults(random: &mut Pcg64) -> (String, bool) {
    let mut script = String::from("schema = \"hil.faults/1\"\n");
    let lasting = random.random_range(0..4) == 0;
    if lasting {
        let kind = LASTING[random.random_range(0..LASTING.len())];
        script += &format!("[[fault]]\nkind = \"{kind}\"\ncycle = {}\ncount = 0\n", random.random_range(1..60));
    }
    let kinds: Vec<String> =
        (0..random.random_range(1..4)).map(|_| format!("\"{}\"", PASSING[random.random_range(0..PASSING.len())])).collect();
    script += &format!(
        "[random]\nseed = {}\nrate = \"{} %\"\nkinds = [{}]\n",
        random.random_range(1..1_000_000),
        random.random_range(0..6),
        kinds.join(", ")
    );
    (script, lasting)
}

fn spawn(folder: &std::path::Path, emulator: &Emulator, name: &str, ending: Ending) -> Child {
    std::fs::write(folder.join("plan.toml"), PLAN).unwrap();
    for shipped in ["valves", "drivers"] {
        std::os::unix::fs::symlink(format!("{}/{shipped}", env!("CARGO_MANIFEST_DIR")), folder.join(shipped)).unwrap();
    }
    let place = match emulator.listening() {
        Listening::Serial(path) => format!("--port {}", path.display()),
        Listening::Tcp(address) => format!("--tcp {address}"),
    };
    let program = std::env::var("HIL_SOAK_PROGRAM").unwrap_or_else(|_| env!("CARGO_BIN_EXE_hil").into());
    let before = if ending == Ending::DiskFull { "ulimit -f 0;" } else { "" };
    let line = format!("{before} exec {program} run plan.toml --driver {name} {place} --out out --format json");
    Command::new("sh")
        .current_dir(folder)
        .args(["-c", &line])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn one(random: &mut Pcg64) -> One {
    let name = ["emulator-tcp", "emulator", "emulator-line"][random.random_range(0..3)];
    let (script, lasting) = faults(random);
    let ending = match random.random_range(0..6) {
        0 | 1 => Ending::Itself,
        2 | 3 => Ending::Signalled(SIGNALS[random.random_range(0..SIGNALS.len())]),
        4 => Ending::Killed,
        _ => Ending::DiskFull,
    };
    let after = random.random_range(0..60u64);
    let profile = driver(name);
    let emulator =
        Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(&profile), Faults::from_toml(&script, "soak").unwrap(), false)
            .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut child = spawn(folder.path(), &emulator, name, ending);
    let pid = Pid::from_child(&child);
    let mut ended_by_us = false;
    let limit = Instant::now() + Duration::from_secs(60);
    let mut broken = Vec::new();
    while child.try_wait().unwrap().is_none() {
        let cycles = emulator.report().cycles;
        match ending {
            Ending::Signalled(signal) if !ended_by_us && cycles > after => {
                let _ = kill_process(pid, signal);
                ended_by_us = true;
            }
            Ending::Killed if !ended_by_us && cycles > after => {
                let _ = kill_process(pid, Signal::KILL);
                ended_by_us = true;
            }
            _ => {}
        }
        if Instant::now() > limit {
            broken.push("hung for a minute".into());
            let _ = child.kill();
            break;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let out = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    let code = out.status.code();
    let report = rest(&emulator);
    let stored =
        std::fs::read(folder.path().join("out/record.json")).ok().and_then(|b| serde_json::from_slice::<serde_json::Value>(&b).ok());
    broken.extend(promises(ending, ended_by_us, code, &said, &report, stored.as_ref()));
    let kind = match (ending, lasting) {
        (Ending::Itself, false) => "bad line",
        (Ending::Itself, true) => "device fails for good",
        (Ending::Signalled(_), _) => "signal",
        (Ending::Killed, _) => "kill -9",
        (Ending::DiskFull, _) => "full disk",
    };
    let what = format!("{name}, {ending:?} after {after} cycles, exit {code:?}, {script:?}: {said}");
    One { what, kind, broken }
}

/// What the device shows half a second after the end: longer than any watchdog may take.
fn rest(emulator: &Emulator) -> DeviceReport {
    std::thread::sleep(Duration::from_millis(500));
    emulator.report()
}

fn promises(
    ending: Ending,
    ended_by_us: bool,
    code: Option<i32>,
    said: &str,
    report: &DeviceReport,
    stored: Option<&serde_json::Value>,
) -> Vec<String> {
    let mut broken = Vec::new();
    let mut promise = |holds: bool, what: &str| {
        if !holds {
            broken.push(what.to_string());
        }
    };
    let killed = ending == Ending::Killed && ended_by_us;
    promise(report.coil_a == 0.0, "the coil was left energised");
    promise(!report.energised_unarmed, "a current flowed before the watchdog was armed");
    promise(!said.contains("panicked") && code != Some(70), "a panic");
    if killed {
        return broken;
    }
    promise(code.is_some_and(|c| [0, 1, 3, 4, 5, 6, 7].contains(&c)), "an exit code that stands nowhere");
    let unsafe_said = said.contains("SAFE STATE NOT CONFIRMED - REMOVE POWER");
    promise(!unsafe_said || code == Some(4), "an unconfirmed safe state with another exit code than 4");
    if ended_by_us {
        promise(!matches!(code, Some(0 | 1)) || stored.is_some(), "a verdict after a signal without a record");
    }
    if ending == Ending::DiskFull {
        promise(stored.is_none() && !matches!(code, Some(0 | 1)), "a verdict that could not be stored");
    }
    if let Some(record) = stored {
        let outcome = record["outcome"].as_str().unwrap_or_default();
        let wanted = match outcome {
            "PASS" | "MARGINAL" | "NOT_RUN" => 0,
            "FAIL" => 1,
            "INVALID" => 6,
            "ABORTED" => 5,
            _ => 4,
        };
        promise(code == Some(wanted), "an exit code that is not that of the record");
        let confirmed = record["safe_state"]["confirmed"].as_bool().unwrap_or(false);
        promise(confirmed != unsafe_said, "the record and the console differ on the safe state");
        promise(record["rig"]["emulated"] == true, "an emulated valve is recorded as a real one");
    } else {
        promise(!matches!(code, Some(0 | 1 | 6)), "a verdict without a record");
    }
    broken
}

/// Runs at random for as long as is asked, or a handful; prints the table, and fails with every broken promise.
#[test]
fn random_runs_keep_every_promise() {
    let minutes: f64 = std::env::var("HIL_SOAK_MINUTES").ok().and_then(|m| m.parse().ok()).unwrap_or(0.0);
    let seed: u64 = std::env::var("HIL_SOAK_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(20_261_121);
    let (began, mut runs) = (Instant::now(), 0u64);
    let mut table: BTreeMap<&'static str, (u32, u32)> = BTreeMap::new();
    let mut broken = Vec::new();
    while runs < 8 || began.elapsed().as_secs_f64() < 60.0 * minutes {
        // Four at once, so that they get in each other's way.
        let ones: Vec<One> = std::thread::scope(|scope| {
            let some: Vec<_> = (0..4).map(|k| scope.spawn(move || one(&mut Pcg64::seed_from_u64(seed + runs + k)))).collect();
            some.into_iter().map(|s| s.join().unwrap()).collect()
        });
        runs += 4;
        for one in ones {
            let line = table.entry(one.kind).or_default();
            line.0 += 1;
            line.1 += u32::from(!one.broken.is_empty());
            if !one.broken.is_empty() {
                println!("BROKEN {}: {}", one.broken.join("; "), one.what);
                broken.push(one.broken.join("; "));
            }
        }
    }
    println!("{:<24} {:>6} {:>16}", "ended by", "runs", "promises broken");
    for (kind, (count, bad)) in &table {
        println!("{kind:<24} {count:>6} {bad:>16}");
    }
    println!("{:<24} {runs:>6} {:>16} in {:.1} minutes", "all", broken.len(), began.elapsed().as_secs_f64() / 60.0);
    assert!(broken.is_empty(), "{broken:?}");
}
