//! What the attempts of a batch run on: threads of a simulation, or the sites of a bench.

use std::io::{BufRead, IsTerminal};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::batch_args::{RigArgs, ValveReports};
use super::batch_emulated::Emulated;
use super::batch_folder::attempt_folder;
use super::lock::lock;
use super::on_wire::{self, WireArgs};
use super::run::sha256;
use super::seat::{Company, Seat};
use super::valves::believed;
use super::{CliError, exit, files, run_folder};
use crate::batch::BatchError;
use crate::batch::campaign::{Job, Retry, Worker};
use crate::batch::population::{Population, valve_seed};
use crate::batch::station::Station;
use crate::output::make_folder_within;
use crate::plan::Plan;
use crate::record::{Dut, Outcome, PhaseRecord, PlanIdentity, Provenance, TestRecord, Timing, Trace};
use crate::rig::RigIdentity;
use crate::rig::paced::Paced;
use crate::rig::profile::{Profile, TransportKind};
use crate::rig::simulated::SimulatedRig;
use crate::runner::{self, Attended, Prepared, RunOptions, glances};
use crate::units::{Current, Pressure};
use crate::valve::Valve;

/// How often somebody looks at a simulation that goes by the clock.
const LOOK: std::time::Duration = std::time::Duration::from_millis(20);

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
    /// Driver and line of each site; empty in a simulation.
    sites: Vec<WireArgs>,
    /// What is emulated at each site, where anything is.
    emulated: Vec<Option<Emulated>>,
    supply: Option<Mutex<()>>,
}

impl Setup {
    /// Checks plan, valve, model and profile against each other before anything moves.
    pub fn new(args: &RigArgs, plan: Plan, population: Option<Population>, seed: u64, station: Option<&Station>) -> Result<Self, CliError> {
        if !args.sim && args.wire.driver.is_none() {
            return Err(CliError::usage("say on what: --sim, or --driver PROFILE with --port DEV or --tcp HOST:PORT"));
        }
        let (valve, path) = files::valve_under(&plan, args.valve.as_deref())?;
        let model = believed(&plan, &valve)?;
        plan.check_valve(&model).and_then(|()| plan.check_valve(&valve)).map_err(CliError::input)?;
        let sites = sites(args, station)?;
        let identity = match &args.wire.driver {
            Some(driver) => driver_identity(driver)?,
            None => RigIdentity { kind: "sim".into(), name: file_name(&path), sha256: sha256(&path)?, ..RigIdentity::default() },
        };
        let prepared = Prepared::new(&plan, &model);
        let shared = station.and_then(|s| s.supply.as_ref()).is_some_and(|s| s.shared);
        let supply = shared.then(Mutex::default);
        let emulated = vec![None; sites.len()];
        Ok(Self { plan, model, valve, prepared, identity, population, seed, sites, emulated, supply })
    }

    /// Puts an emulator at a site, for which the valve of each attempt is mounted anew.
    pub fn emulate(&mut self, site: usize, emulated: Emulated) {
        if let Some(place) = self.emulated.get_mut(site) {
            *place = Some(emulated);
        }
    }

    /// Whether the valves are simulated.
    pub fn simulated(&self) -> bool {
        self.sites.is_empty()
    }

    /// What the rig is.
    pub fn identity(&self) -> RigIdentity {
        self.identity.clone()
    }

    /// One attempt: on the valve at `position` of the population, or on the one that is mounted on `site`. A rig that fails gives a
    /// record that says so.
    pub fn attempt(&self, site: usize, position: usize, attempt: u32, dut: &Dut) -> Result<(TestRecord, Trace), BatchError> {
        self.attempt_seated(site, position, attempt, dut, Seat::empty())
    }

    /// As [`Setup::attempt`], with somebody beside it.
    pub fn attempt_seated(
        &self,
        site: usize,
        position: usize,
        attempt: u32,
        dut: &Dut,
        mut seat: Seat<'_>,
    ) -> Result<(TestRecord, Trace), BatchError> {
        // The noise of a further attempt is other noise on the same valve.
        let seed = valve_seed(valve_seed(self.seed, position), attempt as usize);
        let Some(wire) = self.sites.get(site) else { return self.simulate(position, seed, dut, seat) };
        // Sites on one supply take turns: a flow that starves the neighbour would be measured as his fault.
        let _turn = self.supply.as_ref().map(|supply| match supply.try_lock() {
            Ok(turn) => turn,
            Err(_) => {
                (seat.waits)();
                lock(supply)
            }
        });
        (seat.begins)();
        let mounted = match self.emulated.get(site) {
            Some(Some(emulated)) => {
                let mounted = emulated.mount(position, seed, wire, self.plan.period_s);
                Some(mounted.map_err(|e| BatchError::Rig(e.message))?)
            }
            _ => None,
        };
        let wire = mounted.as_ref().map_or(wire, |m| &m.1);
        match on_wire::run_seated(&self.plan, &self.model, dut, seed, wire, seat, Some(&self.prepared)) {
            Ok(run) => Ok((run.record, run.trace)),
            Err(on_wire::Failed { error, safe }) => {
                let outcome = match error.code {
                    exit::ABORTED => Outcome::Aborted,
                    exit::RIG | exit::INTERNAL => Outcome::Error,
                    _ => return Err(BatchError::Input(error.message)),
                };
                let mut record = self.without_run(dut, outcome, error.message);
                record.safe_state = safe.map(Into::into);
                if record.ended_unsafe() {
                    record.outcome = Outcome::Error;
                    record.reasons.insert(0, "SAFE STATE NOT CONFIRMED".into());
                }
                Ok((record, Trace::default()))
            }
        }
    }

