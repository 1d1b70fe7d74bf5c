//! The FMU gives what the library gives: every effect, step by step, two instances side by side.

use hil::exchange::fmu::{
    CURRENT_IN, CURRENT_OUT, CURVE_PRESSURE_OUT, OIL_TEMPERATURE_IN, PRESSURE_IN, PRESSURE_OUT, Part, SEED, SUPPLY_PRESSURE_IN, variables,
};
use hil::physics::{Channel, EFFECTS, Plant, Signals, Stage, simulate, simulate_with, specification};
use hil::valve::{Hysteresis, Input, Valve};
use hil_fmu::Instance;

const STEP_S: f64 = 0.01;
/// What the FMU may differ from the simulation of the whole [bar].
const ALLOWED: f64 = 1e-9;

fn paper() -> Valve {
    Valve::from_toml(include_str!("../../valves/paper.toml"), "paper.toml").unwrap()
}

/// Steps, then a triangle [A].
fn drive() -> Vec<f64> {
    (0..3000)
        .map(|k| if k < 1500 { [0.3, 0.8, 0.45, 0.6][k / 100 % 4] } else { 0.2 + 0.6 * (f64::from(k as u32 % 400) / 200.0 - 1.0).abs() })
        .collect()
}

fn begun(valve: Valve, first_a: f64) -> Instance {
    let mut instance = Instance::of(valve, Part::Whole, STEP_S).unwrap();
    instance.enter_initialization().unwrap();
    instance.set_real(CURRENT_IN, first_a).unwrap();
    instance.exit_initialization().unwrap();
    instance
}

fn run(instance: &mut Instance, current_a: &[f64]) -> Vec<f64> {
    let mut pressure = vec![instance.real(PRESSURE_OUT).unwrap()];
    for (k, current) in current_a[..current_a.len() - 1].iter().enumerate() {
        instance.set_real(CURRENT_IN, *current).unwrap();
        instance.do_step(k as f64 * STEP_S, STEP_S).unwrap();
        pressure.push(instance.real(PRESSURE_OUT).unwrap());
    }
    pressure
}

fn difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn every_effect_as_the_library_simulates_it() {
    let current = drive();
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * STEP_S).collect();
    let plain = simulate(&paper(), Input::Held, &time, &current).unwrap();
    let mut acted = 0;
    for effect in EFFECTS {
        let valve = with(*effect);
        let whole = simulate(&valve, Input::Held, &time, &current).unwrap();
        let stepped = run(&mut begun(valve, current[0]), &current);
        let off = difference(&whole, &stepped);
        assert!(off <= ALLOWED, "{}: {off:e} bar", effect.id());
        acted += usize::from(difference(&whole, &plain) > 1e-3);
    }
    // A comparison of effects that do nothing would show nothing.
    assert!(acted > EFFECTS.len() / 2, "{acted} effects acted");
}

/// The valve with this effect at its first start.
fn with(effect: &'static dyn hil::physics::Effect) -> Valve {
    let plainest: Vec<f64> = effect.parameters().iter().map(|p| p.default.unwrap_or(p.starts[0])).collect();
    let theta = if plainest.is_empty() { effect.examples().swap_remove(0) } else { plainest };
    Valve { effects: vec![specification(effect, &theta)], ..paper() }
}

#[test]
fn chance_with_a_seed_is_that_of_the_simulated_valve() {
    let current = drive();
    // What chance does to messages is drawn a message later here: a master sets each at the begin of a step.
    for effect in EFFECTS.iter().filter(|e| e.stage() != Stage::Delay) {
        let valve = with(*effect);
        let mut plant = Plant::new(&valve, STEP_S, current[0], Some(7)).unwrap();
        let whole: Vec<f64> = current.iter().map(|i| plant.step(*i)).collect();
        let mut instance = Instance::of(valve, Part::Whole, STEP_S).unwrap();
        instance.set_integer(SEED, 7).unwrap();
        instance.enter_initialization().unwrap();
        instance.set_real(CURRENT_IN, current[0]).unwrap();
        instance.exit_initialization().unwrap();
        let off = difference(&whole, &run(&mut instance, &current));
        assert!(off <= ALLOWED, "{}: {off:e} bar", effect.id());
    }
}

