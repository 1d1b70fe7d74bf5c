//! Faults with a number or a course of their own: every exception code, long noise, a clamp behind function 6, a line
//! that is gone.

use std::sync::Arc;
use std::time::{Duration, Instant};

use hil::rig::emulator::{Emulator, Faults, Kind, Load};
use hil::rig::{Rig, RigError};

use super::metronome::in_time;
use super::wire::{driver, faulty, listen, opened, rig, run_and_compare, simple_valve};
use super::wire_variants::quantity;

fn script(faults: &str) -> Faults {
    Faults::from_toml(&format!("schema = \"hil.faults/1\"\n{faults}"), "script").unwrap()
}

fn with_number(kind: &str, number: u8) -> Faults {
    script(&format!("[[fault]]\nkind = \"{kind}\"\ncycle = 10\nnumber = {number}\n"))
}

#[test]
fn noise_longer_than_the_codec_searches_loses_at_most_its_slot() {
    for bytes in [1, 19, 20, 25, 30, 60] {
        faulty(&driver("emulator"), Kind::Garbage, with_number("garbage", bytes), 0.01);
    }
}

#[test]
fn an_exception_that_may_pass_loses_one_sample() {
    for code in [5, 6, 8, 0x55] {
        for name in ["emulator", "emulator-tcp"] {
            faulty(&driver(name), Kind::Exception, with_number("exception", code), 0.01);
        }
    }
}

#[test]
fn an_exception_of_another_function_loses_one_sample() {
    let both = "[[fault]]\nkind = \"exception\"\ncycle = 10\n[[fault]]\nkind = \"wrong_function\"\ncycle = 10\n";
    for name in ["emulator", "emulator-tcp"] {
        faulty(&driver(name), Kind::WrongFunction, script(both), 0.01);
    }
}

#[test]
fn an_exception_that_cannot_pass_ends_the_run_in_the_safe_state() {
    for code in [1, 2, 3, 4, 10, 11] {
        in_time(0.01, || ended_by(code));
    }
}

fn ended_by(code: u8) -> Result<(), String> {
    let profile = driver("emulator-tcp");
    let faults = with_number("exception", code);
    let emulator = Emulator::start(Arc::new(profile.clone()), Load::RequestNumber, &listen(&profile), faults, false).unwrap();
    let mut rig = opened(&profile, &emulator, 0.01)?;
    let (_, error) = run_and_compare(&mut rig, &emulator, &profile, 40, 0.01);
    assert!(rig.make_safe().unwrap().confirmed && emulator.report().coil_a == 0.0, "{code}");
    if matches!(error, Some(RigError::Device { .. })) { Ok(()) } else { Err(format!("{code}: {error:?}")) }
}

#[test]
fn a_clamp_behind_function_6_is_noticed() {
    let clamped = script("[[fault]]\nkind = \"clamped\"\ncycle = 11\ncount = 4\nat = \"100 mA\"\n");
    faulty(&quantity(), Kind::Clamped, clamped, 0.03);
}

#[test]
fn a_port_that_is_gone_ends_the_run_without_a_hang() {
    let profile = driver("emulator");
    let emulator = Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(&profile), Faults::none(), false).unwrap();
    let mut rig = rig(&profile, &emulator, 0.02);
    for k in 1..=5 {
        rig.step(0.3, f64::from(k) * 0.02).unwrap();
    }
    drop(emulator);
    let began = Instant::now();
    let error = (6..100).find_map(|k| rig.step(0.3, f64::from(k) * 0.02).err()).expect("a port that is gone still answers");
    assert!(matches!(error, RigError::Lost { .. }), "{error}");
    let state = rig.make_safe().unwrap();
    assert!(!state.confirmed && state.evidence.contains("watchdog"), "{}", state.evidence);
    assert!(began.elapsed() < Duration::from_secs(10));
}
