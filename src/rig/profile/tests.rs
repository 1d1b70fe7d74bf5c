//! A profile is right as a whole or refused with the line and the key.

use super::*;

const EMULATOR: &str = include_str!("../../../drivers/emulator.toml");

/// The message for the emulator's profile with one text replaced by another.
fn message(from: &str, to: &str) -> String {
    assert!(EMULATOR.contains(from), "{from}");
    match Profile::from_toml(&EMULATOR.replacen(from, to, 1), "p.toml") {
        Ok(_) => "accepted".into(),
        Err(e) => e.to_string(),
    }
}

fn emulator() -> Profile {
    Profile::from_toml(EMULATOR, "drivers/emulator.toml").unwrap()
}

#[test]
fn the_emulators_own_map_is_sound() {
    let p = emulator();
    assert_eq!(p.role, Role::Driver);
    assert_eq!(p.name, "emulator.toml");
    assert!(p.watchdog.protects() && p.proves_freshness());
    let (_, pressure) = p.signal(SignalName::Pressure).unwrap();
    assert_eq!(pressure.from_raw(12_000.0), 40.0);
    assert!(!pressure.plausible(3599.0) && pressure.plausible(3600.0));
    let (_, setpoint) = p.signal(SignalName::Setpoint).unwrap();
    assert_eq!(setpoint.to_raw(0.65), Some(6500.0));
}

#[test]
fn every_shipped_profile_passes_its_checks() {
    let mut count = 0;
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/drivers")).unwrap() {
        let path = entry.unwrap().path();
        if let Err(e) = Profile::load(&path) {
            panic!("{e}");
        }
        count += 1;
    }
    assert!(count >= 7, "{count}");
}

