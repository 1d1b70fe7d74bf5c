//! Batches from outside: kills, threads, folders, gates.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use hil::batch::store::load;
use hil::record::Outcome;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn hil(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil"));
    command.current_dir(root()).args(args);
    command
}

fn run(args: &[&str]) -> (i32, String, String) {
    let Output { status, stdout, stderr } = hil(args).output().unwrap();
    (status.code().unwrap_or(-1), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn journal_bytes(dir: &Path) -> u64 {
    let entries = std::fs::read_dir(dir.join("journal")).into_iter().flatten();
    entries.filter_map(|e| Some(e.ok()?.metadata().ok()?.len())).sum()
}

/// Fifty kills (SIGKILL) at random moments of one batch, resumed after each. At the end every valve is there once, nothing torn is
/// counted, what was interrupted is ABORTED, and the others have the figures of a batch that nobody disturbed.
#[test]
fn fifty_kills_lose_nothing_and_tear_nothing() {
    // Enough that a machine which is slow to send a signal has not finished before the last.
    const VALVES: &str = "6000";
    let folder = tempfile::tempdir().unwrap();
    let (killed, calm) = (folder.path().join("killed"), folder.path().join("calm"));
    let batch = |out: &Path| {
        let args =
            ["batch", "plans/tipin.toml", "--sim", "--count", VALVES, "--threads", "2", "--valve-reports", "none", "--out", text(out)];
        let mut command = hil(&args);
        command.stdout(Stdio::null()).stderr(Stdio::null());
        command
    };
    let mut state: u64 = 20_261_121;
    let mut random = |below: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    for kill in 0..50 {
        let before = journal_bytes(&killed);
        let mut child = batch(&killed).arg("--resume").spawn().unwrap();
        // The moment is one of progress, not of time, so that slow machines are killed as deep inside as fast ones.
        let after = before + 1 + random(30_000);
        let began = Instant::now();
        while journal_bytes(&killed) < after {
            assert!(child.try_wait().unwrap().is_none(), "the batch ended before kill {kill}");
            assert!(began.elapsed() < Duration::from_secs(60), "no progress before kill {kill}");
            std::thread::sleep(Duration::from_micros(200 + random(2000)));
        }
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let status = batch(&killed).arg("--resume").status().unwrap();
    assert_eq!(status.code(), Some(5), "valves that were interrupted are ABORTED");
    assert!(batch(&calm).status().unwrap().code().is_some());
    let (killed, calm) = (load(&killed).unwrap(), load(&calm).unwrap());
    assert!(killed.interrupted.is_empty(), "{:?}", killed.interrupted);
    assert!(killed.damage.iter().all(|d| d.what == "torn"), "{:?}", killed.damage);
    let mut aborted = 0;
    let valves: Vec<_> = killed.tally.valves().collect();
    assert_eq!(valves.len().to_string(), VALVES);
    for (attempts, undisturbed) in valves.iter().zip(calm.tally.attempts()) {
        assert_eq!(attempts.len(), 1, "valve {} is there {} times", attempts[0].dut.serial, attempts.len());
        if attempts[0].outcome == Outcome::Aborted {
            aborted += 1;
        } else {
            assert_eq!(format!("{:?}", attempts[0]), format!("{undisturbed:?}"));
        }
    }
    // Each kill interrupts at most one valve per thread, and a kill between two valves none.
    assert!((1..=100).contains(&aborted), "{aborted}");
}

#[test]
fn the_number_of_threads_does_not_show() {
    let folder = tempfile::tempdir().unwrap();
    let files = |threads: &str| {
        let out = folder.path().join(threads);
        let (_, stdout, _) =
            run(&["batch", "plans/tipin.toml", "--sim", "--count", "60", "--threads", threads, "--format", "json", "--out", text(&out)]);
        let names = ["statistics.json", "measurements.csv", "measurements.parquet", "junit.xml", "summary.md", "report.html"];
        let read = |name: &&str| std::fs::read(out.join(name)).unwrap();
        (stdout, names.iter().map(read).collect::<Vec<_>>())
    };
    let one = files("1");
    assert!(one.0.contains("\"schema\": \"hil.batch/1\""));
    assert!(one == files("5"));
}

#[test]
fn a_folder_is_not_written_over_and_a_bad_one_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("b");
    let batch = ["batch", "plans/tipin.toml", "--sim", "--count", "2", "--out", text(&out)];
    assert_eq!(run(&batch).0, 0);
    let (code, _, stderr) = run(&batch);
    assert!(code == 3 && stderr.contains("--resume goes on with it"), "{stderr}");
    let (code, _, stderr) = run(&["batch", "plans/tipin.toml", "--sim", "--count", "3", "--resume", "--out", text(&out)]);
    assert!(code == 3 && stderr.contains("the list of the valves changed since the batch began"), "{stderr}");
    let (code, _, stderr) = run(&["batch", "plans/tipin.toml", "--sim", "--count", "2", "--out", "/proc/hil"]);
    assert!(code == 7 && stderr.contains("/proc/hil"), "{code} {stderr}");
    let (code, _, stderr) = run(&["batch", "plans/tipin.toml", "--sim"]);
    assert!(code == 2 && stderr.contains("--duts"), "{stderr}");
}

#[test]
fn a_lot_with_its_limits_and_its_station_comes_through_the_gate() {
    let folder = tempfile::tempdir().unwrap();
    let station = folder.path().join("station.toml");
    std::fs::copy(root().join("examples/batch/station.toml"), &station).unwrap();
    let out = folder.path().join("lot");
    let batch = [
        "batch",
        "plans/tipin.toml",
        "--sim",
        "--duts",
        "examples/batch/lot.csv",
        "--limits",
        "examples/batch/limits.toml",
        "--station",
        text(&station),
        "--valve-reports",
        "failed",
        "--out",
        text(&out),
    ];
    let (code, _, stderr) = run(&batch);
    assert!(code == 4 && stderr.contains("`MASTER-GOOD` has not been checked with this plan"), "{stderr}");
    assert!(!out.exists(), "nothing is begun behind a closed gate");
    let master = ["master", "plans/tipin.toml", "--sim", "--station", text(&station), "--serial", "MASTER-GOOD"];
    let (code, stdout, stderr) = run(&master);
    assert!(code == 0 && stdout.contains("as it should"), "{stdout} {stderr}");
    let (code, stdout, stderr) = run(&batch);
    assert!(code == 0 || code == 1, "{code} {stderr}");
    assert!(stdout.contains("guarded acceptance"), "{stdout}");
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("example station") && page.contains("number of its certificate") && page.contains("SIMULATION"));
    // A calibration that has run out is refused, or overridden with a reason that is on the page.
    let expired = std::fs::read_to_string(&station).unwrap().replacen("2099-03-01", "2026-03-02", 1);
    std::fs::write(&station, expired).unwrap();
    let late: PathBuf = folder.path().join("late");
    let mut batch: Vec<&str> = batch.to_vec();
    let last = batch.len() - 1;
    batch[last] = text(&late);
    let (code, _, stderr) = run(&batch);
    assert!(code == 3 && stderr.contains("calibration due 2026-03-02"), "{stderr}");
    batch.extend(["--override-calibration", "the laboratory is closed"]);
    run(&batch);
    assert!(std::fs::read_to_string(late.join("report.html")).unwrap().contains("tested nevertheless: the laboratory is closed"));
}

#[test]
fn history_and_diff_answer() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    let batch = |out: &Path, seed: &str, set: &str| {
        run(&[
            "batch",
            "plans/tipin.toml",
            "--sim",
            "--count",
            "60",
            "--seed",
            seed,
            "--set",
            set,
            "--valve-reports",
            "none",
            "--out",
            text(out),
        ]);
    };
    batch(&a, "1", "high=24 bar");
    batch(&b, "2", "high=24 bar");
    let (code, stdout, stderr) = run(&["history", text(folder.path()), "--serial", "SIM-000007", "--metric", "tip-in/rmse"]);
    assert!(code == 0 && stdout.contains("2 attempt(s)") && stdout.matches("tip-in/rmse").count() == 2, "{stdout}{stderr}");
    let (code, stdout, _) = run(&["diff", text(&a), text(&b)]);
    assert!(code == 0 && stdout.contains("No difference beyond noise"), "another draw of the same population: {stdout}");
    let c = folder.path().join("c");
    batch(&c, "1", "high=21 bar");
    let (code, stdout, _) = run(&["diff", text(&a), text(&c)]);
    assert!(code == 1 && stdout.contains("MOVED"), "{stdout}");
}

