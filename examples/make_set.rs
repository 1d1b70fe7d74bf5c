//! Writes a labelled set of concealed cases: `cargo run --example make_set -- OUT [--seed N] [--count N] [--severity S]`.
//!
//! With `--each`, every effect in both variants once, then pairs, healthy valves and unknown effects as drawn.

use std::error::Error;
use std::path::PathBuf;

use hil::challenge::{Concealed, EFFECTS, UNKNOWN, draw_series, placed, record_session, truth_of, write_run, write_text};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (mut out, mut seed, mut count, mut severity, mut each) = (None, 1_u64, 27_usize, None, false);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or(format!("{arg} needs a value"));
        match arg.as_str() {
            "--seed" => seed = value()?.parse()?,
            "--count" => count = value()?.parse()?,
            "--severity" => severity = Some(value()?.parse::<f64>()?),
            "--each" => each = true,
            _ => out = Some(PathBuf::from(arg)),
        }
    }
    let out = out.ok_or("usage: make_set OUT_DIR [--seed N] [--count N] [--severity S] [--each]")?;
    let mut cases = Vec::new();
    if each {
        for id in EFFECTS {
            for variant in 0..2 {
                cases.push(placed(seed + cases.len() as u64, vec![Concealed { id, variant, severity: 1.0 }]));
            }
        }
        for variant in 0..3 {
            cases.push(placed(seed + cases.len() as u64, vec![Concealed { id: UNKNOWN, variant, severity: 1.0 }]));
        }
        for _ in 0..5 {
            cases.push(placed(seed + cases.len() as u64, Vec::new()));
        }
    } else {
        cases = draw_series(seed, count);
    }
    let mut truth = serde_json::Map::new();
    for (k, mut case) in cases.into_iter().enumerate() {
        if let Some(severity) = severity {
            case.effects.iter_mut().for_each(|e| e.severity = severity);
            case.absorbed &= severity > 0.9;
        }
        let name = format!("{k:02}-{}", case.name());
        let (valve, twin) = record_session(&case);
        for (folder, session) in [(out.join(&name), &valve), (out.join("twins").join(&name), &twin)] {
            std::fs::create_dir_all(&folder)?;
            write_run(&folder.join("sweep.csv"), &session.sweep)?;
            write_run(&folder.join("record.csv"), &session.record)?;
            write_run(&folder.join("holdout.csv"), &session.holdout)?;
        }
        let mut entry = truth_of(&case);
        entry["variant"] = entry["variants"].get(0).cloned().unwrap_or(0.into());
        entry["severity"] = entry["severities"].get(0).cloned().unwrap_or(1.into());
        entry["fam"] = entry["family"].clone();
        entry["delay"] = entry["delay_s"].clone();
        let noise = case.noise_bar();
        for drive in ["record", "holdout"] {
            entry[drive] = serde_json::json!({ "floor": null, "noise": noise });
        }
        truth.insert(name, entry);
    }
    write_text(&out.join("truth.json"), &serde_json::to_string_pretty(&truth)?)?;
    Ok(())
}
