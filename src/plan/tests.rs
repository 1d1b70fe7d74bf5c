//! Plans that read, and plans that are refused with the wrong token underlined.

use std::path::Path;

use super::*;
use crate::valve::Valve;

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "example"
rate = "100 Hz"

[parameters]
peak = "20 bar"
turns = 3

[controller]
ki = "5 mA/(bar s)"

[[setup]]
name = "fill"
stimulus.ramp = { from = "0 bar", to = "2 bar", over = "0.5 s" }

[[phase]]
name = "step"
stimulus.step = { from = "2 bar", to = "$peak", hold = "2 s" }
repeat = "$turns"
controller = { ki = "10 mA/(bar s)" }

[[phase.measure]]
metric.rmse = {}
limit = { max = "0.5 bar", marginal_max = "0.4 bar" }

[[phase.measure]]
metric.settling_time.band = "2 %"

[[phase]]
name = "back"
stimulus.ramp = { to = "5 bar", rate = "10 bar/s" }

[[teardown]]
name = "open"
stimulus.hold = { at = "100 mA", for = "1 s" }
"#;

fn plan(text: &str) -> Result<Plan, PlanError> {
    Plan::from_toml(text, "example.toml", Path::new("."), &[])
}

fn refused(from: &str, to: &str) -> String {
    assert!(PLAN.contains(from), "{from}");
    plan(&PLAN.replacen(from, to, 1)).unwrap_err().to_string()
}

#[test]
fn a_plan_is_checked_into_canonical_units() {
    let plan = plan(PLAN).unwrap();
    let names: Vec<&str> = plan.phases.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["fill", "step", "back", "open"]);
    let step = &plan.phases[1];
    assert_eq!((step.repeat, step.waveform.at(0.5), step.waveform.at(1.5)), (3, 2.0, 20.0));
    assert_eq!((plan.controller.gains.ki_ma_per_bar_s, step.controller.gains.ki_ma_per_bar_s), (5.0, 10.0));
    assert_eq!(step.measures[0].limit.unwrap().marginal_max, Some(0.4));
    // The ramp goes on from where the step ended.
    assert_eq!((plan.phases[2].waveform.at(0.0), plan.phases[2].waveform.duration_s()), (20.0, 1.5));
    assert!(!plan.phases[3].closed_loop());
    assert_eq!((plan.samples(), plan.parameters[0].1.as_str()), (50 + 3 * 300 + 150 + 100, "20 bar"));
}

#[test]
fn set_changes_parameters_and_named_values() {
    let set = |key: &str, value: &str| Plan::from_toml(PLAN, "example.toml", Path::new("."), &[(key.into(), value.into())]);
    let changed = set("peak", "2.5 MPa").unwrap();
    assert_eq!((changed.phases[1].waveform.at(1.5), changed.overridden.as_slice()), (25.0, &["peak".to_string()][..]));
    assert_eq!(set("turns", "7").unwrap().phases[1].repeat, 7);
    assert_eq!(set("controller.ki", "7 mA/(bar s)").unwrap().controller.gains.ki_ma_per_bar_s, 7.0);
    let wrong = |key: &str, value: &str| set(key, value).unwrap_err().to_string();
    insta::assert_snapshot!(wrong("peek", "20 bar"), @"--set peek=20 bar: the plan has no such parameter; did you mean `peak`? (allowed: peak, turns, controller.ki)");
    insta::assert_snapshot!(wrong("peak", "20 mA"), @"--set peak=20 mA: `20 mA` is not a pressure: the unit `mA` is of a current; allowed: bar, mbar, Pa, kPa, MPa, psi (the plan has `20 bar`)");
    insta::assert_snapshot!(wrong("turns", "many"), @"--set turns=many: a whole number is wanted (the plan has `3`)");
}

