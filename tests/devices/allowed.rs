//! What a station may send and bear: every command that moves a valve holds the largest current and the largest pressure that
//! the command line and the station file name, whatever plan and profile allow.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use hil::rig::emulator::{DeviceReport, Emulator, Faults, Listening};

use super::metronome::BUSY;
use super::wire::{driver, listen, simple_valve};

/// 300 mA, which gives 12 bar.
const PLAN: &str = r#"
schema = "hil.plan/1"
name = "allowed"
rate = "50 Hz"
[[phase]]
name = "hold"
stimulus.hold = { at = "300 mA", for = "400 ms" }
measure = [{ metric.max_pressure = {} }]
"#;

struct Seen {
    code: i32,
    said: String,
    device: DeviceReport,
}

/// A command line on an emulator of its own; `station` stands in the station file.
fn hil(folder: &Path, line: &str, station: &str) -> Seen {
    let master = "[master]\nmax_age = \"8 h\"\n[[master.valve]]\nserial = \"GOOD\"\nexpect = \"pass\"\n";
    let bench = format!("schema = \"hil.station/1\"\nid = \"b\"\n{station}\n");
    for (name, text) in [
        ("plan.toml", format!("{BUSY}{PLAN}")),
        ("station.toml", bench.clone()),
        ("masters.toml", bench + master),
        ("lot.csv", "serial\nA-1\n".into()),
    ] {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let mut profile = driver("emulator-tcp");
    profile.interlock.lost_max = 10;
    let emulator = Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(&profile), Faults::none(), false).unwrap();
    let Listening::Tcp(address) = emulator.listening() else { panic!("TCP") };
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil"));
    command.current_dir(folder).args(line.split(' ').map(|word| word.replace('_', " ").replace('\u{1}', "_")));
    let out = command.args(["--driver", "emulator-tcp", "--tcp", &address.to_string()]).stdin(Stdio::null()).output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    Seen { code: out.status.code().unwrap_or(-1), said, device: emulator.report() }
}

/// Each command with the limit on its command line, in its station file, and the larger one in the other place.
fn lines(option: &str, key: &str, small: &str, large: &str) -> Vec<(String, String)> {
    let (small_option, large_option) = (format!("{option} {}", small.replace(' ', "_")), format!("{option} {}", large.replace(' ', "_")));
    let (in_file, large_in_file) = (format!("{key} = \"{small}\""), format!("{key} = \"{large}\""));
    let batch = "batch plan.toml --duts lot.csv --station station.toml --out out";
    let master = "master plan.toml --station masters.toml --serial GOOD";
    let msa = "msa plan.toml --metric hold/max_pressure --parts 2 --appraisers 2 --trials 2".replace('_', "\u{1}");
    vec![
        (format!("run plan.toml --out out {small_option}"), String::new()),
        (format!("batch plan.toml --duts lot.csv --out out {small_option}"), String::new()),
        (format!("{batch} {small_option}"), large_in_file.clone()),
        (batch.into(), in_file.clone()),
        (format!("{batch} {large_option}"), in_file.clone()),
        (format!("{master} {small_option}"), large_in_file),
        (master.into(), in_file),
        (format!("{msa} {small_option}"), String::new()),
    ]
}

fn each(option: &str, key: &str, small: &str, large: &str, holds: impl Fn(&str, &Seen) + Sync) {
    let lines = lines(option, key, small, large);
    std::thread::scope(|scope| {
        for some in lines.chunks(2) {
            let holds = &holds;
            scope.spawn(move || {
                for (line, station) in some {
                    let folder = tempfile::tempdir().unwrap();
                    let seen = hil(folder.path(), line, station);
                    let what = format!("{line}, {station}: exit {}, {:?}: {}", seen.code, seen.device, seen.said);
                    assert_eq!(seen.code, 4, "{what}");
                    assert!(seen.device.coil_a == 0.0 && !seen.said.contains("REMOVE POWER"), "{what}");
                    holds(&what, &seen);
                }
            });
        }
    });
}

#[test]
fn no_command_sends_more_than_the_largest_current_of_the_station() {
    each("--max-current", "max_current", "250 mA", "1 A", |what, seen| {
        assert!(seen.device.largest_coil_a <= 0.25 && seen.said.contains("outside the limits of"), "{what}");
    });
}

#[test]
fn no_command_goes_on_above_the_largest_pressure_of_the_station() {
    each("--max-pressure", "max_pressure", "5 bar", "60 bar", |what, seen| {
        assert!((seen.device.largest_coil_a - 0.3).abs() < 1e-6, "the limit of the current has no part in it: {what}");
        assert!(seen.said.contains("pressure ") && seen.said.contains("above 5.000 bar"), "{what}");
    });
}

/// The same plan without the limits passes: it is they that ended the runs above.
#[test]
fn without_these_limits_the_plan_passes() {
    for (line, station) in [
        ("run plan.toml --out out --max-current 350_mA --max-pressure 20_bar", ""),
        ("batch plan.toml --duts lot.csv --station station.toml --out out", "max_current = \"350 mA\"\nmax_pressure = \"20 bar\""),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let seen = hil(folder.path(), line, station);
        assert!(seen.code == 0 && (seen.device.largest_coil_a - 0.3).abs() < 1e-6, "{line}: exit {}: {}", seen.code, seen.said);
    }
}

#[test]
fn a_limit_that_lets_nothing_pass_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (line, code) in [("run plan.toml --out out --max-current=-1_A", 2), ("run plan.toml --out out --max-pressure=0_bar", 2)] {
        let seen = hil(folder.path(), line, "");
        assert!(seen.code == code && seen.said.contains("not positive"), "{line}: exit {}: {}", seen.code, seen.said);
    }
    let seen = hil(folder.path(), "batch plan.toml --duts lot.csv --station station.toml --out b", "max_pressure = \"0 bar\"");
    assert!(seen.code == 3 && seen.said.contains("max_pressure: is not positive"), "exit {}: {}", seen.code, seen.said);
    assert_eq!(seen.device.requests, 0);
}
