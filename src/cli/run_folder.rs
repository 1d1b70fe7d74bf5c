//! The folder that a run leaves: trace, page, JUnit, and last the record, so that a record means a whole folder.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::CliError;
use crate::output::{folder_name, make_folder};
use crate::record::{TestRecord, Trace};
use crate::recording::{Cells, Column, RecordingError, Values, read_parquet, replace_file, write_parquet_stating};
use crate::report;
use crate::rig::Quality;
use crate::valve::Input;

/// The folder of a run that named none: the first `reports/runs/<plan>-<serial>-<n>` that does not exist.
pub fn new_folder(plan: &str, serial: &str) -> Result<PathBuf, CliError> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let plan: String = plan.chars().map(|c| if plain(c) { c } else { '_' }).collect();
    let serial = folder_name(serial);
    let runs = Path::new("reports/runs");
    make_folder(runs).map_err(|e| CliError::not_stored(format!("{}: {e}", runs.display())))?;
    for n in 1u32.. {
        let folder = runs.join(format!("{plan}-{serial}-{n}"));
        match std::fs::create_dir(&folder) {
            Ok(()) => return Ok(folder),
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(CliError::not_stored(format!("{}: {e}", folder.display()))),
        }
    }
    Err(CliError::not_stored(format!("{}: no free number", runs.display())))
}

/// Writes the run; each file is whole or not there, the record comes last.
pub fn write(folder: &Path, record: &TestRecord, trace: &Trace) -> Result<(), CliError> {
    let all = || -> Result<(), RecordingError> {
        write_trace(&folder.join("trace.parquet"), record, trace)?;
        write_text(&folder.join("report.html"), &report::html(record, trace))?;
        write_text(&folder.join("junit.xml"), &report::junit(record))?;
        write_text(&folder.join("record.json"), &report::json(record))
    };
    all().map_err(CliError::not_stored)
}

/// Writes a text file; it is whole or not there.
pub fn write_text(path: &Path, text: &str) -> Result<(), RecordingError> {
    replace_file(path, |file| file.write_all(text.as_bytes()))
}

/// The trace with the names of the recording format, so that it is a recording too.
fn write_trace(path: &Path, record: &TestRecord, trace: &Trace) -> Result<(), RecordingError> {
    let phases: Vec<&str> = trace.phase.iter().map(|p| record.phases.get(usize::from(*p)).map_or("", |p| p.name.as_str())).collect();
    let quality: Vec<&str> = trace.quality.iter().map(|q| q.name()).collect();
    let numbers = |name, values| Column { name, values: Values::Numbers(values) };
    let mut table = vec![
        numbers("time_s", &trace.time_s),
        Column { name: "phase", values: Values::Texts(&phases) },
        numbers("target_bar", &trace.target_bar),
        numbers("current_a", &trace.current_a),
        numbers("feed_forward_a", &trace.feed_forward_a),
        numbers("feedback_a", &trace.feedback_a),
        numbers("pressure_bar", &trace.pressure_bar),
        numbers("current_meas_a", &trace.current_meas_a),
        Column { name: "quality", values: Values::Texts(&quality) },
        numbers("lateness_s", &trace.lateness_s),
        numbers("round_trip_s", &trace.round_trip_s),
    ];
    for (name, values) in [("oil_temp_c", &trace.oil_temp_c), ("supply_bar", &trace.supply_bar)] {
        if values.iter().any(|v| v.is_finite()) {
            table.push(numbers(name, values));
        }
    }
    // What a driver is told stands until the next message.
    write_parquet_stating(path, &[table], Some(Input::Held))
}

/// The trace beside a record; `None` where there is none.
pub fn read_trace(folder: &Path, record: &TestRecord) -> Result<Option<Trace>, CliError> {
    let path = folder.join("trace.parquet");
    if !path.is_file() {
        return Ok(None);
    }
    let mut columns = read_parquet(&path).map_err(CliError::input)?;
    let mut take = |name: &str| columns.iter().position(|c| c.0 == name).map(|at| columns.swap_remove(at).1);
    let texts = |cells: Option<Cells>| match cells {
        Some(Cells::Texts(texts)) => texts,
        _ => Vec::new(),
    };
    let (phases, quality) = (texts(take("phase")), texts(take("quality")));
    let mut numbers = |name: &str| match take(name) {
        Some(Cells::Numbers(values)) => values,
        _ => Vec::new(),
    };
    let mut trace = Trace {
        time_s: numbers("time_s"),
        target_bar: numbers("target_bar"),
        current_a: numbers("current_a"),
        feed_forward_a: numbers("feed_forward_a"),
        feedback_a: numbers("feedback_a"),
        pressure_bar: numbers("pressure_bar"),
        current_meas_a: numbers("current_meas_a"),
        oil_temp_c: numbers("oil_temp_c"),
        supply_bar: numbers("supply_bar"),
        lateness_s: numbers("lateness_s"),
        round_trip_s: numbers("round_trip_s"),
        ..Trace::default()
    };
    let number = |name: &String| record.phases.iter().position(|p| p.name == *name).unwrap_or_default();
    trace.phase = phases.iter().map(|name| u16::try_from(number(name)).unwrap_or_default()).collect();
    trace.quality = quality.iter().map(|name| Quality::by_name(name).unwrap_or(Quality::Good)).collect();
    // A column that an older version did not write is one of gaps.
    let samples = trace.time_s.len();
    for values in [
        &mut trace.target_bar,
        &mut trace.current_a,
        &mut trace.feed_forward_a,
        &mut trace.feedback_a,
        &mut trace.pressure_bar,
        &mut trace.current_meas_a,
        &mut trace.oil_temp_c,
        &mut trace.supply_bar,
        &mut trace.lateness_s,
        &mut trace.round_trip_s,
    ] {
        values.resize(samples, f64::NAN);
    }
    Ok((samples > 0).then_some(trace))
}
