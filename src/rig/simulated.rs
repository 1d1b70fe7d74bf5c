//! A simulated valve as a rig: no clock, no bus, the same bytes for the same seed.

use super::{Rig, RigError, RigIdentity, SafeState, Sample};
use crate::physics::{PhysicsError, Plant};
use crate::valve::Valve;

/// A valve model behind the [`Rig`] trait. It starts at rest, settled at its smallest current.
pub struct SimulatedRig {
    plant: Plant,
    identity: RigIdentity,
    period_s: f64,
    slot: u64,
    rest_a: f64,
}

impl SimulatedRig {
    /// A rig that simulates `valve` every `period_s`. Without a seed there is no noise.
    ///
    /// # Errors
    /// [`PhysicsError`] where an effect of the valve is not known or out of range.
    pub fn new(valve: &Valve, period_s: f64, seed: Option<u64>, identity: RigIdentity) -> Result<Self, PhysicsError> {
        let rest_a = valve.current_limits_a.0;
        let plant = Plant::new(valve, period_s, rest_a, seed)?;
        Ok(Self { plant, identity: RigIdentity { kind: "sim".into(), ..identity }, period_s, slot: 0, rest_a })
    }
}

impl Rig for SimulatedRig {
    fn identity(&self) -> RigIdentity {
        self.identity.clone()
    }

    /// Computes the slots up to `until_s`. The sample is that of the transaction at the start of the last one, which
    /// writes the command and reads the pressure.
    fn step(&mut self, command_a: f64, until_s: f64) -> Result<Sample, RigError> {
        let until = (until_s / self.period_s).round() as u64;
        let mut pressure_bar = self.plant.step(command_a);
        self.slot += 1;
        while self.slot < until {
            pressure_bar = self.plant.step(command_a);
            self.slot += 1;
        }
        Ok(Sample::simulated((self.slot - 1) as f64 * self.period_s, pressure_bar))
    }

    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        self.plant.step(self.rest_a);
        Ok(SafeState::of(true, format!("simulated: current {:.4} A", self.rest_a)))
    }
}
