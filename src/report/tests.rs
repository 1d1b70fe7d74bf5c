//! A small record made by hand, with every kind of verdict, and what each report says of it.

use super::*;
use crate::record::*;
use crate::rig::RigIdentity;

fn measurement(metric: &str, value: Option<f64>, unit: &str, outcome: Outcome, definition: &str) -> Measurement {
    Measurement { metric: metric.into(), value, unit: unit.into(), limit: None, outcome, definition: definition.into(), reason: None }
}

/// A record with every kind of verdict.
pub(super) fn record() -> TestRecord {
    let limit = LimitRecord { max: Some(0.2), marginal_max: Some(0.18), bound: "inclusive".into(), ..LimitRecord::default() };
    let mut passed = measurement("rmse", Some(0.1234), "bar", Outcome::Pass, "rmse.delayed.v1(delay=20 ms)");
    passed.limit = Some(limit.clone());
    let mut marginal =
        measurement("rmse_band", Some(0.19), "bar", Outcome::Marginal, "rmse_band.delayed.v1(delay=20 ms, from=20 bar, to=26 bar)");
    marginal.limit = Some(limit.clone());
    let free = measurement("feedback_share", Some(0.0312), "1", Outcome::NotRun, "feedback_share.v1");
    let mut unsettled = measurement("settling_time", None, "s", Outcome::Fail, "settling_time.v1(band=2 %)");
    unsettled.limit = Some(LimitRecord { min: Some(0.01), max: Some(0.15), bound: "exclusive".into(), ..LimitRecord::default() });
    unsettled.reason = Some("the pressure left the band of +-0.100 bar again at 2.310 s and did not come back before the end".into());
    let phase = |name: &str, role: &str, outcome, span_s, measurements| PhaseRecord {
        name: name.into(),
        role: role.into(),
        outcome,
        reason: None,
        span_s,
        measurements,
        prompt: None,
    };
    let mut skipped = phase("drain", "teardown", Outcome::NotRun, None, vec![]);
    skipped.reason = Some("an earlier phase failed".into());
    TestRecord {
        schema: "hil.record/1".into(),
        plan: PlanIdentity {
            name: "tip-in".into(),
            sha256: "4f9a0d3c2b1e".repeat(5) + "abcd",
            parameters: vec![("kp".into(), "1 mA/bar".into()), ("peak".into(), "20 bar".into())],
            overridden: vec!["peak".into()],
        },
        dut: Dut { serial: "by-hand".into(), lot: Some("A<7>".into()), ..Dut::default() },
        rig: RigIdentity { kind: "sim".into(), name: "by-hand.toml".into(), sha256: "00ff".repeat(16), ..RigIdentity::default() },
        simulated: true,
        seed: 7,
        outcome: Outcome::Fail,
        reasons: vec![],
        phases: vec![
            phase("fill", "setup", Outcome::NotRun, Some((0.0, 0.5)), vec![]),
            phase("tip & hold", "main", Outcome::Fail, Some((0.51, 3.0)), vec![passed, marginal, free, unsettled]),
            skipped,
        ],
        timing: Timing { period_s: 0.01, samples: 301, ..Timing::default() },
        stability: Some(serde_json::json!({
            "loop": { "gain_bar_per_ma": 0.04, "lag_s": 0.01, "delay_s": 0.04, "kp_ma_per_bar": 1.0, "ki_ma_per_bar_s": 5.0 },
            "routh": { "kp_max_ma_per_bar": 37.5, "ki_max_ma_per_bar_s": 923.0 },
            "gain_margin_db": 29.366, "phase_margin_deg": 91.72, "delay_margin_s": 7.998, "max_sensitivity": 1.0354,
            "gain_crossover_rad_s": 0.20016, "phase_crossover_rad_s": 62.57,
            "sampled": { "rate_hz": 100.0, "gain_margin_db": 26.0, "phase_margin_deg": null },
            "stable": true,
            "boundary": { "routh": [[0.0, 937.5], [35.0, 500.0], [37.5, 0.0]], "exact": [[0.0, 700.0], [20.0, 400.0], [25.0, 0.0]] },
        })),
        model: None,
        safe_state: None,
        provenance: Some(Provenance { version: "0.1.0".into(), started: "2026-01-02T03:04:05Z".into(), station: None }),
    }
}

