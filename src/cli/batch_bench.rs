//! What the attempts of a batch run on: threads of a simulation, or the sites of a bench.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;

use super::batch::ValveReports;
use super::batch_folder::attempt_folder;
use super::run::{believed, load_valve};
use super::{CliError, run_folder};
use crate::batch::BatchError;
use crate::batch::campaign::{Job, Worker};
use crate::batch::population::{Population, valve_seed};
use crate::plan::Plan;
use crate::record::{Outcome, Provenance, TestRecord, Trace};
use crate::rig::RigIdentity;
use crate::rig::simulated::SimulatedRig;
use crate::runner::{self, Prepared, RunOptions};
use crate::valve::Valve;

/// Where and on what is tested.
#[derive(Debug, Clone, Args)]
pub struct RigArgs {
    /// Run on simulated valves.
    #[arg(long)]
    pub sim: bool,
    /// Valve file, or the bare name of one in valves/: the valve that is simulated, and the middle of the population.
    #[arg(long)]
    pub valve: Option<String>,
}

/// What all attempts share.
pub struct Setup {
    /// The plan with its limits.
    pub plan: Plan,
    /// The valve that the controller believes in.
    pub model: Valve,
    valve: Valve,
    prepared: Prepared,
    identity: RigIdentity,
    population: Option<Population>,
    seed: u64,
    simulated: bool,
}

impl Setup {
    /// Checks plan, valve and model against each other before anything moves.
    pub fn new(args: &RigArgs, plan: Plan, population: Option<Population>, seed: u64) -> Result<Self, CliError> {
        let (valve, path) = load_valve(args.valve.as_deref().or(plan.model.as_deref()).unwrap_or("paper"))?;
        let model = believed(&plan, &valve)?;
        plan.check_valve(&model).and_then(|()| plan.check_valve(&valve)).map_err(CliError::input)?;
        let bytes = std::fs::read(&path).map_err(|e| CliError::input(format!("{}: {e}", path.display())))?;
        let identity = RigIdentity {
            kind: "sim".into(),
            name: path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            sha256: super::batch::hex(&bytes),
            details: Vec::new(),
        };
        let prepared = Prepared::new(&plan, &model);
        Ok(Self { plan, model, valve, prepared, identity, population, seed, simulated: args.sim })
    }

    /// Whether the valves are simulated.
    pub fn simulated(&self) -> bool {
        self.simulated
    }

    /// What the rig is.
    pub fn identity(&self) -> RigIdentity {
        self.identity.clone()
    }

    /// Simulates one attempt on the valve at `position` of the population.
    pub fn simulate(
        &self,
        position: usize,
        attempt: u32,
        dut: &crate::record::Dut,
        stop: Option<&AtomicBool>,
    ) -> Result<(TestRecord, Trace), BatchError> {
        let (valve, drawn) = match &self.population {
            Some(population) => population.draw(&self.valve, self.seed, position),
            None => (self.valve.clone(), Vec::new()),
        };
        // The noise of a further attempt is other noise on the same valve.
        let seed = valve_seed(valve_seed(self.seed, position), attempt as usize);
        let identity = RigIdentity { details: drawn, ..self.identity.clone() };
        let mut rig = SimulatedRig::new(&valve, self.plan.period_s, Some(seed), identity).map_err(|e| BatchError::Input(e.to_string()))?;
        let options = RunOptions { model: &self.model, dut, seed, stop, prepared: Some(&self.prepared) };
        Ok(runner::run(&self.plan, &mut rig, &options, &mut ()))
    }
}

/// The workers of a campaign.
pub struct Bench<'a> {
    setup: &'a Setup,
    dir: PathBuf,
    reports: ValveReports,
    workers: usize,
    stop: &'a AtomicBool,
}

impl<'a> Bench<'a> {
    /// Opens what is needed before the first valve.
    pub fn open(
        setup: &'a Setup,
        _args: &RigArgs,
        dir: &Path,
        reports: ValveReports,
        threads: Option<usize>,
        stop: &'a AtomicBool,
    ) -> Result<Self, CliError> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self { setup, dir: dir.into(), reports, workers: threads.unwrap_or(cores).clamp(1, 256), stop })
    }

    /// One worker per thread or site.
    pub fn workers(&self) -> Vec<Worker<'_>> {
        (0..self.workers).map(|_| Box::new(|job: &Job| self.test(job)) as Worker<'_>).collect()
    }

    fn test(&self, job: &Job) -> Result<TestRecord, BatchError> {
        let started = super::batch::now();
        // A simulated valve takes milliseconds: it ends, and the campaign stops after it.
        let stop = (!self.setup.simulated).then_some(self.stop);
        let (mut record, trace) = self.setup.simulate(job.position, job.attempt, &job.dut, stop)?;
        record.provenance = Some(Provenance { version: env!("CARGO_PKG_VERSION").into(), started, station: None });
        let accepted = matches!(record.outcome, Outcome::Pass | Outcome::Marginal);
        if self.reports == ValveReports::All || (self.reports == ValveReports::Failed && !accepted) {
            let folder = self.dir.join(attempt_folder(&job.dut.serial, job.attempt));
            let stored = |e: CliError| BatchError::store(&folder, std::io::Error::other(e.message));
            run_folder::make_folder(&folder).and_then(|()| run_folder::write(&folder, &record, &trace)).map_err(stored)?;
        }
        // What all attempts share stands once, in the plan and the model, and not in every line of the journal.
        record.stability = None;
        record.model = None;
        Ok(record)
    }
}
