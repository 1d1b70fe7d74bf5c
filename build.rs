//! Collects the sources whose doc comments `hil explain` prints and the files that ship inside the binary, so that no
//! list of them has to be kept.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Rooms that hold the terms of the trade; the effects of `physics` carry their own pages.
const ROOMS: [&str; 9] = ["metrics", "control", "valve", "plan", "limits.rs", "record", "identify", "batch", "diagnose/diagnosis.rs"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=src");
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?).join("src");
    let mut table = String::from("&[\n");
    for room in ROOMS {
        let mut files = Vec::new();
        collect(&root.join(room), &mut files)?;
        files.sort();
        for file in files {
            let place = file.strip_prefix(&root)?.iter().map(|p| p.to_string_lossy()).collect::<Vec<_>>().join("/");
            writeln!(table, "    ({place:?}, {:?}),", documented(&std::fs::read_to_string(&file)?))?;
        }
    }
    table.push_str("]\n");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("sources.rs"), table)?;
    std::fs::write(out.join("shipped.rs"), shipped()?)?;
    Ok(())
}

/// Plans, valves, profiles and the example of a batch, as pairs of path and text, so that the binary needs no repository.
fn shipped() -> Result<String, Box<dyn std::error::Error>> {
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?);
    let mut table = String::from("&[\n");
    for folder in ["plans", "valves", "drivers", "examples/batch"] {
        println!("cargo:rerun-if-changed={folder}");
        let mut files: Vec<PathBuf> = std::fs::read_dir(root.join(folder))?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
        files.sort();
        for file in files.iter().filter(|f| f.extension().is_some_and(|e| e == "toml")) {
            let name = file.file_name().map(|n| n.to_string_lossy()).unwrap_or_default();
            writeln!(table, "    ({:?}, include_str!({:?})),", format!("{folder}/{name}"), file.display().to_string())?;
        }
    }
    table.push_str("]\n");
    Ok(table)
}

/// What `hil explain` reads of a source: the comment at its head, each doc comment with the line that it stands before, and where a type
/// begins and ends. The code itself would be a megabyte of the binary.
fn documented(source: &str) -> String {
    let (mut kept, mut documents) = (String::new(), false);
    for line in source.lines().take_while(|l| !l.starts_with("#[cfg(test)]")) {
        let text = line.trim_start();
        let doc = text.starts_with("///") || text.starts_with("#[doc(alias");
        let beside = text.starts_with("#[") || (text.starts_with("//") && !doc);
        let bound = line == "}" || (text.starts_with("pub ") && text.ends_with('{'));
        if doc || line.starts_with("//!") || (!beside && (documents || bound)) {
            kept.push_str(line);
            kept.push('\n');
        }
        documents = doc || (documents && beside);
    }
    kept
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if path.is_file() {
        files.push(path.into());
    } else if path.is_dir() {
        for entry in std::fs::read_dir(path)? {
            let entry = entry?.path();
            if entry.is_dir() || entry.extension().is_some_and(|e| e == "rs") {
                collect(&entry, files)?;
            }
        }
    }
    Ok(())
}
