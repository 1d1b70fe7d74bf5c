//! Every shipped plan, run on its simulated valve: its accepted report, its JUnit file and its page.

use std::path::{Path, PathBuf};

use assert_cmd::Command;

fn plans() -> Vec<PathBuf> {
    let mut plans: Vec<PathBuf> = std::fs::read_dir("plans")
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "toml") && read(p).contains("hil.plan/1"))
        .collect();
    plans.sort();
    assert!(plans.len() >= 7, "{plans:?}");
    plans
}

fn hil(arguments: &[&str]) -> (i32, String) {
    let output = Command::cargo_bin("hil").unwrap().args(arguments).output().unwrap();
    let code = output.status.code().unwrap();
    assert!(code <= 1, "hil {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    (code, String::from_utf8(output.stdout).unwrap())
}

fn read(path: impl AsRef<Path>) -> String {
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.as_ref().display()))
}

#[test]
fn every_shipped_plan_gives_its_accepted_report() {
    let folder = tempfile::tempdir().unwrap();
    let mut moved = Vec::new();
    for plan in plans() {
        let name = plan.file_stem().unwrap().to_str().unwrap().to_string();
        let run = folder.path().join("run").join(&name);
        let (accepted, run_name) = (folder.path().join("accepted"), run.to_str().unwrap());
        let (_, printed) = hil(&["run", plan.to_str().unwrap(), "--sim", "--out", run_name]);
        assert!(printed.lines().all(|l| l.chars().count() <= 80), "{name}");
        hil(&["accept", run_name, "--into", accepted.to_str().unwrap()]);
        for file in ["report.txt", "report.md", "record.json"] {
            let (now, then) = (read(accepted.join(&name).join(file)), read(Path::new("reports").join(&name).join(file)));
            if now != then {
                moved.push(format!("reports/{name}/{file}"));
            }
        }
        assert_eq!(printed, read(accepted.join(&name).join("report.txt")), "{name}: stdout and the accepted report");
        insta::assert_snapshot!(format!("junit {name}"), read(run.join("junit.xml")));
        let page = read(run.join("report.html"));
        assert!(page.contains("SIMULATION") && page.len() < 3_000_000, "{name}: {} bytes", page.len());
    }
    let (_, difference) = hil(&["diff", "reports", folder.path().join("accepted").to_str().unwrap()]);
    assert!(
        moved.is_empty(),
        "{difference}\nnot the accepted bytes: {moved:?}\nif that is meant: hil run PLAN --sim --out RUN, then hil accept RUN"
    );
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let folder = tempfile::tempdir().unwrap();
    let page = |name: &str, seed: &str| {
        let run = folder.path().join(name);
        hil(&["run", "plans/tipin.toml", "--sim", "--seed", seed, "--out", run.to_str().unwrap()]);
        let page = read(run.join("report.html"));
        let started = page.find("<dt>started</dt>").unwrap();
        page[..started].to_string()
    };
    let first = page("a", "1");
    assert_eq!(first, page("b", "1"));
    assert_ne!(first, page("c", "2"));
}

#[test]
fn a_difference_ends_with_1_and_none_with_0() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, more: &[&str]| {
        let path = folder.path().join(name).to_str().unwrap().to_string();
        hil(&[&["run", "plans/tipin.toml", "--sim", "--out", &path], more].concat());
        path
    };
    let (a, b, c) = (run("a", &[]), run("b", &[]), run("c", &["--set", "high=26 bar"]));
    assert_eq!(hil(&["diff", &a, &b]).0, 0);
    let (code, text) = hil(&["diff", &a, &c]);
    assert!(code == 1 && text.contains("rmse.delayed") && text.contains("high: 24 bar -> 26 bar"), "{text}");
    let (_, markdown) = hil(&["diff", &a, &c, "--format", "markdown"]);
    assert!(markdown.starts_with("## Reports differ"), "{markdown}");
    let json: serde_json::Value = serde_json::from_str(&hil(&["diff", &a, &c, "--format", "json"]).1).unwrap();
    assert_eq!(json["different"], true);
}

#[test]
fn what_is_no_record_ends_with_3_and_a_wrong_tolerance_with_2() {
    let ends = |arguments: &[&str], code: i32, says: &str| {
        let output = Command::cargo_bin("hil").unwrap().args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).to_string();
        assert!(output.status.code() == Some(code) && said.contains(says), "hil {arguments:?}: {:?} {said}", output.status);
    };
    ends(&["diff", "README.md", "README.md"], 3, "README.md: is not a record");
    ends(&["diff", "src", "src"], 3, "no record.json");
    ends(&["accept", "nothing-here"], 3, "nothing-here");
    ends(&["diff", "reports/tipin", "reports/tipin", "--tolerance", "rmse=5 mA"], 2, "`5 mA` is not a pressure");
    ends(&["diff", "reports/tipin", "reports/tipin", "--tolerance", "rmsee=5 mbar"], 2, "they hold: ");
    ends(&["explain", "setling_time"], 2, "settling_time");
    ends(&["schema", "spoon"], 2, "spoon");
}

#[test]
fn schemas_and_completions_are_printed() {
    for kind in ["plan", "valve", "driver", "limits"] {
        let schema: serde_json::Value = serde_json::from_str(&hil(&["schema", kind]).1).unwrap();
        assert!(schema["properties"]["schema"].is_object(), "{kind}");
    }
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        assert!(hil(&["completions", shell]).1.contains("diagnose") || hil(&["completions", shell]).1.contains("identify"), "{shell}");
    }
}
