//! The program in an empty folder, without its repository: shipped files, projects, names.

use std::path::Path;

use assert_cmd::Command;
use predicates::str::contains;

/// A folder that holds nothing.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn path(&self) -> &Path {
        self.0.path()
    }
    fn hil(&self, arguments: &str) -> assert_cmd::assert::Assert {
        self.hil_in("", arguments)
    }
    fn hil_in(&self, below: &str, arguments: &str) -> assert_cmd::assert::Assert {
        Command::new(env!("CARGO_BIN_EXE_hil")).current_dir(self.path().join(below)).args(arguments.split_whitespace()).assert()
    }
    fn put(&self, name: &str, text: &str) {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }
}

#[test]
fn what_ships_with_the_program_needs_no_repository() {
    let folder = Folder::new();
    folder.hil("run tipin --sim").code(0).stdout(contains("PASS")).stderr(contains("stored in reports/runs/tipin-paper"));
    folder.hil("run gain-comparison --sim --valve clutch-1 --out other --format json").stdout(contains("\"name\": \"clutch-1.toml\""));
    // The range of a valve is said once.
    let said = folder.hil("check tipin paper emulator limits").code(0).get_output().stdout.clone();
    assert_eq!(String::from_utf8(said).unwrap().matches("0.058 A").count(), 1);
    folder.hil("margins --model paper --kp 1 --ki 5").code(0);
    folder.hil("tune --model paper").code(0).stdout(contains("tipin"));
    folder.hil("batch tipin --count 3 --sim --population population").code(0);
    folder.hil("run tipn --sim").code(3).stderr(contains("did you mean `tipin`?"));
    folder.hil("run plans/tipin.toml --sim").code(3).stderr(contains("`tipin` alone means the one that ships with the program"));
}

#[test]
fn a_file_beside_the_plan_goes_before_the_folder_and_that_before_the_shipped_one() {
    let folder = Folder::new();
    let named = |name: &str| {
        let text = std::fs::read_to_string("valves/paper.toml").unwrap();
        text.replacen("name = \"paper\"", &format!("name = \"{name}\""), 1)
    };
    let plan = std::fs::read_to_string("plans/tipin.toml").unwrap();
    folder.put("bench/plan.toml", &plan.replacen("rate =", "valve = \"paper\"\nrate =", 1));
    let serial = |out: &str| {
        folder.hil(&format!("run bench/plan.toml --sim --out {out}")).code(0);
        let record: serde_json::Value = serde_json::from_str(&folder.read(&format!("{out}/record.json"))).unwrap();
        record["dut"]["serial"].as_str().unwrap().to_string()
    };
    assert_eq!(serial("1"), "paper");
    folder.put("paper.toml", &named("folder"));
    assert_eq!(serial("2"), "folder");
    folder.put("bench/paper.toml", &named("beside"));
    assert_eq!(serial("3"), "beside");
    folder.hil("run bench/plan.toml --sim --valve hil:valves/paper.toml --out 4").code(0);
    assert!(folder.read("4/record.json").contains("\"serial\": \"paper\""));
}

#[test]
fn every_project_that_init_lays_checks_and_passes_at_once() {
    for example in ["", "--example bench", "--example ci"] {
        let folder = Folder::new();
        folder.hil(&format!("init {example}")).code(0).stdout(contains("Next:"));
        let checked = folder.hil("check").code(0);
        if example.contains("bench") {
            checked.stdout(contains("station.toml: station"));
        }
        folder.hil("run acceptance --sim").code(0).stderr(contains("limits of limits/part.toml (hil.toml)"));
        // From a folder below, names still mean the project's.
        std::fs::create_dir(folder.path().join("below")).unwrap();
        folder.hil_in("below", "run acceptance --sim --out run").code(0).stdout(contains("450 mbar").or("0.450 bar"));
        // Nothing is replaced.
        folder.hil("init").code(2).stderr(contains("hil.toml").or("already there"));
        for kind in ["plan", "valve", "limits", "project"] {
            let schema: serde_json::Value = serde_json::from_str(&folder.read(&format!(".hil/{kind}.schema.json"))).unwrap();
            assert!(schema["properties"]["schema"].is_object(), "{kind}");
        }
        assert!(folder.read("plans/acceptance.toml").starts_with("#:schema ../.hil/plan.schema.json\n"));
    }
}

