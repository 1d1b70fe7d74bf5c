//! A valve behind an emulator at a site: real bytes on a real wire, and no hardware.

use std::path::PathBuf;
use std::sync::Arc;

use super::CliError;
use super::on_wire::{self, WireArgs};
use crate::batch::population::Population;
use crate::physics::Plant;
use crate::rig::emulator::{Emulator, Faults, Listen, Listening, Load};
use crate::rig::profile::{Profile, TransportKind};
use crate::valve::Valve;

/// What is mounted at an emulated site: the valve itself, or one of a population around it.
#[derive(Debug, Clone)]
pub struct Emulated {
    profile: Arc<Profile>,
    valve: Valve,
    population: Option<Population>,
    seed: u64,
}

impl Emulated {
    /// An emulated site behind the driver `driver`.
    ///
    /// # Errors
    /// A profile that cannot be read, or that is one of real hardware: whoever tests a real driver would not know what answers.
    pub fn new(driver: &str, valve: Valve, population: Option<Population>, seed: u64) -> Result<Self, CliError> {
        let profile = on_wire::load_profile(driver)?;
        if !profile.device.emulated {
            return Err(CliError::input(format!(
                "driver `{driver}` is not one of an emulator (`device.emulated = true`); a site with `emulate` needs one, for instance `emulator-tcp`"
            )));
        }
        Ok(Self { profile: Arc::new(profile), valve, population, seed })
    }

    /// Starts the emulator with the valve of this place in the batch, and says where it listens. The valve of a place is the same
    /// at every attempt; its noise is not.
    pub fn mount(&self, position: usize, seed: u64, wire: &WireArgs, period_s: f64) -> Result<(Emulator, WireArgs), CliError> {
        let valve = match &self.population {
            Some(population) => population.draw(&self.valve, self.seed, position).0,
            None => self.valve.clone(),
        };
        let mut plant = Plant::new(&valve, period_s, valve.current_limits_a.0, Some(seed)).map_err(CliError::input)?;
        let load = Load::Valve { step: Box::new(move |current_a| plant.step(current_a)), period_s };
        let listen = match self.profile.transport.kind {
            TransportKind::Tcp | TransportKind::TcpGateway | TransportKind::RtuOverTcp => Listen::Tcp(([127, 0, 0, 1], 0).into()),
            _ => Listen::Pty(None),
        };
        let emulator = Emulator::start(Arc::clone(&self.profile), load, &listen, Faults::none(), true).map_err(CliError::rig)?;
        let (port, tcp): (Option<PathBuf>, Option<String>) = match emulator.listening() {
            Listening::Serial(path) => (Some(path.clone()), None),
            Listening::Tcp(address) => (None, Some(address.to_string())),
        };
        Ok((emulator, WireArgs { port, tcp, ..wire.clone() }))
    }
}
