//! A model that a good valve leaves where it moves, and follows where it rests.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

use super::super::*;
use super::valve;
use crate::physics::simulate;
use crate::recording::Run;
use crate::valve::Input;

const NOISE_BAR: f64 = 0.05;

/// Steps of a valve that overshoots or falls short as chance has it, and what `and_then` does to the reading at time and pressure.
fn steps(source: &str, seed: u64, and_then: impl Fn(f64, f64) -> f64) -> Recording {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let levels = [0.3, 0.62, 0.45, 0.8, 0.35, 0.7, 0.5, 0.66, 0.4, 0.74];
    let time_s: Vec<f64> = (0..6000).map(|k| 0.01 * f64::from(k)).collect();
    let level = |k: usize| levels[(k / 200 + seed as usize) % levels.len()];
    let current_a: Vec<f64> = (0..6000).map(level).collect();
    let mut off_bar = 0.0;
    let pressure = simulate(&valve(), Input::Held, &time_s, &current_a).unwrap();
    let pressure = pressure.iter().enumerate().map(|(k, p)| {
        // Where the step arrives.
        if k % 200 == 3 && k > 200 {
            off_bar = 3.0 * normal.sample(&mut random);
        }
        off_bar *= (-0.01f64 / 0.06).exp();
        and_then(time_s[k], p + off_bar) + NOISE_BAR * normal.sample(&mut random)
    });
    let pressure_bar = Some(pressure.collect());
    let runs = vec![Run { pressure_bar, time_s, current_a, ..Run::default() }];
    Recording { source: source.into(), runs, notes: vec![], input: None }
}

fn against_good(record: &Recording) -> Diagnosis {
    diagnose_against(record, &valve(), &[steps("good.csv", 1, |_, p| p)]).unwrap().diagnosis
}

#[test]
fn what_the_model_lacks_in_movement_is_no_excuse_for_what_is_off_at_rest() {
    let healthy = against_good(&steps("healthy.csv", 2, |_, p| p));
    assert_eq!((healthy.verdict, healthy.effects.len()), (Verdict::Match, 0), "{}", healthy.summary);

    // Less than the model is off in all, and many times what it is off at rest.
    let off = against_good(&steps("off.csv", 2, |_, p| p + 0.4));
    let first = off.effects.first().unwrap_or_else(|| panic!("{}", off.summary));
    assert_eq!((first.id.as_str(), first.claim), ("sensor_zero", Claim::Changed), "{}", off.summary);
    assert!((first.parameters["offset"].value - 0.4).abs() < 0.1, "{}", off.summary);

    let gain = against_good(&steps("gain.csv", 2, |_, p| 1.06 * p));
    let told =
        |f: &Finding| f.claim == Claim::Changed && (f.id == "sensor_gain" || f.indistinguishable.iter().any(|id| id == "sensor_gain"));
    assert!(gain.effects.iter().any(told), "{}", gain.summary);
}

#[test]
fn a_tone_is_none_of_what_a_good_valve_is_off_by() {
    let hums = against_good(&steps("hums.csv", 2, |t, p| p + 0.25 * (std::f64::consts::TAU * 7.3 * t).sin()));
    let first = hums.effects.first().unwrap_or_else(|| panic!("{}", hums.summary));
    assert_eq!((first.id.as_str(), first.claim), ("periodic_disturbance", Claim::Changed), "{}", hums.summary);
    assert!((first.parameters["frequency"].value - 7.3).abs() < 0.01, "{}", hums.summary);
}

#[test]
fn readings_that_stand_still_show_no_quieter_sensor() {
    // A sensor that sticks within 0.1 bar.
    let sticks = |mut of: Recording| {
        let mut shown = 0.0;
        for p in of.runs[0].pressure_bar.iter_mut().flatten() {
            shown = f64::clamp(shown, *p - 0.1, *p + 0.1);
            *p = shown;
        }
        of
    };
    let d = against_good(&sticks(steps("sticks.csv", 2, |_, p| p)));
    assert!(d.rmse_bar.noise_floor > 0.5 * NOISE_BAR, "{}", d.rmse_bar.noise_floor);
    assert!(d.effects.iter().all(|f| f.id != "sensor_outliers"), "{}", d.summary);
}
