//! `hil emulate`: a simulated valve behind an emulated driver, on a pseudo terminal or on TCP.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;

use super::on_wire::{host_port, load_profile};
use super::run::stop_on_signals;
use super::{CliError, CliResult, exit, files};
use crate::physics::Plant;
use crate::rig::emulator::{Emulator, Faults, Listen, Listening, Load};
use crate::rig::profile::Profile;
use crate::units::Frequency;

/// Arguments of `hil emulate`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("line").args(["pty", "tcp"]).required(true)))]
pub struct EmulateArgs {
    /// Valve file, or the bare name of one in valves/.
    #[arg(long)]
    valve: String,
    /// Driver profile: a path, or the bare name of a file in drivers/.
    #[arg(long, value_name = "PROFILE")]
    driver: String,
    /// Listen on a pseudo terminal; LINK becomes a symbolic link to it.
    #[arg(long, value_name = "LINK", num_args = 0..=1)]
    pty: Option<Option<PathBuf>>,
    /// Listen on TCP; port 0 takes a free one.
    #[arg(long, value_name = "HOST:PORT", value_parser = host_port)]
    tcp: Option<String>,
    /// A second device with the pressure of the same valve.
    #[arg(long, value_name = "PROFILE")]
    pressure_driver: Option<String>,
    /// Its pseudo terminal, with a symbolic link.
    #[arg(long, value_name = "LINK", num_args = 0..=1, requires = "pressure_driver", conflicts_with = "pressure_tcp")]
    pressure_pty: Option<Option<PathBuf>>,
    /// Its TCP address.
    #[arg(long, value_name = "HOST:PORT", requires = "pressure_driver", value_parser = host_port)]
    pressure_tcp: Option<String>,
    /// Fault script: what goes wrong, and when.
    #[arg(long, value_name = "SCRIPT")]
    fault: Option<PathBuf>,
    /// Rate at which the simulated valve is stepped: that of the loop which drives it.
    #[arg(long, default_value = "100 Hz")]
    rate: Frequency,
    /// Seed of the valve's noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Frames take no time on the wire.
    #[arg(long)]
    fast: bool,
}

/// Serves until a signal ends it.
pub fn run(args: &EmulateArgs) -> CliResult {
    let profile = load_profile(&args.driver)?;
    let (valve, _) = files::valve(&args.valve)?;
    let rate_hz = args.rate.value();
    if !(rate_hz > 0.0 && rate_hz <= 10_000.0) {
        return Err(CliError::usage(format!("--rate {}: above 0 Hz and at most 10 kHz", args.rate)));
    }
    let mut plant = Plant::new(&valve, 1.0 / rate_hz, valve.current_limits_a.0, Some(args.seed)).map_err(CliError::input)?;
    let load = Load::Valve { step: Box::new(move |current_a| plant.step(current_a)), period_s: 1.0 / rate_hz };
    let faults = match &args.fault {
        None => Faults::none(),
        Some(path) => {
            let text = crate::document::read(path).map_err(CliError::input)?;
            Faults::from_toml(&text, &path.display().to_string()).map_err(CliError::input)?
        }
    };
    let second = args.pressure_driver.as_deref().map(load_profile).transpose()?;
    let stop = stop_on_signals()?;
    let emulator = start(profile, load, &listen(&args.pty, &args.tcp)?, faults, !args.fast)?;
    let source = match second {
        Some(profile) => {
            Some(start(profile, emulator.pressure(), &listen(&args.pressure_pty, &args.pressure_tcp)?, Faults::none(), !args.fast)?)
        }
        None => None,
    };
    for (what, emulator) in [("driver", Some(&emulator)), ("pressure source", source.as_ref())] {
        let Some(emulator) = emulator else { continue };
        let place = match emulator.listening() {
            Listening::Serial(path) => format!("--port {}", path.display()),
            Listening::Tcp(address) => format!("--tcp {address}"),
        };
        super::print(&format!("emulated {what}: {place}\n"))?;
    }
    let mut told = 0.0;
    while !stop.load(std::sync::atomic::Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
        for (time_s, event) in emulator.report().events.iter().filter(|e| e.0 > told) {
            super::note(&format!("{time_s:10.3} s  {event}"));
        }
        told = emulator.report().events.last().map_or(told, |e| e.0.max(told));
    }
    let report = emulator.report();
    super::note(&format!(
        "{} requests, largest current {:.4} A, {} watchdog trips, current now {:.4} A",
        report.requests, report.largest_coil_a, report.trips, report.coil_a
    ));
    Ok(exit::DONE)
}

fn start(profile: Profile, load: Load, listen: &Listen, faults: Faults, paced: bool) -> Result<Emulator, CliError> {
    Emulator::start(Arc::new(profile), load, listen, faults, paced).map_err(CliError::rig)
}

fn listen(pty: &Option<Option<PathBuf>>, tcp: &Option<String>) -> Result<Listen, CliError> {
    let Some(address) = tcp else { return Ok(Listen::Pty(pty.clone().flatten())) };
    let mut found = address.to_socket_addrs().map_err(|e| CliError::usage(format!("--tcp {address}: {e}; write HOST:PORT")))?;
    let found: Option<SocketAddr> = found.next();
    found.map(Listen::Tcp).ok_or_else(|| CliError::usage(format!("--tcp {address}: no such address")))
}
