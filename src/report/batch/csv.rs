//! Every measurement of every attempt as CSV.

use std::io::{self, Write};

use crate::batch::tally::Tally;
use crate::output::inert;
use crate::record::{Origin, Outcome};

/// Writes one row per attempt and metric; a value that does not exist is an empty field.
///
/// # Errors
/// What `out` says.
pub fn csv(tally: &Tally, out: &mut dyn Write) -> io::Result<()> {
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record([
        "position",
        "serial",
        "part_number",
        "revision",
        "lot",
        "attempt",
        "outcome",
        "simulated",
        "phase",
        "metric",
        "value",
        "unit",
        "min",
        "max",
        "verdict",
        "emulated",
    ])?;
    let number = |v: Option<f64>| v.filter(|v| v.is_finite()).map_or_else(String::new, |v| v.to_string());
    let bounds: Vec<(String, String)> =
        tally.metrics().iter().map(|m| m.limit.as_ref().map_or_else(Default::default, |l| (number(l.min), number(l.max)))).collect();
    for a in tally.attempts() {
        let (position, attempt) = (a.position.to_string(), a.number.to_string());
        let simulated = if a.origin == Origin::Simulated { "true" } else { "false" };
        let emulated = if a.origin == Origin::Emulated { "true" } else { "false" };
        let text = |text: &str| inert(text).into_owned();
        for ((m, (value, verdict)), (min, max)) in tally.metrics().iter().zip(&a.values).zip(&bounds) {
            if value.is_nan() && *verdict == Outcome::NotRun {
                continue;
            }
            writer.write_record([
                position.as_str(),
                &text(&a.dut.serial),
                &text(a.dut.part_number.as_deref().unwrap_or("")),
                &text(a.dut.revision.as_deref().unwrap_or("")),
                &text(a.dut.lot.as_deref().unwrap_or("")),
                &attempt,
                a.outcome.text(),
                simulated,
                &text(&m.phase),
                &text(&m.metric),
                &number(Some(*value)),
                &m.unit,
                min,
                max,
                verdict.text(),
                emulated,
            ])?;
        }
    }
    writer.flush()
}
