//! The report for a CI server: one test case per phase and per measurement with a limit.
//!
//! A limit that was missed is a failure; a rig that failed, a broken clock or an abort is an error; what did not
//! run is skipped. No times and no hosts, so that equal records give equal bytes.

use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};

use super::format;
use crate::record::{Measurement, Outcome, PhaseRecord, TestRecord};

/// The record as JUnit XML.
pub fn junit(record: &TestRecord) -> String {
    let mut report = Report::new(format!("hil {}", record.plan.name));
    let mut suite = TestSuite::new(format!("{} on {}", record.plan.name, record.dut.serial));
    for (name, value) in [
        ("simulated", record.simulated.to_string()),
        ("outcome", record.outcome.text().to_string()),
        ("plan.sha256", record.plan.sha256.clone()),
        ("dut.serial", record.dut.serial.clone()),
        ("rig", format!("{} {}", record.rig.kind, record.rig.name)),
        ("seed", record.seed.to_string()),
    ] {
        suite.add_property(Property::new(name, value));
    }
    if record.rig.emulated {
        suite.add_property(Property::new("emulated", "true"));
    }
    if record.ended_unsafe() {
        let evidence = record.safe_state.as_ref().map_or("", |s| s.evidence.as_str());
        let mut case = TestCase::new("safe state", status(Outcome::Error, &format!("{}: {evidence}", format::UNSAFE), true));
        case.set_classname(record.plan.name.as_str());
        suite.add_property(Property::new("safe_state", "NOT CONFIRMED"));
        suite.add_test_case(case);
    }
    // What is said of the run as a whole; a missed limit is told by its own case.
    let whole = if record.outcome.is_broken() { record.outcome } else { Outcome::Pass };
    let mut run = TestCase::new("run", status(whole, &record.reasons.join("; "), true));
    run.set_classname(record.plan.name.as_str());
    suite.add_test_case(run);
    for phase in &record.phases {
        suite.add_test_case(phase_case(record, phase));
        for measurement in phase.measurements.iter().filter(|m| m.limit.is_some()) {
            let message = format!("{}, limit {}{}", format::value(measurement), format::limit(measurement), reason(measurement));
            let name = format!("{}: {}", phase.name, format::definition(measurement));
            let mut case = TestCase::new(name, status(measurement.outcome, &message, false));
            case.set_classname(record.plan.name.as_str());
            if measurement.outcome == Outcome::Marginal {
                case.set_system_out(format!("MARGINAL: {message}, warns {}", format::warning(measurement)));
            }
            suite.add_test_case(case);
        }
    }
    report.add_test_suite(suite);
    // Writing to memory fails only on characters that XML cannot hold, and quick-junit removes those.
    report.to_string().unwrap_or_default()
}

fn phase_case(record: &TestRecord, phase: &PhaseRecord) -> TestCase {
    // A missed limit is told by its own case; the phase repeats only what no measurement says.
    let told = phase.outcome == Outcome::Fail && phase.measurements.iter().any(|m| m.outcome == Outcome::Fail);
    let outcome = if told { Outcome::Pass } else { phase.outcome };
    let mut case = TestCase::new(
        format!("{}: phase ran", phase.name),
        status(
            outcome,
            phase.reason.as_deref().unwrap_or(""),
            phase.span_s.is_some() || phase.prompt.as_ref().is_some_and(|p| p.answer.is_some()),
        ),
    );
    case.set_classname(record.plan.name.as_str());
    let seen: Vec<String> = phase
        .measurements
        .iter()
        .filter(|m| m.limit.is_none())
        .map(|m| format!("{} = {}{}", format::definition(m), format::value(m), reason(m)))
        .collect();
    if !seen.is_empty() {
        case.set_system_out(seen.join("\n"));
    }
    case
}

fn reason(measurement: &Measurement) -> String {
    measurement.reason.as_ref().map_or_else(String::new, |r| format!(" ({r})"))
}

/// `ran`: whether NOT_RUN only means that there was no limit to judge by.
fn status(outcome: Outcome, message: &str, ran: bool) -> TestCaseStatus {
    let kind = match outcome {
        Outcome::Pass | Outcome::Marginal => return TestCaseStatus::success(),
        Outcome::NotRun if ran => return TestCaseStatus::success(),
        Outcome::NotRun => {
            let mut skipped = TestCaseStatus::skipped();
            skipped.set_message(message);
            return skipped;
        }
        Outcome::Fail => NonSuccessKind::Failure,
        Outcome::Invalid | Outcome::Error | Outcome::Aborted => NonSuccessKind::Error,
    };
    let mut status = TestCaseStatus::non_success(kind);
    status.set_type(outcome.text()).set_message(message);
    status
}