#[test]
fn a_gauge_study_from_a_file_and_from_a_plan() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("msa");
    let plan =
        ["msa", "plans/tipin.toml", "--sim", "--metric", "tip-in/steady_offset", "--parts", "5", "--appraisers", "2", "--trials", "2"];
    let mut with_out = plan.to_vec();
    with_out.extend(["--out", text(&out), "--format", "json"]);
    let (code, first, stderr) = run(&with_out);
    assert!(code <= 1 && first.contains("\"schema\": \"hil.msa/1\""), "{stderr}");
    let readings = out.join("readings.csv");
    let (_, again, _) = run(&["msa", text(&readings), "--tolerance", "0.6 bar", "--format", "json"]);
    let study = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap()["study"]["grr_of_study"].as_f64().unwrap();
    assert!((study(&first) - study(&again)).abs() < 1e-9);
    let (code, _, stderr) = run(&["msa", "plans/tipin.toml", "--sim", "--metric", "tip-in/rms"]);
    assert!(code == 2 && stderr.contains("tip-in/rmse"), "{stderr}");
}

#[test]
fn valves_can_be_scanned_and_a_valve_that_passed_is_refused() {
    use std::io::Write;
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("b");
    let mut child = hil(&["batch", "plans/tipin.toml", "--sim", "--prompt", "--threads", "1", "--out", text(&out)])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(b"\nV-1\nV-2\nV-1\n.\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains("the serial number is blank"), "{stderr}");
    assert!(stderr.contains("`V-1` has passed in this batch already") || stderr.contains("`V-1` is being tested"), "{stderr}");
    let loaded = load(&out).unwrap();
    let serials: Vec<&str> = loaded.tally.attempts().iter().map(|a| a.dut.serial.as_str()).collect();
    assert_eq!(serials, ["V-1", "V-2"]);
}
