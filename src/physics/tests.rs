//! Laws that hold for every effect of the list.

use super::*;
use crate::valve::{Input, Valve};

/// A valve like the paper's, with these effects.
pub(crate) fn valve(effects: Vec<crate::valve::EffectSpec>) -> Valve {
    let text = r#"
        schema = "hil.valve/1"
        name = "test"
        current_limits = ["0 A", "1 A"]
        hysteresis.hyperbolic.a = "0.8 bar^2"
        delay = "23 ms"
        lag = "8 ms"
        floor = "0 bar"
        [curve]
        ascending = [-42.65, 92.5, -8.4, -2.03]
        descending = [-40.01, 83.32, -1.3, -2.41]
    "#;
    let mut valve = Valve::from_toml(text, "test").unwrap();
    valve.effects = effects;
    valve
}

/// A current with ramps, holds, steps and small movements.
fn current() -> Vec<f64> {
    (0..4000)
        .map(|k| {
            let t = k as f64 * 0.01;
            0.5 + 0.3 * (0.4 * t).sin() + if (k / 300) % 2 == 0 { 0.1 } else { 0.0 } + if k > 2500 && k < 2800 { -0.45 } else { 0.0 }
        })
        .collect()
}

fn first_starts(effect: &dyn Effect) -> Vec<f64> {
    effect.examples().swap_remove(0)
}

#[test]
fn every_effect_is_documented_and_its_values_are_within_its_ranges() {
    for effect in EFFECTS {
        let doc = effect.doc();
        for part in ["What it is:", "Model:", "Signature:", "What to check on the bench:", "Source:"] {
            assert!(doc.contains(part), "{}: no `{part}`", effect.id());
        }
        for p in effect.parameters() {
            assert!(!p.starts.is_empty() && p.starts.iter().all(|s| (p.range.0..=p.range.1).contains(s)), "{} {}", effect.id(), p.name);
            assert!(p.default.is_none_or(|d| (p.range.0..=p.range.1).contains(&d)), "{} {}", effect.id(), p.name);
        }
        assert_eq!(super::effect(effect.id()).unwrap().id(), effect.id());
    }
}

#[test]
fn every_effect_gives_the_same_pressure_whole_and_step_by_step() {
    let current = current();
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * 0.01).collect();
    let beside = BESIDE.iter().map(|(id, theta)| (super::effect(id).unwrap(), theta.to_vec()));
    for (effect, theta) in EFFECTS.iter().map(|effect| (*effect, first_starts(*effect))).chain(beside) {
        let valve = valve(vec![specification(effect, &theta)]);
        let whole = simulate(&valve, Input::Held, &time, &current).unwrap();
        let mut plant = Plant::new(&valve, 0.01, current[0], None).unwrap();
        for (k, i) in current.iter().enumerate() {
            let p = plant.step(*i);
            assert!((p - whole[k]).abs() < 1e-6, "{} at {k}: {p} {}", effect.id(), whole[k]);
        }
    }
}

#[test]
fn every_effect_of_the_course_changes_the_pressure_and_all_are_finite() {
    let current = current();
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * 0.01).collect();
    let plain = simulate(&valve(vec![]), Input::Held, &time, &current).unwrap();
    for effect in EFFECTS {
        for (low, high) in [(true, false), (false, true), (false, false)] {
            let ends: Vec<f64> = effect
                .parameters()
                .iter()
                .map(|p| {
                    if low {
                        p.range.0
                    } else if high {
                        p.range.1
                    } else {
                        p.starts[0]
                    }
                })
                .collect();
            let theta = if ends.is_empty() { first_starts(*effect) } else { ends };
            let changed = simulate(&valve(vec![specification(*effect, &theta)]), Input::Held, &time, &current).unwrap();
            assert!(changed.iter().all(|p| p.is_finite()), "{} at {theta:?}", effect.id());
            if !low && !high && effect.kind() == Kind::Course && effect.needs().is_none() {
                let rms = (plain.iter().zip(&changed).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / plain.len() as f64).sqrt();
                assert!(rms > 1e-3, "{} does nothing: {rms}", effect.id());
            }
        }
    }
}

