//! `hil diagnose --jobs` and `hil collect` from outside: bad recordings are rows, what is done is not done again, a kill
//! loses nothing, parts add up.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use assert_cmd::Command;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// A valve's steps, ramps and holds along the shipped model, so short that a diagnosis takes a moment.
fn recordings(folder: &Path, count: usize) -> Outcome {
    std::fs::create_dir_all(folder.join("r"))?;
    let mut list = String::from("id,recording,model,lot,mileage\n");
    for k in 0..count {
        let mut text = String::from("time_s,current_a,pressure_bar\n");
        for n in 0..1500 {
            let t = f64::from(n) * 0.01;
            let i = 0.5 + 0.15 * (0.6 * t + k as f64).sin() + 0.08 * (2.3 * t).sin();
            text.push_str(&format!("{t:.2},{i:.5},0\n"));
        }
        let raw = folder.join(format!("raw{k}.csv"));
        std::fs::write(&raw, text)?;
        let recording = folder.join(format!("r/{k}.csv"));
        Command::cargo_bin("hil")?.arg("simulate").arg(&raw).args(["--model", "paper", "-o"]).arg(&recording).assert().success();
        list.push_str(&format!("job {k},r/{k}.csv,model.toml,L{},{}\n", k % 2, 1000 * k));
    }
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("valves/paper.toml"), folder.join("model.toml"))?;
    std::fs::write(folder.join("jobs.csv"), list)?;
    Ok(())
}

/// The last row of each id, without what tells calls apart.
fn rows(out: &Path) -> Result<BTreeMap<String, serde_json::Value>, Box<dyn std::error::Error>> {
    let mut rows = BTreeMap::new();
    for entry in std::fs::read_dir(out.join("rows"))? {
        for line in std::fs::read_to_string(entry?.path())?.lines() {
            let row: serde_json::Value = serde_json::from_str(line)?;
            let id = row["id"].as_str().unwrap_or_default().to_owned();
            assert!(rows.insert(id.clone(), row).is_none(), "{id} has two rows");
        }
    }
    Ok(rows)
}

fn diagnose(list: &Path, out: &Path, more: &[&str]) -> Result<std::process::Output, Box<dyn std::error::Error>> {
    Ok(Command::cargo_bin("hil")?.args(["diagnose", "--jobs"]).arg(list).arg("--out").arg(out).args(more).output()?)
}

#[test]
fn a_bad_recording_is_a_row_and_a_second_call_does_nothing_again() -> Outcome {
    let folder = tempfile::tempdir()?;
    recordings(folder.path(), 3)?;
    std::fs::write(folder.path().join("r/1.csv"), "time_s,current_a\n0,zero\n")?;
    let (list, out) = (folder.path().join("jobs.csv"), folder.path().join("out"));
    let done = diagnose(&list, &out, &[])?;
    assert_eq!(done.status.code(), Some(3), "{}", String::from_utf8_lossy(&done.stderr));
    let first = rows(&out)?;
    assert_eq!(first.len(), 3);
    assert!(first["job 1"]["status"] == "unusable" && first["job 1"]["error"].as_str().is_some_and(|e| e.contains("1.csv")));
    assert!(first["job 0"]["status"] == "done" && first["job 0"]["tags"]["lot"] == "L0" && first["job 0"]["verdict"].is_string());
    let again = diagnose(&list, &out, &[])?;
    assert_eq!(again.status.code(), Some(3), "the bad one still is");
    assert!(String::from_utf8_lossy(&again.stderr).contains("3 were done before"), "{}", String::from_utf8_lossy(&again.stderr));
    assert_eq!(rows(&out)?, first);

    let table = folder.path().join("fleet.parquet");
    let page = folder.path().join("fleet.html");
    let collected = || -> Result<std::process::Output, Box<dyn std::error::Error>> {
        Ok(Command::cargo_bin("hil")?
            .arg("collect")
            .arg(&out)
            .arg("-o")
            .arg(&table)
            .arg("--report")
            .arg(&page)
            .args(["--format", "json", "--fail-on", "new-finding"])
            .output()?)
    };
    let first = collected()?;
    assert_eq!(first.status.code(), Some(0), "{}", String::from_utf8_lossy(&first.stderr));
    let document: serde_json::Value = serde_json::from_slice(&first.stdout)?;
    assert!(document["schema"] == "hil.fleet/1" && document["recordings"] == 3 && document["unusable"] == 1, "{document}");
    let html = std::fs::read_to_string(&page)?;
    assert!(html.contains("Unusable inputs") && html.contains("job 1"));
    assert_eq!(collected()?.stdout, first.stdout, "collected again, the same");
    Ok(())
}

