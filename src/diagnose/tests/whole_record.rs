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
