//! `hil run`, `check`, `margins` and `tune` as a user calls them.

use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

fn hil() -> Command {
    Command::new(env!("CARGO_BIN_EXE_hil"))
}

fn json(text: &[u8]) -> Value {
    serde_json::from_slice(text).unwrap()
}

fn record(folder: &Path) -> Value {
    json(&std::fs::read(folder.join("record.json")).unwrap())
}

#[test]
fn tipin_ends_well_and_leaves_its_folder() {
    let out = tempfile::tempdir().unwrap();
    let run = hil().args(["run", "plans/tipin.toml", "--sim", "--format", "json", "--out"]).arg(out.path()).assert().code(0);
    let printed = json(&run.get_output().stdout);
    assert_eq!(printed["schema"], "hil.record/1");
    assert_eq!(printed["outcome"], "PASS");
    assert_eq!(record(out.path())["phases"], printed["phases"]);
    for file in ["report.html", "junit.xml", "trace.parquet"] {
        assert!(std::fs::metadata(out.path().join(file)).unwrap().len() > 100, "{file}");
    }
    assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 4, "nothing half-written is left");
    // The trace is a recording with the record's samples.
    let trace = hil::recording::Recording::read(&out.path().join("trace.parquet"), &[]).unwrap();
    assert_eq!(trace.runs[0].len() as u64, printed["timing"]["samples"].as_u64().unwrap());
}

#[test]
fn every_shipped_plan_ends_well_on_its_valve_with_another_seed_and_measures_everything() {
    for entry in std::fs::read_dir("plans").unwrap() {
        let plan = entry.unwrap().path();
        // The long drive in short.
        let rounds = if plan.ends_with("drive-800s.toml") { vec!["--set", "rounds=2"] } else { vec![] };
        let out = tempfile::tempdir().unwrap();
        let run =
            hil().arg("run").arg(&plan).args(["--sim", "--seed", "7", "--format", "json", "--out"]).arg(out.path()).args(&rounds).assert();
        let record = json(&run.code(0).get_output().stdout);
        assert_eq!(record["outcome"], "PASS", "{}: {:#}", plan.display(), record["phases"]);
        for measurement in record["phases"].as_array().unwrap().iter().flat_map(|p| p["measurements"].as_array().unwrap()) {
            assert!(measurement["value"].is_number(), "{}: {measurement}", plan.display());
        }
    }
}

#[test]
fn a_limit_that_is_missed_is_exit_code_1() {
    let folder = tempfile::tempdir().unwrap();
    let limits = folder.path().join("limits.toml");
    let text = "schema = \"hil.limits/1\"\n[[limit]]\nphase = \"tip-in\"\nmetric = \"rmse\"\nlimit = { max = \"1 mbar\" }\n";
    std::fs::write(&limits, text).unwrap();
    let out = folder.path().join("out");
    hil().args(["run", "plans/tipin.toml", "--sim", "--limits"]).arg(&limits).arg("--out").arg(&out).assert().code(1);
    assert_eq!(record(&out)["outcome"], "FAIL");
}

#[test]
fn bad_input_is_exit_code_3_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let tipin = std::fs::read_to_string("plans/tipin.toml").unwrap();
    let changed = |name: &str, from: &str, to: &str| {
        assert!(tipin.contains(from), "{from}");
        file(name, tipin.replacen(from, to, 1).as_bytes())
    };
    let cases = [
        (changed("unit.toml", "\"24 bar\"", "\"24 mA\""), vec!["unit.toml:", "current"]),
        (changed("key.toml", "metric.rmse", "metric.rsme"), vec!["key.toml:", "did you mean `rmse`"]),
        (changed("type.toml", "repeat = 3", "repeat = \"often\""), vec!["type.toml:", "repeat"]),
        (
            changed("crossed.toml", "max = \"0.5 bar\", marginal_max = \"0.4 bar\"", "min = \"2 bar\", max = \"1 bar\""),
            vec!["`min` (2)", "`max` (1)"],
        ),
        (changed("range.toml", "\"24 bar\"", "\"80 bar\""), vec!["range.toml:", "80 bar", "max_pressure"]),
        (changed("model.toml", "rate =", "model = \"nowhere\"\nrate ="), vec!["nowhere", "paper"]),
        (
            changed("table.toml", "stimulus.ramp = { to = \"0 bar\", over = \"1 s\" }", "stimulus.table.file = \"none.csv\""),
            vec!["none.csv"],
        ),
        (file("phases.toml", b"schema = \"hil.plan/1\"\nname = \"x\"\n"), vec!["phases.toml:2", "[[phase]]"]),
        (file("empty.toml", b""), vec!["empty.toml", "is empty"]),
        (file("binary.toml", &[0xff, 0xfe, 0, 1]), vec!["binary.toml", "UTF-8"]),
        (file("huge.toml", &vec![b'#'; 5 << 20]), vec!["huge.toml", "at most"]),
        (file("valve.toml", std::fs::read("valves/paper.toml").unwrap().as_slice()), vec!["valve.toml:"]),
        (folder.path().display().to_string(), vec!["is a directory"]),
        ("missing.toml".to_string(), vec!["missing.toml"]),
    ];
    let out = folder.path().join("out");
    for (plan, wanted) in cases {
        let run = hil().args(["run", &plan, "--sim", "--out"]).arg(&out).assert().code(3);
        let said = String::from_utf8_lossy(&run.get_output().stderr).to_string();
        assert!(wanted.iter().all(|w| said.contains(w)), "{plan}: {wanted:?} not in\n{said}");
        assert!(run.get_output().stdout.is_empty() && !out.exists(), "{plan}");
    }
    let wrong = |args: &[&str]| hil().args(["run", "plans/tipin.toml", "--sim"]).args(args).arg("--out").arg(&out).assert().code(3);
    wrong(&["--set", "hight=20 bar"]);
    wrong(&["--set", "high=20 s"]);
    wrong(&["--valve", "nowhere"]);
    assert!(!out.exists());
    hil().args(["run", "plans/tipin.toml"]).assert().code(2);
    hil().args(["run", "plans/tipin.toml", "--sim", "--set", "high"]).assert().code(2);
}

