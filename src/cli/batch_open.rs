//! How a batch is opened: everything that can refuse it is asked before anything moves.

use std::path::{Path, PathBuf};

use super::batch_args::BatchArgs;
use super::batch_bench::Setup;
use super::batch_error::failed;
use super::batch_folder;
use super::clock::now;
use super::run::sha256;
use super::{CliError, files};
use crate::batch::journal::{Journal, Kind, Line, encode};
use crate::batch::population::Population;
use crate::batch::station::Station;
use crate::batch::store::{Header, Loaded, SCHEMA, Store};
use crate::batch::summary::BatchSummary;
use crate::batch::tally::Tally;
use crate::batch::{campaign::Retry, duts, journal::Damage, master, summary};
use crate::digest;
use crate::output::{Claim, Outputs};
use crate::plan::{LimitsFile, Plan, RetryOn, SerialForm};
use crate::record::{Dut, Outcome};

/// A batch whose folder this process holds.
pub struct Opened {
    /// What all attempts share.
    pub setup: Setup,
    /// Its folder.
    pub store: Store,
    /// What the journal holds.
    pub loaded: Loaded,
    /// Its valves; `None` where they are entered one by one.
    pub valves: Option<Vec<Dut>>,
    /// The limits file of the part.
    pub limits: Option<LimitsFile>,
    /// Keeps other processes out of the folder.
    pub claim: Claim,
}

/// A batch that nothing refuses, before its folder is touched.
pub struct Ready {
    /// What all attempts share.
    pub setup: Setup,
    /// What is asked for.
    pub header: Header,
    /// Its valves; `None` where they are entered one by one.
    valves: Option<Vec<Dut>>,
    /// The limits file of the part.
    pub limits: Option<LimitsFile>,
}

/// Whether the station still admits a valve: its calibrations hold, its master valves were checked.
pub fn admits(args: &BatchArgs) -> Result<(), CliError> {
    let plan = files::plan(&args.plan, &args.set)?;
    station(args, &plan).map(drop)
}

/// Checks everything that the arguments ask for: plan, limits, calibration, master valves, driver, list of valves.
pub fn prepare(args: &BatchArgs) -> Result<Ready, CliError> {
    let mut plan = files::plan(&args.plan, &args.set)?;
    let limits_path = files::limits(args.limits.as_deref(), &plan.name)?;
    let limits = limits_path.as_deref().map(LimitsFile::load).transpose().map_err(CliError::input)?;
    if let Some(limits) = &limits {
        plan.apply_limits(limits).map_err(CliError::input)?;
    }
    let (station, station_block) = station(args, &plan)?;
    let population = match &args.population {
        Some(path) => Some(Population::load(&files::population(path)?).map_err(failed)?),
        None => args.count.map(|_| Population::standard()),
    };
    let form = |_: &Dut| limits.as_ref().map_or_else(SerialForm::default, |l| l.serial.clone());
    let valves = valves(args, form)?;
    let setup = Setup::new(&args.rig, plan, population.clone(), args.seed, station.as_ref())?;
    let header = header(args, &setup, population, limits_path.as_deref().zip(limits.as_ref()), station_block, valves.as_deref())?;
    Ok(Ready { setup, header, valves, limits })
}

impl Ready {
    /// Takes the folder of the batch.
    pub fn open(self, args: &BatchArgs, dir: &Path) -> Result<Opened, CliError> {
        let Self { setup, header, valves, limits } = self;
        let begins = !dir.join("batch.json").exists() && !dir.join("journal").exists();
        let inputs = [Some(&args.plan), args.duts.as_ref(), args.limits.as_ref(), args.station.as_ref(), args.population.as_ref()];
        let outputs =
            Outputs::new(args.force.force).reads(inputs.into_iter().flatten()).folder(begins.then_some(dir), &batch_folder::FILES);
        let claim = outputs.claim()?;
        let store = Store::open(dir, header, args.resume).map_err(failed)?;
        let loaded = store.load().map_err(failed)?;
        refuse_known(args, valves.as_deref())?;
        Ok(Opened { setup, store, loaded, valves, limits, claim })
    }
}

impl Opened {
    /// The journal of this session; attempts that were interrupted are closed in it as ABORTED.
    pub fn journal(&mut self) -> Result<Journal, CliError> {
        let mut journal = self.store.journal().map_err(failed)?;
        for interrupted in std::mem::take(&mut self.loaded.interrupted) {
            let why = format!("interrupted: begun at {}, and the process ended before the record was stored", interrupted.at);
            let record = self.setup.without_run(&interrupted.dut, Outcome::Aborted, why);
            let (position, attempt) = (interrupted.position, interrupted.attempt);
            let line = Line { event: Kind::Finished, position, attempt, at: now(), dut: None, record: Some(record.clone()) };
            journal.append(&encode(&line)).map_err(failed)?;
            self.loaded.tally.add(position, attempt, &record);
            self.loaded.last.insert(position, (attempt, Outcome::Aborted));
            super::note(&format!("valve {}: attempt {attempt} was interrupted; closed as ABORTED", record.dut.serial));
        }
        journal.confirm().map_err(failed)?;
        Ok(journal)
    }
}

/// The batch with its statistics; the limits of the part go before those of the records.
pub fn summary(header: &Header, dir: &Path, tally: &Tally, damage: Vec<Damage>, limits: Option<&LimitsFile>) -> BatchSummary {
    let tolerance = |m: &crate::batch::tally::MetricKey| {
        limits?.tolerance(&m.phase, &m.metric, &m.unit).map(|(min, max)| crate::batch::statistics::Tolerance { min, max })
    };
    summary::summarise(header, tally, damage, tolerance, |a| batch_folder::report_link(dir, a))
}

