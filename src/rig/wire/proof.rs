//! What is shown again while a run goes on: that the watchdog is still armed with its time, and that nobody else writes
//! to the device.

use super::WireRig;
use super::bus::Loss;
use super::proofs::{EVERY_S, forgotten};
use crate::rig::profile::{Profile, TransportKind};
use crate::rig::{Quality, RigError};

/// Longest time without a proof [s].
const LONGEST_S: f64 = 1.0;
/// What the host needs beside the wire for one more request [s].
const HOST_S: f64 = 0.5e-3;

/// Time of one more request and its reply on the wire [s].
pub(super) fn request_s(profile: &Profile) -> f64 {
    // Eight characters there and seven back, a silence before, the device's answer time.
    profile.characters_s(15) + profile.frame_silence_s() + profile.transport.turnaround_s + HOST_S
}

impl WireRig {
    /// At the end of a slot: one register after the other of those that show the watchdog, where there is time left.
    pub(super) fn prove_watchdog(&mut self, slot_end_s: f64, quality: Quality) -> Result<(), RigError> {
        let watchdog = &self.driver.profile.watchdog;
        if !watchdog.protects() || watchdog.check.is_empty() {
            return Ok(());
        }
        if std::mem::take(&mut self.driver.reconnected) {
            self.proofs.hasten(self.clock.now_s());
        }
        let cost_s = request_s(&self.driver.profile);
        loop {
            let now_s = self.clock.now_s();
            let since_s = now_s - self.proofs.proven_s;
            let late = since_s > LONGEST_S.max(2.0 * self.period_s);
            if since_s < EVERY_S || (!late && now_s + cost_s > slot_end_s) || (!late && quality != Quality::Good) {
                return Ok(());
            }
            let within_s = (slot_end_s - now_s).max(cost_s);
            if self.prove_one(within_s)? {
                continue;
            }
            // A line that loses replies gets further slots; one that gives no proof at all for too long does not.
            if late {
                let last = self.proofs.last.clone().unwrap_or_default();
                let reason = format!("that the watchdog is armed could not be shown for {since_s:.1} s: {last}");
                return Err(RigError::Device { name: self.driver.profile.name.clone(), reason });
            }
            return Ok(());
        }
    }

    /// Reads the next register of the watchdog; whether it could be read.
    fn prove_one(&mut self, within_s: f64) -> Result<bool, RigError> {
        let register = self.driver.profile.watchdog.check[self.proofs.next].clone();
        self.clock.sleep_until(self.clock.now_s() + self.driver.profile.frame_silence_s());
        match self.driver.bus.read_register(&register, within_s) {
            Ok(found) if found == register.value => {
                self.proofs.next = (self.proofs.next + 1) % self.driver.profile.watchdog.check.len();
                if self.proofs.next == 0 {
                    self.proofs.proven_s = self.clock.now_s();
                    self.proofs.count += 1;
                }
                Ok(true)
            }
            Ok(found) => {
                let name = self.driver.profile.name.clone();
                let reason = forgotten(&self.driver.profile, register.address, found, register.value);
                Err(RigError::Device { name, reason })
            }
            Err(loss) => {
                self.proofs.last = Some(loss.to_string());
                self.driver.reconnected |= self.driver.bus.recover(within_s);
                Ok(false)
            }
        }
    }

    /// At the beginning of a slot: whether the device still holds what this program wrote last. Another master that writes at this
    /// pace has written since.
    pub(super) fn look_for_another_master(&mut self, slot_end_s: f64) -> Result<(), RigError> {
        let p = &self.driver.profile;
        let now_s = self.clock.now_s();
        let shared = matches!(p.transport.kind, TransportKind::Tcp | TransportKind::TcpGateway);
        let fits = now_s + request_s(p) + p.budget().total_s + HOST_S < slot_end_s;
        if !shared || !fits || now_s - self.proofs.looked_s < EVERY_S || self.last.quality != Quality::Good {
            return Ok(());
        }
        match self.driver.bus.holds_last_write(request_s(p).max(p.cycle.timeout_s.min(0.3 * self.period_s))) {
            Ok(None) => self.proofs.looked_s = now_s,
            Ok(Some(what)) => {
                let reason = format!("{what}: another master writes to this device, or it restarted");
                return Err(RigError::Device { name: p.name.clone(), reason });
            }
            // A refusal says that the device does not read back what it was written; that is no fault of it.
            Err(Loss::Exception(_)) => self.proofs.looked_s = f64::INFINITY,
            Err(_) => self.driver.reconnected |= self.driver.bus.recover(0.3 * self.period_s),
        }
        Ok(())
    }
}