#[test]
fn what_the_valve_stands_in_is_an_input_where_an_effect_uses_it() {
    let current = drive();
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * STEP_S).collect();
    let oil = vec![95.0; current.len()];
    let mut seen = 0;
    for effect in EFFECTS.iter().filter(|e| e.needs() == Some(Channel::OilTemperature)) {
        let valve = with(*effect);
        let signals = Signals { oil_temp_c: Some(&oil), ..Signals::current(&current) };
        let whole = simulate_with(&valve, Input::Held, &time, &signals).unwrap();
        let started = |oil_c: Option<f64>| {
            let mut instance = Instance::of(valve.clone(), Part::Whole, STEP_S).unwrap();
            instance.enter_initialization().unwrap();
            instance.set_real(CURRENT_IN, current[0]).unwrap();
            if let Some(oil_c) = oil_c {
                instance.set_real(OIL_TEMPERATURE_IN, oil_c).unwrap();
            }
            instance.exit_initialization().unwrap();
            instance
        };
        let stepped = run(&mut started(Some(95.0)), &current);
        assert!(difference(&whole, &stepped) <= ALLOWED, "{}: {:e} bar", effect.id(), difference(&whole, &stepped));
        assert!(difference(&run(&mut started(None), &current), &stepped) > 1e-3, "{}", effect.id());
        assert!(started(None).set_real(SUPPLY_PRESSURE_IN, 30.0).is_err(), "{}: nothing uses the supply", effect.id());
        seen += 1;
    }
    assert!(seen >= 3, "{seen} effects");
    assert!(begun(paper(), 0.3).set_real(OIL_TEMPERATURE_IN, 80.0).is_err(), "no effect uses it");
}

#[test]
fn the_state_on_the_curve_is_shown() {
    // Without dynamics the pressure on the curve is the pressure.
    let mut instance = begun(Valve { delay_s: STEP_S, lag_s: 0.0, ..paper() }, 0.3);
    for (k, current) in drive()[..200].iter().enumerate() {
        instance.set_real(CURRENT_IN, *current).unwrap();
        instance.do_step(k as f64 * STEP_S, STEP_S).unwrap();
        assert_eq!(instance.real(CURRENT_OUT).unwrap(), *current);
        assert!((instance.real(CURVE_PRESSURE_OUT).unwrap() - instance.real(PRESSURE_OUT).unwrap()).abs() < 1e-12);
    }
    // With them it is ahead.
    let mut lagged = begun(Valve { lag_s: 0.2, ..paper() }, 0.3);
    lagged.set_real(CURRENT_IN, 0.8).unwrap();
    (0..5).for_each(|k| lagged.do_step(f64::from(k) * STEP_S, STEP_S).unwrap());
    assert!(lagged.real(CURVE_PRESSURE_OUT).unwrap() > lagged.real(PRESSURE_OUT).unwrap() + 5.0);
}

#[test]
fn two_instances_know_nothing_of_each_other() {
    let current = drive();
    let alone = run(&mut begun(paper(), current[0]), &current);
    let (mut first, mut second) = (begun(paper(), current[0]), begun(paper(), 0.9));
    let mut pressure = vec![first.real(PRESSURE_OUT).unwrap()];
    for (k, value) in current[..current.len() - 1].iter().enumerate() {
        first.set_real(CURRENT_IN, *value).unwrap();
        second.set_real(CURRENT_IN, 1.0 - value).unwrap();
        first.do_step(k as f64 * STEP_S, STEP_S).unwrap();
        second.do_step(k as f64 * STEP_S, STEP_S).unwrap();
        pressure.push(first.real(PRESSURE_OUT).unwrap());
    }
    assert_eq!(pressure, alone);
}