#[test]
fn parts_and_a_kill_give_the_rows_of_one_call() -> Outcome {
    let folder = tempfile::tempdir()?;
    recordings(folder.path(), 6)?;
    let (list, one, parts) = (folder.path().join("jobs.csv"), folder.path().join("one"), folder.path().join("parts"));
    assert_eq!(diagnose(&list, &one, &["--threads", "2"])?.status.code(), Some(0));
    let mut killed = std::process::Command::new(assert_cmd::cargo::cargo_bin("hil"))
        .args(["diagnose", "--threads", "1", "--jobs"])
        .arg(&list)
        .arg("--out")
        .arg(&parts)
        .stderr(Stdio::null())
        .spawn()?;
    std::thread::sleep(Duration::from_millis(700));
    killed.kill()?;
    killed.wait()?;
    for part in ["1/2", "2/2"] {
        assert_eq!(diagnose(&list, &parts, &["--shard", part, "--threads", "1"])?.status.code(), Some(0));
    }
    assert_eq!(rows(&parts)?, rows(&one)?);
    Ok(())
}

#[test]
fn many_recordings_in_one_parquet_file_are_as_many_jobs() -> Outcome {
    use hil::recording::{Column, Values, write_parquet};
    let folder = tempfile::tempdir()?;
    recordings(folder.path(), 2)?;
    let mut tables = Vec::new();
    let read: Vec<hil::recording::Recording> =
        (0..2).map(|k| hil::recording::Recording::read(&folder.path().join(format!("r/{k}.csv")), &[])).collect::<Result<_, _>>()?;
    for (recording, serial) in read.iter().zip(["V7", "V8"]) {
        let run = &recording.runs[0];
        let pressure = run.pressure_bar.as_deref().unwrap_or_default();
        tables.push(vec![
            Column { name: "serial", values: Values::Same(serial, run.len()) },
            Column { name: "model", values: Values::Same("model.toml", run.len()) },
            Column { name: "lot", values: Values::Same(if serial == "V7" { "L0" } else { "L1" }, run.len()) },
            Column { name: "time_s", values: Values::Numbers(&run.time_s) },
            Column { name: "current_a", values: Values::Numbers(&run.current_a) },
            Column { name: "pressure_bar", values: Values::Numbers(pressure) },
        ]);
    }
    let data = folder.path().join("all.parquet");
    write_parquet(&data, &tables)?;
    let (one, all) = (folder.path().join("one"), folder.path().join("all"));
    assert_eq!(diagnose(&folder.path().join("jobs.csv"), &one, &[])?.status.code(), Some(0));
    let done = diagnose(&data, &all, &["--group-by", "serial"])?;
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    let (one, grouped) = (rows(&one)?, rows(&all)?);
    for (job, serial) in [("job 0", "V7"), ("job 1", "V8")] {
        let row = &grouped[serial];
        assert_eq!(
            (&row["verdict"], &row["rmse_bar"], &row["tags"]["lot"]),
            (&one[job]["verdict"], &one[job]["rmse_bar"], &one[job]["tags"]["lot"])
        );
        assert!(row["recording"].as_str().is_some_and(|r| r.ends_with(&format!("all.parquet#serial={serial}"))), "{row}");
    }
    let again = diagnose(&data, &all, &["--group-by", "serial"])?;
    assert!(String::from_utf8_lossy(&again.stderr).contains("2 were done before"));
    assert_eq!(diagnose(&data, &all, &["--group-by", "vin"])?.status.code(), Some(3));
    Ok(())
}

#[test]
fn wrong_lists_and_parts_are_told() -> Outcome {
    let folder = tempfile::tempdir()?;
    let list = folder.path().join("jobs.csv");
    std::fs::write(&list, "id,recording\na,x.csv\na,y.csv\n")?;
    let wrong = diagnose(&list, &folder.path().join("out"), &[])?;
    assert!(wrong.status.code() == Some(3) && String::from_utf8_lossy(&wrong.stderr).contains("row 2"));
    assert_eq!(diagnose(&list, &folder.path().join("out"), &["--shard", "3/2"])?.status.code(), Some(2));
    Command::cargo_bin("hil")?.arg("diagnose").assert().code(2);
    Ok(())
}

#[test]
fn a_fleet_is_written_with_its_list_and_a_sealed_story() -> Outcome {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("fleet");
    Command::cargo_bin("hil")?.args(["challenge", "--seed", "3", "--fleet", "30", "--out"]).arg(&out).assert().success();
    let list = std::fs::read_to_string(out.join("jobs.csv"))?;
    assert_eq!(list.lines().count(), 31);
    assert!(out.join("recordings/00030.csv").exists() && out.join("models/P1.csv").exists());
    let truth: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("sealed/truth.json"))?)?;
    let told = serde_json::json!({ "findings": [{ "column": "lot", "group": truth["lot"], "what": truth["effect"],
        "onset": { "column": "mileage", "at": truth["onset_km"] } }] });
    let collected = folder.path().join("collected.json");
    std::fs::write(&collected, told.to_string())?;
    let score = |path: &Path| -> Result<std::process::Output, Box<dyn std::error::Error>> {
        Ok(Command::cargo_bin("hil")?
            .args(["challenge", "--seed", "3", "--fleet", "30", "--out"])
            .arg(&out)
            .arg("--collected")
            .arg(path)
            .output()?)
    };
    assert_eq!(score(&collected)?.status.code(), Some(0));
    std::fs::write(&collected, "{\"findings\":[]}")?;
    assert_eq!(score(&collected)?.status.code(), Some(1));
    Ok(())
}
