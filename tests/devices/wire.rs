//! The driver against the emulator: good days, bad days, and never an old sample called good.

use std::path::Path;
use std::sync::Arc;

use hil::rig::emulator::{Emulator, Faults, Kind, Listen, Listening, Load};
use hil::rig::profile::Profile;
use hil::rig::wire::WireRig;
use hil::rig::{Endpoint, Options, Quality, Rig, RigError, open};

use super::metronome::in_time;

pub fn driver(name: &str) -> Profile {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("drivers").join(format!("{name}.toml"));
    Profile::load(&path).unwrap_or_else(|e| panic!("{e}"))
}

pub fn endpoint(emulator: &Emulator) -> Endpoint {
    match emulator.listening() {
        Listening::Serial(path) => Endpoint::Serial(path.clone()),
        Listening::Tcp(address) => Endpoint::Tcp(address.to_string()),
    }
}

pub fn listen(profile: &Profile) -> Listen {
    use hil::rig::profile::TransportKind;
    match profile.transport.kind {
        TransportKind::Tcp | TransportKind::TcpGateway | TransportKind::RtuOverTcp => Listen::Tcp("127.0.0.1:0".parse().unwrap()),
        _ => Listen::Pty(None),
    }
}

/// A first-order valve of 40 bar/A, in steps of 2 ms.
pub fn simple_valve() -> Load {
    let mut pressure_bar = 0.0;
    let step = move |current_a: f64| {
        pressure_bar += 0.1 * (40.0 * current_a - pressure_bar);
        pressure_bar
    };
    Load::Valve { step: Box::new(step), period_s: 0.002 }
}

pub fn rig(profile: &Profile, emulator: &Emulator, period_s: f64) -> WireRig {
    opened(profile, emulator, period_s).unwrap_or_else(|e| panic!("{e}"))
}

/// The rig, or why it could not be opened: a machine that is late spoils the first replies as well.
pub fn opened(profile: &Profile, emulator: &Emulator, period_s: f64) -> Result<WireRig, String> {
    open(profile, &endpoint(emulator), period_s, Options::default()).map_err(|e| format!("{}: {e}", profile.name))
}

fn round_trip(name: &str) {
    in_time(0.02, || round_trip_once(&driver(name)));
}

fn round_trip_once(profile: &Profile) -> Result<(), String> {
    let emulator = Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(profile), Faults::none(), false).unwrap();
    let mut rig = opened(profile, &emulator, 0.02)?;
    let mut good = 0;
    for k in 1..=50 {
        let sample = rig.step(0.5, f64::from(k) * 0.02).map_err(|e| e.to_string())?;
        if sample.quality == Quality::Good {
            good += 1;
            if k > 30 {
                assert!((sample.pressure_bar - 20.0).abs() < 0.1, "{sample:?}");
                assert!((sample.current_a.unwrap() - 0.5).abs() < 1e-6);
            }
        }
    }
    if good <= 40 {
        return Err(format!("{good} good of 50: {:?}", rig.losses()));
    }
    let state = rig.make_safe().unwrap();
    assert!(state.confirmed, "{}", state.evidence);
    let report = emulator.report();
    assert_eq!(report.coil_a, 0.0);
    assert_eq!(report.largest_coil_a, 0.5);
    assert!(!report.energised_unarmed && report.trips == 1, "armed and seen to trip before the first current: {report:?}");
    Ok(())
}

#[test]
fn a_current_goes_out_and_a_pressure_comes_back_over_a_serial_line() {
    round_trip("emulator");
}

#[test]
fn a_current_goes_out_and_a_pressure_comes_back_over_tcp() {
    round_trip("emulator-tcp");
}

/// Runs `cycles` slots and holds every sample called good against what the device served for that very request.
pub fn run_and_compare(rig: &mut WireRig, emulator: &Emulator, profile: &Profile, cycles: u32, period_s: f64) -> (u32, Option<RigError>) {
    let pressure = profile.signal(hil::rig::profile::SignalName::Pressure).unwrap().1.clone();
    let mut good = 0;
    for k in 1..=cycles {
        // Equal commands in a row too: then only the sequence of the requests tells a reply from the one before.
        let command_a = 0.3 + 0.2 * f64::from(k % 28 / 4) / 7.0;
        let before = emulator.report().requests;
        match rig.step(command_a, f64::from(k) * period_s) {
            Ok(sample) if sample.quality == Quality::Good => {
                good += 1;
                // Measured for a request that the device received in this very slot. It need not be the latest: after a
                // reconnection the device may still work on what came over the old connection.
                let served = emulator.report().served;
                let fresh = served.iter().any(|(n, raw)| *n > before && (pressure.from_raw(*raw) - sample.pressure_bar).abs() < 1e-9);
                assert!(fresh, "cycle {k}: an old sample was called good: {sample:?}, after request {before}: {served:?}");
            }
            Ok(_) => {}
            Err(e) => return (good, Some(e)),
        }
    }
    (good, None)
}

fn fault(name: &str, kind: Kind, by_s: f64) {
    faulty(&driver(name), kind, Faults::once(kind, 10, by_s), 0.01);
}

pub fn faulty(profile: &Profile, kind: Kind, faults: Faults, period_s: f64) {
    in_time(period_s, || faulty_once(profile, kind, faults.clone(), period_s));
}

