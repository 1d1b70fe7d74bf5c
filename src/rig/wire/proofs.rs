//! Where the proofs of a run stand that its watchdog is still armed, and the last of them.

use super::device::Device;
use crate::rig::profile::Profile;
use crate::rig::realtime::Clock;

/// Time from one proof to the next [s].
pub(super) const EVERY_S: f64 = 0.5;

/// Where the proofs of a run stand.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Proofs {
    /// Clock time of the last complete proof of the watchdog [s].
    pub proven_s: f64,
    /// Next register of the list that is read.
    pub next: usize,
    /// Why the last attempt gave nothing.
    pub last: Option<String>,
    /// Clock time of the last look for another master [s].
    pub looked_s: f64,
    /// Complete proofs of the watchdog.
    pub count: u64,
}

impl Proofs {
    /// Proofs that begin now, right after the start has shown everything.
    pub fn begin(&mut self, now_s: f64) {
        *self = Self { proven_s: now_s, looked_s: now_s, ..Self::default() };
    }

    /// Asks for the next proof at once: a connection that was made anew may lead to a device that restarted.
    pub fn hasten(&mut self, now_s: f64) {
        self.proven_s = self.proven_s.min(now_s - EVERY_S);
    }
}

/// At the end, after the current has gone: whether the watchdog would have acted until now.
pub(super) fn watchdog_at_end(driver: &mut Device, clock: &Clock) -> Option<String> {
    const ATTEMPTS: u32 = 5;
    let p = driver.profile.clone();
    if !p.watchdog.protects() {
        return None;
    }
    for register in &p.watchdog.check {
        let mut last = String::new();
        let found = (0..ATTEMPTS).find_map(|_| {
            clock.sleep_until(clock.now_s() + p.frame_silence_s());
            match driver.bus.read_register(register, p.cycle.timeout_s.max(0.02)) {
                Ok(found) => Some(found),
                Err(loss) => {
                    last = loss.to_string();
                    driver.bus.recover(p.cycle.timeout_s.max(0.02));
                    None
                }
            }
        });
        match found {
            Some(found) if found == register.value => {}
            Some(found) => return Some(format!("at the end: {}", forgotten(&p, register.address, found, register.value))),
            None => return Some(format!("at the end: that the watchdog is armed could not be shown: {last}")),
        }
    }
    None
}

pub(super) fn forgotten(p: &Profile, address: u16, found: u16, wanted: u16) -> String {
    format!(
        "the watchdog of {} {} is not armed any more: register {address} holds {found} and not {wanted}; the device restarted or forgot it",
        p.device.vendor, p.device.model
    )
}
