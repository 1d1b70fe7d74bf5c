//! One recording, one answer: identification, simulation and diagnosis speak of the same samples, noise and error.

use hil::course::{Course, Preparation};
use hil::diagnose::diagnose;
use hil::identify::{HysteresisChoice, Options, identify};
use hil::physics::{Misfit, simulate_course};
use hil::recording::{Recording, Run};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

const NOISE_BAR: f64 = 0.03;

/// A valve without hysteresis, 20 ms dead time and a lag of 30 ms, computed step by step.
fn run(name: &str, start_s: f64, dt_s: f64, samples: usize, seed: u64) -> Run {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    let normal = Normal::new(0.0, NOISE_BAR).unwrap();
    let current = |t: f64| 0.5 + 0.3 * (0.5 * t).sin() + 0.1 * (2.9 * t).sin();
    let curve = |i: f64| ((-41.3 * i + 87.9) * i - 4.85) * i - 2.22;
    let mut run = Run { name: Some(name.into()), ..Run::default() };
    let (mut pressure, mut all) = (curve(current(-0.02)), Vec::new());
    let fine = (dt_s / 0.001).round() as usize;
    for k in 0..samples {
        let t = k as f64 * dt_s;
        run.time_s.push(start_s + t);
        run.current_a.push(current(t));
        all.push(pressure + normal.sample(&mut random));
        for j in 0..fine {
            pressure += (curve(current(t + j as f64 * 0.001 - 0.0195)) - pressure) * (1.0 - (-0.001f64 / 0.03).exp());
        }
    }
    run.pressure_bar = Some(all);
    run
}

/// Two runs at two rates; in the first 5 s without a row and half a second without a pressure.
fn recording(start_s: f64) -> Recording {
    let mut first = run("a", start_s, 0.01, 6000, 1);
    let keep = |k: usize| !(2000..2500).contains(&k);
    let kept = |values: &[f64]| values.iter().enumerate().filter(|(k, _)| keep(*k)).map(|(_, v)| *v).collect::<Vec<f64>>();
    let mut pressure = kept(first.pressure_bar.as_ref().unwrap());
    pressure[3000..3050].fill(f64::NAN);
    first = Run { time_s: kept(&first.time_s), current_a: kept(&first.current_a), pressure_bar: Some(pressure), ..first };
    Recording { source: "law.csv".into(), runs: vec![first, run("b", start_s, 0.02, 2500, 2)], notes: Vec::new(), input: None }
}

#[test]
fn all_commands_see_the_same_samples_noise_and_error() {
    let recording = recording(0.0);
    let course = Course::of(&recording, &Preparation::default()).unwrap();
    assert_eq!(
        course.runs.iter().map(|r| (r.name.clone().unwrap(), r.dt_s)).collect::<Vec<_>>(),
        [("a".into(), 0.01), ("a".into(), 0.01), ("b".into(), 0.02)]
    );
    assert_eq!(course.readings(), 5500 - 50 + 2500);
    assert!((course.noise.bar / NOISE_BAR - 1.0).abs() < 0.05, "{:?}", course.noise);

    let options = Options { order: Some(3), hysteresis: HysteresisChoice::None, ..Options::default() };
    let identified = identify(&recording, &options).unwrap();
    let course = Course::of(&recording, &Preparation::for_model(&recording, &identified.valve)).unwrap();
    let simulated = simulate_course(&identified.valve, &course).unwrap();
    let misfit = course.runs.iter().zip(&simulated).map(|(run, values)| Misfit::of(run, values)).fold(Misfit::default(), Misfit::and);
    let diagnosed = diagnose(&recording, &identified.valve).unwrap();

    let compared = |values: &[f64]| values.iter().filter(|p| p.is_finite()).count();
    let traced: usize = identified.traces.iter().map(|t| compared(&t.measured_bar)).sum();
    assert_eq!([traced, misfit.readings, compared(&diagnosed.curves.measured_bar)], [course.readings(); 3]);
    assert_eq!([identified.valve.noise_bar, diagnosed.diagnosis.rmse_bar.noise_floor], [course.noise.bar; 2]);
    let rmse_bar = misfit.rmse_bar().unwrap();
    assert!((identified.rmse_bar - rmse_bar).abs() < 1e-6, "identify {} simulate {rmse_bar}", identified.rmse_bar);
    assert!(
        (diagnosed.diagnosis.rmse_bar.base - rmse_bar).abs() < 1e-6,
        "diagnose {} simulate {rmse_bar}",
        diagnosed.diagnosis.rmse_bar.base
    );
    // Beside the noise stands what nobody knows: where the valve was before each of the three starts.
    assert!(rmse_bar < 1.15 * NOISE_BAR, "{rmse_bar}");
}

/// A comparison has the gaps, the rates and the input of every other command.
#[test]
fn a_model_in_a_comparison_is_that_of_a_simulation() {
    let folder = tempfile::tempdir().unwrap();
    recording(0.0).write(&folder.path().join("law.csv")).unwrap();
    let rmse_bar = |arguments: &[&str], at: &dyn Fn(&serde_json::Value) -> f64| {
        let output =
            assert_cmd::Command::cargo_bin("hil").unwrap().current_dir(folder.path()).args(arguments).args(["--format", "json"]).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        at(&serde_json::from_slice(&output.stdout).unwrap())
    };
    let mut found = Vec::new();
    for input in ["held", "ramp"] {
        let simulated = ["simulate", "law.csv", "--model", "paper", "--input", input];
        let simulated = rmse_bar(&simulated, &|v| v["rmse_bar"].as_f64().unwrap());
        let compared =
            rmse_bar(&["compare", "law.csv", "paper", "--input", input], &|v| v["against_first"][0]["rmse_bar"].as_f64().unwrap());
        assert!((simulated - compared).abs() < 2e-6, "{input}: simulate {simulated} compare {compared}");
        found.push(simulated);
    }
    assert!((found[0] - found[1]).abs() > 1e-3, "{found:?}");
}

#[test]
fn the_clock_of_a_recording_does_not_matter() {
    let options = Options { order: Some(3), hysteresis: HysteresisChoice::None, ..Options::default() };
    let zero = identify(&recording(0.0), &options).unwrap();
    let course = |start_s: f64| Course::take(recording(start_s), &Preparation::default()).unwrap();
    for start_s in [-86_400.0, 1.7e9] {
        let moved = identify(&recording(start_s), &options).unwrap();
        assert!((moved.rmse_bar - zero.rmse_bar).abs() < 1e-6 && (moved.valve.delay_s - zero.valve.delay_s).abs() < 1e-6, "{start_s}");
        // An effect that counts time counts it from the run's start.
        let mut drifting = zero.valve.clone();
        drifting.effects.push(hil::physics::specification(hil::physics::effect("sensor_drift").unwrap(), &[0.5, 30.0]));
        let (there, here) = (simulate_course(&drifting, &course(start_s)).unwrap(), simulate_course(&drifting, &course(0.0)).unwrap());
        assert!(there.iter().flatten().zip(here.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-6), "{start_s}");
    }
}