fn faulty_once(profile: &Profile, kind: Kind, faults: Faults, period_s: f64) -> Result<(), String> {
    let emulator = Emulator::start(Arc::new(profile.clone()), Load::RequestNumber, &listen(profile), faults, false).unwrap();
    // Some faults cost three samples in a row; that this ends a run is tested elsewhere.
    let mut profile = profile.clone();
    profile.interlock.lost_max = 10;
    let mut rig = opened(&profile, &emulator, period_s)?;
    let (good, error) = run_and_compare(&mut rig, &emulator, &profile, 40, period_s);
    let state = rig.make_safe().unwrap();
    assert!(state.confirmed, "{kind:?}: {}", state.evidence);
    assert_eq!(emulator.report().coil_a, 0.0);
    if let Some(error) = error {
        return Err(format!("{kind:?}: {error:?}"));
    }
    let (losses, _) = rig.losses();
    let lost = losses.lost + losses.stale + losses.exceptions + losses.implausible;
    // Bytes before a reply and a late duplicate need not cost a sample; everything else must.
    let line = profile.transport.kind == hil::rig::profile::TransportKind::Line;
    let harmless = match kind {
        Kind::Garbage | Kind::Duplicate | Kind::LocalEcho | Kind::Gap => true,
        // Text has neither units nor registers, and a late line in the same slot is a reply in time.
        Kind::ExtraRegister | Kind::MissingRegister => line,
        _ => false,
    };
    assert!(harmless || lost >= 1, "{kind:?}: no sample was lost");
    if good < 25 { Err(format!("{kind:?}: {good} good of 40, {losses:?}")) } else { Ok(()) }
}

#[test]
fn a_clamped_set_point_is_noticed() {
    let script = "schema = \"hil.faults/1\"\n[[fault]]\nkind = \"clamped\"\ncycle = 10\ncount = 2\nat = \"0.1 A\"\n";
    faulty(&driver("emulator"), Kind::Clamped, Faults::from_toml(script, "clamped").unwrap(), 0.01);
}

#[test]
fn a_frozen_sensor_is_noticed() {
    // The first frozen reply still holds the present value; from the second on the counter has not moved.
    let script = "schema = \"hil.faults/1\"\n[[fault]]\nkind = \"frozen_sensor\"\ncycle = 10\ncount = 3\n";
    let profile = driver("emulator");
    let faults = Faults::from_toml(script, "frozen").unwrap();
    let emulator = Emulator::start(Arc::new(profile.clone()), Load::RequestNumber, &listen(&profile), faults, false).unwrap();
    let mut rig = rig(&profile, &emulator, 0.01);
    run_and_compare(&mut rig, &emulator, &profile, 40, 0.01);
    assert!(rig.losses().0.stale >= 2, "{:?}", rig.losses());
}

macro_rules! faults {
    ($($test:ident $driver:literal $kind:ident $by_s:literal;)+) => { $(#[test] fn $test() { fault($driver, Kind::$kind, $by_s); })+ };
}

faults! {
    a_late_reply_is_not_taken_for_the_next_one "emulator" Late 0.008;
    a_reply_later_than_a_slot_is_not_taken_for_the_next_one "emulator" Late 0.011;
    a_reply_later_than_two_slots_is_not_taken_for_a_later_one "emulator" Late 0.018;
    silence_loses_one_sample "emulator" Silent 0.0;
    a_wrong_crc_loses_one_sample "emulator" WrongCrc 0.0;
    a_truncated_reply_loses_one_sample "emulator" Truncated 0.0;
    garbage_before_a_reply_does_no_harm "emulator" Garbage 0.0;
    garbage_like_a_header_loses_one_sample "emulator" GarbageHeader 0.0;
    an_exception_loses_one_sample "emulator" Exception 0.0;
    a_duplicate_is_not_taken_for_the_next_reply "emulator" Duplicate 0.003;
    a_duplicate_in_the_next_slot_is_not_taken_for_its_reply "emulator" Duplicate 0.0105;
    the_own_request_is_not_a_reply "emulator" EchoOnly 0.0;
    an_echo_before_the_reply_loses_one_sample "emulator" LocalEcho 0.0;
    the_reply_of_another_unit_is_refused "emulator" WrongUnit 0.0;
    the_reply_to_another_function_is_refused "emulator" WrongFunction 0.0;
    a_reply_with_a_register_too_many_is_refused "emulator" ExtraRegister 0.0;
    a_reply_with_a_register_too_few_is_refused "emulator" MissingRegister 0.0;
    the_reply_before_is_refused "emulator" Previous 0.0;
    a_broken_wire_is_noticed "emulator" WireBreak 0.0;
    a_broken_sensor_is_noticed "emulator" SensorBreak 0.0;
    late_on_tcp "emulator-tcp" Late 0.011;
    silent_on_tcp "emulator-tcp" Silent 0.0;
    wrong_header_on_tcp "emulator-tcp" WrongCrc 0.0;
    truncated_on_tcp "emulator-tcp" Truncated 0.0;
    noise_on_tcp "emulator-tcp" Garbage 0.0;
    a_gap_in_a_reply_does_no_harm "emulator" Gap 0.002;
    a_gap_on_tcp "emulator-tcp" Gap 0.002;
    a_gap_longer_than_a_slot_is_not_joined_with_the_next_reply "emulator" Gap 0.0105;
    garbage_on_tcp "emulator-tcp" GarbageHeader 0.0;
    exception_on_tcp "emulator-tcp" Exception 0.0;
    duplicate_on_tcp "emulator-tcp" Duplicate 0.003;
    wrong_unit_on_tcp "emulator-tcp" WrongUnit 0.0;
    wrong_function_on_tcp "emulator-tcp" WrongFunction 0.0;
    extra_register_on_tcp "emulator-tcp" ExtraRegister 0.0;
    missing_register_on_tcp "emulator-tcp" MissingRegister 0.0;
    previous_on_tcp "emulator-tcp" Previous 0.0;
    closed_on_tcp "emulator-tcp" ClosedLine 0.0;
}
