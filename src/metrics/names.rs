//! The names of all metrics: what a plan writes, what a record names, which definition it states.

use super::loop_width::tests::triangle;
use super::tests::Columns;
use super::*;

/// Each metric as a plan writes it, with parameters where it needs them.
const PLANNED: &str = r#"[
    {"rmse": {}}, {"rmse_band": {"from": "20 bar", "to": "26 bar"}}, {"max_error": {"delay": "40 ms"}}, {"steady_offset": {}},
    {"rise_time": {}}, {"fall_time": {}}, {"dead_time": {}}, {"settling_time": {}}, {"overshoot": {}},
    {"hysteresis_width": {}}, {"hysteresis_width_input": {"rated": "1 A"}}, {"linearity": {}}, {"linearity": {"line": "terminal"}},
    {"linearity": {"line": "least_squares"}}, {"repeatability": {"rated": "20 bar"}}, {"pressure_gain": {}}, {"start_current": {}},
    {"dead_band": {}}, {"threshold": {"rated": "1 A"}}, {"reversal_error": {}}, {"bandwidth_gain": {}}, {"bandwidth_phase": {}},
    {"temperature_sensitivity": {}}, {"supply_sensitivity": {}}, {"model_rmse": {}}, {"model_rmse_average": {}},
    {"feed_forward_share": {}}, {"feedback_share": {}}, {"max_pressure": {}}, {"min_pressure": {}}
]"#;

fn planned() -> Vec<(String, MetricSpec)> {
    let values: Vec<serde_json::Value> = serde_json::from_str(PLANNED).unwrap();
    let key = |v: &serde_json::Value| v.as_object().unwrap().keys().next().unwrap().clone();
    values.into_iter().map(|v| (key(&v), serde_json::from_value(v).unwrap())).collect()
}

#[test]
fn a_metric_is_recorded_under_the_name_that_the_plan_gives_it() {
    for (key, spec) in planned() {
        assert_eq!(spec.metric().id(), key);
        assert!(spec.check().is_ok(), "{key}: {:?}", spec.check());
    }
    // None is left out.
    let schema = serde_json::to_value(schemars::schema_for!(MetricSpec)).unwrap();
    let names: std::collections::BTreeSet<String> = planned().into_iter().map(|(key, _)| key).collect();
    assert_eq!(schema["oneOf"].as_array().unwrap().len(), names.len());
}

/// A record states by which definition a figure was taken; who compares two records compares these.
#[test]
fn definitions_are_what_records_state() {
    let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| 20.0 * triangle(t));
    let mut segment = columns.segment(0.02);
    segment.lag_s = 0.01;
    let stated: Vec<String> =
        planned().iter().map(|(_, s)| format!("{} [{}]", s.metric().definition(&segment), s.metric().unit().symbol)).collect();
    insta::assert_snapshot!(stated.join("\n"), @r"
    rmse.delayed.v1(delay=20 ms) [bar]
    rmse_band.delayed.v1(from=20 bar, to=26 bar, delay=20 ms) [bar]
    max_error.delayed.v1(delay=40 ms) [bar]
    steady_offset.mean.v1(window=0.5 s) [bar]
    rise_time.10_90.v1 [s]
    fall_time.10_90.v1 [s]
    dead_time.tangent_10_30.v1 [s]
    settling_time.last_exit.v1(band=5 %) [s]
    overshoot.over_final.v1 [1]
    hysteresis_width.max.v2(delay=20 ms, lag=10 ms, rate=0.0500 A/s) [bar]
    hysteresis_width_input.max.v2(delay=20 ms, lag=10 ms, rate=0.0500 A/s, rated=1 A) [1]
    linearity.independent.v2(delay=20 ms, lag=10 ms, rate=0.0500 A/s) [1]
    linearity.terminal.v2(delay=20 ms, lag=10 ms, rate=0.0500 A/s) [1]
    linearity.least_squares.v2(delay=20 ms, lag=10 ms, rate=0.0500 A/s) [1]
    repeatability.limit.v2(delay=20 ms, lag=10 ms, rate=0.0500 A/s, rated=20 bar) [1]
    pressure_gain.least_squares_10_90.v1(delay=20 ms, lag=10 ms, rate=0.0500 A/s) [bar/A]
    start_current.tangent_5_10.v1(delay=20 ms, lag=10 ms, rate=0.0500 A/s) [A]
    dead_band.turns.v1(change=0.1 bar, delay=20 ms, lag=10 ms) [A]
    threshold.after_standstill.v1(change=0.1 bar, delay=20 ms, lag=10 ms, rated=1 A) [1]
    reversal_error.middle.v1(delay=20 ms, lag=10 ms, rate=0.0500 A/s) [bar]
    bandwidth_gain.minus_3_db.v1 [Hz]
    bandwidth_phase.minus_90_deg.v1 [Hz]
    temperature_sensitivity.slope.v1(per=10 K) [bar]
    supply_sensitivity.slope.v1(per=10 bar) [bar]
    model_rmse.free_run.v1 [bar]
    model_rmse_average.free_run.v1 [bar]
    feed_forward_share.mean_abs.v1 [1]
    feedback_share.mean_abs.v1 [1]
    max_pressure.v1 [bar]
    min_pressure.v1 [bar]
    ");
}

/// What must be positive is refused at zero.
#[test]
fn senseless_parameters_are_refused() {
    for text in [
        r#"{"steady_offset": {"window": "0 s"}}"#,
        r#"{"settling_time": {"band": "0 %"}}"#,
        r#"{"hysteresis_width": {"rated": "0 bar"}}"#,
        r#"{"hysteresis_width_input": {"rated": "0 A"}}"#,
        r#"{"repeatability": {"rated": "0 bar"}}"#,
        r#"{"dead_band": {"change": "0 bar"}}"#,
        r#"{"dead_band": {"rated": "0 A"}}"#,
        r#"{"threshold": {"change": "0 bar"}}"#,
        r#"{"threshold": {"rated": "0 A"}}"#,
        r#"{"temperature_sensitivity": {"rated": "0 bar"}}"#,
        r#"{"supply_sensitivity": {"per": "0 bar"}}"#,
        r#"{"max_error": {"delay": "-1 ms"}}"#,
        r#"{"rmse": {"delay": "-1 ms"}}"#,
    ] {
        let spec: MetricSpec = serde_json::from_str(text).unwrap();
        assert!(spec.check().is_err(), "{text}");
    }
}
