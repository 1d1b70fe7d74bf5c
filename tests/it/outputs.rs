//! Outputs from outside: nothing that a command reads, nothing of somebody else's and no record is ever written over.

use std::path::Path;
use std::process::Command;

fn hil(folder: &Path, args: &[&str]) -> (i32, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(folder).args(args).output().unwrap();
    (out.status.code().unwrap_or(-1), String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr))
}

/// A folder with a copy of the shipped valve and plan, and a sweep of the valve.
fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (from, to) in [("valves/paper.toml", "valve.toml"), ("plans/triangle-sweep.toml", "plan.toml")] {
        std::fs::copy(root.join(from), folder.path().join(to)).unwrap();
    }
    let (code, said) = hil(folder.path(), &["run", "plan.toml", "--sim", "--valve", "valve.toml", "--out", "run"]);
    assert!(code <= 1, "{said}");
    std::fs::copy(folder.path().join("run/trace.parquet"), folder.path().join("sweep.parquet")).unwrap();
    let (code, said) = hil(folder.path(), &["simulate", "sweep.parquet", "--model", "valve.toml", "-o", "sweep.csv"]);
    assert_eq!(code, 0, "{said}");
    folder
}

/// Every file below a folder with its bytes.
fn bytes(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { open.push(path) } else { files.push((path.display().to_string(), std::fs::read(&path).unwrap())) }
        }
    }
    files.sort();
    files
}

/// Each of these replaced a file that somebody needs. All are refused before any work, and nothing changes.
#[test]
fn no_command_writes_over_what_is_there() {
    let folder = bench();
    let before = bytes(folder.path());
    let refused = [
        "simulate sweep.csv --model valve.toml -o sweep.csv",
        "simulate sweep.csv --model valve.toml -o ./run/../sweep.csv --force",
        "simulate sweep.csv --model valve.toml -o valve.toml",
        "simulate sweep.csv --model valve.toml -o run/trace.parquet --force",
        "identify sweep.csv -o sweep.csv",
        "identify sweep.csv -o plan.toml",
        "identify sweep.csv -o x.toml --report x.toml",
        "identify sweep.csv --report run/record.json --force",
        "diagnose sweep.csv --model valve.toml --report sweep.csv",
        "diagnose sweep.csv --model valve.toml --next-plan sweep.csv",
        "diagnose sweep.csv --model valve.toml -o valve.toml",
        "diagnose sweep.csv --model valve.toml -o a.toml --report no/such/folder/page.html",
        "run plan.toml --sim --valve valve.toml --out run",
        "run plan.toml --sim --valve valve.toml --out run --force",
        "batch plan.toml --sim --valve valve.toml --count 1 --out run",
        "msa plan.toml --sim --valve valve.toml --metric x/rmse --out run",
    ];
    for line in refused {
        let (code, said) = hil(folder.path(), &line.split(' ').collect::<Vec<_>>());
        assert!(code == 2 || code == 7, "{line}: exit {code}: {said}");
        assert!(bytes(folder.path()) == before, "{line}: changed a file: {said}");
    }
}

#[test]
fn an_own_file_is_replaced_by_one_of_its_kind_and_others_by_force() {
    let folder = bench();
    let run = |line: &str| hil(folder.path(), &line.split(' ').collect::<Vec<_>>());
    for _ in 0..2 {
        let (code, said) = run("identify sweep.csv -o found.toml --report found.html");
        assert_eq!(code, 0, "a valve by a valve, a page by a page: {said}");
    }
    let (code, said) = run("simulate sweep.csv --model valve.toml -o other.csv");
    assert_eq!(code, 0, "{said}");
    let (code, said) = run("simulate sweep.csv --model valve.toml -o other.csv");
    assert!(code == 2 && said.contains("--force"), "{said}");
    assert_eq!(run("simulate sweep.csv --model valve.toml -o other.csv --force").0, 0);
}

/// Two runs into one folder at once: one of them has it, and the folder holds the whole of that one.
#[test]
fn two_at_once_cannot_mix() {
    let folder = bench();
    let start = |seed: &str| {
        let args = ["run", "plan.toml", "--sim", "--valve", "valve.toml", "--out", "both", "--seed", seed];
        Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(folder.path()).args(args).output().unwrap()
    };
    let codes: Vec<(u32, i32)> = std::thread::scope(|scope| {
        let runs: Vec<_> = (1..=4).map(|seed: u32| (seed, scope.spawn(move || start(&seed.to_string())))).collect();
        runs.into_iter().map(|(seed, run)| (seed, run.join().unwrap().status.code().unwrap_or(-1))).collect()
    });
    let stored: Vec<u32> = codes.iter().filter(|(_, code)| *code <= 1).map(|(seed, _)| *seed).collect();
    assert_eq!(stored.len(), 1, "{codes:?}");
    assert!(codes.iter().all(|(_, code)| [0, 1, 2, 7].contains(code)), "{codes:?}");
    let text = std::fs::read_to_string(folder.path().join("both/record.json")).unwrap();
    let record: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(record["seed"].as_u64(), Some(stored[0].into()));
}
