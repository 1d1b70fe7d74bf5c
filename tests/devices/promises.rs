//! What is promised of the wire, each against a device that breaks it: fresh samples, a watchdog that stays armed, a
//! safe state that was seen, one master, no blind current.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use hil::rig::profile::Profile;
use hil::rig::wire::WireRig;
use hil::rig::{Options, Quality, Rig, RigError, open};

use super::fake::{COUNTER, CURRENT, Fake, PRESSURE};
use super::wire::driver;

const PERIOD_S: f64 = 0.01;

fn text(name: &str) -> String {
    std::fs::read_to_string(format!("{}/drivers/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn profile(text: &str) -> Profile {
    Profile::from_toml(text, "test.toml").unwrap_or_else(|e| panic!("{e}"))
}

fn refused(text: &str) -> String {
    Profile::from_toml(text, "test.toml").unwrap_err().to_string()
}

/// A rig that bears with a machine that is busy with other tests; that losses in a row end a run is tested elsewhere.
fn rig(profile: &Profile, device: &Fake) -> WireRig {
    let mut profile = profile.clone();
    profile.interlock.lost_max = 40;
    strict(&profile, device)
}

fn strict(profile: &Profile, device: &Fake) -> WireRig {
    open(profile, &device.endpoint(), PERIOD_S, Options::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// Steps with a current until an error or so many slots; the qualities, and the error with the time at which it came.
fn drive(rig: &mut WireRig, slots: u32, current_a: f64) -> (Vec<Quality>, Option<(f64, RigError)>) {
    let mut seen = Vec::new();
    for k in 1..=slots {
        match rig.step(current_a, f64::from(k) * PERIOD_S) {
            Ok(sample) => seen.push(sample.quality),
            Err(error) => return (seen, Some((f64::from(k) * PERIOD_S, error))),
        }
    }
    (seen, None)
}

/// The device restarts in mid-run and forgets its watchdog; it answers everything else as before.
#[test]
fn a_device_that_forgets_its_watchdog_ends_the_run_within_a_second() {
    let p = driver("emulator-tcp");
    let slots = AtomicU64::new(0);
    let device = Fake::start(&p, move |turn| {
        let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
        // From the 130th slot on, register 16 holds no time.
        if n > 130 && turn.request[..3] == [3, 0, 16] {
            turn.reply = Some(vec![3, 2, 0, 0]);
        }
    });
    let mut rig = rig(&p, &device);
    let (seen, ended) = drive(&mut rig, 400, 0.3);
    let (_, error) = ended.expect("the run went on");
    assert!(error.to_string().contains("not armed any more"), "{error}");
    assert!(seen.len() <= 130 + 110, "after {} slots", seen.len());
    assert!(rig.make_safe().unwrap().confirmed);
    assert_eq!(device.coil_a(), 0.0);
}

#[test]
fn a_watchdog_that_is_forgotten_at_the_very_end_is_told_at_the_end() {
    let p = driver("emulator-tcp");
    let forgets = Arc::new(AtomicU64::new(0));
    let inside = Arc::clone(&forgets);
    let device = Fake::start(&p, move |turn| {
        if inside.load(Ordering::Relaxed) > 0 && turn.request[..3] == [3, 0, 16] {
            turn.reply = Some(vec![3, 2, 0, 0]);
        }
    });
    let mut rig = rig(&p, &device);
    assert!(drive(&mut rig, 20, 0.3).1.is_none());
    forgets.store(1, Ordering::Relaxed);
    let state = rig.make_safe().unwrap();
    assert!(state.confirmed && state.fault.as_ref().is_some_and(|f| f.contains("at the end")), "{state:?}");
}

/// After a new connection the watchdog is shown again at once: the device may be another one since.
#[test]
fn a_reconnection_proves_the_watchdog_anew() {
    let p = driver("emulator-tcp");
    let slots = AtomicU64::new(0);
    let device = Fake::start(&p, move |turn| {
        let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
        turn.close = turn.is_slot() && n == 70;
        if n > 70 && turn.request[..3] == [3, 0, 16] {
            turn.reply = Some(vec![3, 2, 0, 0]);
        }
    });
    let mut rig = rig(&p, &device);
    let (seen, ended) = drive(&mut rig, 400, 0.3);
    let (_, error) = ended.expect("the run went on");
    assert!(error.to_string().contains("not armed any more"), "{error}");
    assert!(seen.len() < 80, "after {} slots", seen.len());
}

/// Counters that run backwards, stand, jump, or run late; each made differ from the last one, which was enough once.
#[test]
fn a_counter_must_move_forwards_by_what_the_time_allows() {
    type Change = fn(u16, u64) -> u16;
    let kinds: [(&str, Change); 4] = [
        ("backwards", |c, n| c.wrapping_sub((10 * n) as u16)),
        ("stands", |_, _| 77),
        ("jumps", |c, n| c.wrapping_add((3000 * (1 + n % 6)) as u16)),
        ("late by three slots", |c, _| c.wrapping_sub(15)),
    ];
    for (what, change) in kinds {
        let p = driver("emulator-tcp");
        let slots = AtomicU64::new(0);
        let device = Fake::start(&p, move |turn| {
            let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
            if turn.is_slot() && n > 60 {
                let counter = change(turn.word(COUNTER), n);
                turn.put_word(COUNTER, counter);
            }
        });
        let mut rig = rig(&p, &device);
        let (seen, ended) = drive(&mut rig, 120, 0.3);
        let (_, error) = ended.unwrap_or_else(|| panic!("{what}: accepted"));
        assert!(matches!(error, RigError::Lost { .. }), "{what}: {error}");
        assert!(seen.len() > 60 && seen.iter().skip(62).all(|q| *q != Quality::Good), "{what}: {seen:?}");
    }
}

/// A gateway gives back the id of every request, with a reply of its unit from three slots before.
#[test]
fn a_gateway_with_a_late_unit_gives_no_fresh_sample() {
    let claims = text("emulator-tcp")
        .replace("kind = \"tcp\"", "kind = \"tcp-gateway\"")
        .replace("freshness = \"echo\"", "freshness = \"transaction-id\"");
    assert!(refused(&claims).contains("the transaction id is that of the gateway"));
    let late = |text: &str| {
        let p = profile(text);
        let mut queue: Vec<(f64, Vec<u8>)> = Vec::new();
        let slots = AtomicU64::new(0);
        let device = Fake::start(&p, move |turn| {
            if !turn.is_slot() {
                return;
            }
            let n = slots.fetch_add(1, Ordering::Relaxed);
            queue.extend(turn.reply.clone().map(|pdu| (turn.now_s, pdu)));
            if n > 60 {
                turn.reply = queue.iter().rfind(|(at_s, _)| *at_s < turn.now_s - 0.025).map(|(_, pdu)| pdu.clone());
            }
        });
        let mut rig = rig(&p, &device);
        let (seen, ended) = drive(&mut rig, 120, 0.3);
        assert!(ended.is_some(), "280 samples of another time were good once");
        assert!(seen.iter().skip(62).all(|q| *q != Quality::Good), "{seen:?}");
    };
    let gateway = text("emulator-tcp").replace("kind = \"tcp\"", "kind = \"tcp-gateway\"");
    late(&gateway);
    // A counter alone: the reply three slots ago has a token of its own, which then proves nothing.
    late(&gateway.replace("freshness = \"echo\"", "freshness = \"counter\""));
}

/// A reply to a request of the last connection comes over the new one, before anything else.
#[test]
fn an_old_reply_on_a_new_connection_finds_no_request() {
    // Without a token nothing but the id tells it; without a counter nothing but the id proves it.
    let plain = text("emulator-tcp")
        .replace("freshness = \"echo\"", "freshness = \"transaction-id\"")
        .replace("write = [\"setpoint\", \"token\"]", "write = [\"setpoint\"]")
        .replace("[\"setpoint\", \"token\", \"status\", \"counter\", \"current\", \"pressure\"]", "[\"current\", \"pressure\"]")
        .replace("[signal.token]\ntable = \"holding\"\naddress = 2\n", "")
        .replace("[signal.counter]\ntable = \"holding\"\naddress = 4\n", "")
        .replace("valid = [\"-5 bar\", \"80 bar\"]", "valid = [\"-5 bar\", \"80 bar\"]\nfrozen_after = \"10 s\"");
    let start = plain.find("[signal.status]").unwrap();
    let end = plain.find("[signal.current]").unwrap();
    let p = profile(&format!("{}{}", &plain[..start], &plain[end..]));
    let slots = AtomicU64::new(0);
    let mut old: Vec<(u16, Vec<u8>)> = Vec::new();
    let ids = Arc::new(std::sync::Mutex::new(Vec::new()));
    let seen_ids = Arc::clone(&ids);
    let device = Fake::start(&p, move |turn| {
        if !turn.is_slot() {
            return;
        }
        let n = slots.fetch_add(1, Ordering::Relaxed);
        seen_ids.lock().unwrap().push(turn.id);
        if n < 40 {
            old.extend(turn.reply.clone().map(|pdu| (turn.id, pdu)));
        }
        turn.close = n == 40;
        if n > 40 {
            // Every old reply there ever was, with 99 bar in it, in the hope that one has the id of this request.
            turn.before = old.iter().map(|(id, pdu)| turn.frame(*id, pdu)).collect();
            for frame in &mut turn.before {
                let at = frame.len() - 4;
                frame[at..].copy_from_slice(&55.0f32.to_bits().to_be_bytes());
            }
        }
    });
    let mut rig = open(&p, &device.endpoint(), PERIOD_S, Options::default()).unwrap();
    for k in 1..=80u32 {
        match rig.step(0.1, f64::from(k) * PERIOD_S) {
            Ok(sample) => assert!(sample.quality != Quality::Good || sample.pressure_bar < 30.0, "slot {k}: {sample:?}"),
            Err(RigError::Lost { .. }) => break,
            Err(error) => panic!("{error}"),
        }
    }
    let ids = ids.lock().unwrap();
    let (first, second) = ids.split_at(41);
    assert!(!second.is_empty() && second.iter().all(|id| !first.contains(id)), "{first:?} then {second:?}");
}

/// Where only the quantity or a digit of the set-point tells four requests apart, more losses in a row are not tolerated.
#[test]
fn lost_max_is_no_more_than_the_freshness_rule_can_tell_apart() {
    let many =
        |name: &str, from: &str, to: &str| Profile::from_toml(&text(name).replace(from, to), "x").map(drop).map_err(|e| e.to_string());
    let quantity = many("waveshare-ao-ai", "pressure_max = \"50 bar\"", "pressure_max = \"50 bar\"\nlost_max = 12");
    assert!(quantity.unwrap_err().contains("repeats every 4 requests"));
    assert!(many("waveshare-ao-ai", "pressure_max = \"50 bar\"", "pressure_max = \"50 bar\"\nlost_max = 4").is_ok());
    assert!(many("emulator-tcp", "lost_max = 3", "lost_max = 12").is_ok(), "a token tells 65535 requests apart");
}

#[test]
fn a_device_that_may_repeat_its_last_value_needs_frozen_after() {
    let frozen = |name: &str, line: &str| Profile::from_toml(&text(name).replace(line, ""), "x").map(drop).map_err(|e| e.to_string());
    for (name, line) in [
        ("waveshare-ao-ai", "frozen_after = \"1 s\"\n"),
        ("beckhoff-kl2535", "frozen_after = \"500 ms\"\n"),
        ("keller-33x", "frozen_after = \"1 s\"\n"),
    ] {
        assert!(frozen(name, line).unwrap_err().contains("frozen_after"), "{name}");
    }
}

/// The coil reads -0.8 A after zero was written: that is below 20 mA, and no safe state.
#[test]
fn a_safe_state_is_confirmed_by_magnitude_and_by_a_number() {
    for shown in [-0.8f32, f32::NAN, f32::INFINITY, 0.5] {
        let p = profile(&text("emulator-tcp").replace("valid = [\"0 mA\", \"1300 mA\"]", ""));
        let broken = Arc::new(AtomicU64::new(0));
        let inside = Arc::clone(&broken);
        let device = Fake::start(&p, move |turn| {
            if turn.is_slot() && inside.load(Ordering::Relaxed) > 0 {
                turn.put_float(CURRENT, shown);
            }
        });
        let mut rig = rig(&p, &device);
        let _ = drive(&mut rig, 20, 0.0);
        broken.store(1, Ordering::Relaxed);
        let state = rig.make_safe().unwrap();
        assert!(!state.confirmed, "{shown}: {}", state.evidence);
        assert!(state.evidence.contains("watchdog must have acted"), "{}", state.evidence);
        assert!(state.within_s.is_some_and(|s| s > 0.2 + 0.25), "the silence for the watchdog: {state:?}");
    }
}

/// A device that hears, but holds its current: only silence lets its watchdog act, and that is seen.
#[test]
fn silence_lets_the_watchdog_act_where_the_device_does_not_obey() {
    let p = driver("emulator-tcp");
    let stuck = Arc::new(AtomicU64::new(0));
    let inside = Arc::clone(&stuck);
    let mut last_s = 0.0;
    let device = Fake::start(&p, move |turn| {
        let silent_s = turn.now_s - last_s;
        last_s = turn.now_s;
        if inside.load(Ordering::Relaxed) > 0 && turn.is_slot() {
            if silent_s > 0.2 {
                inside.store(0, Ordering::Relaxed);
            } else {
                turn.put_float(CURRENT, 0.3);
            }
        }
    });
    let mut rig = rig(&p, &device);
    assert!(drive(&mut rig, 20, 0.3).1.is_none());
    stuck.store(1, Ordering::Relaxed);
    let state = rig.make_safe().unwrap();
    assert!(state.confirmed && state.evidence.contains("ms of silence"), "{state:?}");
}

/// The last set-point of the run was held on its way, and reaches the device behind the first zero.
#[test]
fn after_losses_on_tcp_zero_is_confirmed_twice() {
    let mut once = 0;
    // Where other work makes the machine lose samples of its own, the clean line is tried again.
    for lost in [true, false, false, false, false] {
        if once > 0 {
            break;
        }
        let p = driver("emulator-tcp");
        let slots = AtomicU64::new(0);
        let device = Fake::start(&p, move |turn| {
            let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
            // One slot gets no answer; the device hears of it again when all is thought to be over.
            if lost && turn.is_slot() && turn.request.get(10..14).is_some_and(|bytes| bytes != [0; 4]) && n == 42 {
                turn.later.push((0.06, turn.request.clone()));
                turn.reply = None;
            }
        });
        let mut rig = rig(&p, &device);
        let mut k = 0;
        let quality = loop {
            k += 1;
            let quality = rig.step(0.3, f64::from(k) * PERIOD_S).unwrap().quality;
            if quality != Quality::Good || k >= 60 {
                break quality;
            }
        };
        assert!(quality != Quality::Good || !lost, "slot {k}");
        let state = rig.make_safe().unwrap();
        assert!(state.confirmed, "{state:?}");
        assert!(state.within_s.unwrap() >= 0.1 || !lost, "{state:?}");
        // A first look may come before the device has measured anew; the second look after that is no second zero.
        once += usize::from(!lost && state.within_s.unwrap() < 0.1);
        // Well within the watchdog's time: it is the second zero that took the current away.
        for _ in 0..20 {
            assert_eq!(device.coil_a(), 0.0, "{state:?}");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }
    assert!(once > 0, "a line that lost nothing is not looked at twice");
}

/// Zero was read once after losses, and then never again: that confirms nothing, and is told in bounded time.
#[test]
fn a_zero_that_is_not_seen_again_confirms_nothing() {
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let p = driver("emulator-tcp");
        let (currents, zeros) = (AtomicU64::new(0), AtomicU64::new(0));
        let device = Fake::start(&p, move |turn| {
            let current = turn.is_slot() && turn.request.get(10..14).is_some_and(|bytes| bytes != [0; 4]);
            let after = currents.fetch_add(u64::from(current), Ordering::Relaxed) + u64::from(current);
            let zero = turn.is_slot() && !current && after > 20;
            // The 20th current gets no answer, the first zero at the end does, and nothing behind it.
            if (after == 20 && current) || (zero && zeros.fetch_add(1, Ordering::Relaxed) > 0) {
                turn.reply = None;
            }
        });
        let mut rig = rig(&p, &device);
        let _ = drive(&mut rig, 25, 0.3);
        // The device has measured anew by the first look.
        std::thread::sleep(std::time::Duration::from_millis(10));
        let _ = tell.send(rig.make_safe().unwrap());
    });
    let state = told.recv_timeout(std::time::Duration::from_secs(20)).expect("it never ended");
    assert!(!state.confirmed, "{state:?}");
}

#[test]
fn a_sample_without_a_pressure_is_not_good() {
    let p = profile(&text("emulator-tcp").replace("valid = [\"-5 bar\", \"80 bar\"]", ""));
    let slots = AtomicU64::new(0);
    let device = Fake::start(&p, move |turn| {
        let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
        // Where other work makes the loop miss one, another comes.
        if turn.is_slot() && n >= 30 && n.is_multiple_of(4) {
            turn.put_float(PRESSURE, f32::NAN);
        }
    });
    let mut rig = rig(&p, &device);
    let (seen, ended) = drive(&mut rig, 100, 0.3);
    let implausible = seen.iter().filter(|q| **q == Quality::Implausible).count();
    assert!(ended.is_none() && (1..=20).contains(&implausible), "{seen:?}");
}

#[test]
fn a_pressure_source_without_a_pressure_is_refused() {
    let p = driver("emulator-tcp");
    let device = Fake::start(&p, |_| ());
    let wago = driver("wago-750-632");
    let options = Options { pressure_source: Some((wago, hil::rig::Endpoint::Tcp("127.0.0.1:9".into()))), ..Options::default() };
    let Err(error) = open(&p, &device.endpoint(), PERIOD_S, options) else { panic!("accepted") };
    assert!(error.to_string().contains("no pressure source"), "{error}");
}

/// One sample jumps by more than half of what the bench may see; no interlock of the profile names a rate.
#[test]
fn a_single_spike_of_the_sensor_ends_the_run_by_default() {
    let p = driver("emulator-tcp");
    let slots = AtomicU64::new(0);
    let device = Fake::start(&p, move |turn| {
        let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
        // Where other work makes the loop miss one, another comes.
        if turn.is_slot() && n >= 50 && n.is_multiple_of(10) {
            turn.put_float(PRESSURE, 60.0);
        }
    });
    let mut rig = rig(&p, &device);
    let error = drive(&mut rig, 200, 0.1).1.expect("a spike went by").1;
    assert!(error.to_string().contains("step of pressure"), "{error}");
}

/// What the profile of a driver allows to be measured, whatever the plan says: each limit ends the run on its own.
#[test]
fn every_interlock_of_a_profile_ends_the_run_on_its_own() {
    type Change = fn(&mut super::fake::Turn<'_>, u64);
    let kinds: [(&str, Change, &str); 4] = [
        ("pressure_max = \"20 bar\"", |turn, _| turn.put_float(PRESSURE, 20.5), "pressure 20.500 bar above"),
        ("pressure_max = \"70 bar\"\ncurrent_max = \"400 mA\"", |turn, _| turn.put_float(CURRENT, 0.41), "measured current"),
        ("pressure_max = \"70 bar\"\ncurrent_max = \"400 mA\"", |turn, _| turn.put_float(CURRENT, -0.41), "measured current"),
        // 2 bar in each slot: 200 bar/s, far below half of what the bench may see.
        (
            "pressure_max = \"70 bar\"\npressure_rate_max = \"150 bar/s\"",
            |turn, n| turn.put_float(PRESSURE, 12.0 + 2.0 * (n % 10) as f32),
            "rate of pressure",
        ),
    ];
    for (limits, change, what) in kinds {
        let without = text("emulator-tcp")
            .replace("pressure_max = \"70 bar\"\ncurrent_max = \"1250 mA\"\n", "")
            .replace("valid = [\"0 mA\", \"1300 mA\"]", "valid = [\"-1300 mA\", \"1300 mA\"]")
            .replace("current_deviation = \"50 mA\"\ncurrent_deviation_for = \"100 ms\"\n", "");
        for with in [true, false] {
            let limits = if with { limits } else { "pressure_max = \"70 bar\"" };
            let p = profile(&without.replace("[interlock]", &format!("[interlock]\n{limits}")));
            let slots = AtomicU64::new(0);
            let device = Fake::start(&p, move |turn| {
                let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
                if turn.is_slot() && n >= 50 {
                    change(turn, n);
                }
            });
            let mut rig = rig(&p, &device);
            let ended = drive(&mut rig, 120, 0.3).1;
            match (with, ended) {
                (true, Some((_, error))) => {
                    assert!(matches!(error, RigError::Interlock { .. }) && error.to_string().contains(what), "{limits}: {error}");
                }
                (true, None) => panic!("{limits}: went by"),
                (false, ended) => assert!(!matches!(ended, Some((_, RigError::Interlock { .. }))), "{what}: {ended:?}"),
            }
            assert!(rig.make_safe().unwrap().current_a.is_none_or(|a| a.abs() <= 0.41));
        }
    }
}

/// A driver that can turn its current round: the station's limit holds for both signs.
#[test]
fn the_largest_current_of_a_station_holds_for_both_signs() {
    let both = text("emulator-tcp")
        .replace("limit = { min = \"0 mA\"", "limit = { min = \"-1200 mA\"")
        .replace("valid = [\"0 mA\", \"1300 mA\"]", "valid = [\"-1300 mA\", \"1300 mA\"]");
    let p = profile(&both);
    for current_a in [0.31f64, -0.31] {
        let device = Fake::start(&p, |_| ());
        let options = Options { current_max_a: Some(0.3), ..Options::default() };
        let mut rig = open(&p, &device.endpoint(), PERIOD_S, options).unwrap_or_else(|e| panic!("{e}"));
        assert!(rig.step(current_a.signum() * 0.29, PERIOD_S).is_ok(), "{current_a}");
        assert!(matches!(rig.step(current_a, 2.0 * PERIOD_S), Err(RigError::Refused(_))), "{current_a}");
    }
}

#[test]
fn a_current_that_changes_faster_than_the_driver_may_is_not_sent() {
    let p = profile(&text("emulator-tcp").replace("max = \"1200 mA\" }", "max = \"1200 mA\", slew = \"5 A/s\" }"));
    let device = Fake::start(&p, |_| ());
    let mut rig = rig(&p, &device);
    rig.step(0.05, PERIOD_S).unwrap();
    assert!(matches!(rig.step(0.2, 2.0 * PERIOD_S), Err(RigError::Slew { .. })));
    drop(rig);
    assert_eq!(device.coil_a(), 0.0);
}

/// Somebody else writes set-points at the same pace: neither a bad line, nor a bad valve.
#[test]
fn another_master_on_the_same_device_is_told() {
    let p = driver("emulator-tcp");
    let slots = AtomicU64::new(0);
    let device = Fake::start(&p, move |turn| {
        let n = slots.fetch_add(u64::from(turn.is_slot()), Ordering::Relaxed);
        if turn.is_slot() && n > 60 {
            // Right behind each of our requests: 0.2 A, with a token of its own.
            let now_s = turn.now_s;
            let mut other = vec![16, 0, 0, 0, 3, 6];
            other.extend(0.2f32.to_bits().to_be_bytes());
            other.extend([0x12, 0x34]);
            turn.device.execute(now_s, 1, &other);
        }
    });
    let mut rig = rig(&p, &device);
    let (seen, ended) = drive(&mut rig, 300, 0.3);
    let error = ended.expect("two masters, and nobody said so").1;
    assert!(error.to_string().contains("another master"), "{error}");
    assert!(seen.len() < 60 + 110, "after {} slots", seen.len());
}

/// What a lost connection or a gateway carries out late is a bad line, however often it happens: nobody else writes.
#[test]
fn a_late_write_of_our_own_is_no_other_master() {
    let p = driver("emulator-tcp");
    let late = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&late);
    let slots = std::sync::Mutex::new(Vec::<Vec<u8>>::new());
    let device = Fake::start(&p, move |turn| {
        let mut slots = slots.lock().unwrap();
        if turn.is_slot() {
            slots.push(turn.request.clone());
        } else if slots.len() > 60 && turn.request[..3] == [3, 0, 0] {
            // The write of three slots ago arrives right before the question what the registers hold.
            let old = slots[slots.len() - 3].clone();
            turn.device.execute(turn.now_s, 1, &old);
            turn.reply = turn.device.execute(turn.now_s, 1, &turn.request);
            count.fetch_add(1, Ordering::Relaxed);
        }
    });
    let mut rig = rig(&p, &device);
    let mut seen = Vec::new();
    for k in 1..=300 {
        let sample = rig.step(0.2 + 0.001 * f64::from(k % 50), f64::from(k) * PERIOD_S).unwrap_or_else(|e| panic!("{e}"));
        seen.push(sample.quality);
    }
    assert!(late.load(Ordering::Relaxed) > 0, "never asked");
    assert!(seen.iter().filter(|q| **q == Quality::Good).count() > 200, "{seen:?}");
}

#[test]
fn a_second_program_on_the_same_device_is_refused() {
    let p = driver("emulator-tcp");
    let device = Fake::start(&p, |_| ());
    let held = rig(&p, &device);
    let Err(error) = open(&p, &device.endpoint(), PERIOD_S, Options::default()) else { panic!("accepted") };
    assert!(error.to_string().contains("another program of this machine"), "{error}");
    drop(held);
    drop(rig(&p, &device));
}
