//! `hil master`: a valve whose verdict is known is tested, and the station's log remembers whether it got that verdict.

use std::path::PathBuf;

use clap::Args;

use super::batch_args::RigArgs;
use super::batch_bench::Setup;
use super::batch_error::failed;
use super::run::{exit_code, key_value};
use super::{CliError, CliResult, exit, files, run_folder};
use crate::batch::master;
use crate::batch::station::Station;
use crate::plan::Override;
use crate::record::{Dut, Provenance};

/// Arguments of `hil master`.
#[derive(Debug, Args)]
pub struct MasterArgs {
    /// Plan file: the one that production runs.
    pub plan: PathBuf,
    /// Station file with a [master] block.
    #[arg(long, value_name = "FILE")]
    pub station: PathBuf,
    /// Serial number of the master valve.
    #[arg(long)]
    pub serial: String,
    /// Where and on what is tested.
    #[command(flatten)]
    pub rig: RigArgs,
    /// Change a parameter of the plan.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub set: Vec<Override>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// Runs the command: 0 where the master got the verdict it should get, 1 where not.
pub fn run(args: &MasterArgs) -> CliResult {
    let plan = files::plan(&args.plan, &args.set)?;
    let station = Station::load(&files::station(&args.station)?).map_err(failed)?;
    let known = |s: &Station| s.master.as_ref().is_some_and(|m| m.valves.iter().any(|v| v.serial == args.serial));
    if !known(&station) {
        return Err(CliError::input(format!("{}: names no master valve `{}` under [master]", args.station.display(), args.serial)));
    }
    let setup = Setup::new(&args.rig, plan, None, args.seed, Some(&station))?;
    let dut = Dut { serial: args.serial.clone(), ..Dut::default() };
    let folder = run_folder::new_folder(&format!("master-{}", setup.plan.name), &args.serial)?;
    let started = super::clock::now();
    let (mut record, trace) = setup.attempt(0, 0, 1, &dut).map_err(failed)?;
    record.provenance =
        Some(Provenance { version: env!("CARGO_PKG_VERSION").into(), started, station: Some(station.provenance(None, &[])) });
    run_folder::write(&folder, &record, &trace)?;
    let check = master::judge(&station, &record, jiff::Timestamp::now()).map_err(failed)?;
    let log = master::log_path(&args.station);
    master::append(&log, &check).map_err(failed)?;
    record.reasons.iter().for_each(|reason| super::note(reason));
    let verdict = if check.as_expected { "as it should" } else { "NOT as it should: the gate stays closed" };
    super::print(&format!("master {} got {}, {verdict}\n", check.serial, check.outcome.text()))?;
    if record.ended_unsafe() {
        super::print("SAFE STATE NOT CONFIRMED - REMOVE POWER\n")?;
        return Ok(exit::RIG);
    }
    super::note(&format!("stored in {}, logged in {}", folder.display(), log.display()));
    if record.outcome.is_broken() {
        // No verdict, so nothing is said of the station.
        return Ok(exit_code(record.outcome));
    }
    Ok(if check.as_expected { exit::DONE } else { exit::NEGATIVE })
}
