//! What the program is made of and how it is had: licences and sources of `deny.toml`, man pages, completions.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

fn metadata() -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--filter-platform", "x86_64-unknown-linux-gnu"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn licences_and_sources_are_those_that_deny_toml_allows() {
    let rules: toml::Table = toml::from_str(&std::fs::read_to_string("deny.toml").unwrap()).unwrap();
    let allowed: Vec<spdx::Licensee> =
        rules["licenses"]["allow"].as_array().unwrap().iter().map(|l| spdx::Licensee::parse(l.as_str().unwrap()).unwrap()).collect();
    let banned: Vec<&str> = rules["bans"]["deny"].as_array().unwrap().iter().map(|b| b["crate"].as_str().unwrap()).collect();
    let metadata = metadata();
    let packages = metadata["packages"].as_array().unwrap();
    assert!(packages.len() > 50);
    let mut wrong = Vec::new();
    for package in packages {
        let name = package["name"].as_str().unwrap();
        let license = package["license"].as_str().unwrap_or("none").replace('/', " OR ");
        let fits = spdx::Expression::parse(&license).is_ok_and(|e| e.evaluate(|wanted| allowed.iter().any(|l| l.satisfies(wanted))));
        if !fits {
            wrong.push(format!("{name}: licence {license}"));
        }
        // A crate of the workspace has no source; all others come from the one registry.
        if package["source"].as_str().is_some_and(|source| !source.starts_with("registry+")) {
            wrong.push(format!("{name}: source {}", package["source"]));
        }
        if banned.contains(&name) {
            wrong.push(format!("{name}: is banned"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn man_pages_and_completions_are_there_for_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let hil = |args: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_hil")).args(args).env("XDG_DATA_HOME", folder.path().join("share")).output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let pages = folder.path().join("man");
    hil(&["man", pages.to_str().unwrap()]);
    let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let help = hil(&["--help"]);
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|l| *l != "Commands:")
        .skip(1)
        .take_while(|l| !l.is_empty())
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next())
        .filter(|c| *c != "help")
        .collect();
    assert!(commands.len() >= 20, "{commands:?}");
    assert!(read(&pages.join("hil.1")).contains(".TH HIL 1"));
    for command in &commands {
        let page = read(&pages.join(format!("hil-{command}.1")));
        assert!(page.contains(&format!(".TH HIL-{} 1", command.to_uppercase())) && page.contains("SYNOPSIS"), "{command}");
    }
    hil(&["man"]);
    for place in [
        "man/man1/hil.1",
        "man/man1/hil-run.1",
        "bash-completion/completions/hil",
        "zsh/site-functions/_hil",
        "fish/vendor_completions.d/hil.fish",
    ] {
        assert!(read(&folder.path().join("share").join(place)).contains("hil"), "{place}");
    }
}
