//! The challenge is blind: the concealing plant shares nothing with the simulator, and the diagnosis never sees it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, into: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|e| e.path()) {
        if path.is_dir() {
            sources(&path, into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
}

/// The rooms of the library that a room's code names (comments and strings of tests do not begin with `crate::`).
fn rooms_used_by(room: &str) -> BTreeSet<String> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&src.join(room), &mut files);
    assert!(!files.is_empty(), "room {room} holds no source");
    let mut rooms = BTreeSet::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        for line in text.lines().filter(|l| !l.trim_start().starts_with("//")) {
            assert!(
                !line.contains("use crate::{") && !line.contains("use crate::*"),
                "{}: name the room on one line: {line}",
                file.display()
            );
            for (at, _) in line.match_indices("crate::") {
                let rest = &line[at + "crate::".len()..];
                rooms.insert(rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect());
            }
        }
    }
    rooms.remove(room);
    rooms
}

#[test]
fn the_concealing_plant_uses_neither_the_simulator_nor_the_diagnosis() {
    let rooms = rooms_used_by("challenge");
    let allowed = BTreeSet::from(["digest", "output", "recording", "units"].map(str::to_owned));
    assert!(rooms.is_subset(&allowed), "src/challenge uses {rooms:?}");
}

#[test]
fn neither_diagnosis_nor_simulator_nor_identification_uses_the_concealing_plant() {
    for room in ["diagnose", "physics", "identify", "valve"] {
        assert!(!rooms_used_by(room).contains("challenge"), "src/{room} uses src/challenge");
    }
}