#[test]
fn long_steps_of_the_master_are_steps_of_the_model() {
    let mut fine = begun(paper(), 0.3);
    let mut coarse = begun(paper(), 0.3);
    for k in 0..50u32 {
        let level = [0.3, 0.7][k as usize % 2];
        coarse.set_real(CURRENT_IN, level).unwrap();
        coarse.do_step(f64::from(k) * 0.05, 0.05).unwrap();
        for j in 0..5u32 {
            fine.set_real(CURRENT_IN, level).unwrap();
            fine.do_step(f64::from(5 * k + j) * STEP_S, STEP_S).unwrap();
        }
        assert_eq!(fine.real(PRESSURE_OUT), coarse.real(PRESSURE_OUT));
    }
}

#[test]
fn a_parameter_changed_in_mid_run_acts_as_if_it_had_always_been_so() {
    let current = drive();
    let lag = variables(&paper(), Part::Whole).unwrap().into_iter().find(|v| v.name == "lag").unwrap().reference;
    let mut changed = begun(paper(), current[0]);
    run(&mut changed, &current[..1000]);
    changed.set_real(lag, 0.08).unwrap();
    let expected = run(&mut begun(Valve { lag_s: 0.08, ..paper() }, current[0]), &current[..1000]);
    assert_eq!(changed.real(PRESSURE_OUT).unwrap(), *expected.last().unwrap());
    assert_eq!(changed.real(lag).unwrap(), 0.08);
}

#[test]
fn noise_needs_a_seed_and_follows_it() {
    let seeded = |seed: i32| {
        let mut instance = Instance::of(paper(), Part::Whole, STEP_S).unwrap();
        instance.set_integer(SEED, seed).unwrap();
        instance.enter_initialization().unwrap();
        instance.set_real(CURRENT_IN, 0.5).unwrap();
        instance.exit_initialization().unwrap();
        run(&mut instance, &[0.5; 100])
    };
    assert_eq!(seeded(3), seeded(3));
    assert_ne!(seeded(3), seeded(4));
    let still = seeded(0);
    assert!(still.windows(2).all(|w| (w[0] - w[1]).abs() < 1e-12));
}

#[test]
fn what_the_interface_forbids_is_refused_and_changes_nothing() {
    let mut instance = Instance::of(paper(), Part::Whole, STEP_S).unwrap();
    assert!(instance.do_step(0.0, STEP_S).is_err(), "a step before the initialisation");
    assert!(instance.exit_initialization().is_err());
    assert!(instance.terminate().is_err());
    assert!(instance.real(PRESSURE_OUT).is_err());
    instance.enter_initialization().unwrap();
    assert!(instance.enter_initialization().is_err());
    assert!(instance.set_real(CURRENT_IN, f64::NAN).is_err());
    assert!(instance.set_real(PRESSURE_OUT, 1.0).is_err());
    assert!(instance.set_real(9999, 1.0).is_err());
    assert!(instance.real(9999).is_err());
    assert!(instance.set_integer(SEED, -1).is_err());
    instance.exit_initialization().unwrap();
    let before = instance.real(PRESSURE_OUT).unwrap();
    for (now_s, step_s) in
        [(0.5, STEP_S), (f64::NAN, STEP_S), (0.0, 0.0), (0.0, -STEP_S), (0.0, 0.4 * STEP_S), (0.0, f64::NAN), (0.0, f64::INFINITY)]
    {
        assert!(instance.do_step(now_s, step_s).is_err(), "{now_s} {step_s}");
    }
    assert!(instance.set_integer(SEED, 1).is_err(), "a seed in mid-run");
    assert_eq!(instance.real(PRESSURE_OUT).unwrap(), before);
    instance.do_step(0.0, STEP_S).unwrap();
    instance.terminate().unwrap();
    assert!(instance.do_step(STEP_S, STEP_S).is_err());
    assert!(instance.set_real(CURRENT_IN, 0.5).is_err());
    instance.reset().unwrap();
    instance.enter_initialization().unwrap();
    instance.exit_initialization().unwrap();
}

