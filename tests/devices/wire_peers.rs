//! Modbus frames against peers that others wrote: mbpoll, a pymodbus client, pymodbus and libmodbus servers.
//!
//! `tests/peers/install.sh` installs them; a clone without them passes with a note. With `HIL_PEERS` set, as `.ci/run`
//! does, a missing peer is a failure.

use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use hil::rig::emulator::{Emulator, Faults, Listening};
use hil::rig::profile::Profile;
use hil::rig::{Endpoint, Options, Quality, Rig, RigError, open};

use super::wire::{listen, simple_valve};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Whether the peers are there; panics where they are missing although `HIL_PEERS` asks for them.
fn wanted() -> bool {
    if std::env::var_os("HIL_SKIP_PEERS").is_some() {
        return false;
    }
    if !python().is_file() {
        assert!(std::env::var_os("HIL_PEERS").is_none(), "run tests/peers/install.sh");
        eprintln!("not compared with other Modbus programs: run tests/peers/install.sh first");
        return false;
    }
    true
}

fn python() -> PathBuf {
    root().join("target/modbus-peers/bin/python")
}

/// A process that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(command: &mut Command) -> Running {
    Running(command.spawn().unwrap_or_else(|e| panic!("{command:?}: {e}")))
}

fn output(command: &mut Command) -> String {
    let out = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}; run tests/peers/install.sh"));
    let text = format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert!(out.status.success(), "{command:?}: {text}");
    text
}

fn script(name: &str) -> Command {
    let mut command = Command::new(python());
    command.arg(root().join("tests/peers").join(name));
    command
}

