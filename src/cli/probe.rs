//! `hil probe`: what is at the other end of a line, told to a person; nothing but zero is written.

use std::path::PathBuf;

use clap::Args;

use super::last_word;
use super::on_wire::{endpoint, host_port, load_profile};
use super::run::stop_on_signals;
use super::{CliError, CliResult, exit};
use crate::rig::RigError;
use crate::rig::loop_thread::safe_text;
use crate::rig::wire::probe;

/// Arguments of `hil probe`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("line").args(["port", "tcp"]).required(true)))]
pub struct ProbeArgs {
    /// Driver profile: a path, or the bare name of a file in drivers/.
    #[arg(long, value_name = "PROFILE")]
    driver: String,
    /// Serial port.
    #[arg(long, value_name = "DEV")]
    port: Option<PathBuf>,
    /// Host and port.
    #[arg(long, value_name = "HOST:PORT", value_parser = host_port)]
    tcp: Option<String>,
}

/// Looks, and tells what was found.
pub fn run(args: &ProbeArgs) -> CliResult {
    let profile = load_profile(&args.driver)?;
    let at = endpoint(&args.port, &args.tcp, "--driver")?;
    let stop = stop_on_signals()?;
    let probed = probe(&profile, &at, &stop);
    let confirmed = probed.safe.as_ref().is_none_or(|s| s.confirmed);
    if let Some(state) = &probed.safe {
        last_word::note(state);
    }
    let found = probed.findings.map_err(|error| match error {
        RigError::Stopped { .. } => {
            let left = if probed.safe.is_some() { safe_text(&probed.safe) } else { "nothing was written".into() };
            CliError { code: exit::ABORTED, message: format!("{error}; {left}") }
        }
        error => CliError::rig(error),
    })?;
    let mut text = format!("{} {} ({})\n", profile.device.vendor, profile.device.model, profile.name);
    for (what, value) in &found.facts {
        text.push_str(&format!("  {what:<20} {value}\n"));
    }
    text.push_str(&format!("  {:<20} {:.0} Hz\n", "highest loop rate", found.highest_rate_hz.floor()));
    if !found.readings.is_empty() {
        text.push_str("readings\n");
        for (signal, value) in &found.readings {
            text.push_str(&format!("  {signal:<20} {value}\n"));
        }
    }
    for warning in &found.warnings {
        text.push_str(&format!("note: {warning}\n"));
    }
    if let Some(state) = probed.safe {
        text.push_str(&format!("{}\n", safe_text(&Some(state))));
    }
    super::print(&text)?;
    Ok(if confirmed { exit::DONE } else { exit::RIG })
}
