//! A record that the first version of the program has written, as it was accepted then, is shown by this one.

use std::process::Command;

use serde_json::Value;

const RECORD: &str = include_str!("records/first-version.json");

#[test]
fn a_record_of_the_first_version_is_shown_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("record.json"), RECORD).unwrap();
    let record: Value = serde_json::from_str(RECORD).unwrap();
    let shown = |format: &str| {
        let out = Command::new(env!("CARGO_BIN_EXE_hil")).arg("report").arg(folder.path()).args(["--format", format]).output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{format}: {}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    let measured: Vec<&Value> = record["phases"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|p| p["measurements"].as_array().unwrap())
        .filter(|m| m["value"].is_number())
        .collect();
    assert!(measured.len() > 5);
    let outcome = record["outcome"].as_str().unwrap();
    for format in ["text", "markdown", "html", "junit"] {
        let page = shown(format);
        assert!(page.contains(outcome), "{format}: {outcome}");
        // JUnit names what failed, and nothing did.
        for m in measured.iter().filter(|m| m["unit"] == "bar" && format != "junit") {
            let figure = format!("{:.3}", m["value"].as_f64().unwrap());
            assert!(page.contains(&figure), "{format}: {} = {figure}", m["metric"]);
        }
    }
    // What was known then is the same; what is known since then is absent, not made up.
    let again: Value = serde_json::from_str(&shown("json")).unwrap();
    for (key, value) in record.as_object().unwrap().iter().filter(|(key, _)| *key != "phases" && *key != "stability") {
        assert!(same(&again[key], value), "{key}: {} is not {value}", again[key]);
    }
}

/// Whether all that the older value holds stands in the newer one.
fn same(new: &Value, old: &Value) -> bool {
    match (new, old) {
        (Value::Object(new), Value::Object(old)) => old.iter().all(|(k, v)| new.get(k).map_or(v.is_null(), |n| same(n, v))),
        (Value::Array(new), Value::Array(old)) => new.len() == old.len() && new.iter().zip(old).all(|(n, o)| same(n, o)),
        _ => new == old,
    }
}