const VALVE: &str = r#"
schema = "hil.valve/1"
name = "by-hand"
current_limits = ["0 A", "1 A"]
hysteresis.hyperbolic.a = "0.8 bar^2"
delay = "20 ms"
[curve]
ascending = [-42.65, 92.5, -8.4, -2.03]
descending = [-40.01, 83.32, -1.3, -2.41]
"#;

/// A trace of 3 s with a rise, a fall and one stale sample.
pub(super) fn trace() -> Trace {
    let curves = crate::valve::Valve::from_toml(VALVE, "by-hand").unwrap().curves;
    let mut state = crate::valve::HyperbolaState::start(0.8, 0.3, curves.average_at(0.3));
    let mut trace = Trace::default();
    for n in 0..301u32 {
        let t = f64::from(n) * 0.01;
        let shape = if t < 0.5 { 0.0 } else { (std::f64::consts::PI * (t - 0.5) / 2.5).sin() };
        let current = 0.3 + 0.4 * shape;
        trace.time_s.push(t);
        trace.phase.push(u16::from(n > 50));
        trace.target_bar.push(curves.average_at(current));
        trace.current_a.push(current);
        trace.feed_forward_a.push(current - 0.002 * shape);
        trace.feedback_a.push(0.002 * shape);
        trace.pressure_bar.push(state.advance(&curves, current));
        trace.current_meas_a.push(f64::NAN);
        trace.quality.push(if n == 150 { crate::rig::Quality::Stale } else { crate::rig::Quality::Good });
        trace.lateness_s.push(0.0);
        trace.round_trip_s.push(0.0);
    }
    trace
}

#[test]
fn the_page_shows_every_part() {
    let mut record = record();
    record.model = Some(VALVE.into());
    record.timing.lateness_histogram = vec![(1e-6, 3), (1e-5, 200), (1e-4, 90), (1e-3, 8)];
    record.timing.period_histogram = vec![(0.0098, 10), (0.0100, 140), (0.0102, 145), (0.0104, 6)];
    let page = html(&record, &trace());
    for part in [
        "SIMULATION",
        "FAIL",
        "Pressure over current",
        "Stability boundary",
        "stale",
        "Lateness of the slots",
        "4f9a0d3c2b1e",
        "tip &amp; hold",
        "A&lt;7&gt;",
    ] {
        assert!(page.contains(part), "{part}");
    }
    // Self-contained: nothing is fetched.
    for fetch in ["src=", "href=", "@import", "url(", "http"] {
        assert!(!page.contains(fetch), "{fetch}");
    }
    assert!(!page.contains("NaN") && !page.contains("inf"));
    if let Some(path) = std::env::var_os("HIL_PAGE") {
        std::fs::write(path, page).unwrap();
    }
}

#[test]
fn text_of_every_verdict() {
    insta::assert_snapshot!(text(&record()));
}

#[test]
fn markdown_of_every_verdict() {
    insta::assert_snapshot!(markdown(&record()));
}

#[test]
fn junit_of_every_verdict() {
    insta::assert_snapshot!(junit(&record()));
}

#[test]
fn json_reads_back_as_the_same_record() {
    let record = record();
    assert_eq!(serde_json::from_str::<TestRecord>(&json(&record)).unwrap(), record);
}

proptest::proptest! {
    #[test]
    fn text_fits_80_columns(name in ".{0,200}", serial in ".{0,120}", reason in ".{0,300}", definition in "[a-z.() =]{0,120}", value in proptest::num::f64::NORMAL) {
        let mut record = record();
        record.plan.name = name;
        record.dut.serial = serial.clone();
        record.rig.name = serial;
        record.reasons.push(reason.clone());
        record.phases[1].name = reason.clone();
        record.phases[1].reason = Some(reason);
        record.phases[1].measurements[0].definition = definition;
        record.phases[1].measurements[1].value = Some(value.clamp(-1e6, 1e6));
        let text = text(&record);
        for line in text.lines() {
            proptest::prop_assert!(line.chars().count() <= COLUMNS, "{line:?}");
        }
    }

    #[test]
    fn no_report_lets_markup_in(name in "[<>&\"'|`a-z]{0,40}") {
        let mut record = record();
        record.plan.name = name.clone();
        record.phases[0].name = name.clone() + "<script>";
        proptest::prop_assert!(!markdown(&record).contains("<script>"));
        proptest::prop_assert!(!junit(&record).contains("<script>"));
    }
}