#[test]
fn wrong_units_keys_and_types_are_underlined() {
    insta::assert_snapshot!(refused("\"0.5 s\"", "\"0.5 bar\""), @r#"
    `0.5 bar` is not a time: the unit `bar` is of a pressure; allowed: s, ms, us, min, h
      --> example.toml:15:56
       |
    15 | stimulus.ramp = { from = "0 bar", to = "2 bar", over = "0.5 bar" }
       |                                                        ^^^^^^^^^
    "#);
    insta::assert_snapshot!(refused("metric.settling_time", "metric.setling_time"), @r#"
    unknown variant `setling_time`, expected one of `rmse`, `rmse_band`, `max_error`, `steady_offset`, `rise_time`, `fall_time`, `dead_time`, `settling_time`, `overshoot`, `hysteresis_width`, `hysteresis_width_input`, `linearity`, `repeatability`, `pressure_gain`, `start_current`, `dead_band`, `threshold`, `reversal_error`, `bandwidth_gain`, `bandwidth_phase`, `temperature_sensitivity`, `supply_sensitivity`, `model_rmse`, `model_rmse_average`, `feed_forward_share`, `feedback_share`, `max_pressure`, `min_pressure`
      --> example.toml:28:8
       |
    28 | metric.setling_time.band = "2 %"
       |        ^^^^^^^^^^^^
       |
       = help: did you mean `settling_time`?
    "#);
    insta::assert_snapshot!(refused("repeat =", "repeet ="), @r#"
    unknown field `repeet`, expected one of `name`, `stimulus`, `prompt`, `repeat`, `controller`, `measure`, `on_fail`
      --> example.toml:20:1
       |
    20 | repeet = "$turns"
       | ^^^^^^
       |
       = help: did you mean `repeat`?
    "#);
    insta::assert_snapshot!(refused("\"0.5 bar\", marginal", "0.5, marginal"), @r#"
    invalid type: floating point `0.5`, expected a string
      --> example.toml:25:17
       |
    25 | limit = { max = 0.5, marginal_max = "0.4 bar" }
       |                 ^^^
       |
       = help: a number carries its unit, as text: "0.5 bar"
    "#);
    insta::assert_snapshot!(refused("metric.rmse = {}", "metric = \"rmse\""), @r#"
    a name with a table is wanted here
      --> example.toml:24:10
       |
    24 | metric = "rmse"
       |          ^^^^^^
       |
       = help: write for instance `metric.rmse = {}`
    "#);
    insta::assert_snapshot!(refused("hil.plan/1", "hil.valve/1"), @r#"
    schema: is "hil.valve/1"; a plan has "hil.plan/1"
     --> example.toml:2:10
      |
    2 | schema = "hil.valve/1"
      |          ^^^^^^^^^^^^^
    "#);
}

#[test]
fn what_makes_no_sense_is_refused() {
    insta::assert_snapshot!(refused("\"0.4 bar\"", "\"0.6 bar\""), @r#"
    `marginal_max` (0.6) is larger than `max` (0.5)
      --> example.toml:25:9
       |
    25 | limit = { max = "0.5 bar", marginal_max = "0.6 bar" }
       |         ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    "#);
    insta::assert_snapshot!(refused("max = \"0.5 bar\"", "max = \"0.5 s\""), @r#"
    `0.5 s` is not a pressure: the unit `s` is of a time; allowed: bar, mbar, Pa, kPa, MPa, psi
      --> example.toml:25:17
       |
    25 | limit = { max = "0.5 s", marginal_max = "0.4 bar" }
       |                 ^^^^^^^
    "#);
    insta::assert_snapshot!(refused("to = \"2 bar\", over", "to = \"200 mA\", over"), @r#"
    a pressure in a phase that began with a current; one phase commands one of the two
      --> example.toml:15:26
       |
    15 | stimulus.ramp = { from = "0 bar", to = "200 mA", over = "0.5 s" }
       |                          ^^^^^^^
    "#);
    insta::assert_snapshot!(refused("over = \"0.5 s\"", "over = \"0.5 s\", rate = \"1 bar/s\""), @r#"
    a ramp needs either `over` (a time) or `rate`, not both
      --> example.toml:15:1
       |
    15 | stimulus.ramp = { from = "0 bar", to = "2 bar", over = "0.5 s", rate = "1 bar/s" }
       | ^^^^^^^^
    "#);
    insta::assert_snapshot!(refused("name = \"back\"", "name = \"step\""), @r#"
    a second phase `step`; names are unique
      --> example.toml:31:8
       |
    31 | name = "step"
       |        ^^^^^^
    "#);
    insta::assert_snapshot!(refused("\"$peak\"", "\"$peek\""), @r#"
    there is no parameter `peek`; did you mean `$peak`? (parameters: peak, turns)
      --> example.toml:19:40
       |
    19 | stimulus.step = { from = "2 bar", to = "$peek", hold = "2 s" }
       |                                        ^^^^^^^
    "#);
    insta::assert_snapshot!(refused("\"2 bar\", to = \"$peak\"", "\"100 mA\", to = \"200 mA\""), @r"
    `rmse` needs a target pressure, but the phase `step` commands a current
      --> example.toml:24:1
       |
    24 | metric.rmse = {}
       | ^^^^^^
    ");
    insta::assert_snapshot!(refused("rate = \"100 Hz\"", "rate = \"1 MHz\""), @r#"
    `1 MHz` is not a frequency: the unit `MHz` is unknown; allowed: Hz, kHz, mHz
     --> example.toml:4:8
      |
    4 | rate = "1 MHz"
      |        ^^^^^^^
    "#);
    let phases = PLAN.find("[[setup]]").unwrap();
    insta::assert_snapshot!(plan(&PLAN[..phases]).unwrap_err(), @r#"
    the plan has no [[phase]]; one at least is wanted
     --> example.toml:3:8
      |
    3 | name = "example"
      |        ^^^^^^^^^
    "#);
}

#[test]
fn a_pressure_outside_the_valve_is_underlined() {
    let valve = crate::control::test_valve();
    plan(PLAN).unwrap().check_valve(&valve).unwrap();
    let high = plan(&PLAN.replace("to = \"5 bar\"", "to = \"65 bar\"")).unwrap();
    insta::assert_snapshot!(high.check_valve(&valve).unwrap_err(), @r#"
    phase `back` asks for 65 bar; the valve `test` is good for 0.000 bar to 39.420 bar
      --> example.toml:32:24
       |
    32 | stimulus.ramp = { to = "65 bar", rate = "10 bar/s" }
       |                        ^^^^^^^^
    "#);
    let other: Valve = Valve { current_limits_a: (0.0, 0.05), ..valve };
    insta::assert_snapshot!(plan(PLAN).unwrap().check_valve(&other).unwrap_err(), @r#"
    phase `open` asks for 0.1 A; the valve `test` is good for 0.000 A to 0.050 A
      --> example.toml:36:24
       |
    36 | stimulus.hold = { at = "100 mA", for = "1 s" }
       |                        ^^^^^^^^
    "#);
}

#[test]
fn limits_can_come_from_their_own_file() {
    let text = |phase: &str, metric: &str, max: &str| {
        format!(
            "schema = \"hil.limits/1\"\npart_number = \"7\"\n[[limit]]\nphase = \"{phase}\"\nmetric = \"{metric}\"\nlimit = {{ max = \"{max}\" }}\n"
        )
    };
    let apply = |text: &str| {
        let mut plan = plan(PLAN).unwrap();
        plan.apply_limits(&LimitsFile::from_toml(text, "limits.toml").unwrap()).map(|()| plan)
    };
    let plan = apply(&text("step", "rmse", "300 mbar")).unwrap();
    assert_eq!(plan.phases[1].measures[0].limit.unwrap().max, Some(0.3));
    insta::assert_snapshot!(apply(&text("steep", "rmse", "1 bar")).unwrap_err(), @r#"
    the plan `example` has no phase `steep` (phases: fill, step, back, open)
     --> limits.toml:4:9
      |
    4 | phase = "steep"
      |         ^^^^^^^
    "#);
    insta::assert_snapshot!(apply(&text("step", "overshoot", "1 bar")).unwrap_err(), @r#"
    the phase `step` does not measure `overshoot` (it measures: rmse, settling_time)
     --> limits.toml:5:10
      |
    5 | metric = "overshoot"
      |          ^^^^^^^^^^^
    "#);
    insta::assert_snapshot!(apply(&text("step", "rmse", "1 ms")).unwrap_err(), @r#"
    `1 ms` is not a pressure: the unit `ms` is of a time; allowed: bar, mbar, Pa, kPa, MPa, psi
     --> limits.toml:6:17
      |
    6 | limit = { max = "1 ms" }
      |                 ^^^^^^
    "#);
}

proptest::proptest! {
    #[test]
    fn no_text_panics(text in "\\PC*") {
        let _ = plan(&text);
    }

    #[test]
    fn no_cut_and_no_changed_character_panics(at in 0usize..2000, with in "\\PC?", cut in proptest::bool::ANY) {
        let mut characters: Vec<char> = PLAN.chars().collect();
        let at = at % characters.len();
        if cut { characters.truncate(at) } else { characters.splice(at..=at, with.chars()); }
        let _ = plan(&characters.into_iter().collect::<String>());
    }
}

#[test]
fn what_could_never_pass_is_found_before_a_valve_moves() {
    let window = refused("metric.settling_time.band = \"2 %\"", "metric.steady_offset.window = \"5 s\"");
    assert!(window.contains("the window of 5 s is longer than the phase `step`, whose samples span 2.990 s"), "{window}");
    let pressure = refused("[controller]", "[interlocks]\nmax_pressure = \"15 bar\"\n\n[controller]");
    assert!(pressure.contains("phase `step` asks for 20 bar, and the interlock `max_pressure` stops the run above 15 bar"), "{pressure}");
    let current = refused("[controller]", "[interlocks]\nmax_current = \"50 mA\"\n\n[controller]");
    assert!(current.contains("phase `open` asks for 0.1 A"), "{current}");
}

#[test]
fn a_question_is_checked_like_everything_else() {
    let plan_of = |text: &str| Plan::from_toml(text, "example.toml", Path::new("."), &[]);
    let before = |prompt: &str| plan_of(&PLAN.replacen("[[phase]]", &format!("[[setup]]\nname = \"ask\"\n{prompt}\n\n[[phase]]"), 1));
    let plan = before("prompt = { text = \"Current?\", answer.number = { unit = \"mA\", limit = { max = \"0.5 A\" } } }").unwrap();
    let (phase, prompt) = plan.prompts().next().unwrap();
    assert_eq!((phase.samples_per_repetition(plan.period_s), phase.on_fail, prompt.timeout_s), (0, OnFail::Stop, 600.0));
    let judged = |typed: &str| prompt.kind.answer(typed).map(|a| (a.value, a.verdict));
    use crate::limits::Verdict::{Fail, Pass};
    assert_eq!(judged("400"), Ok((Some(0.4), Some(Pass))), "a number without a unit is in the unit of the question");
    assert_eq!(judged("0,6 A"), Ok((Some(0.6), Some(Fail))));
    assert!(judged("0.6 bar").unwrap_err().contains("current"));
    let message = |prompt: &str| before(prompt).unwrap_err().to_string();
    assert!(message("prompt = { text = \" \" }").contains("`text` is blank"));
    assert!(message("prompt = { text = \"x\", answer.choice = { options = [\"a\"] } }").contains("two options"));
    assert!(
        message("prompt = { text = \"x\", answer.choice = { options = [\"a\", \"b\"], accept = [\"c\"] } }")
            .contains("`c` is accepted, but is no option: a, b")
    );
    assert!(message("prompt = { text = \"x\", answer.number = { unit = \"foot\" } }").contains("`foot` is no unit; there are: A, bar"));
    assert!(message("prompt = { text = \"x\", picture = \"none.png\" }").contains("none.png"));
    assert!(message("prompt = { text = \"x\", picture = \"/etc/passwd\" }").contains("outside of the plan's project"));
    assert!(message("prompt = { text = \"x\", picture = \"Cargo.toml\" }").contains("neither PNG nor JPEG"));
    assert!(message("prompt = { text = \"x\", timeout = \"0 s\" }").contains("not positive"));
    assert!(message("repeat = 2\nprompt = { text = \"x\" }").contains("asks once"));
    assert!(message("stimulus.hold = { at = \"1 bar\", for = \"1 s\" }\nprompt = { text = \"x\" }").contains("not both"));
    assert!(message("").contains("neither a `stimulus` nor a `prompt`"));
}
