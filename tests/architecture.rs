//! Holds what ARCHITECTURE.md promises: which room may use which, how a file opens, what never stands in the source.

use std::path::{Path, PathBuf};

#[path = "architecture/circles.rs"]
mod circles;

/// The rooms in the order of dependence: a room may use only those before it.
const ROOMS: [&str; 27] = [
    "shipped",
    "document",
    "digest",
    "output",
    "units",
    "valve",
    "recording",
    "course",
    "physics",
    "control",
    "metrics",
    "limits",
    "least_squares",
    "process_loop",
    "identify",
    "plan",
    "rig",
    "record",
    "runner",
    "diagnose",
    "challenge",
    "batch",
    "fleet",
    "exchange",
    "report",
    "station",
    "cli",
];

/// Rooms that must not use another although it stands before them, with the reason.
const FORBIDDEN: [(&str, &str, &str); 4] = [
    ("station", "rig::wire", "the page sees a run through its observer; it never reaches for the device"),
    ("challenge", "physics", "the plant that conceals an effect is written apart from the effects that explain it"),
    ("report", "rig::profile", "a report shows a record; it never reaches for the device"),
    ("report", "runner", "a report shows a record; it never runs anything"),
];

/// Longest file, its tests not counted [lines].
const LONGEST: usize = 450;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

fn sources(folder: &str) -> Vec<(String, String)> {
    let mut files = Vec::new();
    let mut open = vec![root().join(folder)];
    while let Some(folder) = open.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        for entry in entries {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let name = path.strip_prefix(root()).unwrap().to_string_lossy().replace('\\', "/");
                files.push((name, std::fs::read_to_string(&path).unwrap()));
            }
        }
    }
    files.sort();
    files
}

/// The room of a source file: the first part of its path below `src/`.
fn room(file: &str) -> Option<&str> {
    let rest = file.strip_prefix("src/")?;
    let room = rest.split('/').next()?.trim_end_matches(".rs");
    ROOMS.contains(&room).then_some(room)
}

/// The part of a source file before its tests.
fn without_tests(text: &str) -> &str {
    let inline = |line: &str| line.contains("mod ") && line.contains('{');
    let mut ends = text.match_indices("\n#[cfg(test)]\n");
    let end = ends.find(|(at, mark)| text[at + mark.len()..].lines().next().is_some_and(inline));
    end.map_or(text, |(at, _)| &text[..at])
}

/// Whether a file holds only tests: its parent declares it under `#[cfg(test)]`, or is such a file itself.
fn is_test_file(file: &str, all: &[(String, String)]) -> bool {
    let (folder, name) = file.rsplit_once('/').unwrap_or(("", file));
    let module = name.trim_end_matches(".rs");
    let parents = [format!("{folder}/mod.rs"), format!("{folder}.rs")];
    let declared = ["", "pub ", "pub(crate) ", "pub(super) "].map(|visible| format!("#[cfg(test)]\n{visible}mod {module};"));
    let mut of = all.iter().filter(|(f, _)| parents.contains(f));
    of.any(|(f, text)| declared.iter().any(|d| text.contains(d.as_str())) || f != file && is_test_file(f, all))
}