#[test]
fn a_specification_resolves_to_its_own_values_and_says_what_is_wrong() {
    for effect in EFFECTS {
        let theta = first_starts(*effect);
        let (back, values) = resolve(&specification(*effect, &theta)).unwrap();
        assert_eq!(back.id(), effect.id());
        for (a, b) in values.iter().zip(&theta) {
            assert!(a == b || (a - b).abs() <= 1e-12 * b.abs(), "{}", effect.id());
        }
    }
    let spec =
        |id: &str, name: &str, value: &str| crate::valve::EffectSpec { id: id.into(), parameters: vec![(name.into(), value.into())] };
    let message = |s| resolve(&s).err().unwrap().to_string();
    insta::assert_snapshot!(message(spec("first_order_lag", "tau", "45 bar")), @"effect `first_order_lag`, parameter `tau`: `45 bar` is not a time: the unit `bar` is of a pressure; allowed: s, ms, us, min, h");
    insta::assert_snapshot!(message(spec("first_order_lag", "tau", "45 min")), @"effect `first_order_lag`, parameter `tau`: 45 min is outside 0.001 s to 5 s");
    insta::assert_snapshot!(message(spec("first_order_lag", "taw", "45 ms")), @"effect `first_order_lag` has no parameter `taw`; there are: tau, exponent");
    assert!(message(spec("first_order_lak", "tau", "45 ms")).contains("did you mean `first_order_lag`?"));
    assert!(
        resolve(&crate::valve::EffectSpec { id: "creep".into(), parameters: vec![] })
            .err()
            .unwrap()
            .to_string()
            .contains("wants its parameter `gain`")
    );
}

#[test]
fn uneven_and_missing_samples_are_simulated_close_to_the_even_grid() {
    let current = current();
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * 0.01).collect();
    let valve = valve(vec![]);
    let even = simulate(&valve, Input::Ramp, &time, &current).unwrap();
    // Every seventh sample is missing in a stretch without steps; the rest keeps its times.
    let keep: Vec<usize> = (0..current.len()).filter(|k| !(1000..1090).contains(k) || k % 7 != 0).collect();
    let pick = |v: &[f64]| keep.iter().map(|k| v[*k]).collect::<Vec<_>>();
    let uneven = simulate(&valve, Input::Ramp, &pick(&time), &pick(&current)).unwrap();
    for (a, b) in pick(&even).iter().zip(&uneven) {
        assert!((a - b).abs() < 0.05, "{a} {b}");
    }
    assert!(simulate(&valve, Input::Held, &[0.0, 0.0], &[0.1, 0.2]).unwrap_err().to_string().contains("does not increase at sample 2"));
}

/// Levels held for 50 ms each, of every size, among them rests and small movements.
fn levels() -> Vec<f64> {
    (0..400)
        .map(|k: usize| {
            let wild = ((k * 7919 + 13 * (k / 7)) % 101) as f64 / 101.0;
            match (k / 40) % 4 {
                0 => 0.1 + 0.75 * wild,
                1 => 0.5 + 0.03 * wild,
                2 => 0.2 + 0.6 * ((k % 40) as f64 / 40.0),
                _ => {
                    if (k / 10).is_multiple_of(2) {
                        0.75
                    } else {
                        0.15
                    }
                }
            }
        })
        .collect()
}

/// The levels sampled with this step, a divisor of 50 ms, and the pressure at every 50 ms.
fn sampled(valve: &Valve, per_level: usize) -> Vec<f64> {
    let current: Vec<f64> = levels().iter().flat_map(|i| std::iter::repeat_n(*i, per_level)).collect();
    let dt_s = 0.05 / per_level as f64;
    let pipeline = Pipeline { input: Input::Held, ..Pipeline::of(valve).unwrap() };
    let (mut work, mut out) = (Vec::new(), Vec::new());
    pipeline.run(0.0, dt_s, &Signals::current(&current), &mut work, &mut out);
    out.into_iter().step_by(per_level).collect()
}

/// What no example has, as a search starts without it: a piston that the oil resists both ways, curves that have moved along the current,
/// and a play that grows with the rate.
const BESIDE: [(&str, &[f64]); 6] = [
    ("fill_phase", &[1.5, 0.2, 0.2, 1.0, 0.0, 0.0, 3.0]),
    ("fill_phase", &[3.0, 0.5, 1.5, 1.0, 1.0, 0.2, 2.7]),
    ("fill_phase", &[2.0, 0.3, 0.0, 0.5, 0.5, 0.0, 20.0]),
    ("reference_shift", &[0.0, 0.0, 0.0, -0.012]),
    ("rate_dependent_hysteresis", &[1.2, 1.0, 0.0, 0.02, 1.0]),
    ("rate_dependent_hysteresis", &[0.6, 0.6, 0.006, 0.05, 0.5]),
];

