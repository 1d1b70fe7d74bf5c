//! Every command of README.md, in its order, in an empty folder.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// The `hil` and `cd` lines of README.md's blocks without a language.
fn commands() -> Vec<String> {
    let text = std::fs::read_to_string("README.md").unwrap();
    let mut lines = Vec::new();
    let mut inside = None;
    for line in text.lines() {
        if let Some(language) = line.strip_prefix("```") {
            inside = if inside.is_none() { Some(language.to_string()) } else { None };
        } else if inside.as_deref() == Some("") {
            lines.push(line.to_string());
        }
    }
    lines
}

/// A command line as a shell takes it apart: words, and what stands in double quotes.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quoted) = (Vec::new(), String::new(), false);
    for c in line.chars() {
        match c {
            '"' => quoted = !quoted,
            ' ' if !quoted => words.extend((!word.is_empty()).then(|| std::mem::take(&mut word))),
            c => word.push(c),
        }
    }
    words.extend((!word.is_empty()).then_some(word));
    words
}

/// Programs that run beside the others, ended with the test.
struct Beside(Vec<Child>);

impl Drop for Beside {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

#[cfg(unix)]
#[test]
fn every_command_of_the_readme_does_what_it_says() {
    let commands = commands();
    assert!(commands.iter().filter(|c| c.starts_with("hil ")).count() >= 18, "{commands:#?}");
    let empty = tempfile::tempdir().unwrap();
    let mut folder: PathBuf = empty.path().into();
    let mut beside = Beside(Vec::new());
    let mut wrong = Vec::new();
    for line in &commands {
        if let Some(to) = line.strip_prefix("cd ") {
            folder = folder.join(to);
            continue;
        }
        let line = line.replace("/tmp/valve", empty.path().join("valve").to_str().unwrap());
        let (line, background) = line.strip_suffix(" &").map_or((line.as_str(), false), |l| (l, true));
        let words = words(line);
        assert_eq!(words[0], "hil", "{line}");
        let mut command = Command::new(env!("CARGO_BIN_EXE_hil"));
        command.args(&words[1..]).current_dir(&folder).stdin(Stdio::null());
        if background {
            beside.0.push(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
            let link = empty.path().join("valve");
            for _ in 0..500 {
                if link.exists() {
                    break;
                }
                std::thread::sleep(std::time::Duration::from_millis(20));
            }
            continue;
        }
        if words[1] == "station" {
            // It serves until it is told to end. Its usual port may be another's on this machine.
            let mut child = command.args(["--listen", "127.0.0.1:0"]).stdout(Stdio::piped()).spawn().unwrap();
            let mut address = String::new();
            std::io::BufRead::read_line(&mut std::io::BufReader::new(child.stdout.take().unwrap()), &mut address).unwrap();
            let _ = Command::new("kill").arg(child.id().to_string()).status();
            let code = child.wait().unwrap().code();
            if !address.contains("http://127.0.0.1:") || code != Some(0) {
                wrong.push(format!("{line}: {code:?}\n{address}"));
            }
            continue;
        }
        let output = command.output().unwrap();
        // `diff` finds what was changed on purpose; a valve with a fault may fail its test, a machine at work may miss
        // deadlines, which the tests of the wire hold.
        let fine: &[i32] = match words[1].as_str() {
            "diff" | "batch" => &[0, 1],
            "run" if line.contains("augmented") => &[0, 1],
            "run" if line.contains("--port") => &[0, 4, 6],
            _ => &[0],
        };
        if !output.status.code().is_some_and(|code| fine.contains(&code)) {
            wrong.push(format!("{line}: {:?}\n{}", output.status.code(), String::from_utf8_lossy(&output.stderr)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for page in [
        "workshop/identify.html",
        "workshop/diagnosis.html",
        "workshop/compare.html",
        "workshop/higher.html",
        "workshop/reports/runs/lot/report.html",
    ] {
        assert!(empty.path().join(page).is_file(), "{page}");
    }
}
