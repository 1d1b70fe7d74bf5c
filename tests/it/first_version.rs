//! What the first version wrote opens as before: records, stores with their journals, models, plans, profiles. The files beside this one are
//! its own.

use std::path::Path;

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;

const FILES: [&str; 12] = [
    "batch/batch.json",
    "batch/journal/000001.jsonl",
    "record.json",
    "plan.toml",
    "valve.toml",
    "driver.toml",
    "station.toml",
    "population.toml",
    "limits.toml",
    "run/record.json",
    "plans/hold-20-26.toml",
    "valves/paper.toml",
];

/// A folder as somebody has it who worked with the first version.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let kept = Path::new("tests/it/first_version");
    for name in FILES {
        let from = match name {
            "run/record.json" => kept.join("record.json"),
            "plans/hold-20-26.toml" => kept.join("plan.toml"),
            "valves/paper.toml" => kept.join("paper.toml"),
            name => kept.join(name),
        };
        let to = folder.path().join(name);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(from, to).unwrap();
    }
    folder
}

fn hil(folder: &tempfile::TempDir, arguments: &str) -> Assert {
    Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(folder.path()).args(arguments.split_whitespace()).assert()
}

#[test]
fn its_files_are_taken() {
    let folder = folder();
    hil(&folder, "check plan.toml valve.toml driver.toml station.toml population.toml limits.toml").code(0);
    hil(&folder, "margins --model valve.toml --kp 1 --ki 5").code(0);
    hil(&folder, "run plan.toml --sim --valve valve.toml --out again").code(0).stdout(contains("hold-20-26"));
}

#[test]
fn its_records_are_shown_and_compared() {
    let folder = folder();
    hil(&folder, "report run").code(0).stdout(contains("PASS").and(contains("slow sine in the band")));
    hil(&folder, "report record.json --format html -o page.html").code(0);
    hil(&folder, "diff record.json run/record.json").code(0).stdout(contains("no difference"));
}

#[test]
fn its_store_is_read_asked_and_gone_on_with() {
    let folder = folder();
    hil(&folder, "report batch").code(0).stdout(contains("batch of 2 on hold-20-26"));
    hil(&folder, "history . --serial SIM-000002").code(0).stdout(contains("1 attempt(s)"));
    hil(&folder, "diff batch batch").code(0);
    // Both valves have their verdict: nothing is tested again, and nothing that was written is changed.
    let journal = folder.path().join("batch/journal/000001.jsonl");
    let before = std::fs::read(&journal).unwrap();
    hil(&folder, "batch plans/hold-20-26.toml --count 2 --sim --out batch --resume").code(0).stderr(contains("going on after 2 valve(s)"));
    let after = std::fs::read(&journal).unwrap();
    assert!(after.starts_with(&before), "the journal was rewritten");
    assert_eq!(after.len(), before.len());
}
