//! What is shown before the first current: the right device, an armed watchdog that trips, and a current of zero.

use super::safe::must_have_acted_s;
use super::{Loss, Losses, Outgoing, WireRig};
use crate::rig::profile::{OnTrip, RegisterValue, SignalName, TransportKind, WatchdogKind};
use crate::rig::{Rig, RigError, emulator};

/// Attempts at each register before the device counts as unreachable.
const ATTEMPTS: u32 = 5;
/// Time for one register, well above any documented answer time [s].
const REGISTER_S: f64 = 0.25;

impl WireRig {
    /// Shows that the rig may be energised; an error leaves it at zero.
    pub(super) fn start(&mut self) -> Result<(), RigError> {
        self.details = self.driver.bus.details();
        let p = self.driver.profile.clone();
        self.details.push(("device".into(), format!("{} {} ({:?})", p.device.vendor, p.device.model, p.device.verified).to_lowercase()));
        for r in &p.start.identity {
            let found = self.read(r)?;
            if found != r.value {
                let reason = format!(
                    "register {} holds {found} where {} identifies the device: is this the right port and unit id?",
                    r.address, r.value
                );
                return Err(RigError::Device { name: p.name.clone(), reason });
            }
        }
        self.emulated = self.answers_as_emulator();
        if self.emulated {
            self.details.push(("emulated".into(), "an emulator stands for driver and valve".into()));
        }
        self.safe = false;
        for r in &p.start.init {
            self.write(r)?;
        }
        self.arm_watchdog()?;
        let budget = p.budget();
        self.details.push(("wire time of a slot".into(), format!("{:.2} ms of {:.2} ms", budget.total_s * 1e3, self.period_s * 1e3)));
        self.details.push(("current limit".into(), format!("{:.4} A", p.limit.max_a)));
        if let Some(source) = &self.source {
            let s = &source.profile;
            self.details.push(("pressure source".into(), format!("{} {} ({})", s.device.vendor, s.device.model, s.name)));
        }
        if let Some(privileges) = &self.options.privileges {
            self.details.extend(privileges.details());
        }
        let state = self.make_safe()?;
        if !state.confirmed {
            return Err(RigError::Device { name: p.name, reason: format!("the rest state could not be shown: {}", state.evidence) });
        }
        // What the start took is not part of the run's own quality.
        self.driver.losses = Losses::default();
        self.driver.reconnected = false;
        self.proofs.begin(self.clock.now_s());
        Ok(())
    }

    /// Whether an emulator is at the other end: by its profile, or by what it says of itself under any profile.
    fn answers_as_emulator(&mut self) -> bool {
        let devices = [Some(&mut self.driver), self.source.as_mut()];
        devices.into_iter().flatten().any(|device| {
            let p = &device.profile;
            if p.device.emulated || p.transport.kind == TransportKind::Line || !p.transport.functions.contains(&3) {
                return p.device.emulated;
            }
            for _ in 0..ATTEMPTS {
                match device.bus.read_block(emulator::SIGNATURE_ADDRESS, emulator::SIGNATURE.len() as u16, REGISTER_S) {
                    Ok(words) => return words == emulator::SIGNATURE,
                    // A device without these registers refuses them; one that says nothing has no more to say the second time.
                    Err(Loss::Exception(_)) => return false,
                    Err(_) => device.bus.recover(REGISTER_S),
                };
            }
            false
        })
    }

    fn unreachable(&self, what: &str, last: &str) -> RigError {
        let p = &self.driver.profile;
        let advice = if p.transport.baud > 0 {
            format!(
                "check wiring and termination, the unit id ({}), the baud rate ({}), parity and stop bits",
                p.transport.unit, p.transport.baud
            )
        } else {
            format!("check address, unit id ({}) and whether the device allows another connection", p.transport.unit)
        };
        RigError::Device { name: p.name.clone(), reason: format!("{what}: {last}; {advice}") }
    }

