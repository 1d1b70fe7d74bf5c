//! `hil challenge --fleet N`: a fleet with a concealed story, as recordings and the list of its jobs; and whether what was
//! collected of it tells the story.

use std::fmt::Write as _;
use std::path::Path;

use rayon::prelude::*;
use serde_json::Value;

use super::{CliError, CliResult, exit};
use crate::challenge::{draw_fleet, tells, write_run, write_text};
use crate::digest;

/// Length of each recording [s].
const LENGTH_S: f64 = 60.0;

/// Writes `jobs.csv`, the recordings, a sweep for each part number, and the sealed truth.
pub(super) fn write(out: &Path, seed: u64, count: usize) -> CliResult {
    let fleet = draw_fleet(seed, count);
    for folder in ["recordings", "models", "sealed"].map(|f| out.join(f)) {
        std::fs::create_dir_all(&folder).map_err(|e| CliError::not_stored(format!("{}: {e}", folder.display())))?;
    }
    let truth = format!("{:#}\n", fleet.truth());
    let digest = digest::sha256(&truth);
    write_text(&out.join("sealed/truth.json"), &truth).map_err(CliError::not_stored)?;
    super::print(&format!("fleet of {count} valves, seed {seed}\nsealed truth: sha256 {digest}\n"))?;
    for part in 0..2 {
        write_run(&out.join(format!("models/P{part}.csv")), &fleet.sweep(part)).map_err(CliError::not_stored)?;
    }
    fleet
        .recordings(LENGTH_S)
        .map(|(valve, run)| write_run(&out.join(format!("recordings/{:05}.csv", valve.number)), &run))
        .collect::<Result<(), _>>()
        .map_err(CliError::not_stored)?;
    let mut list = String::from("id,recording,model,part_number,lot,supplier,date,mileage\n");
    for v in &fleet.valves {
        let _ = writeln!(
            list,
            "V{:05},recordings/{:05}.csv,identify:models/P{}.csv,P{},{},{},{},{:.0}",
            v.number, v.number, v.part, v.part, v.lot, v.supplier, v.date, v.mileage_km
        );
    }
    write_text(&out.join("jobs.csv"), &list).map_err(CliError::not_stored)?;
    Ok(exit::DONE)
}

/// Holds what `hil collect --format json` printed against the story. Exit code 1 where it is not told.
pub(super) fn score(collected: &Path, seed: u64, count: usize) -> CliResult {
    let wrong = |what: String| CliError::input(format!("{}: {what}", collected.display()));
    let text = std::fs::read_to_string(collected).map_err(|e| wrong(e.to_string()))?;
    let document: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let findings =
        document["findings"].as_array().ok_or_else(|| wrong("no `findings`; this is what `hil collect --format json` prints".into()))?;
    let fleet = draw_fleet(seed, count);
    let mut told = [false; 3];
    for f in findings {
        let word = |key: &str| f[key].as_str().unwrap_or_default();
        let onset = f["onset"]["at"].as_f64().filter(|_| f["onset"]["column"] == "mileage");
        let whats: Vec<&str> = f["or"].as_array().into_iter().flatten().filter_map(Value::as_str).chain([word("what")]).collect();
        let here = tells(&fleet, word("column"), word("group"), &whats, onset);
        if here.iter().filter(|t| **t).count() > told.iter().filter(|t| **t).count() {
            told = here;
        }
    }
    let (lot, effect, onset_km) = &fleet.story;
    super::print(&format!(
        "lot {lot}: {}\neffect {effect}: {}\nonset {onset_km:.0} km, within a tenth of the range: {}\n",
        yes(told[0]),
        yes(told[1]),
        yes(told[2])
    ))?;
    Ok(if told == [true; 3] { exit::DONE } else { exit::NEGATIVE })
}

fn yes(told: bool) -> &'static str {
    if told { "found" } else { "MISSED" }
}
