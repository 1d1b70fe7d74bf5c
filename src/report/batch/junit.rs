//! The batch for a CI server: one case per valve and measurement.
//!
//! Written as it goes, since a large batch has hundreds of thousands of cases.

use std::io::{self, Write};

use crate::batch::summary::BatchSummary;
use crate::batch::tally::{Attempt, Tally, deciding};
use crate::record::{Origin, Outcome};
use crate::report::format;

/// Writes the deciding attempt of every valve: a case for the valve, and one for every measurement that has a limit.
///
/// # Errors
/// What `out` says.
pub fn junit(summary: &BatchSummary, tally: &Tally, out: &mut dyn Write) -> io::Result<()> {
    let (mut tests, mut failures, mut errors, mut skipped) = (0, 0, 0, 0);
    for valve in tally.valves() {
        for case in cases(deciding(valve), tally) {
            tests += 1;
            match case.outcome {
                Outcome::Fail => failures += 1,
                Outcome::Invalid | Outcome::Error | Outcome::Aborted => errors += 1,
                Outcome::NotRun => skipped += 1,
                Outcome::Pass | Outcome::Marginal => {}
            }
        }
    }
    let name = escape(&summary.batch.plan);
    let counts = format!("tests=\"{tests}\" failures=\"{failures}\" errors=\"{errors}\"");
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"hil {name}\" {counts}>")?;
    writeln!(out, "  <testsuite name=\"{name}\" {counts} skipped=\"{skipped}\">")?;
    writeln!(out, "    <properties>")?;
    for (key, value) in [("simulated", summary.batch.simulated.to_string()), ("plan.sha256", summary.batch.plan_sha256.clone())] {
        writeln!(out, "      <property name=\"{key}\" value=\"{}\"/>", escape(&value))?;
    }
    for serial in &summary.safe_state_not_confirmed {
        writeln!(out, "      <property name=\"safe_state\" value=\"NOT CONFIRMED: {}\"/>", escape(serial))?;
    }
    if summary.origin == Origin::Emulated {
        writeln!(out, "      <property name=\"emulated\" value=\"true\"/>")?;
    }
    writeln!(out, "    </properties>")?;
    for valve in tally.valves() {
        let attempt = deciding(valve);
        let class = escape(&format!("{}.{}", summary.batch.plan, attempt.dut.serial));
        for case in cases(attempt, tally) {
            write!(out, "    <testcase classname=\"{class}\" name=\"{}\"", escape(&case.name))?;
            let element = match case.outcome {
                Outcome::Pass | Outcome::Marginal => None,
                Outcome::Fail => Some("failure"),
                Outcome::NotRun => Some("skipped"),
                Outcome::Invalid | Outcome::Error | Outcome::Aborted => Some("error"),
            };
            match element {
                None => writeln!(out, "/>")?,
                Some("skipped") => writeln!(out, "><skipped message=\"{}\"/></testcase>", escape(&case.message))?,
                Some(element) => {
                    let kind = case.outcome.text();
                    writeln!(out, "><{element} type=\"{kind}\" message=\"{}\"/></testcase>", escape(&case.message))?;
                }
            }
        }
    }
    writeln!(out, "  </testsuite>\n</testsuites>")
}

struct Case {
    name: String,
    outcome: Outcome,
    message: String,
}

/// The case of the valve fails only for what no measurement tells.
fn cases<'a>(attempt: &'a Attempt, tally: &'a Tally) -> impl Iterator<Item = Case> + 'a {
    let told = attempt.outcome == Outcome::Fail && attempt.values.iter().any(|v| v.1 == Outcome::Fail);
    let outcome = if told { Outcome::Pass } else { attempt.outcome };
    let whole = Case { name: "valve".into(), outcome, message: attempt.reason.clone().unwrap_or_default() };
    let measured = tally.metrics().iter().zip(&attempt.values).filter_map(|(m, (value, outcome))| {
        let limit = m.limit.as_ref()?;
        let number = |v: f64| format::number(v, &m.unit);
        let value = if value.is_nan() { "not measured".to_string() } else { format::quantity(*value, &m.unit) };
        let min = limit.min.map_or_else(String::new, |v| format!(", at least {}", number(v)));
        let max = limit.max.map_or_else(String::new, |v| format!(", at most {}", number(v)));
        Some(Case { name: format!("{}: {}", m.phase, m.metric), outcome: *outcome, message: format!("{value}{min}{max}") })
    });
    std::iter::once(whole).chain(measured)
}

/// XML text: the five special characters, and nothing that XML cannot hold.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' => out.push_str("&#10;"),
            c if c < ' ' => {}
            c => out.push(c),
        }
    }
    out
}
