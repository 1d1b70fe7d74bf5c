//! The safe state: current zero, written until the device repeats it and a measurement confirms it; where it does not, a
//! silence in which the device's own watchdog must act, and a last look.

use super::{Device, Incoming};
use crate::rig::SafeState;
use crate::rig::profile::{SafeConfirmation, SignalName, TransportKind};
use crate::rig::realtime::Clock;

/// Pause between two attempts [s].
const PAUSE_S: f64 = 0.005;
/// A request that was lost on its way may be carried out so much later still: by a gateway that held it, or from a connection that
/// was given up [s].
const OVERTAKEN_S: f64 = 0.1;

/// Silence after which a watchdog of this time must have acted: a quarter for its tolerance, 20 ms for the coil [s].
pub(super) fn must_have_acted_s(watchdog_s: f64) -> f64 {
    1.25 * watchdog_s + 0.02
}

/// A driver, where it needs one its pressure source, and the loop's clock.
pub(super) struct Ending<'a> {
    pub driver: &'a mut Device,
    pub source: Option<&'a mut Device>,
    pub clock: &'a Clock,
}

/// What the attempts gave so far.
struct Attempts {
    began_s: f64,
    count: u32,
    last: String,
    current_a: Option<f64>,
    /// Whether a request or its reply went astray.
    astray: bool,
    /// Whether the latest reading showed zero, and only a late request could change that.
    seen_once: bool,
}

impl Ending<'_> {
    /// Writes zero and reads back until the confirmation holds or its time is over; then falls silent for the watchdog, and looks
    /// again.
    pub fn reach(&mut self) -> SafeState {
        let Some(confirm) = self.driver.profile.safe_state else {
            return SafeState::of(false, "the profile has no safe state");
        };
        let began_s = self.clock.now_s();
        let mut attempts =
            Attempts { began_s, count: 0, last: "nothing was read back".into(), current_a: None, astray: false, seen_once: false };
        if let Some(state) = self.write_until(confirm, &mut attempts, began_s + confirm.within_s, "") {
            return state;
        }
        let written = format!("set-point 0 A written {} times in {:.0} ms", attempts.count, confirm.within_s * 1e3);
        let watchdog = &self.driver.profile.watchdog;
        let mut evidence = format!("{written}, not confirmed: {}", attempts.last);
        if watchdog.protects() {
            // Every request feeds the watchdog of a device that hears, but does not obey: only silence lets it act.
            let (time_s, silence_s) = (watchdog.time_s, must_have_acted_s(watchdog.time_s));
            self.clock.sleep_until(self.clock.now_s() + silence_s);
            let how =
                format!(" after {:.0} ms of silence, in which the device's watchdog ({:.0} ms) must act", silence_s * 1e3, time_s * 1e3);
            let until_s = self.clock.now_s() + confirm.within_s.min(0.5);
            if let Some(state) = self.write_until(confirm, &mut attempts, until_s, &how) {
                return state;
            }
            evidence = format!(
                "{written}, then {:.0} ms of silence, in which the device's own watchdog must have acted; not confirmed: {}",
                silence_s * 1e3,
                attempts.last
            );
        }
        SafeState { current_a: attempts.current_a, within_s: Some(self.clock.now_s() - began_s), ..SafeState::of(false, evidence) }
    }

    fn write_until(&mut self, confirm: SafeConfirmation, attempts: &mut Attempts, until_s: f64, how: &str) -> Option<SafeState> {
        let first = attempts.count;
        // A zero that was seen once is looked at again, also where the time is over by then.
        while attempts.count == first || attempts.seen_once || self.clock.now_s() < until_s {
            attempts.count += 1;
            match self.attempt(confirm.name, attempts) {
                // By magnitude: a current of the wrong sign opens a valve too. What is no number is below nothing.
                Ok(value) if value.abs() < confirm.below && self.may_be_overtaken(attempts) => {
                    attempts.last = format!("{} read {value:.4} once, and was not read again", confirm.name);
                    attempts.seen_once = true;
                    self.clock.sleep_until(self.clock.now_s() + OVERTAKEN_S);
                    continue;
                }
                Ok(value) if value.abs() < confirm.below => {
                    let within_s = self.clock.now_s() - attempts.began_s;
                    let unit = confirm.name.unit().map_or("", |u| u.symbol);
                    // Where the last digit of the set-point is the proof of freshness, it now becomes exactly zero.
                    let _ = self.driver.outgoing_zero().map(|out| self.driver.transact_all(&out, confirm.within_s, self.clock));
                    let evidence = format!(
                        "set-point 0 A written and repeated by the device; {} {value:.4} {unit} is within {} {unit} of zero after {:.1} ms, attempt {}{how}",
                        confirm.name,
                        confirm.below,
                        within_s * 1e3,
                        attempts.count
                    );
                    return Some(SafeState { current_a: attempts.current_a, within_s: Some(within_s), ..SafeState::of(true, evidence) });
                }
                Ok(value) => attempts.last = format!("{} still reads {value:.4}", confirm.name),
                Err(why) => attempts.last = why,
            }
            attempts.seen_once = false;
            self.clock.sleep_until(self.clock.now_s() + PAUSE_S);
        }
        None
    }

    /// Whether a request of before may still arrive behind this confirmation: after losses on a line that can hold one, zero is
    /// confirmed twice.
    fn may_be_overtaken(&self, attempts: &Attempts) -> bool {
        // Lines of text may go through a TCP serial server, too.
        let holds = self.driver.profile.transport.kind != TransportKind::Rtu;
        holds && !attempts.seen_once && (self.driver.last_loss.is_some() || attempts.astray)
    }

    /// One attempt: zero, repeated by the device; then the fresh, plausible value that confirms it.
    fn attempt(&mut self, confirm: SignalName, attempts: &mut Attempts) -> Result<f64, String> {
        let out = self.driver.outgoing(0.0, true).map_err(|e| e.to_string())?;
        let sent_s = self.clock.now_s();
        let replied = self.driver.transact_all(&out, f64::INFINITY, self.clock);
        let repeated = |values: &Incoming| values.get(SignalName::Setpoint).is_none_or(|raw| raw == out.setpoint);
        attempts.astray |= !replied.as_ref().is_ok_and(repeated);
        let values = replied?;
        if !repeated(&values) {
            return Err("the device repeats another set-point".into());
        }
        self.driver.shows_new_conversion(&values, (sent_s, self.clock.now_s()))?;
        let read = |device: &Device, values: &Incoming, name: SignalName| {
            let (_, signal) = device.profile.signal(name)?;
            let raw = values.get(name)?;
            Some(if signal.plausible(raw) { Ok(signal.from_raw(raw)) } else { Err(format!("raw {name} = {raw} cannot be")) })
        };
        if let Some(Ok(value)) = read(self.driver, &values, SignalName::Current) {
            attempts.current_a = Some(value);
        }
        if let Some(result) = read(self.driver, &values, confirm) {
            return result;
        }
        let Some(source) = &mut self.source else { return Err(format!("the device does not show its {confirm}")) };
        let out = source.outgoing(0.0, true).map_err(|e| e.to_string())?;
        let sent_s = self.clock.now_s();
        let values = source.transact_all(&out, f64::INFINITY, self.clock)?;
        source.shows_new_conversion(&values, (sent_s, self.clock.now_s()))?;
        read(source, &values, confirm).unwrap_or_else(|| Err(format!("the pressure source does not show {confirm}")))
    }
}