#[test]
fn a_folder_that_cannot_be_written_is_exit_code_7() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "in the way").unwrap();
    hil().args(["run", "plans/tipin.toml", "--sim", "--out"]).arg(file.join("out")).assert().code(7);
}

#[cfg(unix)]
#[test]
fn a_signal_ends_a_run_as_aborted() {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("long.toml");
    let text = "schema = \"hil.plan/1\"\nname = \"long\"\n[[phase]]\nname = \"hold\"\nstimulus.hold = { at = \"20 bar\", for = \"50 h\" }\n[[phase]]\nname = \"after\"\nstimulus.hold = { at = \"20 bar\", for = \"1 s\" }\n";
    std::fs::write(&plan, text).unwrap();
    let out = folder.path().join("out");
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_hil"))
        .args(["run", "--sim", "--out"])
        .arg(&out)
        .arg(&plan)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    // The folder is made just before the run begins.
    while !out.exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    std::thread::sleep(std::time::Duration::from_millis(100));
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(5));
    let record = record(&out);
    assert_eq!(
        (&record["outcome"], &record["phases"][0]["outcome"], &record["phases"][1]["outcome"]),
        (&"ABORTED".into(), &"ABORTED".into(), &"NOT_RUN".into())
    );
}

#[test]
fn every_shipped_file_checks_clean() {
    let mut files: Vec<_> = ["plans", "valves"].iter().flat_map(|d| std::fs::read_dir(d).unwrap()).map(|e| e.unwrap().path()).collect();
    files.sort();
    hil().arg("check").args(&files).assert().code(0);
    hil().args(["check", "plans/tipin.toml", "Cargo.toml"]).assert().code(3);
}

#[test]
fn margins_of_the_paper() {
    let run = hil().args("margins --gain 0.04 --lag 0.01 --delay 0.04 --kp 1 --ki 5 --format json".split(' ')).assert().code(0);
    let margins = json(&run.get_output().stdout);
    let close = |at: &str, wanted: f64, tolerance: f64| {
        let found = margins.pointer(at).and_then(Value::as_f64).unwrap_or_else(|| panic!("{at} in {margins:#}"));
        assert!((found - wanted).abs() <= tolerance, "{at}: {found} against {wanted}");
    };
    close("/routh/kp_max_ma_per_bar", 37.5, 1e-6);
    close("/gain_margin_db", 29.366, 5e-4);
    close("/phase_crossover_rad_s", 62.57, 5e-3);
    close("/phase_margin_deg", 91.72, 5e-3);
    close("/gain_crossover_rad_s", 0.20016, 5e-6);
    close("/delay_margin_s", 7.998, 5e-4);
    close("/max_sensitivity", 1.0354, 5e-5);
    assert_eq!(margins["stable"], true);
    let limit = |kp: &str| {
        let run = hil()
            .args(["margins", "--gain", "0.04 bar/mA", "--lag", "10 ms", "--delay", "40 ms", "--kp", kp, "--ki", "5", "--format", "json"])
            .assert();
        json(&run.get_output().stdout)["routh"]["ki_max_ma_per_bar_s"].as_f64()
    };
    assert_eq!((limit("0"), limit("35"), limit("40")), (Some(937.5), Some(500.0), None));
    hil().args("margins --gain 0.04 --lag 0.01 --delay 0.04 --kp -1 --ki 5".split(' ')).assert().code(2);
    hil().args("margins --kp 1 --ki 5".split(' ')).assert().code(2);
}

#[test]
fn tuned_gains_use_the_sensitivity_and_help_on_a_plan() {
    let run = hil().args("tune --model paper --valve clutch-1 --max-sensitivity 1.4 --format json".split(' ')).assert().code(0);
    let tuning = json(&run.get_output().stdout);
    let worst = tuning.pointer("/margins/worst_over_delay_range/sampled/max_sensitivity").and_then(Value::as_f64).unwrap();
    assert!(worst <= 1.4 && worst > 1.35, "{worst}");
    let offset = tuning["comparison"].as_array().unwrap().iter().find(|c| c["metric"] == "steady_offset").unwrap();
    assert!(offset["tuned"].as_f64().unwrap().abs() < offset["paper"].as_f64().unwrap().abs(), "{offset}");
}