#[test]
fn every_deterministic_effect_gives_the_same_pressure_however_often_is_sampled() {
    let plain = sampled(&valve(vec![]), 25);
    let mut wrong = Vec::new();
    for effect in EFFECTS {
        let beside = BESIDE.iter().filter(|(id, _)| *id == effect.id()).map(|(_, theta)| theta.to_vec());
        for theta in effect.examples().into_iter().chain(beside) {
            let valve = valve(vec![specification(*effect, &theta)]);
            let fine = sampled(&valve, 500);
            let swing = fine.iter().zip(&plain).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            for per_level in [25, 5, 1] {
                let coarse = sampled(&valve, per_level);
                let (at, off) =
                    coarse.iter().zip(&fine).map(|(a, b)| (a - b).abs()).enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
                if off > 0.01 * swing + 1e-6 {
                    wrong.push(format!("{} {theta:?} at {} ms: {off:.4} of {swing:.3} bar at level {at}", effect.id(), 50 / per_level));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn side_by_side_every_valve_gives_what_it_gives_alone() {
    let current_a = current();
    let oil: Vec<f64> = current_a.iter().map(|i| 60.0 - 20.0 * i).collect();
    let beside = BESIDE.iter().map(|(id, theta)| (super::effect(id).unwrap(), theta.to_vec()));
    for (effect, theta) in EFFECTS.iter().flat_map(|e| e.examples().into_iter().map(move |t| (*e, t))).chain(beside) {
        let moved: Vec<f64> = theta
            .iter()
            .zip(effect.parameters())
            .map(|(v, p)| if p.range.0 < 1.02 * v && 1.02 * v < p.range.1 { 1.02 * v } else { *v })
            .collect();
        let plain = valve(vec![]);
        let of = |effects: Vec<(&'static dyn Effect, Vec<f64>)>, lag_s: f64| Pipeline {
            effects,
            lag_s,
            delay_s: 0.031 - lag_s,
            ..Pipeline::of(&plain).unwrap()
        };
        let with = |theta: &[f64], lag_s: f64| of(vec![(effect, theta.to_vec())], lag_s);
        // All alike, and with one whose steps are finer and one with other blocks.
        let alike = [with(&theta, 0.008), with(&moved, 0.0081), with(&theta, 0.0079)];
        let unlike = [with(&theta, 0.008), with(&moved, 0.001), of(vec![], 0.008)];
        for pipelines in [alike, unlike] {
            let on_curve_bar: Vec<Vec<f64>> =
                pipelines.iter().map(|pipeline| (0..4000).map(|k| pipeline.curves.span_bar() * current_a[k]).collect()).collect();
            let at = Signals { oil_temp_c: Some(&oil), ..Signals::current(&current_a) };
            let (mut alone, mut abreast) = (on_curve_bar.clone(), on_curve_bar);
            for (pipeline, pressure_bar) in pipelines.iter().zip(&mut alone) {
                pipeline.pressure_stages(&pipeline.context(0.0, 0.01, None), &at, pressure_bar);
            }
            let stages = pipelines.iter().zip(&mut abreast);
            let stages =
                stages.map(|(pipeline, pressure_bar)| Stages { pipeline, context: pipeline.context(0.0, 0.01, None), at, pressure_bar });
            pressure_stages_abreast(stages.collect());
            assert!(alone == abreast, "{} {theta:?}", effect.id());
            assert!(alone[0] != alone[1], "{} {theta:?}: what is compared differs", effect.id());
        }
    }
}

/// A chamber equation y' = f(u, y), its effect and its values.
type Equation = (&'static str, Vec<f64>, fn(f64, f64) -> f64);

#[test]
fn chambers_agree_with_their_equations_solved_in_steps_of_ten_microseconds() {
    let equations: [Equation; 5] = [
        ("first_order_lag", vec![0.04, 0.5], |u, y| (u - y).abs().sqrt().copysign(u - y) / 0.04),
        ("air_entrainment", vec![0.12, 2.0, 1.0], |u, y| (u - y) / (0.12 * (6.0 / (y + 1.0)).powi(2))),
        ("air_entrainment", vec![0.2, 1.0, 0.6], |u, y| (u - y).abs().powf(0.6).copysign(u - y) / (0.2 * 6.0 / (y + 1.0))),
        ("flow_limit", vec![100.0, 250.0, 0.0, 0.0], |u, y| ((u - y) * 1e5).clamp(-250.0, 100.0)),
        ("flow_limit", vec![100.0, 250.0, 0.0, 4.0], |u, y| ((u - y) / 4.0).clamp(-1.0, 1.0) * if u > y { 100.0 } else { 250.0 }),
    ];
    for (id, theta, slope) in equations {
        let mut valve = valve(vec![specification(super::effect(id).unwrap(), &theta)]);
        (valve.lag_s, valve.delay_s) = (0.0, 0.0);
        let mut without = valve.clone();
        without.effects.clear();
        let (whole, input) = (sampled(&valve, 5), sampled(&without, 5));
        let (mut y, n) = (input[0], 5000);
        for k in 1..input.len() {
            // The level of the sample before stood until this one.
            for _ in 0..n {
                y += slope(input[k - 1], y) * 0.05 / f64::from(n);
            }
            let jump = (input[k] - input[k - 1]).abs();
            assert!((whole[k] - y).abs() < 0.01 * 30.0_f64.min(1.0 + jump), "{id} {theta:?} at {k}: {} against {y}", whole[k]);
        }
    }
}

#[test]
fn what_an_effect_holds_comes_out_of_it() {
    let current = current();
    let time: Vec<f64> = (0..current.len()).map(|k| k as f64 * 0.01).collect();
    for effect in EFFECTS {
        let Some(nested) = effect.nested() else { continue };
        let plain = super::effect(nested.id).unwrap();
        let values: Vec<f64> = plain.parameters().iter().map(|p| p.default.unwrap_or(p.starts[0])).collect();
        let of = |effect: &dyn Effect, theta: &[f64]| {
            simulate(&valve(vec![specification(effect, theta)]), Input::Held, &time, &current).unwrap()
        };
        let (plainer, same) = (of(plain, &values), of(*effect, &(nested.same)(&values)));
        let squares: f64 = plainer.iter().zip(&same).map(|(a, b)| (a - b).powi(2)).sum();
        let rms = (squares / plainer.len() as f64).sqrt();
        assert!(rms < 5e-3, "{} as {}: {rms} bar", effect.id(), nested.id);
    }
}

/// A fit that stands at such a bound is told nonsense by its derivative otherwise, and stays where it is.
#[test]
fn what_is_nothing_by_default_begins_with_nothing() {
    let time: Vec<f64> = (0..current().len()).map(|k| k as f64 * 0.01).collect();
    let mut wrong = Vec::new();
    for effect in EFFECTS {
        for (theta, (k, parameter)) in effect.examples().iter().flat_map(|e| effect.parameters().iter().enumerate().map(move |p| (e, p))) {
            let range = parameter.range;
            let Some(least) = parameter.default.filter(|d| *d == range.0) else { continue };
            // When an event comes, and what a spool does that sticks again and again, go by jumps.
            if parameter.name == "from" || effect.id() == "stiction" {
                continue;
            }
            let with = |value: f64| {
                let mut theta = theta.clone();
                theta[k] = value;
                simulate(&valve(vec![specification(*effect, &theta)]), Input::Ramp, &time, &current()).unwrap()
            };
            let (none, hardly) = (with(least), with(least + 1e-6 * (range.1 - range.0)));
            let rms = (none.iter().zip(&hardly).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / none.len() as f64).sqrt();
            if rms > 1e-4 {
                wrong.push(format!("{} {theta:?} {}: {rms} bar", effect.id(), parameter.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_simulated_loop_turns_unstable_where_the_sampled_margins_say() {
    // k = 0.04 bar/mA, tau = 10 ms, T_d = 40 ms at 100 Hz: K_P up to 27.50 mA/bar with K_I = 0, by the modified z-transform
    // with one period of computation.
    let text = r#"
        schema = "hil.valve/1"
        name = "straight"
        current_limits = ["0 A", "1 A"]
        hysteresis = "none"
        delay = "40 ms"
        lag = "10 ms"
        [curve]
        ascending = [40.0, 0.0]
        descending = [40.0, 0.0]
    "#;
    let valve = Valve::from_toml(text, "straight").unwrap();
    let swing_after = |kp_a_per_bar: f64| {
        let mut plant = Plant::new(&valve, 0.01, 0.5, None).unwrap();
        let (mut pressure, mut largest) = (plant.step(0.5), [0.0f64; 2]);
        for k in 0..1200 {
            let kick = if k == 0 { 1e-4 } else { 0.0 };
            // What was measured in the last slot makes the command of this one.
            pressure = plant.step(0.5 - kp_a_per_bar * (pressure - 20.0) + kick);
            let part = usize::from(k >= 600);
            largest[part] = largest[part].max((pressure - 20.0).abs());
        }
        largest[1] / largest[0]
    };
    assert!(swing_after(0.0272) < 1.0, "{}", swing_after(0.0272));
    assert!(swing_after(0.0278) > 1.0, "{}", swing_after(0.0278));
}
