//! What a part of a record prefers, and the whole of it denies.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};

use super::super::*;
use super::{NOISE_BAR, valve};
use crate::physics::{effect, simulate, specification};
use crate::recording::Run;
use crate::valve::Input;

/// Steps at 100 Hz for 380 s, much longer than what a search looks at, on a valve whose curve the model does not quite have.
fn steps(of: &Valve, seed: u64) -> Recording {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let time_s: Vec<f64> = (0..38_000).map(|k| f64::from(k) * 0.01).collect();
    let mut current_a = Vec::with_capacity(time_s.len());
    while current_a.len() < time_s.len() {
        let (level_a, samples) = (random.random_range(0.25..0.85), random.random_range(100..600));
        current_a.extend(std::iter::repeat_n(level_a, samples));
    }
    current_a.truncate(time_s.len());
    let noise = Normal::new(0.0, NOISE_BAR).unwrap();
    let pressure = simulate(of, Input::Held, &time_s, &current_a).unwrap();
    let pressure = pressure.iter().map(|p| p + 0.05 * (p / 1.7).sin() + noise.sample(&mut random)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    Recording { source: "drive.csv".into(), runs: vec![run], notes: vec![], input: Some(Input::Held) }
}

#[test]
fn shares_are_those_of_the_whole_record_where_it_denies_what_its_part_prefers() {
    for seed in 0..3 {
        let mut warm = valve();
        warm.effects.push(specification(effect("coil_heating").unwrap(), &[0.1, 25.0, 0.0]));
        let d = diagnose(&steps(&warm, seed), &valve()).unwrap().diagnosis;
        let told: Vec<_> = d.effects.iter().map(|f| f.id.as_str()).collect();
        assert_eq!(told, ["coil_heating"], "seed {seed}: {}", d.summary);
        // Of the part alone it has none.
        assert!(d.effects[0].share > 0.9, "seed {seed}: {}", d.effects[0].share);
    }
}