    fn simulate(&self, position: usize, seed: u64, dut: &Dut, mut seat: Seat<'_>) -> Result<(TestRecord, Trace), BatchError> {
        let (valve, drawn) = match &self.population {
            Some(population) => population.draw(&self.valve, self.seed, position),
            None => (self.valve.clone(), Vec::new()),
        };
        let identity = RigIdentity { details: drawn, ..self.identity.clone() };
        let mut rig = SimulatedRig::new(&valve, self.plan.period_s, Some(seed), identity).map_err(|e| BatchError::Input(e.to_string()))?;
        (seat.begins)();
        let control = std::sync::Arc::clone(&seat.control);
        // A simulated valve takes milliseconds: it ends, and the campaign stops after it. One that goes by the clock can be stopped.
        let stop = seat.paced.then(|| control.stop_flag());
        let options = RunOptions { model: &self.model, dut, seed, stop, prepared: Some(&self.prepared) };
        let mut observer = Attended { observer: seat.feed.take().unwrap_or_else(|| glances(1).0), attendant: seat.attendant.take() };
        let (mut record, trace) = if seat.paced {
            // As on a bench: the run has a thread of its own, and whoever looks has another.
            std::thread::scope(|scope| {
                let run = scope.spawn(|| runner::run(&self.plan, &mut Paced::new(&mut rig), &options, &mut observer));
                while !run.is_finished() {
                    (seat.look)();
                    std::thread::sleep(LOOK);
                }
                run.join().map_err(|_| BatchError::Rig("the simulation ended by a bug; its message stands in the terminal".into()))
            })?
        } else {
            runner::run(&self.plan, &mut rig, &options, &mut observer)
        };
        (seat.look)();
        if let Some(who) = control.stop_requested() {
            on_wire::name_the_operator(&mut record, who);
        }
        Ok((record, trace))
    }

    /// The record of an attempt of which there is no measurement.
    pub fn without_run(&self, dut: &Dut, outcome: Outcome, reason: String) -> TestRecord {
        let phase = |p: &crate::plan::Phase| PhaseRecord {
            name: p.name.clone(),
            role: p.role.name().into(),
            outcome: Outcome::NotRun,
            reason: Some("nothing of it was stored".into()),
            span_s: None,
            measurements: Vec::new(),
            prompt: None,
        };
        let plan = &self.plan;
        TestRecord {
            schema: "hil.record/1".into(),
            plan: PlanIdentity {
                name: plan.name.clone(),
                sha256: plan.sha256.clone(),
                parameters: plan.parameters.clone(),
                overridden: plan.overridden.clone(),
            },
            dut: dut.clone(),
            rig: self.identity(),
            simulated: self.simulated(),
            seed: 0,
            outcome,
            reasons: vec![reason],
            phases: plan.phases.iter().map(phase).collect(),
            timing: Timing { period_s: plan.period_s, ..Timing::default() },
            stability: None,
            model: None,
            safe_state: None,
            provenance: None,
        }
    }
}

/// Driver and line of each site, with the station's limits of current and pressure.
fn sites(args: &RigArgs, station: Option<&Station>) -> Result<Vec<WireArgs>, CliError> {
    if args.sim {
        return Ok(Vec::new());
    }
    let mut first = args.wire.clone();
    if let Some(most) = station.and_then(|s| s.max_current) {
        let own = first.max_current.map_or(most.value(), |m| m.value().min(most.value()));
        first.max_current = Some(Current::new(own));
    }
    if let Some(most) = station.and_then(|s| s.max_pressure) {
        let own = first.max_pressure.map_or(most.value(), |m| m.value().min(most.value()));
        first.max_pressure = Some(Pressure::new(own));
    }
    on_wire::endpoint(&first.port, &first.tcp, "--driver")?;
    if !args.sites.is_empty() && first.pressure_driver.is_some() {
        return Err(CliError::usage("--site: several sites need drivers that measure the pressure themselves"));
    }
    let further = args.sites.iter().map(|place| {
        let tcp = place.contains(':') && !place.starts_with('/');
        let (port, tcp) = if tcp { (None, Some(place.clone())) } else { (Some(PathBuf::from(place)), None) };
        WireArgs { port, tcp, watch: false, ..first.clone() }
    });
    Ok(std::iter::once(first.clone()).chain(further).collect())
}

