//! The safe state: current zero, written until the device repeats it and a measurement confirms it.

use super::{Incoming, WireRig};
use crate::rig::SafeState;
use crate::rig::profile::SignalName;

/// Pause between two attempts [s].
const PAUSE_S: f64 = 0.005;

impl WireRig {
    /// Writes zero and reads back until the confirmation holds or its time is over.
    pub(super) fn reach_safe_state(&mut self) -> SafeState {
        let Some(confirm) = self.driver.profile.safe_state else {
            return SafeState { confirmed: false, evidence: "the profile has no safe state".into() };
        };
        let began_s = self.clock.now_s();
        let (mut attempts, mut last) = (0, String::from("nothing was read back"));
        while attempts == 0 || self.clock.now_s() - began_s < confirm.within_s {
            attempts += 1;
            match self.attempt(confirm.name) {
                Ok(value) if value < confirm.below => {
                    let ms = (self.clock.now_s() - began_s) * 1e3;
                    let unit = confirm.name.unit().map_or("", |u| u.symbol);
                    // Where the last digit of the set-point is the proof of freshness, it now becomes exactly zero.
                    let _ = self.driver.outgoing_zero().map(|out| self.driver.transact_all(&out, confirm.within_s, &self.clock));
                    let evidence = format!(
                        "set-point 0 A written and repeated by the device; {} {value:.4} {unit} is below {} {unit} after {ms:.1} ms, attempt {attempts}",
                        confirm.name, confirm.below
                    );
                    return SafeState { confirmed: true, evidence };
                }
                Ok(value) => last = format!("{} still reads {value:.4}", confirm.name),
                Err(why) => last = why,
            }
            self.clock.sleep_until(self.clock.now_s() + PAUSE_S);
        }
        let watchdog = if self.driver.profile.watchdog.protects() {
            format!("; the device's own watchdog acts after {:.0} ms of silence", self.driver.profile.watchdog.time_s * 1e3)
        } else {
            String::new()
        };
        SafeState {
            confirmed: false,
            evidence: format!(
                "set-point 0 A written {attempts} times in {:.0} ms, not confirmed: {last}{watchdog}",
                confirm.within_s * 1e3
            ),
        }
    }

    /// One attempt: zero, repeated by the device; then the value that confirms it.
    fn attempt(&mut self, confirm: SignalName) -> Result<f64, String> {
        let out = self.driver.outgoing(0.0, true).map_err(|e| e.to_string())?;
        let values = self.driver.transact_all(&out, f64::INFINITY, &self.clock)?;
        if values.get(SignalName::Setpoint).is_some_and(|raw| raw != out.setpoint) {
            return Err("the device repeats another set-point".into());
        }
        self.driver.shows_new_conversion(&values)?;
        let plausible = |device: &super::Device, values: &Incoming| {
            let (_, signal) = device.profile.signal(confirm)?;
            let raw = values.get(confirm)?;
            Some(if signal.plausible(raw) { Ok(signal.from_raw(raw)) } else { Err(format!("raw {confirm} = {raw} cannot be")) })
        };
        if let Some(result) = plausible(&self.driver, &values) {
            return result;
        }
        let Some(source) = &mut self.source else { return Err(format!("the device does not show its {confirm}")) };
        let out = source.outgoing(0.0, true).map_err(|e| e.to_string())?;
        let values = source.transact_all(&out, f64::INFINITY, &self.clock)?;
        plausible(source, &values).unwrap_or_else(|| Err(format!("the pressure source does not show {confirm}")))
    }
}
