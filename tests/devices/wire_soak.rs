//! Ten thousand cycles with random faults from a seed: no old sample called good, no hang, no panic, and the safe state
//! confirmed every time.

use std::sync::Arc;

use hil::rig::emulator::{Emulator, Faults, Load};
use hil::rig::profile::Profile;
use hil::rig::{Options, Rig, RigError, open};

use super::wire::{endpoint, listen, run_and_compare};

fn soak(name: &str, timeout: &str, kinds: &str, period_s: f64, wanted: u32) {
    let text = std::fs::read_to_string(format!("{}/drivers/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let text =
        text.replace("timeout = \"6 ms\"", &format!("timeout = \"{timeout}\"")).replace("turnaround = \"0.5 ms\"", "turnaround = \"0 ms\"");
    let mut profile = Profile::from_toml(&text, name).unwrap();
    // The pressure that tells requests apart begins again at zero: a step that is no spike of a sensor.
    profile.interlock.pressure_step_max_bar = None;
    let script = format!("schema = \"hil.faults/1\"\n[random]\nseed = 7\nrate = \"5 %\"\nkinds = [{kinds}]\n");
    let faults = Faults::from_toml(&script, "soak").unwrap();
    let emulator = Emulator::start(Arc::new(profile.clone()), Load::RequestNumber, &listen(&profile), faults, false).unwrap();
    let (mut cycles, mut good, mut runs) = (0, 0, 0);
    while cycles < wanted {
        runs += 1;
        assert!(runs < 4000, "{name}: {cycles} cycles in {runs} runs");
        let mut rig = match open(&profile, &endpoint(&emulator), period_s, Options::default()) {
            Ok(rig) => rig,
            // The start talks over the same bad line.
            Err(RigError::Device { .. } | RigError::Lost { .. } | RigError::Open { .. }) => continue,
            Err(e) => panic!("{name}: {e}"),
        };
        let before = emulator.report().requests;
        let (fresh, error) = run_and_compare(&mut rig, &emulator, &profile, wanted - cycles, period_s);
        cycles += (emulator.report().requests - before) as u32;
        good += fresh;
        if let Some(error) = error {
            assert!(matches!(error, RigError::Lost { .. }), "{name}: {error}");
        }
        let state = rig.make_safe().unwrap();
        assert!(state.confirmed, "{name}: {}", state.evidence);
        // A request that a given-up connection still holds may overtake the last one: then the watchdog acts.
        let until = std::time::Instant::now() + std::time::Duration::from_millis(500);
        while emulator.report().coil_a != 0.0 && std::time::Instant::now() < until {
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        assert_eq!(emulator.report().coil_a, 0.0);
    }
    assert!(good > cycles / 2, "{name}: {good} good of {cycles} in {runs} runs");
}

const PASSING: &str = "\"late\", \"silent\", \"wrong_crc\", \"truncated\", \"garbage\", \"garbage_header\", \"exception\", \"duplicate\", \
    \"echo_only\", \"local_echo\", \"wrong_unit\", \"wrong_function\", \"extra_register\", \"missing_register\", \"previous\"";

#[test]
fn soak_on_a_serial_line() {
    soak("emulator", "5 ms", PASSING, 0.008, 4000);
}

#[test]
fn soak_on_tcp() {
    soak("emulator-tcp", "3 ms", &format!("{PASSING}, \"closed_line\""), 0.006, 6000);
}