/// Source without comments and without the tests at its end.
fn code(text: &str) -> String {
    let lines = without_tests(text).lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

/// Paths of the form `crate::a::b` in `code`, groups `crate::{a, b::c}` taken apart.
fn uses(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        // `$crate::` of a macro and `mycrate::` are no paths of this kind.
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = &code[at + "crate::".len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let mut depth = 0;
            let mut path = String::new();
            for c in group.chars() {
                match c {
                    '{' => depth += 1,
                    '}' if depth == 0 => break,
                    '}' => depth -= 1,
                    ',' if depth == 0 => found.push(std::mem::take(&mut path).trim().to_string()),
                    _ if depth == 0 => path.push(c),
                    _ => {}
                }
            }
            found.push(path.trim().to_string());
        } else {
            found.push(rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_' || *c == ':').collect());
        }
    }
    found.retain(|path| !path.is_empty());
    found
}

#[test]
fn a_room_uses_only_the_rooms_before_it() {
    let mut wrong = Vec::new();
    let all = sources("src");
    for (file, text) in all.iter().filter(|(file, _)| !is_test_file(file, &all)) {
        let Some(from) = room(file) else { continue };
        let place = |room: &str| ROOMS.iter().position(|r| *r == room);
        for path in uses(&code(text)) {
            let to = path.split("::").next().unwrap_or_default();
            if let Some(to_place) = place(to)
                && Some(to_place) > place(from)
            {
                wrong.push(format!("{file}: room `{from}` uses `{path}`, which stands after it"));
            }
            for (room, other, why) in FORBIDDEN {
                if from == room && (path == other || path.starts_with(&format!("{other}::"))) {
                    wrong.push(format!("{file}: room `{room}` must not use `{other}`: {why}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn no_files_form_a_circle() {
    let all = sources("src");
    let code: Vec<(String, String)> =
        all.iter().filter(|(file, _)| !is_test_file(file, &all)).map(|(file, text)| (file.clone(), code(text))).collect();
    let found = circles::circles(&circles::read(&code));
    let lines: Vec<String> = found.iter().map(|c| c.join(" ")).collect();
    assert!(found.is_empty(), "files that need one another:\n{}", lines.join("\n"));
}

#[test]
fn the_table_of_rooms_is_complete() {
    let lib = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let declared: Vec<&str> = lib.lines().filter_map(|l| l.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    for room in &declared {
        assert!(ROOMS.contains(room), "`{room}` of src/lib.rs is not in the table of rooms");
    }
    for room in ROOMS {
        assert!(declared.contains(&room), "`{room}` of the table of rooms is not in src/lib.rs");
    }
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    for room in ROOMS {
        assert!(text.contains(&format!("`{room}`")), "ARCHITECTURE.md does not name the room `{room}`");
    }
}

#[test]
fn paths_are_taken_apart() {
    let code = code(
        "use crate::a::X; // crate::no\nuse crate::{b::{self, Y}, c};\nlet z = crate::d::f();\n#[cfg(test)]\nmod tests { use crate::e; }",
    );
    assert_eq!(uses(&code), ["a::X", "b::", "c", "d::f"]);
}

#[test]
fn every_file_opens_with_its_idea() {
    let wrong: Vec<String> = ["src", "tests", "benches", "examples"]
        .iter()
        .flat_map(|f| sources(f))
        .filter(|(_, text)| !text.starts_with("//!"))
        .map(|(f, _)| f)
        .collect();
    assert!(wrong.is_empty(), "no `//!` at the head of {wrong:?}");
}

#[test]
fn no_file_grows_beyond_one_idea() {
    let long: Vec<String> = sources("src")
        .iter()
        .map(|(f, t)| (f, without_tests(t).lines().count()))
        .filter(|(_, lines)| *lines > LONGEST)
        .map(|(f, lines)| format!("{f}: {lines}"))
        .collect();
    assert!(long.is_empty(), "longer than {LONGEST} lines: {long:?}");
}

#[test]
fn nothing_unfinished_stands_in_the_source() {
    // Written in parts, so that this file does not find itself.
    let never = [
        "dbg".to_string() + "!(",
        "todo".to_string() + "!(",
        "unimplemented".to_string() + "!(",
        "#[ign".to_string() + "ore",
        "FIX".to_string() + "ME",
    ];
    let mut wrong = Vec::new();
    for (file, text) in ["src", "tests", "benches", "examples"].iter().flat_map(|f| sources(f)) {
        for (n, line) in text.lines().enumerate() {
            wrong.extend(never.iter().filter(|w| line.contains(w.as_str())).map(|w| format!("{file}:{}: {w}", n + 1)));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn no_effect_is_known_by_name_outside_physics() {
    // What lays out a valve with a fault, as a person would in a valve file; and the plant that is written apart from the effects.
    let writers = ["src/cli/paper_search.rs", "src/cli/metrics_page.rs", "src/cli/init/recordings.rs"];
    let all = sources("src");
    let id = |text: &str| Some(text.split_once("fn id(&self) -> &'static str {")?.1.split('"').nth(1)?.to_string());
    let ids: Vec<String> = all
        .iter()
        .filter(|(file, text)| room(file) == Some("physics") && text.contains("impl Effect for"))
        .filter_map(|(_, t)| id(t))
        .collect();
    assert!(ids.len() > 30 && ids.contains(&"stiction".to_string()), "{ids:?}");
    let mut wrong = Vec::new();
    for (file, text) in all.iter().filter(|(file, _)| !is_test_file(file, &all) && !writers.contains(&file.as_str())) {
        if ["physics", "challenge"].contains(&room(file).unwrap_or_default()) {
            continue;
        }
        let code = code(text);
        wrong.extend(code.split('"').filter(|part| ids.iter().any(|id| id == part)).map(|id| format!("{file}: \"{id}\"")));
    }
    assert!(wrong.is_empty(), "an effect says itself what it is: {wrong:?}");
}

#[test]
fn the_maths_reads_no_clock_and_no_file() {
    // A valve model, a plan and a recording are read from files by the rooms that own them; these compute only.
    let wrong: Vec<String> = sources("src")
        .iter()
        .filter(|(file, _)| ["physics", "control", "metrics", "limits"].contains(&room(file).unwrap_or_default()))
        .flat_map(|(file, text)| {
            let code = code(text);
            ["std::fs", "std::net", "SystemTime", "Instant::now", "jiff::"]
                .iter()
                .filter(|w| code.contains(**w))
                .map(|w| format!("{file}: {w}"))
                .collect::<Vec<_>>()
        })
        .collect();
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn a_panic_is_no_answer_to_bad_input() {
    // Outside tests, `expect` is allowed only where its message says why it cannot happen.
    let mut wrong = Vec::new();
    let all = sources("src");
    for (file, text) in all.iter().filter(|(file, _)| !is_test_file(file, &all)) {
        for (n, line) in code(text).lines().enumerate() {
            if line.contains(".unwrap()") || line.contains("panic!(") {
                wrong.push(format!("{file}:{}: {}", n + 1, line.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

/// A file of tests that no module names would be compiled by nobody and fail never.
#[test]
fn every_file_of_the_integration_tests_is_a_module_of_theirs() {
    for program in ["tests/it", "tests/devices"] {
        let main = std::fs::read_to_string(root().join(program).join("main.rs")).unwrap();
        let files = std::fs::read_dir(root().join(program)).unwrap().map(|e| e.unwrap().path());
        let names =
            files.filter(|f| f.extension().is_some_and(|e| e == "rs")).map(|f| f.file_stem().unwrap().to_string_lossy().into_owned());
        let forgotten: Vec<String> = names.filter(|n| n != "main" && !main.contains(&format!("mod {n};\n"))).collect();
        assert!(forgotten.is_empty(), "{program}: {forgotten:?}");
    }
}