/// One of two texts.
trait Or: predicates::Predicate<str> + Sized {
    fn or(self, other: &'static str) -> impl predicates::Predicate<str> {
        predicates::prelude::PredicateBooleanExt::or(self, contains(other))
    }
}
impl Or for predicates::str::ContainsPredicate {}

#[cfg(unix)]
#[test]
fn the_script_of_ci_compares_with_the_accepted_report() {
    let folder = Folder::new();
    folder.hil("init --example ci").code(0);
    let ci = |code: i32| {
        let bin = Path::new(env!("CARGO_BIN_EXE_hil")).parent().unwrap();
        let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
        Command::new("sh").arg("ci/check.sh").env("PATH", path).current_dir(folder.path()).assert().code(code);
        folder.read("diff.md")
    };
    assert!(ci(0).contains("no accepted report yet"));
    folder.hil("accept reports/runs/ci").code(0);
    assert!(ci(0).contains("Reports agree"), "{}", folder.read("diff.md"));
    folder.put("plans/acceptance.toml", &folder.read("plans/acceptance.toml").replacen("kp = \"1 mA/bar\"", "kp = \"2 mA/bar\"", 1));
    assert!(ci(0).contains("Reports differ"));
    folder.put(
        "limits/part.toml",
        &folder.read("limits/part.toml").replacen("450 mbar\", marginal_max = \"400 mbar", "1 mbar\", marginal_max = \"1 mbar", 1),
    );
    assert!(ci(1).contains("FAIL"));
    // Both services call this script, and no other.
    for file in [".github/workflows/hil.yml", ".gitlab-ci.yml"] {
        assert!(folder.read(file).contains("sh ci/check.sh") && folder.read(file).contains("diff.md"), "{file}");
    }
}

/// On a terminal of 60 columns no line of any report is longer; `script` of util-linux gives the program such a terminal.
#[test]
fn reports_fit_a_terminal_of_sixty_columns() {
    let folder = tempfile::tempdir().unwrap();
    let hil = env!("CARGO_BIN_EXE_hil");
    let on_terminal = |line: &str| {
        let out = std::process::Command::new("script")
            .args([
                "--quiet",
                "--return",
                "--command",
                &format!("stty rows 40 cols 60; {hil} --color never {line} 2> /dev/null"),
                "/dev/null",
            ])
            .current_dir(folder.path())
            .stdin(std::process::Stdio::null())
            .output()
            .expect("`script` of util-linux");
        assert!(out.status.code().is_some_and(|code| code < 2), "{line}: {}", String::from_utf8_lossy(&out.stdout));
        String::from_utf8_lossy(&out.stdout).replace('\r', "")
    };
    for line in [
        "run tipin --sim --out run",
        "report run",
        "init work --example diagnosis",
        "inspect work/recordings/logger.csv",
        "identify work/recordings/sweep.csv -o valve.toml",
        "diagnose work/recordings/sweep.csv --model valve.toml",
        "batch tipin --sim --count 3 --out lot",
        "report lot",
        "diff run run",
        "margins --model paper --kp '1 mA/bar' --ki '5 mA/(bar s)'",
        "explain",
        "explain flow_limit",
        "explain rmse",
        "check work/plans/acceptance.toml",
    ] {
        let text = on_terminal(line);
        let long: Vec<&str> = text.lines().filter(|l| l.chars().count() > 60 && l.trim().contains(' ')).collect();
        assert!(!text.trim().is_empty() && long.is_empty(), "{line}: {long:#?}");
    }
}