/// Two serial ports with a wire between them.
fn wire() -> (Running, String, String) {
    let mut pair = start(script("pty_pair.py").stdout(Stdio::piped()));
    let mut line = String::new();
    BufReader::new(pair.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let (a, b) = line.trim().split_once(' ').unwrap();
    (pair, a.to_string(), b.to_string())
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// The map of the serial emulator, here also on TCP: the peers' servers play the same one.
fn map_of_the_emulator(tcp: bool) -> Profile {
    let text = std::fs::read_to_string(root().join("drivers/emulator.toml")).unwrap();
    if !tcp {
        return Profile::from_toml(&text, "emulator.toml").unwrap();
    }
    let serial = |line: &&str| !["baud", "parity", "stop_bits", "low_latency"].iter().any(|k| line.starts_with(k));
    let text: Vec<&str> = text.lines().filter(serial).collect();
    Profile::from_toml(&text.join("\n").replace("kind = \"rtu\"", "kind = \"tcp\""), "emulator-over-tcp.toml").unwrap()
}

fn emulator(tcp: bool) -> (Emulator, &'static str, String) {
    let profile = map_of_the_emulator(tcp);
    let emulator = Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(&profile), Faults::none(), true).unwrap();
    match emulator.listening().clone() {
        Listening::Serial(path) => (emulator, "rtu", path.display().to_string()),
        Listening::Tcp(address) => (emulator, "tcp", address.to_string()),
    }
}

#[test]
fn mbpoll_reads_and_writes_the_emulator() {
    if !wanted() {
        return;
    }
    for tcp in [false, true] {
        let (emulator, kind, place) = emulator(tcp);
        let mut command = Command::new("mbpoll");
        command.args(["-q", "-a", "1", "-0", "-1", "-o", "2"]);
        match kind {
            "tcp" => {
                let (host, port) = place.split_once(':').unwrap();
                command.args(["-m", "tcp", "-p", port, "-t", "4", "-r", "32", "-c", "1", host]);
            }
            _ => {
                command.args(["-m", "rtu", "-b", "115200", "-P", "none", "-t", "4", "-r", "32", "-c", "1", &place]);
            }
        }
        let text = output(&mut command);
        assert!(text.contains("18518"), "{kind}: {text}");
        assert!(emulator.report().requests >= 1);
    }
}

#[test]
fn a_pymodbus_client_drives_the_emulator() {
    if !wanted() {
        return;
    }
    for tcp in [false, true] {
        let (emulator, kind, place) = emulator(tcp);
        assert!(output(script("modbus_client.py").args([kind, &place])).contains("ok"));
        let report = emulator.report();
        assert_eq!((report.largest_coil_a, report.coil_a), (0.25, 0.0), "{kind}: {report:?}");
    }
}

/// The emulator's map with functions 6 and 4, which every cheap module has.
fn simple_functions(tcp: bool) -> Profile {
    let (kind, line, freshness) =
        if tcp { ("tcp", "", "\"transaction-id\"") } else { ("rtu", "baud = 115200\nstop_bits = 1", "\"quantity\"\nspare = 3") };
    let written = if tcp { "\"transaction-id\"" } else { "\"echo\"" };
    let text = format!(
        r#"
schema = "hil.driver/1"
[device]
vendor = "peer"
model = "functions 6 and 4"
sources = ["tests/peers"]
verified = "emulated"
update = "100 Hz"
[transport]
kind = "{kind}"
unit = 1
{line}
turnaround = "1 ms"
functions = [3, 4, 6]
[signal.setpoint]
table = "holding"
address = 0
scale = "0.1 mA"
limit = {{ min = "0 A", max = "1 A" }}
[signal.pressure]
table = "input"
address = 0
map = {{ raw = [4000, 20000], value = ["0 bar", "80 bar"] }}
frozen_after = "500 ms"
[signal.current]
table = "input"
address = 1
scale = "0.1 mA"
[cycle]
timeout = "12 ms"
[[cycle.transaction]]
function = 6
write = ["setpoint"]
freshness = {written}
[[cycle.transaction]]
function = 4
read = ["pressure", "current"]
freshness = {freshness}
[watchdog]
kind = "none"
[safe_state]
confirm = "current"
below = "20 mA"
within = "1 s"
"#
    );
    Profile::from_toml(&text, "functions-6-and-4.toml").unwrap()
}

/// Drives the server: every sample called good has the pressure that belongs to the set-point just written.
fn drive(profile: &Profile, endpoint: &Endpoint, without_watchdog: bool) {
    // What is tested is the frames: a Python server on a busy machine gets the time that it needs.
    let mut profile = profile.clone();
    profile.cycle.timeout_s = 0.04;
    profile.interlock.lost_max = 20;
    let until = Instant::now() + Duration::from_secs(20);
    let mut rig = loop {
        // The server needs a moment to listen.
        match open(&profile, endpoint, 0.1, Options { without_watchdog, ..Options::default() }) {
            Ok(rig) => break rig,
            Err(RigError::Open { .. } | RigError::Device { .. }) if Instant::now() < until => {
                std::thread::sleep(Duration::from_millis(200))
            }
            Err(e) => panic!("{endpoint}: {e}"),
        }
    };
    let mut good = 0;
    for k in 1..=40 {
        let command_a = 0.2 + 0.01 * f64::from(k % 20);
        let Ok(sample) = rig.step(command_a, f64::from(k) * 0.1) else { break };
        if sample.quality == Quality::Good {
            good += 1;
            // 5 mbar for a count of 0.1 mA; the last digits of the set-point may be in use as a sequence number.
            assert!((sample.pressure_bar - 50.0 * command_a).abs() < 0.03, "{sample:?} for {command_a} A");
            assert!((sample.current_a.unwrap() - command_a).abs() < 0.0006, "{sample:?} for {command_a} A");
        }
    }
    assert!(good >= 25, "{endpoint}: {good} good of 40: {:?}", rig.losses());
    let state = rig.make_safe().unwrap();
    assert!(state.confirmed, "{}", state.evidence);
}

/// Runs one server on TCP and on a serial line, with function 23 and with functions 6 and 4.
fn servers(command: &dyn Fn(&str, &str) -> Command) {
    for tcp in [true, false] {
        for fc23 in [true, false] {
            let (_wire, ours, theirs) = if tcp {
                (None, String::new(), String::new())
            } else {
                let (wire, a, b) = wire();
                (Some(wire), a, b)
            };
            let port = free_port();
            let place = if tcp { format!("127.0.0.1:{port}") } else { theirs };
            let _server = start(&mut command(if tcp { "tcp" } else { "rtu" }, &place));
            let endpoint = if tcp { Endpoint::Tcp(place.clone()) } else { Endpoint::Serial(ours.into()) };
            let profile = match (fc23, tcp) {
                (true, tcp) => map_of_the_emulator(tcp),
                (false, tcp) => simple_functions(tcp),
            };
            drive(&profile, &endpoint, !fc23);
        }
    }
}

#[test]
fn the_driver_runs_against_a_pymodbus_server() {
    if wanted() {
        servers(&|kind, place| {
            let mut command = script("modbus_server.py");
            command.args([kind, place]).stderr(Stdio::null());
            command
        });
    }
}

#[test]
fn the_driver_runs_against_a_libmodbus_server() {
    if !wanted() {
        return;
    }
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("libmodbus-server");
    output(Command::new("cc").arg("-o").arg(&program).arg(root().join("tests/peers/modbus_server.c")).arg("-lmodbus"));
    servers(&|kind, place| {
        let mut command = Command::new(&program);
        command.args([kind, place.rsplit(':').next().unwrap_or(place)]);
        command
    });
}