    fn read(&mut self, r: &RegisterValue) -> Result<u16, RigError> {
        let mut last = String::new();
        for _ in 0..ATTEMPTS {
            match self.driver.bus.read_register(r, REGISTER_S) {
                Ok(value) => return Ok(value),
                Err(loss) => last = loss.to_string(),
            }
            self.driver.bus.recover(REGISTER_S);
        }
        Err(self.unreachable(&format!("register {} cannot be read", r.address), &last))
    }

    fn write(&mut self, r: &RegisterValue) -> Result<(), RigError> {
        let mut last = String::new();
        for _ in 0..ATTEMPTS {
            match self.driver.bus.write_register(r, REGISTER_S) {
                Ok(()) => return Ok(()),
                Err(loss) => last = loss.to_string(),
            }
            self.driver.bus.recover(REGISTER_S);
        }
        Err(self.unreachable(&format!("register {} cannot be written", r.address), &last))
    }

    fn arm_watchdog(&mut self) -> Result<(), RigError> {
        let p = self.driver.profile.clone();
        let w = &p.watchdog;
        if !w.protects() {
            let why = match (w.kind, w.on_trip) {
                (WatchdogKind::None, _) => "the device has no communication watchdog",
                (_, OnTrip::Freeze) => "its watchdog leaves the current as it is",
                _ => "what its watchdog does is not documented",
            };
            if !self.options.without_watchdog {
                return Err(RigError::NoWatchdog { name: p.name.clone(), why: why.into() });
            }
            self.details.push(("watchdog".into(), format!("overridden: {why}; nothing re-proves it during the run")));
            return Ok(());
        }
        for r in w.reset.iter().chain(&w.set) {
            self.write(r)?;
        }
        for r in &w.check {
            let found = self.read(r)?;
            if found != r.value {
                let reason = format!("the watchdog is not armed: register {} holds {found} and not {}", r.address, r.value);
                return Err(RigError::Device { name: p.name.clone(), reason });
            }
        }
        let time = format!("{:.0} ms", w.time_s * 1e3);
        let again = if w.check.is_empty() {
            "no register shows that it stays armed"
        } else {
            "its registers are read back every 0.5 s and at the end"
        };
        let bit = p.signal(SignalName::Status).and_then(|(_, s)| s.bits.iter().find(|b| b.0 == "watchdog").map(|b| b.1));
        let Some(bit) = bit else {
            self.details.push(("watchdog".into(), format!("armed, {time}; the device has no status bit that would show a trip; {again}")));
            return Ok(());
        };
        // Silence on purpose, at zero current: the device must notice.
        self.clock.sleep_until(self.clock.now_s() + must_have_acted_s(w.time_s));
        if !self.status_bit(bit)? {
            let reason = format!(
                "the watchdog did not trip after {:.0} ms of silence, although it is set to {time}",
                must_have_acted_s(w.time_s) * 1e3
            );
            return Err(RigError::Device { name: p.name.clone(), reason });
        }
        for r in &w.reset {
            self.write(r)?;
        }
        if self.status_bit(bit)? {
            return Err(RigError::Device { name: p.name.clone(), reason: "the watchdog cannot be cleared after its trip".into() });
        }
        self.details.push(("watchdog".into(), format!("armed, {time}; seen to trip in silence and cleared; {again}")));
        Ok(())
    }

    /// A bit of the status word, in a slot that writes zero.
    fn status_bit(&mut self, bit: u8) -> Result<bool, RigError> {
        let mut last = String::new();
        for _ in 0..ATTEMPTS {
            let out: Outgoing = self.driver.outgoing(0.0, false).map_err(RigError::Refused)?;
            match self.driver.transact_all(&out, f64::INFINITY, &self.clock) {
                Ok(values) => {
                    if let Some(word) = values.get(SignalName::Status) {
                        return Ok((word as u16 >> bit) & 1 == 1);
                    }
                    last = "no status word in the cycle".into();
                }
                Err(why) => last = why,
            }
            // A late reply must not answer the next attempt.
            self.driver.bus.recover(REGISTER_S);
        }
        Err(self.unreachable("the status cannot be read", &last))
    }
}
