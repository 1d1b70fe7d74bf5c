//! What a part of a record prefers, or fewer of its readings, and the whole of it denies.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};

use super::super::*;
use super::{NOISE_BAR, valve, valve_with};
use crate::physics::simulate;
use crate::recording::Run;
use crate::valve::Input;

/// So many steps' readings of a valve that is off by `off_bar` at a pressure.
fn steps(of: &Valve, (samples, step_s): (u32, f64), seed: u64, off_bar: impl Fn(f64) -> f64) -> Recording {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let time_s: Vec<f64> = (0..samples).map(|k| f64::from(k) * step_s).collect();
    let mut current_a = Vec::with_capacity(time_s.len());
    let of_second = (1.0 / step_s) as usize;
    while current_a.len() < time_s.len() {
        let (level_a, samples) = (random.random_range(0.25..0.85), random.random_range(of_second..6 * of_second));
        current_a.extend(std::iter::repeat_n(level_a, samples));
    }
    current_a.truncate(time_s.len());
    let noise = Normal::new(0.0, NOISE_BAR).unwrap();
    let pressure = simulate(of, Input::Held, &time_s, &current_a).unwrap();
    let pressure = pressure.iter().map(|p| p + off_bar(*p) + noise.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    Recording { source: "drive.csv".into(), runs: vec![run], notes: vec![], input: Some(Input::Held) }
}

#[test]
fn shares_are_those_of_the_whole_record_where_it_denies_what_its_part_prefers() {
    // Much longer than what a search looks at, on a valve whose curve the model does not quite have.
    let warm = steps(&valve_with("coil_heating", &[0.1, 25.0, 0.0]), (38_000, 0.01), 0, |p| 0.05 * (p / 1.7).sin());
    let d = diagnose(&warm, &valve()).unwrap().diagnosis;
    let told: Vec<_> = d.effects.iter().map(|f| f.id.as_str()).collect();
    assert_eq!(told, ["coil_heating"], "{}", d.summary);
    // Of the part alone it has none.
    assert!(d.effects[0].share > 0.9, "{}", d.effects[0].share);
}

#[test]
fn what_follows_a_step_that_fewer_readings_make_a_ramp_is_no_effect() {
    let late = steps(&valve_with("transport_delay", &[0.04]), (24_000, 0.0025), 4, |_| 0.0);
    let d = diagnose(&late, &valve()).unwrap().diagnosis;
    let told: Vec<_> = d.effects.iter().chain(&d.form).map(|f| f.id.as_str()).collect();
    assert_eq!(told, ["transport_delay"], "{}", d.summary);
}

/// A log that was cut out of a longer one: it begins with the clutch full, and of what a search looks at one stretch alone shows a filling.
#[test]
fn a_filling_that_few_stretches_show_is_found_in_a_log_that_begins_with_the_clutch_full() {
    let fills = valve_with("fill_phase", &[3.0, 1.0, 0.2, 1.0, 0.0, 0.0, 0.0]);
    let waves = |t: f64| 0.6 + 0.15 * (0.24 * t).sin();
    let current = |t: f64| match t % 50.0 {
        // Empty for six seconds, and filled by a ramp of three.
        since if t < 250.0 || since > 9.0 => waves(t),
        since if since < 6.0 => 0.1,
        since => 0.1 + 0.5 * (since - 6.0) / 3.0,
    };
    let time_s: Vec<f64> = (0..34_000).map(|k| f64::from(k) * 0.01).collect();
    let current_a: Vec<f64> = time_s.iter().map(|t| current(*t)).collect();
    let (mut random, noise) = (rand_pcg::Pcg64::seed_from_u64(8), Normal::new(0.0, NOISE_BAR).unwrap());
    let pressure = simulate(&fills, Input::Held, &time_s, &current_a).unwrap();
    let read: Vec<f64> = pressure.iter().map(|p| p + noise.sample(&mut random)).collect();
    let from = 2000;
    let run = Run {
        time_s: time_s[from..].to_vec(),
        current_a: current_a[from..].to_vec(),
        pressure_bar: Some(read[from..].to_vec()),
        ..Run::default()
    };
    let log = Recording { source: "log.csv".into(), runs: vec![run], notes: vec![], input: Some(Input::Held) };
    let d = diagnose(&log, &valve()).unwrap().diagnosis;
    let told: Vec<_> = d.effects.iter().map(|f| f.id.as_str()).collect();
    assert_eq!(told, ["fill_phase"], "{}", d.summary);
    assert!((d.effects[0].parameters["plateau"].value - 3.0).abs() < 0.2, "{}", d.summary);
    // What a fit could do without is not what an answer is about.
    assert!(d.summary.contains("(plateau ") && !d.summary.contains("hold"), "{}", d.summary);
}

/// A search looks at four stretches; where the zero moves between two of them, all of the record tells the instant.
#[test]
fn a_zero_that_moved_where_no_stretch_was_looked_at_is_found_at_its_instant() {
    for (seed, moved_s) in [(1, 165.0), (2, 230.0)] {
        let time_s: Vec<f64> = (0..34_000).map(|k| f64::from(k) * 0.01).collect();
        let current_a: Vec<f64> = time_s.iter().map(|t| 0.55 + 0.2 * (0.24 * t).sin() + 0.1 * (1.7 * t).sin()).collect();
        let (mut random, noise) = (rand_pcg::Pcg64::seed_from_u64(seed), Normal::new(0.0, NOISE_BAR).unwrap());
        let pressure = simulate(&valve(), Input::Held, &time_s, &current_a).unwrap();
        let moved = |t: f64| if t >= moved_s { 0.4 } else { 0.0 };
        let read = pressure.iter().zip(&time_s).map(|(p, t)| p + moved(*t) + noise.sample(&mut random)).collect();
        let run = Run { time_s, current_a, pressure_bar: Some(read), ..Run::default() };
        let log = Recording { source: "log.csv".into(), runs: vec![run], notes: vec![], input: Some(Input::Held) };
        let d = diagnose(&log, &valve()).unwrap().diagnosis;
        let told: Vec<_> = d.effects.iter().map(|f| f.id.as_str()).collect();
        assert_eq!(told, ["reference_shift"], "{}", d.summary);
        let value = |name: &str| d.effects[0].parameters[name].value;
        assert!((value("from") - moved_s).abs() < 0.1 && (value("offset") - 0.4).abs() < 0.02, "{}", d.summary);
    }
}
