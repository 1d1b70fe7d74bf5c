//! Reading and writing recordings, per row, in every format.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hil::recording::{Recording, Run};

fn recording(c: &mut Criterion) {
    let n = 100_000;
    let time_s: Vec<f64> = (0..n).map(|k| f64::from(k) / 100.0).collect();
    let rounded = |v: f64, digits: f64| (v * digits).round() / digits;
    let current_a: Vec<f64> = time_s.iter().map(|t| rounded(0.5 + 0.4 * (t / 3.0).sin(), 1e5)).collect();
    let pressure_bar: Vec<f64> = current_a.iter().map(|i| rounded(25.0 * i, 1e3)).collect();
    let run = Run { time_s, current_a, pressure_bar: Some(pressure_bar), ..Run::default() };
    let recording = Recording { source: "bench".into(), runs: vec![run], notes: Vec::new(), input: None };
    let folder = tempfile::tempdir().expect("a folder for the files");
    for format in ["csv", "parquet", "mf4"] {
        let path = folder.path().join(format!("bench.{format}"));
        let mut group = c.benchmark_group(format!("recording/{format}"));
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function("write", |b| b.iter(|| recording.write(&path).expect("written")));
        group.bench_function("read", |b| b.iter(|| Recording::read(&path, &[]).expect("read")));
        group.finish();
    }
}

criterion_group!(benches, recording);
criterion_main!(benches);
