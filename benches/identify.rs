//! A model from a sweep of 200 s at 100 Hz: five triangles of shrinking amplitude.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hil::identify::{Options, identify};
use hil::physics::simulate;
use hil::recording::{Recording, Run};
use hil::valve::{Input, Valve};

fn sweep() -> Recording {
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
    let valve = Valve::from_toml(text, "bench").expect("the bench's valve is valid");
    let time_s: Vec<f64> = (0..20_000).map(|k| k as f64 * 0.01).collect();
    let current_a: Vec<f64> = time_s
        .iter()
        .map(|t| {
            let shrink = 1.0 - 0.12 * (t / 40.0).floor();
            let phase = (t / 40.0).fract();
            0.52 + shrink * 0.42 * (1.0 - 4.0 * (phase - 0.5).abs())
        })
        .collect();
    let pressure = simulate(&valve, Input::Held, &time_s, &current_a).expect("the bench's sweep can be simulated");
    let noisy = pressure.iter().enumerate().map(|(k, p)| p + 0.04 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(noisy), ..Run::default() };
    Recording { source: "sweep".into(), runs: vec![run], notes: Vec::new(), input: None }
}

fn identification(c: &mut Criterion) {
    let recording = sweep();
    let mut group = c.benchmark_group("identify");
    group.sample_size(10).throughput(Throughput::Elements(20_000));
    group.bench_function("sweep of 200 s", |b| b.iter(|| identify(black_box(&recording), &Options::default())));
    group.finish();
}

criterion_group!(benches, identification);
criterion_main!(benches);
