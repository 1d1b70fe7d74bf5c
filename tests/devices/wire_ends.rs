//! Every way out of a run, seen from the device: signals at every phase, a killed process, a panic, a limit, a dead line.

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use hil::rig::emulator::{DeviceReport, Emulator, Faults, Kind, Listening};
use hil::rig::loop_thread::{self, LoopControl};
use hil::rig::{Options, Rig, RigError, open};
use rustix::process::{Pid, Signal, kill_process};

use super::wire::{driver, endpoint, listen, rig, simple_valve};

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "ways-out"
rate = "50 Hz"
[[setup]]
name = "fill"
stimulus.sequence = [{ ramp = { from = "4 bar", to = "8 bar", over = "600 ms" } }]
[[phase]]
name = "hold"
stimulus.sequence = [{ hold = { at = "12 bar", for = "600 ms" } }]
[[teardown]]
name = "release"
stimulus.ramp = { from = "12 bar", to = "4 bar", over = "600 ms" }
"#;

fn start_emulator(name: &str, faults: Faults) -> Emulator {
    let profile = driver(name);
    Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(&profile), faults, false).unwrap()
}

/// `hil run` on the emulator, from the repository's root.
fn hil_run(emulator: &Emulator, name: &str, folder: &tempfile::TempDir) -> Child {
    let plan = folder.path().join("plan.toml");
    std::fs::write(&plan, PLAN).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).arg("run").arg(&plan).args(["--driver", name, "--out"]).arg(folder.path().join("out"));
    match emulator.listening() {
        Listening::Serial(path) => command.arg("--port").arg(path),
        Listening::Tcp(address) => command.args(["--tcp", &address.to_string()]),
    };
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn wait_until(emulator: &Emulator, what: &str, done: impl Fn(&DeviceReport) -> bool) {
    let limit = Instant::now() + Duration::from_secs(20);
    while !done(&emulator.report()) {
        assert!(Instant::now() < limit, "{what}: {:?}", emulator.report());
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn send(child: &Child, signal: Signal) {
    kill_process(Pid::from_child(child), signal).unwrap();
}

/// Ends a run after so many cycles with current, and looks at what the device saw.
fn ended(cycles: u64, signals: &[Signal]) {
    let emulator = start_emulator("emulator-tcp", Faults::none());
    let folder = tempfile::tempdir().unwrap();
    let child = hil_run(&emulator, "emulator-tcp", &folder);
    wait_until(&emulator, "the run did not begin", |r| if cycles == 0 { r.armed } else { r.cycles >= cycles });
    for signal in signals {
        send(&child, *signal);
        std::thread::sleep(Duration::from_millis(5));
    }
    let out = child.wait_with_output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    let what = format!("{signals:?} after {cycles} cycles: {said}");
    if signals == [Signal::KILL] {
        // Nobody is left to write zero: the device's own watchdog must.
        wait_until(&emulator, &what, |r| r.coil_a == 0.0);
        if cycles > 0 {
            assert!(emulator.report().trips >= 2, "{what}");
        }
    } else {
        assert_eq!(out.status.code(), Some(5), "{what}");
        assert!(said.contains("onfirmed"), "{what}");
        assert_eq!(emulator.report().coil_a, 0.0, "{what}");
        assert_eq!(
            emulator.report().trips,
            if cycles == 0 { emulator.report().trips } else { 1 },
            "the host wrote zero, not the watchdog: {what}"
        );
    }
    assert!(!emulator.report().energised_unarmed);
}

fn ended_at_every_phase(signals: &[Signal]) {
    // Start, setup, main, teardown: 30 slots each at 50 Hz.
    for cycles in [0, 10, 45, 75] {
        ended(cycles, signals);
    }
}

#[test]
fn control_c_ends_in_the_safe_state() {
    ended_at_every_phase(&[Signal::INT]);
}

#[test]
fn a_second_control_c_does_not_interrupt_the_safe_state() {
    ended_at_every_phase(&[Signal::INT, Signal::INT]);
}

#[test]
fn sigterm_ends_in_the_safe_state() {
    ended_at_every_phase(&[Signal::TERM]);
}

#[test]
fn sighup_ends_in_the_safe_state() {
    ended_at_every_phase(&[Signal::HUP]);
}

#[test]
fn a_killed_process_leaves_it_to_the_watchdog() {
    ended_at_every_phase(&[Signal::KILL]);
}

#[test]
fn a_dead_line_ends_with_exit_code_4_and_says_so() {
    let script = "schema = \"hil.faults/1\"\n[[fault]]\nkind = \"silent\"\ncycle = 10\ncount = 0\n";
    // Where other work makes a run end before the line dies, it is not the run that is meant.
    for _ in 0..5 {
        let emulator = start_emulator("emulator", Faults::from_toml(script, "dead").unwrap());
        let folder = tempfile::tempdir().unwrap();
        let out = hil_run(&emulator, "emulator", &folder).wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(4), "{said}");
        wait_until(&emulator, "current stays", |r| r.coil_a == 0.0);
        if emulator.report().cycles < 10 {
            continue;
        }
        assert!(said.contains("SAFE STATE NOT CONFIRMED") && said.contains("frame: "), "{said}");
        assert!(folder.path().join("out/record.json").is_file() && folder.path().join("out/frames.txt").is_file());
        return;
    }
    panic!("three samples in a row lost within ten cycles, five times");
}

#[test]
fn a_panic_ends_in_the_safe_state() {
    let emulator = start_emulator("emulator-tcp", Faults::none());
    let control = Arc::new(LoopControl::default());
    let (profile, at, inside) = (driver("emulator-tcp"), endpoint(&emulator), Arc::clone(&control));
    let result: Result<(), _> = loop_thread::run(
        &control,
        move |_| {
            let mut rig = open(&profile, &at, 0.02, Options { control: inside, ..Options::default() }).unwrap();
            for k in 1..=10 {
                rig.step(0.4, f64::from(k) * 0.02).unwrap();
            }
            panic!("on purpose");
        },
        || (),
    );
    let error = result.unwrap_err();
    assert!(error.is_safe(), "{error}");
    assert!((emulator.report().largest_coil_a - 0.4).abs() < 1e-6);
    assert_eq!(emulator.report().coil_a, 0.0);
    // Once at the start, where it is shown; again where the panic's own message took longer than the watchdog allows.
    assert!((1..=2).contains(&emulator.report().trips), "{:?}", emulator.report());
}

#[test]
fn a_current_above_the_stations_limit_never_leaves() {
    let emulator = start_emulator("emulator-tcp", Faults::none());
    let options = Options { current_max_a: Some(0.3), ..Options::default() };
    let mut rig = open(&driver("emulator-tcp"), &endpoint(&emulator), 0.02, options).unwrap();
    rig.step(0.3, 0.02).unwrap();
    assert!(matches!(rig.step(0.3001, 0.04), Err(RigError::Refused(_))));
    assert!(matches!(rig.step(f64::NAN, 0.06), Err(RigError::Refused(_))));
    drop(rig);
    assert!((emulator.report().largest_coil_a - 0.3).abs() < 1e-6);
    assert_eq!(emulator.report().coil_a, 0.0);
}

#[test]
fn a_pressure_above_the_interlock_ends_the_run() {
    let emulator = start_emulator("emulator-tcp", Faults::none());
    let options = Options { pressure_max_bar: Some(10.0), ..Options::default() };
    let mut rig = open(&driver("emulator-tcp"), &endpoint(&emulator), 0.02, options).unwrap();
    let error = (1..200).find_map(|k| rig.step(0.5, f64::from(k) * 0.02).err()).unwrap();
    assert!(matches!(error, RigError::Interlock { .. }), "{error}");
}

#[test]
fn a_current_that_does_not_follow_ends_the_run() {
    // The line reports no set-point back, so only the measured current shows that the device clamps.
    let script = "schema = \"hil.faults/1\"\n[[fault]]\nkind = \"clamped\"\ncycle = 5\ncount = 0\nat = \"100 mA\"\n";
    let emulator = start_emulator("emulator-line", Faults::from_toml(script, "clamped").unwrap());
    let mut rig = rig(&driver("emulator-line"), &emulator, 0.02);
    let error = (1..100).find_map(|k| rig.step(0.4, f64::from(k) * 0.02).err()).unwrap();
    assert!(error.to_string().contains("does not follow"), "{error}");
}

#[test]
fn a_trip_of_the_watchdog_while_the_host_talks_ends_the_run() {
    let emulator = start_emulator("emulator", Faults::once(Kind::WatchdogTrip, 10, 0.0));
    let profile = driver("emulator");
    let mut rig = rig(&profile, &emulator, 0.01);
    let error = (1..100).find_map(|k| rig.step(0.5, f64::from(k) * 0.01).err()).unwrap();
    assert!(error.to_string().contains("watchdog"), "{error}");
}

#[test]
fn nothing_is_written_to_another_device() {
    let profile = driver("emulator-tcp");
    let other = std::fs::read_to_string(format!("{}/drivers/emulator-tcp.toml", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let other = hil::rig::profile::Profile::from_toml(&other.replace("value = 18518", "value = 1"), "other").unwrap();
    let emulator = Emulator::start(Arc::new(other.clone()), simple_valve(), &listen(&other), Faults::none(), false).unwrap();
    let Err(error) = open(&profile, &endpoint(&emulator), 0.02, Options::default()) else { panic!("accepted") };
    assert!(error.to_string().contains("identifies the device"), "{error}");
    assert!(!emulator.report().armed && emulator.report().requests == 1, "{:?}", emulator.report());
}

#[test]
fn messages_say_what_to_do() {
    let message = |name: &str, at: hil::rig::Endpoint| match open(&driver(name), &at, 0.02, Options::default()) {
        Ok(_) => panic!("opened"),
        Err(e) => e.to_string(),
    };
    let serial = |path: &str| hil::rig::Endpoint::Serial(path.into());
    assert!(message("emulator", serial("/dev/no-such-port")).contains("there is no such port"));
    assert!(message("emulator", serial("/dev/null")).contains("is this a serial port?"));
    assert!(message("emulator-tcp", serial("/dev/null")).contains("use --tcp"));
    assert!(message("emulator-tcp", hil::rig::Endpoint::Tcp("127.0.0.1:9".into())).contains("nothing listens there"));
    let emulator = start_emulator("emulator", Faults::none());
    let _holder = rig(&driver("emulator"), &emulator, 0.02);
    assert!(message("emulator", endpoint(&emulator)).contains("another program holds it"));
}
