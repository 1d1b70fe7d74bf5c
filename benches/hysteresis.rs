//! The hyperbola over a recorded current: monotone stretches at once, against the plain per-sample recursion.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hil::valve::{Polynomial, ReferenceCurves, hyperbola_per_sample, hyperbola_stretches};

fn hysteresis(c: &mut Criterion) {
    let curves =
        ReferenceCurves::new(Polynomial::new([-42.65, 92.5, -8.4, -2.03]), Polynomial::new([-40.01, 83.32, -1.3, -2.41]), (0.0, 1.0))
            .expect("the paper's curves are valid");
    let n = 100_000;
    // A 40 s triangle at 100 Hz, a current that turns at every sample, and one that turns after one to six.
    let triangle: Vec<f64> = (0..n).map(|k| 0.1 + 0.8 * (1.0 - ((k % 4000) as f64 / 2000.0 - 1.0).abs())).collect();
    let reversing: Vec<f64> = (0..n).map(|k| 0.5 + if k % 2 == 0 { 0.1 } else { -0.1 } + 0.05 * (k as f64 * 0.001).sin()).collect();
    let mut mixed = Vec::with_capacity(n);
    let (mut current, mut direction, mut left, mut seed) = (0.5, 0.02, 0, 1u32);
    for _ in 0..n {
        if left == 0 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            left = 1 + (seed >> 16) % 6;
            direction = -direction;
            if (current - 0.5) * direction > 0.3 * 0.02 {
                left = 1;
            }
        }
        left -= 1;
        current += direction;
        mixed.push(current);
    }
    let mut out = vec![0.0; n];
    for (name, current) in [("triangle", &triangle), ("reversing", &reversing), ("mixed", &mixed)] {
        let mut group = c.benchmark_group(format!("hyperbola/{name}"));
        group.throughput(Throughput::Elements(n as u64));
        let start = curves.average_at(current[0]);
        group.bench_function("stretches", |b| b.iter(|| hyperbola_stretches(&curves, 0.8, start, current, &mut out)));
        group.bench_function("per sample", |b| b.iter(|| hyperbola_per_sample(&curves, 0.8, start, current, &mut out)));
        group.finish();
    }
}

criterion_group!(benches, hysteresis);
criterion_main!(benches);