#[test]
fn a_model_that_is_not_that_of_the_description_is_refused() {
    let folder = std::env::temp_dir().join(format!("hil-fmu-test-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let text = include_str!("../../valves/paper.toml");
    std::fs::write(folder.join("valve.toml"), text).unwrap();
    std::fs::write(folder.join("step.txt"), "0.01").unwrap();
    std::fs::write(folder.join("part.txt"), "whole").unwrap();
    let token = hil::exchange::fmu::token(text, Part::Whole, 0.01);
    assert!(Instance::new(&folder, &token).is_ok());
    assert!(Instance::new(&folder, "another").is_err());
    std::fs::write(folder.join("step.txt"), "nan").unwrap();
    assert!(Instance::new(&folder, &token).is_err());
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Effects on both sides of a valve, each an FMU of its own, are the valve with these effects.
#[test]
fn effects_about_a_model_are_the_model_with_them() {
    let current = drive();
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * STEP_S).collect();
    let of = |ids: &[(&str, &[f64])]| {
        ids.iter().map(|(id, theta)| specification(EFFECTS.iter().copied().find(|e| e.id() == *id).unwrap(), theta)).collect::<Vec<_>>()
    };
    let bare = Valve { lag_s: 0.0, ..paper() };
    let effects: [&[(&str, &[f64])]; 2] = [&[("reversal_dead_band", &[0.015])], &[("leakage", &[1.0]), ("sensor_quantization", &[0.1])]];
    let full = Valve { effects: of(&effects.concat()), ..bare.clone() };
    let whole = simulate(&full, Input::Held, &time, &current).unwrap();
    let alone = |part, effects| {
        // What an export holds but for its curves, which give the effects their size here.
        let valve = Valve { effects, hysteresis: Hysteresis::None, delay_s: 0.0, lag_s: 0.0, ..paper() };
        let mut instance = Instance::of(valve, part, STEP_S).unwrap();
        instance.enter_initialization().unwrap();
        instance
    };
    // What goes in at a step's begin comes out at its end: each FMU is one step behind.
    let mut ahead = alone(Part::Ahead, of(effects[0]));
    ahead.set_real(CURRENT_IN, current[0]).unwrap();
    ahead.exit_initialization().unwrap();
    let mut sent = Vec::new();
    for (k, value) in current.iter().enumerate() {
        ahead.set_real(CURRENT_IN, *value).unwrap();
        ahead.do_step(k as f64 * STEP_S, STEP_S).unwrap();
        sent.push(ahead.real(CURRENT_OUT).unwrap());
    }
    assert!(ahead.real(PRESSURE_OUT).is_err() && ahead.set_real(PRESSURE_IN, 1.0).is_err());
    let middle = simulate(&bare, Input::Held, &time, &sent).unwrap();
    let mut behind = alone(Part::Behind, of(effects[1]));
    behind.set_real(CURRENT_IN, sent[0]).unwrap();
    behind.set_real(PRESSURE_IN, middle[0]).unwrap();
    behind.exit_initialization().unwrap();
    let mut out = Vec::new();
    for (k, (value, pressure)) in sent.iter().zip(&middle).enumerate() {
        behind.set_real(CURRENT_IN, *value).unwrap();
        behind.set_real(PRESSURE_IN, *pressure).unwrap();
        behind.do_step(k as f64 * STEP_S, STEP_S).unwrap();
        out.push(behind.real(PRESSURE_OUT).unwrap());
    }
    assert!(difference(&out, &whole) <= ALLOWED, "{:e}", difference(&out, &whole));
    assert!(difference(&middle, &whole) > 0.5);
}
