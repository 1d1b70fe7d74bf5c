//! Where the time of a diagnosis goes: samples per second of each effect, and a whole diagnosis of a drive of 60 s.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hil::physics::{EFFECTS, simulate, specification};
use hil::recording::{Recording, Run};
use hil::valve::Valve;

fn valve() -> Valve {
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

/// Ramps, holds and small sines, and a reproducible ripple in place of noise.
fn drive(n: usize) -> (Vec<f64>, Vec<f64>) {
    let time: Vec<f64> = (0..n).map(|k| k as f64 * 0.01).collect();
    let current = time.iter().map(|t| 0.5 + 0.3 * (0.37 * t).sin().signum() * (0.9 * t).sin().powi(2) + 0.02 * (11.0 * t).sin()).collect();
    (time, current)
}

fn effects(c: &mut Criterion) {
    let (time, current) = drive(12_000);
    let mut group = c.benchmark_group("effect");
    group.throughput(Throughput::Elements(time.len() as u64));
    for effect in EFFECTS {
        let theta: Vec<f64> = effect.parameters().iter().map(|p| p.starts[0]).collect();
        let mut valve = valve();
        valve.effects.push(specification(*effect, &theta));
        group.bench_function(effect.id(), |b| b.iter(|| simulate(&valve, black_box(&time), black_box(&current))));
    }
    group.finish();
}

fn diagnosis(c: &mut Criterion) {
    let (time_s, current_a) = drive(6_000);
    let mut true_valve = valve();
    true_valve.lag_s = 0.05;
    let pressure = simulate(&true_valve, &time_s, &current_a).expect("the bench's drive can be simulated");
    let noisy = pressure.iter().enumerate().map(|(k, p)| p + 0.04 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(noisy), ..Run::default() };
    let recording = Recording { source: "bench".into(), runs: vec![run], notes: Vec::new() };
    let valve = valve();
    let mut group = c.benchmark_group("diagnose");
    group.sample_size(10);
    group.bench_function("60 s at 100 Hz, whole library", |b| b.iter(|| hil::diagnose::diagnose(black_box(&recording), &valve)));
    group.finish();
}

criterion_group!(benches, effects, diagnosis);
criterion_main!(benches);