#[test]
fn the_wire_budget_is_refused_with_its_arithmetic() {
    // 17 + 17 characters: 13 + 2 x 2 written, 5 + 2 x 6 read.
    let slow = EMULATOR.replace("baud = 230400", "baud = 57600");
    let slow = Profile::from_toml(&slow, "p.toml").unwrap();
    insta::assert_snapshot!(slow.check_period(0.01).unwrap_err(), @r"
    a loop of 100.0 Hz needs 99 % of its period of 10.00 ms on the wire; 80 % is the most, so 80.8 Hz:
      transaction 1: function 23, 17 + 17 characters x 10 bit / 57600 baud = 5.90 ms, silence 3.50 ms, answer 0.50 ms
      together 9.90 ms
    ");
    assert_eq!(slow.check_period(0.02), Ok(()));
    assert_eq!(emulator().check_period(0.01), Ok(()));
    insta::assert_snapshot!(emulator().check_period(0.001).unwrap_err(), @"a loop of 1000.0 Hz is faster than the device renews its values: `device.update` is 500.0 Hz");
}

#[test]
fn the_budget_of_published_examples_is_reproduced() {
    // FC23 with 1 register written and 2 read takes 5.58 ms at 115200 8N1; FC06 + FC04(2) 9.86 ms.
    let block = |words| Some(Block { address: 0, words, signals: vec![] });
    let mut p = emulator();
    p.transport.baud = 115_200;
    p.transport.turnaround_s = 0.0;
    let one = |function, write, read| Transaction {
        function,
        unit_id: 1,
        write,
        read,
        freshness: Freshness::None,
        spare: 0,
        step: 1,
        line: None,
    };
    p.cycle.transactions = vec![one(23, block(1), block(2))];
    assert!((p.budget().total_s - 5.583e-3).abs() < 1e-6, "{:?}", p.budget());
    p.cycle.transactions = vec![one(6, block(1), None), one(4, None, block(2))];
    assert!((p.budget().total_s - 9.865e-3).abs() < 1e-6, "{:?}", p.budget());
}

#[test]
fn what_does_not_fit_together_is_refused_with_line_and_key() {
    insta::assert_snapshot!(message("unit = 1", "unit = 0"), @"p.toml:15: `transport.unit`: 0 is reserved: 0 is the broadcast, which no device answers; allowed: 1 to 247");
    insta::assert_snapshot!(message("functions = [3, 6, 16, 23]", "functions = [3, 6, 16]"), @"p.toml:59: `cycle.transaction.function`: transaction 1: function 23 is not among `transport.functions`");
    insta::assert_snapshot!(message("address = 3", "address = 2"), @"p.toml:41: `signal.counter.address`: register 2 also belongs to `status`");
    insta::assert_snapshot!(message("address = 5", "address = 9"), @"p.toml:61: `cycle.transaction.read`: transaction 1: `pressure` is at register 9, but the block goes on at 5: it must be gapless and in order");
    insta::assert_snapshot!(message("freshness = \"echo\"", "freshness = \"transaction-id\""), @"p.toml:62: `cycle.transaction.freshness`: transaction 1: only Modbus TCP has a transaction id; allowed here: echo, quantity, none");
    insta::assert_snapshot!(message("freshness = \"echo\"", "freshness = \"counter\""), @"p.toml:62: `cycle.transaction.freshness`: transaction 1: a late reply carries a counter that was never seen, so on this line a counter alone proves nothing; use echo or quantity, the counter is checked beside it");
    insta::assert_snapshot!(message("scale = \"0.1 mA\"", "scale = \"0.1 bar\""), @"p.toml:26: `signal.setpoint.scale`: `0.1 bar` is not a current: the unit `bar` is of a pressure; allowed: A, mA, uA");
    insta::assert_snapshot!(message("limit = { min = \"0 mA\", max = \"1200 mA\" }", ""), @r#"p.toml:23: `signal.setpoint.limit`: missing: { min = "0 mA", max = ".." }; no current is sent without a limit"#);
    insta::assert_snapshot!(message("max = \"1200 mA\"", "max = \"7 A\""), @"p.toml:27: `signal.setpoint.limit`: `max` = 7 A does not fit the raw type");
    insta::assert_snapshot!(message("ready = false, ", "redy = false, "), @"p.toml:37: `signal.status.fault_when`: no bit `redy`; known: open, ready, short, watchdog");
    insta::assert_snapshot!(message("time = \"200 ms\"", "time = \"2 s\""), @"p.toml:66: `watchdog.time`: a watchdog must act within 500 ms, and its time must be known");
    insta::assert_snapshot!(message("sources = [\"docs/emulator.md\"]", "sources = []"), @"p.toml:8: `device.sources`: name the public text that the map was read from; a map without a source is not used");
    insta::assert_snapshot!(message("confirm = \"current\"", "confirm = \"supply\""), @"p.toml:80: `safe_state.confirm`: `supply` cannot confirm it; allowed: current where the device measures it, otherwise pressure");
    insta::assert_snapshot!(message("raw = [4000, 20000]", "raw = [4000, 4000]"), @"p.toml:49: `signal.pressure.scale`: one count must be worth something: the two points are the same, or the scale is 0");
    insta::assert_snapshot!(message("[\"setpoint\", \"token\", \"status\"", "[\"status\""), @"p.toml:62: `cycle.transaction.freshness`: transaction 1: no `setpoint` or `token` that this slot writes is read back here");
    insta::assert_snapshot!(message("hil.driver/1", "hil.driver/2"), @r#"
    schema: is "hil.driver/2"; a driver profile has "hil.driver/1"
     --> p.toml:3:10
      |
    3 | schema = "hil.driver/2"
      |          ^^^^^^^^^^^^^^
    "#);
}

#[test]
fn an_unknown_key_is_refused_where_it_stands() {
    insta::assert_snapshot!(message("baud = 230400", "bauds = 230400"), @"
    unknown field `bauds`, expected one of `kind`, `unit`, `baud`, `parity`, `stop_bits`, `low_latency`, `local_echo`, `turnaround`, `functions`
      --> p.toml:16:1
       |
    16 | bauds = 230400
       | ^^^^^
       |
       = help: did you mean `baud`?
    ");
}

#[test]
fn a_missing_profile_lists_those_that_are_there() {
    let e = Profile::find("no-such-device").unwrap_err().to_string();
    assert!(e.contains("emulator"), "{e}");
}
