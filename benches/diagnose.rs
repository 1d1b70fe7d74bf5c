//! Where the time of a diagnosis goes, on a drive of 120 s at 100 Hz: simulated samples per second of each effect, fits
//! per second of each candidate of the search, one plain least-squares fit, and a whole diagnosis.
//!
//! Both lists come from the library, so that a new effect is measured by itself. The data of the plain fits are written
//! to `target/tmp/`, where `benches/scipy_fit.py` makes the same fits with NumPy and SciPy.

use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main, measurement::WallTime};
use hil::physics::{EFFECTS, Kind, simulate, specification};
use hil::recording::{Recording, Run};
use hil::valve::{Input, Valve};

// The fits of the search are no part of the library's interface: its own files are compiled in.
use hil::{course, least_squares, physics, process_loop, recording, valve};
#[path = "../src/diagnose/base.rs"]
#[allow(dead_code, unused_imports)]
mod base;
#[path = "../src/diagnose/criteria.rs"]
#[allow(dead_code)]
mod criteria;
#[path = "../src/diagnose/descent.rs"]
#[allow(dead_code)]
mod descent;
#[path = "../src/diagnose/error.rs"]
#[allow(dead_code)]
mod error;
#[path = "../src/diagnose/evidence.rs"]
#[allow(dead_code)]
mod evidence;
#[path = "../src/diagnose/fit.rs"]
#[allow(dead_code)]
mod fit;
#[path = "../src/diagnose/foreign.rs"]
#[allow(dead_code, unused_imports)]
mod foreign;
#[path = "../src/diagnose/loss.rs"]
#[allow(dead_code, unused_imports)]
mod loss;
#[path = "../src/diagnose/model.rs"]
#[allow(dead_code)]
mod model;
#[path = "../src/diagnose/prior.rs"]
#[allow(dead_code)]
mod prior;
#[path = "../src/diagnose/recall.rs"]
#[allow(dead_code)]
mod recall;
#[path = "../src/diagnose/remembered.rs"]
#[allow(dead_code)]
mod remembered;
#[path = "../src/diagnose/screen.rs"]
#[allow(dead_code)]
mod screen;
#[path = "../src/diagnose/simulator.rs"]
#[allow(dead_code)]
mod simulator;
#[path = "../src/diagnose/trust.rs"]
#[allow(dead_code, unused_imports)]
mod trust;

#[path = "diagnose/plain_fit.rs"]
mod plain_fit;

use plain_fit::Problem;

/// Samples of the drive, and its time step [s].
const SAMPLES: usize = 12_000;
const STEP_S: f64 = 0.01;

/// The plain fits: the effect, and its first parameter in the recording that is fitted.
const PLAIN: [(&str, f64); 2] = [("first_order_lag", 0.05), ("reversal_dead_band", 0.03)];

fn calibrated() -> Valve {
    let text = r#"
        schema = "hil.valve/1"
        name = "bench"
        current_limits = ["0 A", "1 A"]
        hysteresis.hyperbolic.a = "0.8 bar^2"
        delay = "23 ms"
        floor = "0 bar"
        [curve]
        ascending = [-42.65, 92.5, -8.4, -2.03]
        descending = [-40.01, 83.32, -1.3, -2.41]
    "#;
    Valve::from_toml(text, "bench").expect("the bench's valve is valid")
}

/// Bumps of changing height and a small sine: fast and slow, up and down, between 0.2 A and 0.8 A.
fn drive() -> (Vec<f64>, Vec<f64>) {
    let time: Vec<f64> = (0..SAMPLES).map(|k| k as f64 * STEP_S).collect();
    let current = time.iter().map(|t| 0.5 + 0.3 * (0.37 * t).sin().signum() * (0.9 * t).sin().powi(2) + 0.02 * (11.0 * t).sin()).collect();
    (time, current)
}

/// What a valve with this effect would have shown, with a reproducible ripple in place of noise.
fn recorded(id: &str, first: f64, input: Input) -> Run {
    let (time_s, current_a) = drive();
    let effect = hil::physics::effect(id).expect("the library has the effect");
    let theta: Vec<f64> = effect.parameters().iter().map(|p| p.default.unwrap_or(first)).collect();
    let mut valve = calibrated();
    valve.effects.push(specification(effect, &theta));
    let pressure = simulate(&valve, input, &time_s, &current_a).expect("the bench's drive can be simulated");
    let noisy = pressure.iter().enumerate().map(|(k, p)| p + 0.04 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0)).collect();
    Run { time_s, current_a, pressure_bar: Some(noisy), ..Run::default() }
}