fn driver_identity(driver: &str) -> Result<RigIdentity, CliError> {
    let path = Profile::find(driver).map_err(CliError::input)?;
    let profile = Profile::load(&path).map_err(CliError::input)?;
    let kind = if profile.transport.kind == TransportKind::Line { "serial" } else { "modbus" };
    Ok(RigIdentity {
        kind: kind.into(),
        name: profile.name,
        sha256: sha256(&path)?,
        emulated: profile.device.emulated,
        details: Vec::new(),
    })
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The workers of a campaign.
pub struct Bench<'a> {
    /// What all attempts share.
    pub setup: &'a Setup,
    /// Folder of the batch.
    pub dir: &'a Path,
    /// Which valves get a folder of their own.
    pub reports: ValveReports,
    /// Threads of a simulation.
    pub threads: Option<usize>,
    /// When a further attempt is made.
    pub retry: &'a Retry,
    /// The station, for the records.
    pub station: Option<&'a serde_json::Value>,
    /// Whether somebody has to mount each valve.
    pub mounted_by_hand: bool,
    /// Lets running attempts end and begins no other.
    pub stop: &'a AtomicBool,
    /// Set when the station failed for good on a valve: the next one would fare no better.
    pub down: AtomicBool,
    /// Who sits at the sites.
    pub company: &'a dyn Company,
    /// Whether somebody sees every verdict and decides what comes next: then an error ends no batch.
    pub attended: bool,
}

impl Bench<'_> {
    /// One worker per thread or site.
    pub fn workers(&self) -> Vec<Worker<'_>> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let count = if self.setup.simulated() { self.threads.unwrap_or(cores).clamp(1, 256) } else { self.setup.sites.len() };
        (0..count).map(|site| Box::new(move |job: &Job| self.test(site, job)) as Worker<'_>).collect()
    }

    fn test(&self, site: usize, job: &Job) -> Result<TestRecord, BatchError> {
        if self.mounted_by_hand && !self.setup.simulated() && std::io::stdin().is_terminal() {
            let mut input = std::io::stdin().lock();
            super::note(&format!("site {}: mount {} and press Enter", site + 1, job.dut.serial));
            input.read_line(&mut String::new()).map_err(|e| BatchError::Rig(format!("stdin: {e}")))?;
        }
        let started = super::clock::now();
        let (mut record, trace) = self.setup.attempt_seated(site, job.position, job.attempt, &job.dut, self.company.seat(site, job))?;
        if !self.setup.simulated() && self.setup.sites.len() > 1 {
            record.rig.details.push(("site".into(), (site + 1).to_string()));
        }
        let further = job.attempt < self.retry.most && self.retry.after.contains(&record.outcome);
        // Nothing else is tried on a bench whose current nobody saw go.
        if record.ended_unsafe() || record.outcome == Outcome::Error && !self.setup.simulated() && !further && !self.attended {
            self.down.store(true, Ordering::Relaxed);
            self.stop.store(true, Ordering::Relaxed);
        }
        let version = env!("CARGO_PKG_VERSION").to_string();
        // Where the operator changes from valve to valve, each record names its own.
        let operator = self.company.operator(site).map(|name| serde_json::json!({ "operator": name }));
        let mut station = self.station.cloned();
        match (station.as_mut().and_then(|s| s.as_object_mut()), &operator) {
            (Some(block), Some(own)) => block.extend(own.as_object().cloned().into_iter().flatten()),
            (None, Some(_)) => station.clone_from(&operator),
            _ => {}
        }
        record.provenance = Some(Provenance { version: version.clone(), started: started.clone(), station });
        let accepted = matches!(record.outcome, Outcome::Pass | Outcome::Marginal);
        if self.reports == ValveReports::All || (self.reports == ValveReports::Failed && !accepted) {
            let below = attempt_folder(&job.dut.serial, job.attempt);
            let folder = self.dir.join(&below);
            make_folder_within(self.dir, Path::new(&below)).map_err(|e| BatchError::store(&folder, e))?;
            let stored = |e: CliError| BatchError::store(&folder, std::io::Error::other(e.message));
            run_folder::write(&folder, &record, &trace).map_err(stored)?;
        }
        // What all attempts share stands once, in plan, model and head of the batch, and not in every line of the journal.
        record.stability = None;
        record.model = None;
        record.provenance = Some(Provenance { version, started, station: operator });
        Ok(record)
    }
}
