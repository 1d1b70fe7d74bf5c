//! The formula as text and numbers, and the states on courses with a known answer.

use super::*;

fn spec(parameters: &[(&str, &str)]) -> EffectSpec {
    EffectSpec { id: "discovered".into(), parameters: parameters.iter().map(|(a, b)| ((*a).into(), (*b).into())).collect() }
}

#[test]
fn a_formula_reads_back_from_its_own_text() {
    let given = spec(&[
        ("term_1", "0.8 bar * sin((pressure - 3 bar) / 1.5 bar) * tanh((past_pressure(4000 ms) - -1 bar) / 2 bar)"),
        ("term_2", "-0.25 bar * line((switch(14 bar, 6 bar, 0.7 s) - 0) / 1)"),
        ("seen_1", "pressure: 1 bar to 20 bar"),
    ]);
    let values = read(&given).unwrap();
    let all = terms(&values);
    assert_eq!(all.len(), 2);
    assert_eq!((all[0].factors[0].seen, all[0].factors[1].state.values[0], all[0].factors[1].centre), ((1.0, 20.0), 4.0, -1.0));
    let back = EffectSpec { id: "discovered".into(), parameters: Discovered.write(&values).unwrap() };
    assert_eq!(read(&back).unwrap(), values);
}

#[test]
fn what_is_wrong_with_a_formula_is_said() {
    let message = |text: &str| read(&spec(&[("term_1", text)])).unwrap_err().to_string();
    let says = |text: &str, part: &str| assert!(message(text).contains(part), "{}", message(text));
    says("0.8 * tanh((pressure - 1 bar) / 2 bar)", "effect `discovered`, parameter `term_1`: `0.8` has no unit");
    says("0.8 bar * tan((pressure - 1 bar) / 2 bar)", "`tan` is no shape; there are: line, square");
    says("0.8 bar * tanh((presure - 1 bar) / 2 bar)", "`presure` is no state; there are: pressure, current");
    says("0.8 bar * tanh((past_pressure - 1 bar) / 2 bar)", "has 0 values; `past_pressure` takes 1: memory [s]");
    says("0.8 bar * tanh((past_pressure(-1 s) - 1 bar) / 2 bar)", "memory of `past_pressure(-1 s)` is -1; 0 or more is allowed");
    says("0.8 bar * tanh((past_pressure(1 s - 1 bar) / 2 bar)", "lacks its closing bracket");
    says("0.8 bar * tanh(pressure)", "is no factor; write for instance");
    says("0.8 bar * tanh((pressure - 1 bar) / 0 bar)", "divides by 0");
    says("0.8 bar", "has 0 factors behind its coefficient; 1 to 3 are allowed");
    assert!(read(&spec(&[])).unwrap_err().to_string().contains("wants its parameter `term_1`"));
    assert!(read(&spec(&[("tau", "1 s")])).unwrap_err().to_string().contains("there are: term_1, term_2"));
    let range = spec(&[("term_1", EXAMPLES[0]), ("seen_1", "pressure: 20 bar to 1 bar")]);
    assert!(read(&range).unwrap_err().to_string().contains("the smaller one stands first"));
}

/// The values of a state along a pressure in steps of 1 ms.
fn along(state: State, pressure: impl Fn(f64) -> f64, seconds: f64) -> Vec<f64> {
    let dt_s = 1e-3;
    let mut tracker = Tracker::new(state, dt_s);
    let at = |a: f64, b: f64, lasts_s: f64| seen(&Point::current(0.5), lasts_s, a, b);
    tracker.start(&at(pressure(0.0), pressure(0.0), 0.0));
    let mut out = vec![tracker.end_step()];
    for k in 1..(seconds / dt_s) as usize {
        tracker.advance(&at(pressure((k - 1) as f64 * dt_s), pressure(k as f64 * dt_s), dt_s));
        out.push(tracker.end_step());
    }
    out
}

fn step_at_one(t: f64) -> f64 {
    if t < 0.9995 { 2.0 } else { 12.0 }
}

#[test]
fn states_follow_a_step() {
    let near = |a: f64, b: f64| assert!((a - b).abs() < 0.02, "{a} {b}");
    let past = along(State::new(StateKind::PastPressure, &[0.5]), step_at_one, 3.0);
    near(past[1500], 12.0 - 10.0 * (-1.0f64).exp());
    let change = along(State::new(StateKind::PressureChange, &[0.5, 0.25]), step_at_one, 3.0);
    assert_eq!(change[1200], 0.0);
    near(change[1750], 10.0 * (-1.0f64).exp());
    let since = along(State::new(StateKind::SinceShift, &[5.0, 1.0]), step_at_one, 3.0);
    assert!(since[900] > 50.0);
    near(since[2000], 1.0);
    let rise = along(State::new(StateKind::Rise, &[0.1, 1.0]), step_at_one, 3.0);
    let fall = along(State::new(StateKind::Fall, &[0.1, 1.0]), step_at_one, 3.0);
    assert!(rise[1300] > 0.5 && fall.iter().all(|f| *f == 0.0), "{}", rise[1300]);
}

#[test]
fn a_switch_waits_and_a_turn_is_counted_from_where_it_is_seen() {
    let wave = |t: f64| 10.0 + 8.0 * (std::f64::consts::TAU * t / 4.0).sin();
    let switch = along(State::new(StateKind::Switch, &[14.0, 6.0, 0.3]), wave, 8.0);
    // Above 14 bar from 1/3 s on, so on from 0.633 s; below 6 bar from 2.333 s on, so off from 2.633 s.
    assert!(switch[630] < 0.01 && switch[1200] > 0.99 && switch[2630] > 0.99 && switch[3200] < 0.01);
    let since = along(State::new(StateKind::SinceReversal, &[8.0]), wave, 8.0);
    // 8 bar back from the top at 1 s: at 2 s.
    assert!((since[2500] - 0.5).abs() < 0.01, "{}", since[2500]);
}

#[test]
fn beyond_what_was_seen_a_state_counts_as_its_end() {
    let mut term = Term::parse("1 bar * line((pressure - 0 bar) / 1 bar)").unwrap();
    term.factors[0].seen = (2.0, 5.0);
    assert_eq!([-3.0, 3.0, 50.0].map(|p| term.factors[0].at(p)), [2.0, 3.0, 5.0]);
}

#[test]
fn a_term_on_a_channel_that_is_not_recorded_adds_nothing() {
    let theta = numbers(&[Term::parse("1 bar * line((oil_temperature - 60 degC) / 10 degC)").unwrap()]);
    assert_eq!(Discovered.uses(&theta), [Channel::OilTemperature]);
    let valve = crate::valve::Valve::from_toml(include_str!("../../../valves/paper.toml"), "paper").unwrap();
    let context =
        Context { dt_s: 0.01, start_s: 0.0, arrival: super::super::Arrival::Ramp, most_inner: 8, curves: &valve.curves, seed: None };
    let Block::Dynamic(mut block) = Discovered.block(&theta, &context) else { panic!() };
    let block = (block.as_mut() as &mut dyn std::any::Any).downcast_mut::<Adding>().unwrap();
    let hot = Point { oil_temp_c: 80.0, ..Point::current(0.5) };
    Dynamic::start(block, &hot, 10.0);
    assert_eq!(block.step(&hot, 10.0, Step::rest(10.0)).to, 12.0);
    assert_eq!(block.step(&Point::current(0.5), 10.0, Step::rest(10.0)).to, 10.0);
}