fn recording_of(run: Run) -> Recording {
    Recording { source: "bench".into(), runs: vec![run], notes: Vec::new(), input: None }
}

fn group<'c>(c: &'c mut Criterion, name: &str, measurement_s: u64) -> BenchmarkGroup<'c, WallTime> {
    let mut group = c.benchmark_group(name);
    group.sample_size(10).warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(measurement_s));
    group
}

/// A simulation with each effect of the library: samples per second.
fn effects(c: &mut Criterion) {
    let (time, current) = drive();
    let mut group = group(c, "effect", 2);
    group.sample_size(40).throughput(Throughput::Elements(time.len() as u64));
    let mut plain = calibrated();
    group.bench_function("none", |b| b.iter(|| simulate(&plain, Input::Held, black_box(&time), black_box(&current))));
    for effect in EFFECTS {
        let theta = effect.examples().swap_remove(0);
        plain.effects = vec![specification(*effect, &theta)];
        group.bench_function(effect.id(), |b| b.iter(|| simulate(&plain, Input::Held, black_box(&time), black_box(&current))));
    }
    group.finish();
}

/// The fit of each candidate as the first round of a search makes it, base and effect together from all of the effect's
/// starts, on a recording of a valve with a lag: fits per second on one core. Each is brought to its end, which the
/// search spares candidates that show no promise.
fn candidates(c: &mut Criterion) {
    let recording = recording_of(recorded("first_order_lag", 0.05, Input::Held));
    let valve = calibrated();
    let course = course::Course::take(recording, &course::Preparation::default()).expect("the bench's recording has a command");
    let evidence = evidence::Evidence::of(course).expect("the bench's recording carries a diagnosis");
    let base = model::Model::base(&valve).expect("the bench's valve can be simulated");
    let fitter = fit::Fitter::new(&evidence);
    let null = fitter.recalibrate(&base, &[]);
    let mut group = group(c, "candidate", 2);
    group.throughput(Throughput::Elements(1));
    for effect in EFFECTS.iter().filter(|e| e.kind() != Kind::Scatter && !e.parameters().is_empty()) {
        let model = base.with(*effect, 0.0);
        group.bench_function(effect.id(), |b| b.iter(|| fitter.fit_new(&model, black_box(&null), &[])));
    }
    group.finish();
}

/// One least-squares fit from one start, and one simulation of it: what `benches/scipy_fit.py` does too.
fn plain_fits(c: &mut Criterion) {
    let mut group = group(c, "plain fit", 5);
    for (id, first) in PLAIN {
        let run = recorded(id, first, Input::Ramp);
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{id}.csv"));
        recording_of(run.clone()).write(&path).expect("target/tmp can be written");
        let problem = Problem { valve: &calibrated(), effect: id, run: &run, step_s: STEP_S };
        let fitted = problem.fit();
        eprintln!("{id}: {:.4?} at {:.4} bar after {} simulations", fitted.theta, fitted.rmse_bar, fitted.simulations);
        assert!((fitted.theta[4] / first - 1.0).abs() < 0.05, "the fit of {id} does not find what was put in");
        let start = problem.start();
        group.bench_function(format!("{id}, one simulation"), |b| b.iter(|| problem.residual(black_box(&start))));
        group.bench_function(format!("{id}, fit"), |b| b.iter(|| problem.fit()));
    }
    group.finish();
}

/// A whole diagnosis on all cores.
fn diagnosis(c: &mut Criterion) {
    let recording = recording_of(recorded("first_order_lag", 0.05, Input::Held));
    let valve = calibrated();
    let mut group = group(c, "diagnose", 10);
    group.bench_function("120 s at 100 Hz, whole library", |b| b.iter(|| hil::diagnose::diagnose(black_box(&recording), &valve)));
    group.finish();
}

criterion_group!(benches, effects, candidates, plain_fits, diagnosis);
criterion_main!(benches);
