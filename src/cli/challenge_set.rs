//! `hil challenge --record`: a set of recordings with its truth beside it, for whoever wants to judge a diagnosis with a
//! program of their own.

use std::path::Path;
use std::process::Command;

use rayon::prelude::*;
use serde_json::{Map, Value, json};

use super::{CliError, CliResult, exit};
use crate::challenge::{
    BROKEN, Case, Range, Session, UNKNOWN, break_record, draw_healthy, draw_series, record_session, truth_of, write_run, write_text,
};
use crate::recording::{Recording, Run};

/// Writes `count` valves, or each kind of broken recording in turn, below `out`.
pub(super) fn write(out: &Path, seed: u64, count: usize, range: Range, broken: bool) -> CliResult {
    let cases = if broken { draw_healthy(seed, count, range) } else { draw_series(seed, count, range) };
    let entries: Vec<Result<(String, Value), String>> = cases
        .par_iter()
        .enumerate()
        .map(|(k, case)| {
            let name = format!("{:08x}", (case.seed >> 16) as u32);
            let folder = out.join(&name);
            std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
            anstream::eprintln!("case {} of {} ..", k + 1, cases.len());
            let how = BROKEN[k % BROKEN.len()];
            let (session, twin) = if broken {
                (break_record(case, how), None)
            } else {
                let (valve, twin) = record_session(case);
                (valve, Some(twin))
            };
            files(&folder, &session)?;
            let mut truth = truth_of(case);
            if broken {
                truth["broken"] = json!(how.name());
            }
            if let Some(twin) = twin {
                let floors = floors(&folder.join("twin"), &twin)?;
                for (part, floor) in ["record", "holdout"].into_iter().zip(floors) {
                    truth[part] = json!({ "floor": floor, "noise": case.noise_bar() });
                }
            }
            Ok((name, judged(case, truth)))
        })
        .collect();
    let mut all = Map::new();
    for entry in entries {
        let (name, truth) = entry.map_err(CliError::not_stored)?;
        all.insert(name, truth);
    }
    write_text(&out.join("truth.json"), &format!("{:#}\n", Value::Object(all))).map_err(CliError::not_stored)?;
    Ok(exit::DONE)
}

fn files(folder: &Path, session: &Session) -> Result<(), String> {
    let file = |name: &str, run: &Run| write_run(&folder.join(name), run).map_err(|e| e.to_string());
    file("sweep.csv", &session.sweep)?;
    if let Some(commission) = &session.commission {
        file("commission.csv", commission)?;
    }
    file("record.csv", &session.record)?;
    file("holdout.csv", &session.holdout)
}

/// What a model identified from the healthy twin's sweep leaves of its drives [bar]. The folder is scratch.
fn floors(folder: &Path, twin: &Session) -> Result<[f64; 2], String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    // What a run that was stopped has left is made anew.
    if folder.exists() {
        std::fs::remove_dir_all(folder).map_err(failed)?;
    }
    std::fs::create_dir_all(folder).map_err(failed)?;
    files(folder, twin)?;
    let program = std::env::current_exe().map_err(|e| e.to_string())?;
    let call = |args: &[&str]| {
        let done = Command::new(&program).args(args).current_dir(folder).output().map_err(|e| e.to_string())?;
        if done.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&done.stderr).into_owned()) }
    };
    call(&["identify", "sweep.csv", "-o", "model.toml"])?;
    let mut floors = [0.0; 2];
    for (floor, (name, run)) in floors.iter_mut().zip([("record.csv", &twin.record), ("holdout.csv", &twin.holdout)]) {
        let out = format!("simulated-{name}");
        call(&["simulate", name, "--model", "model.toml", "-o", &out])?;
        let out = Recording::read(&folder.join(&out), &[]).map_err(|e| e.to_string())?;
        let simulated = out.runs.into_iter().next().and_then(|r| r.pressure_bar).unwrap_or_default();
        let measured = run.pressure_bar.as_deref().unwrap_or_default();
        *floor = (simulated.iter().zip(measured).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / measured.len() as f64).sqrt();
    }
    std::fs::remove_dir_all(folder).map_err(failed)?;
    Ok(floors)
}

/// The truth with the short keys that judges of such sets read.
fn judged(case: &Case, mut truth: Value) -> Value {
    let ids = case.ids();
    truth["kind"] = json!(if ids == [UNKNOWN] {
        vec![format!("unknown {}", case.effects[0].variant)]
    } else {
        ids.iter().map(|s| (*s).to_owned()).collect()
    });
    truth["fam"] = json!(case.family());
    truth["variant"] = json!(case.effects.first().map_or(0, |e| e.variant));
    truth["severity"] = json!(case.effects.first().map_or(0.0, |e| e.severity));
    truth["T"] = json!(case.length_s);
    truth["ar"] = json!(case.coloured());
    truth
}