/// The station with its gate and its calibration, as the block of the header.
pub fn station(args: &BatchArgs, plan: &Plan) -> Result<(Option<Station>, Option<serde_json::Value>), CliError> {
    let Some(path) = &args.station else {
        return Ok((None, args.operator.as_ref().map(|operator| serde_json::json!({ "operator": operator }))));
    };
    let station = Station::load(&files::station(path)?).map_err(failed)?;
    let mut overrides = Vec::new();
    let expired = station.expired(jiff::Zoned::now().date());
    match (&args.override_calibration, expired.is_empty()) {
        (_, true) => {}
        (Some(reason), false) if !reason.trim().is_empty() => {
            overrides = expired.iter().map(|e| format!("{e}; tested nevertheless: {reason}")).collect();
        }
        _ => {
            let text = format!(
                "{}: {}. Calibrate, or give --override-calibration REASON, which goes into every record",
                path.display(),
                expired.join("; ")
            );
            return Err(CliError::input(text));
        }
    }
    let checks = master::read(&master::log_path(path)).map_err(failed)?;
    let driver = args.rig.wire.driver.as_deref().map(super::on_wire::load_profile).transpose()?;
    let unreal = args.rig.sim || driver.is_some_and(|p| p.device.emulated);
    master::open(&station, &checks, &plan.sha256, unreal, jiff::Timestamp::now()).map_err(failed)?;
    let block = station.provenance(args.operator.as_deref(), &overrides);
    Ok((Some(station), Some(block)))
}

/// The valves of the batch; `None` where they are entered one by one.
fn valves(args: &BatchArgs, form: impl Fn(&Dut) -> SerialForm) -> Result<Option<Vec<Dut>>, CliError> {
    let mut valves = match (&args.duts, args.count) {
        (Some(path), _) => duts::read_csv(path, form).map_err(failed)?,
        (None, Some(count)) => duts::counted(count).map_err(failed)?,
        (None, None) => return Ok(None),
    };
    for dut in &mut valves {
        let fill = |own: &mut Option<String>, given: &Option<String>| {
            if own.is_none() {
                own.clone_from(given);
            }
        };
        fill(&mut dut.part_number, &args.part_number);
        fill(&mut dut.revision, &args.revision);
        fill(&mut dut.lot, &args.lot);
    }
    Ok(Some(valves))
}

fn header(
    args: &BatchArgs,
    setup: &Setup,
    population: Option<Population>,
    limits: Option<(&Path, &LimitsFile)>,
    station: Option<serde_json::Value>,
    valves: Option<&[Dut]>,
) -> Result<Header, CliError> {
    let plan = &setup.plan;
    let limits_of = match limits {
        Some((path, file)) => {
            let part = [file.part_number.as_deref(), file.revision.as_deref()].into_iter().flatten().collect::<Vec<_>>().join(" ");
            Some((part, sha256(path)?))
        }
        None => None,
    };
    let retry = retry(plan);
    Ok(Header {
        schema: SCHEMA.into(),
        plan: plan.name.clone(),
        plan_sha256: plan.sha256.clone(),
        parameters: plan.parameters.clone(),
        overridden: plan.overridden.clone(),
        simulated: setup.simulated(),
        seed: args.seed,
        rig: setup.identity(),
        valves: valves.map(<[Dut]>::len),
        valves_sha256: valves.map(|v| digest::sha256(serde_json::to_vec(v).unwrap_or_default())),
        population,
        limits: limits_of,
        decision_rule: limits.map_or(crate::limits::DecisionRule::Simple, |l| l.1.decision_rule).text().into(),
        attempts: (retry.most, retry.after.iter().map(|o| o.text().to_string()).collect()),
        station,
        version: env!("CARGO_PKG_VERSION").into(),
    })
}

/// When a further attempt is made, as the plan has it.
pub fn retry(plan: &Plan) -> Retry {
    let outcome = |on: &RetryOn| match on {
        RetryOn::Fail => Outcome::Fail,
        RetryOn::Error => Outcome::Error,
        RetryOn::Invalid => Outcome::Invalid,
    };
    Retry { most: plan.attempts.max.max(1), after: plan.attempts.retry_on.iter().map(outcome).collect() }
}

/// The folder of the batch: `reports/runs/batch-<plan>-<n>`, the last one with --resume, a new one without.
pub fn folder(args: &BatchArgs, plan: &str) -> Result<PathBuf, CliError> {
    if let Some(dir) = &args.out {
        return Ok(dir.clone());
    }
    let runs = Path::new("reports/runs");
    let name = |n: u32| runs.join(format!("batch-{plan}-{n}"));
    let first_free = (1u32..).find(|n| !name(*n).exists()).unwrap_or(1);
    match (args.resume, first_free) {
        (false, n) => Ok(name(n)),
        (true, 1) => Err(CliError::usage(format!("no batch of `{plan}` under {}; give its folder with --out", runs.display()))),
        (true, n) => Ok(name(n - 1)),
    }
}

/// Refuses valves that have passed in an earlier batch.
fn refuse_known(args: &BatchArgs, valves: Option<&[Dut]>) -> Result<(), CliError> {
    let (Some(dir), Some(valves)) = (&args.known, valves) else { return Ok(()) };
    for dut in valves {
        if let Some(what) = super::batch_prompt::passed_before(dir, &dut.serial).map_err(failed)? {
            return Err(CliError::input(format!("valve `{}` {what}", dut.serial)));
        }
    }
    Ok(())
}
