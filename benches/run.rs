//! A run from the controller's step to the record, and the margins that every record carries.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hil::control::stability::margins;
use hil::control::tune::{TuningTask, tune};
use hil::control::{Controller, Gains, linear_loop};
use hil::plan::Plan;
use hil::record::Dut;
use hil::rig::RigIdentity;
use hil::rig::simulated::SimulatedRig;
use hil::runner::{self, Prepared, RunOptions};
use hil::valve::Valve;

fn shipped(plan: &str) -> (Plan, Valve) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let plan = Plan::load(&root.join(plan), &[]).expect("the shipped plan");
    (plan, Valve::load(&root.join("valves/paper.toml")).expect("the shipped valve"))
}

fn controller(c: &mut Criterion) {
    let (plan, valve) = shipped("plans/tipin.toml");
    let targets: Vec<f64> = (0..1000).map(|k| 16.0 + 8.0 * (f64::from(k) * 0.02).sin()).collect();
    let mut group = c.benchmark_group("controller");
    group.throughput(Throughput::Elements(targets.len() as u64));
    group.bench_function("step", |b| {
        b.iter(|| {
            let mut controller = Controller::new(plan.controller, &valve, 0.0);
            targets.iter().map(|t| controller.step(*t, Some(t - 0.3)).current_a).sum::<f64>()
        });
    });
    group.finish();
}

fn run(c: &mut Criterion) {
    let mut group = c.benchmark_group("run");
    for name in ["plans/tipin.toml", "plans/drive-800s.toml"] {
        let (plan, valve) = shipped(name);
        let (prepared, dut) = (Prepared::new(&plan, &valve), Dut::default());
        group.throughput(Throughput::Elements(plan.samples() as u64));
        group.bench_function(plan.name.clone(), |b| {
            b.iter(|| {
                let mut rig = SimulatedRig::new(&valve, plan.period_s, Some(1), RigIdentity::default()).expect("a valve");
                let options = RunOptions { model: &valve, dut: &dut, seed: 1, stop: None, prepared: Some(&prepared) };
                runner::run(&plan, &mut rig, &options, &mut ())
            });
        });
    }
    group.finish();
}

fn stability(c: &mut Criterion) {
    let (_, valve) = shipped("plans/tipin.toml");
    let found = linear_loop(&valve);
    c.bench_function("margins", |b| b.iter(|| margins(black_box(&found.plant), found.delay_range_s, Gains::PAPER, 100.0)));
    let task =
        TuningTask { plant: found.plant, delay_range_s: found.delay_range_s, max_sensitivity: 1.4, noise_share: 0.0, rate_hz: 100.0 };
    c.bench_function("tune", |b| b.iter(|| tune(black_box(&task))));
}

criterion_group! { name = benches; config = Criterion::default().sample_size(10); targets = controller, run, stability }
criterion_main!(benches);
