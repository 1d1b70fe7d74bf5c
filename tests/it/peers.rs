//! Files of recordings against the libraries that others use: asammdf and pyarrow, both ways.
//!
//! The scripts in `tests/peers` run in a Python environment that is made once below `target/`. Set
//! `HIL_SKIP_PEERS` where there is no Python or no network; without it a missing peer is a failure.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use hil::recording::{Recording, Run};

const PACKAGES: [&str; 3] = ["asammdf==8.8.28", "numpy==2.4.6", "pyarrow==26.0.1"];

/// Runs a command and panics with its output where it fails.
fn run(command: &mut Command) {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}; set HIL_SKIP_PEERS to go without"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}\nset HIL_SKIP_PEERS to go without");
}

/// The Python with the peers; `None` where they are not wanted.
fn python() -> Option<&'static Path> {
    static PYTHON: OnceLock<Option<PathBuf>> = OnceLock::new();
    PYTHON
        .get_or_init(|| {
            if std::env::var_os("HIL_SKIP_PEERS").is_some() {
                return None;
            }
            let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("peers");
            let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
            let (stamp, wanted) = (folder.join("packages.txt"), PACKAGES.join("\n"));
            if std::fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
                return Some(python);
            }
            run(Command::new(if cfg!(windows) { "python" } else { "python3" }).args(["-m", "venv", "--clear"]).arg(&folder));
            run(Command::new(&python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).args(PACKAGES));
            std::fs::write(&stamp, wanted).unwrap();
            Some(python)
        })
        .as_deref()
}

fn script(python: &Path, name: &str, arguments: [&Path; 2]) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(name);
    run(Command::new(python).arg(path).args(arguments));
}

fn close(a: &[f64], b: &[f64], what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (at, (a, b)) in a.iter().zip(b).enumerate() {
        assert!(a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-12 * b.abs().max(1.0), "{what}[{at}]: {a} is not {b}");
    }
}

fn same(a: &Run, b: &Run, what: &str) {
    assert_eq!(a.name, b.name, "{what}");
    close(&a.time_s, &b.time_s, &format!("{what}: time_s"));
    close(&a.current_a, &b.current_a, &format!("{what}: current_a"));
    close(a.pressure_bar.as_ref().unwrap(), b.pressure_bar.as_ref().unwrap(), &format!("{what}: pressure_bar"));
    assert_eq!(a.oil_temp_c, b.oil_temp_c, "{what}: oil_temp_c");
}

/// Two runs of different length with gaps, and a temperature that only the second has.
fn ours() -> Recording {
    let mut text = String::from("run,time_s,current_a,pressure_bar,oil_temp_c\n");
    for k in 0..500 {
        let (t, i) = (f64::from(k) / 100.0 - 0.2, 0.5 + 0.001 * f64::from(k % 300));
        let pressure = if k % 50 == 7 { String::new() } else { format!("{}", 20.0 * i + 1.0 / 3.0) };
        text += &format!("step up,{t},{i},{pressure},\n");
    }
    for k in 0..200 {
        text += &format!("step down,{},{},{},80.5\n", f64::from(k) / 50.0, 1.0 - 0.001 * f64::from(k), k);
    }
    Recording::from_csv(text, "ours.csv", &[]).unwrap()
}

fn both_ways(name: &str, extension: &str, files: usize) {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    script(python, name, [Path::new("write"), folder.path()]);
    let mut count = 0;
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == extension) {
            let theirs = Recording::read(&path, &[]).unwrap_or_else(|e| panic!("{e}"));
            let expected = Recording::read(&path.with_extension("csv"), &[]).unwrap();
            assert_eq!(theirs.runs.len(), expected.runs.len(), "{}: {:?}", path.display(), theirs.notes);
            theirs.runs.iter().zip(&expected.runs).for_each(|(a, b)| same(a, b, &theirs.source));
            count += 1;
        }
    }
    assert_eq!(count, files);

    let ours = ours();
    let (file, table) = (folder.path().join(format!("ours.{extension}")), folder.path().join("ours.csv"));
    ours.write(&file).unwrap();
    ours.write(&table).unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(name);
    run(Command::new(python).arg(path).arg("check").args([file, table]));
}

#[test]
fn mdf4_is_read_and_written_as_asammdf_does() {
    both_ways("mdf4.py", "mf4", 16);
}

#[test]
fn parquet_is_read_and_written_as_pyarrow_does() {
    both_ways("parquet.py", "parquet", 6);
}
