//! A term that was planted is found on data that its search has not seen, and noise is left alone.

use rand::{RngExt, SeedableRng};

use super::*;
use crate::course::Run;
use crate::diagnose::evidence::Evidence;
use crate::diagnose::evidence::tests::{held, straight};
use crate::diagnose::model::Model;

/// Ramps and rests of 0.3 s to 2 s between 0.15 A and 0.9 A, in steps of 20 ms.
fn drive(seed: u64, seconds: usize) -> Vec<f64> {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let mut out = vec![0.5];
    while out.len() < 50 * seconds {
        let (from, steps) = (out[out.len() - 1], random.random_range(15..100));
        let to = if random.random::<f64>() < 0.7 { random.random_range(0.15..0.9) } else { from };
        out.extend((1..=steps).map(|k| from + (to - from) * f64::from(k) / f64::from(steps)));
    }
    out.truncate(50 * seconds);
    out
}

/// Noise that remembers for `memory_s`, besides 20 mbar of white.
fn noise(seed: u64, samples: usize, memory_s: f64) -> Vec<f64> {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let mut one = || random.random::<f64>() + random.random::<f64>() - 1.0;
    let mut slow = 0.0;
    (0..samples)
        .map(|_| {
            slow += 0.02 / memory_s * (one() - slow);
            slow + 0.05 * one()
        })
        .collect()
}

/// A run of the straight valve with `error_bar` added.
fn run(current_a: Vec<f64>, error_bar: &[f64]) -> Run {
    let pressure = current_a.iter().zip(error_bar).map(|(i, e)| 20.0 * i + e).collect();
    Run::even(None, 0.0, 0.02, current_a, pressure)
}

fn found(runs: Vec<Run>) -> Option<Vec<String>> {
    let evidence = Evidence { input: crate::valve::Input::Ramp, ..held(runs) };
    let valve = straight();
    let base = Model::base(&valve).unwrap().on(&evidence);
    let fitter = Fitter::new(&evidence);
    let null = fitter.recalibrate(&base, &[]);
    let term = discover(&fitter, &null)?;
    // What the page draws is the model with the term.
    let diagnosis = crate::diagnose::diagnosis::tests::nothing();
    let curves = crate::diagnose::diagnosis::Curves::along(&evidence);
    let mut entered = Diagnosed { diagnosis, augmented: valve.clone(), curves, open: None, recalibration: None, stands_apart: false };
    term.enter(&mut entered, &null, Vec::new());
    assert!(entered.diagnosis.adds() && term.adds_bar > 0.0);
    assert_eq!(entered.curves.augmented_bar, term.pressure_bar);
    // The end of the only recording repeats what its begin shows: the model takes what another one confirms.
    let in_model = evidence.grids.len() > 1;
    assert_eq!(entered.augmented.effects.len(), valve.effects.len() + usize::from(in_model));
    let discovery = entered.diagnosis.discovered.unwrap();
    assert_eq!((discovery.in_model, discovery.text.contains("a second recording has to confirm it")), (in_model, !in_model));
    assert_eq!(term.pressure_bar.len(), entered.curves.measured_bar.len());
    Some(term.terms.iter().map(Term::text).collect())
}

/// A wave of the pressure through a lag of 2 s.
fn planted(current_a: &[f64]) -> Vec<f64> {
    let mut past = 20.0 * current_a[0];
    let of = |i: &f64| {
        past += (20.0 * i - past) * 0.02 / 2.0;
        0.4 * (past / 1.2).sin()
    };
    current_a.iter().map(of).collect()
}

#[test]
fn a_wave_over_the_past_is_found_on_one_recording_and_on_two() {
    let of = |seed: u64, seconds: usize| {
        let current = drive(seed, seconds);
        let error: Vec<f64> = planted(&current).iter().zip(noise(seed, current.len(), 0.2)).map(|(a, b)| a + 0.2 * b).collect();
        run(current, &error)
    };
    for runs in [vec![of(1, 120)], vec![of(2, 70), of(3, 70)]] {
        let terms = found(runs).expect("a term");
        assert!(terms.iter().any(|t| t.contains("sin((past_pressure(")), "{terms:?}");
    }
}

/// What is found in noise of this seed.
fn found_in_noise(seed: u64) -> Option<Vec<String>> {
    let current = drive(seed, 60);
    let memory_s = [0.05, 0.2, 0.8, 3.0][seed as usize % 4];
    let error = noise(100 + seed, current.len(), memory_s);
    found(vec![run(current, &error)])
}

#[test]
fn noise_is_left_alone() {
    for seed in 0..4 {
        assert_eq!(found_in_noise(seed), None, "{seed}");
    }
}
