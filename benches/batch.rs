//! A batch of simulated valves, from the first valve to the statistics: the cost per valve must not grow with their number.

use std::sync::atomic::AtomicBool;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use hil::batch::campaign::{Job, Retry, Rules, Worker, run};
use hil::batch::index::{Index, Query};
use hil::batch::journal::{Journal, Kind, Line, encode};
use hil::batch::population::{Population, valve_seed};
use hil::batch::store::{Header, SCHEMA};
use hil::batch::summary::summarise;
use hil::batch::tally::Tally;
use hil::plan::Plan;
use hil::record::{Dut, TestRecord};
use hil::rig::RigIdentity;
use hil::rig::simulated::SimulatedRig;
use hil::runner::{self, Prepared, RunOptions};
use hil::valve::Valve;

struct Setup {
    plan: Plan,
    valve: Valve,
    prepared: Prepared,
    population: Population,
}

impl Setup {
    fn new() -> Self {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let plan = Plan::load(&root.join("plans/tipin.toml"), &[]).expect("the shipped plan");
        let valve = Valve::load(&root.join("valves/paper.toml")).expect("the shipped valve");
        let prepared = Prepared::new(&plan, &valve);
        Self { plan, valve, prepared, population: Population::standard() }
    }

    fn test(&self, position: usize, dut: &Dut) -> TestRecord {
        let (valve, _) = self.population.draw(&self.valve, 1, position);
        let seed = valve_seed(1, position);
        let mut rig = SimulatedRig::new(&valve, self.plan.period_s, Some(seed), RigIdentity::default()).expect("a valve");
        let options = RunOptions { model: &self.valve, dut, seed, stop: None, prepared: Some(&self.prepared) };
        let (mut record, _) = runner::run(&self.plan, &mut rig, &options, &mut ());
        record.stability = None;
        record.model = None;
        record
    }
}

fn header(count: usize) -> Header {
    Header {
        schema: SCHEMA.into(),
        plan: "tipin".into(),
        plan_sha256: String::new(),
        parameters: vec![],
        overridden: vec![],
        simulated: true,
        seed: 1,
        rig: RigIdentity::default(),
        valves: Some(count),
        valves_sha256: None,
        population: None,
        limits: None,
        decision_rule: String::new(),
        attempts: (1, vec![]),
        station: None,
        version: String::new(),
    }
}

fn serial(position: usize) -> Dut {
    Dut { serial: format!("SIM-{position:06}"), ..Dut::default() }
}

fn batch(c: &mut Criterion) {
    let setup = Setup::new();
    let mut group = c.benchmark_group("batch/tipin");
    group.sample_size(10);
    for count in [100, 1000, 10_000] {
        group.throughput(Throughput::Elements(count as u64));
        group.bench_with_input(BenchmarkId::new("valves", count), &count, |b, &count| {
            b.iter(|| {
                let dir = tempfile::tempdir().expect("a folder");
                let journal = Journal::begin(dir.path()).expect("a journal");
                let jobs = (0..count).map(|position| Job { position, attempt: 1, dut: serial(position) });
                let test = |job: &Job| Ok(setup.test(job.position, &job.dut));
                let workers: Vec<Worker<'_>> = (0..2).map(|_| Box::new(test) as Worker<'_>).collect();
                let retry = Retry { most: 1, after: vec![] };
                let rules = Rules { retry: &retry, stop: &AtomicBool::new(false), clock: &String::new, synced: false };
                let mut tally = Tally::default();
                run(journal, jobs, workers, rules, &mut tally, |_| {}).expect("a batch");
                summarise(&header(count), &tally, vec![], |_| None, |_| None)
            });
        });
    }
    group.finish();
}

/// A serial number among 100 000 records: the whole question, from opening the index on.
fn history(c: &mut Criterion) {
    let setup = Setup::new();
    let dir = tempfile::tempdir().expect("a folder");
    let record = setup.test(0, &serial(0));
    let mut journal = Journal::begin(dir.path()).expect("a journal");
    for position in 0..100_000 {
        let record = TestRecord { dut: serial(position), ..record.clone() };
        let line = Line { event: Kind::Finished, position, attempt: 1, at: "2026-01-01T00:00:00Z".into(), dut: None, record: Some(record) };
        journal.append(&encode(&line)).expect("written");
    }
    journal.confirm().expect("on the disk");
    drop(Index::open(dir.path()).expect("an index"));
    c.bench_function("history/serial of 100000", |b| {
        b.iter(|| {
            let index = Index::open(dir.path()).expect("an index");
            index.query(&Query { serial: Some("SIM-073210".into()), limit: 1000, ..Query::default() }).expect("an answer")
        });
    });
}

criterion_group!(benches, batch, history);
criterion_main!(benches);
