//! A look at a device without driving it: identity, readings, round trips, the highest loop rate; nothing but zero is
//! ever written.

use std::sync::atomic::{AtomicBool, Ordering};

use super::safe::Ending;
use super::{Bus, Device, Endpoint, Incoming, Loss, open_device};
use crate::rig::profile::{LARGEST_SHARE, Profile, RegisterValue, Role, SignalName, Table, TransportKind};
use crate::rig::realtime::Clock;
use crate::rig::{RigError, SafeState};

/// Round trips that are timed.
const ROUND_TRIPS: usize = 200;
/// Time for one reply, well above any documented answer time [s].
const REPLY_S: f64 = 0.25;

/// What a probe found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Findings {
    /// Facts in the order in which they are told.
    pub facts: Vec<(String, String)>,
    /// Readings with their units.
    pub readings: Vec<(String, String)>,
    /// What a person should look at.
    pub warnings: Vec<String>,
    /// Highest loop rate by wire, device and measured round trips [Hz].
    pub highest_rate_hz: f64,
}

/// What a probe gave, and where it wrote anything, whether the current was seen to be zero at its end.
#[derive(Debug)]
pub struct Probed {
    /// The findings, or why there are none.
    pub findings: Result<Findings, RigError>,
    /// The safe state; `None` where nothing was written, or what was written drives nothing.
    pub safe: Option<SafeState>,
}

/// Looks at the device behind a profile, until `stop`. Whatever comes of it, a driver that was written to is left in its safe state.
pub fn probe(profile: &Profile, endpoint: &Endpoint, stop: &AtomicBool) -> Probed {
    let (mut device, clock) = match open_device(profile, endpoint) {
        Ok(open) => open,
        Err(error) => return Probed { findings: Err(error), safe: None },
    };
    let mut written = false;
    let findings = look(profile, &mut device, &clock, stop, &mut written);
    let safe = (written && profile.role == Role::Driver && confirms_itself(profile))
        .then(|| Ending { driver: &mut device, source: None, clock: &clock }.reach());
    Probed { findings, safe }
}

/// Whether the device shows by itself what confirms its safe state; the pressure of another device is not looked at here.
fn confirms_itself(profile: &Profile) -> bool {
    profile.safe_state.is_some_and(|s| profile.signal(s.name).is_some())
}

fn look(profile: &Profile, device: &mut Device, clock: &Clock, stop: &AtomicBool, written: &mut bool) -> Result<Findings, RigError> {
    let stopped = || if stop.load(Ordering::Relaxed) { Err(RigError::Stopped { signal: "a signal" }) } else { Ok(()) };
    let mut found = Findings { facts: device.bus.details(), ..Findings::default() };
    for r in &profile.start.identity {
        let value = device.bus.read_register(r, REPLY_S).map_err(|loss| match loss {
            // A refusal with a right checksum: line, baud rate and unit id are right, what listens there is not.
            Loss::Exception(_) => {
                let what = format!("{loss} for register {}, which identifies the device: another device answers here", r.address);
                RigError::Device { name: profile.name.clone(), reason: format!("{what}; check port, unit id and profile") }
            }
            loss => silent(profile, &device.bus.trace(), &loss.to_string()),
        })?;
        if value != r.value {
            let reason =
                format!("register {} holds {value}, and {} identifies the device: another device, or another unit id", r.address, r.value);
            return Err(RigError::Device { name: profile.name.clone(), reason });
        }
        found.facts.push(("identity".into(), format!("register {} holds {value}, as it should", r.address)));
    }
    // The reading cycle writes zero, as any start does; where nothing identifies the device, only reading is safe.
    let writes = profile.cycle.transactions.iter().any(|t| t.write.is_some() || t.line.is_some());
    let known = !profile.start.identity.is_empty() || !writes;
    let mut times: Vec<f64> = Vec::with_capacity(ROUND_TRIPS);
    let (mut lost, mut last) = (0, String::new());
    if known || profile.transport.kind == TransportKind::Line {
        *written = writes;
        for _ in 0..ROUND_TRIPS {
            stopped()?;
            let out = device.outgoing_zero().map_err(RigError::Refused)?;
            let began_s = clock.now_s();
            match device.transact_all(&out, f64::INFINITY, clock) {
                Ok(values) => {
                    times.push(clock.now_s() - began_s);
                    found.readings = readings(profile, &values);
                }
                Err(why) => (lost, last) = (lost + 1, why),
            }
            if lost >= 5 && times.is_empty() {
                return Err(silent(profile, &device.bus.trace(), &last));
            }
        }
    } else {
        for t in profile.cycle.transactions.iter().filter(|t| t.read.is_some()) {
            let table = if t.function == 4 { Table::Input } else { Table::Holding };
            let address = t.read.as_ref().map_or(0, |b| b.address);
            let register = RegisterValue { table, address, value: 0, unit: Some(t.unit_id) };
            for _ in 0..ROUND_TRIPS {
                stopped()?;
                let began_s = clock.now_s();
                match device.bus.read_register(&register, REPLY_S) {
                    Ok(_) => times.push(clock.now_s() - began_s),
                    Err(loss) => {
                        (lost, last) = (lost + 1, loss.to_string());
                        device.bus.recover(REPLY_S);
                    }
                }
                if lost >= 5 && times.is_empty() {
                    return Err(silent(profile, &device.bus.trace(), &last));
                }
            }
        }
        found.readings = readings(profile, &by_register(profile, device.bus.as_mut()));
        found
            .warnings
            .push("nothing in the profile identifies the device, so nothing was written and only single registers were read".into());
    }
    if lost > 0 {
        found.warnings.push(format!("{lost} of {} requests were lost; the last: {last}", lost + times.len()));
    }
    if profile.role == Role::Driver && !profile.watchdog.protects() {
        found.warnings.push("no watchdog that takes the current away: a run needs --without-watchdog".into());
    }
    if !profile.proves_freshness() {
        found.warnings.push("no proof of freshness: a run can only be INVALID".into());
    }
    times.sort_by(f64::total_cmp);
    let at = |q: f64| times.get(((times.len() as f64 * q) as usize).min(times.len().saturating_sub(1))).copied().unwrap_or(f64::NAN);
    found.facts.push((
        "round trip".into(),
        format!("median {:.2} ms, 99 % {:.2} ms, largest {:.2} ms of {}", at(0.5) * 1e3, at(0.99) * 1e3, at(1.0) * 1e3, times.len()),
    ));
    found.facts.push(("wire time of a slot".into(), format!("{:.2} ms", profile.budget().total_s * 1e3)));
    found.highest_rate_hz = profile.highest_rate_hz().min(LARGEST_SHARE / at(0.99));
    Ok(found)
}

fn readings(profile: &Profile, values: &super::Incoming) -> Vec<(String, String)> {
    let mut readings = Vec::new();
    for signal in &profile.signals {
        let Some(raw) = values.get(signal.name) else { continue };
        let text = match signal.name.unit() {
            Some(unit) if signal.plausible(raw) => unit.print(signal.from_raw(raw)),
            Some(unit) => format!("{} - implausible (raw {raw})", unit.print(signal.from_raw(raw))),
            None if signal.name == SignalName::Status => {
                let set: Vec<&str> = signal.bits.iter().filter(|b| (raw as u16 >> b.1) & 1 == 1).map(|b| b.0.as_str()).collect();
                let fault = signal.fault(raw as u16).map(|f| format!("; fault: {}", f.name)).unwrap_or_default();
                format!("{}{fault}", if set.is_empty() { "no bit set".into() } else { set.join(", ") })
            }
            None => format!("{raw}"),
        };
        readings.push((signal.name.to_string(), text));
    }
    readings
}

/// The signals that the cycle reads, one register after the other, without writing anything.
fn by_register(profile: &Profile, bus: &mut dyn Bus) -> Incoming {
    let mut values = Incoming::default();
    for t in &profile.cycle.transactions {
        let Some(block) = &t.read else { continue };
        let table = if t.function == 4 { Table::Input } else { Table::Holding };
        let mut address = block.address;
        for signal in block.signals.iter().map(|index| &profile.signals[*index]) {
            let mut read = |address| bus.read_register(&RegisterValue { table, address, value: 0, unit: Some(t.unit_id) }, REPLY_S);
            let words: Result<Vec<u16>, Loss> = (address..address + signal.words()).map(&mut read).collect();
            if let Some(raw) = words.ok().and_then(|w| signal.decode(&w)) {
                values.set(signal.name, raw);
            }
            address += signal.words();
        }
    }
    values
}

/// A device that does not answer, with what the bytes on the line say about why.
fn silent(profile: &Profile, trace: &[super::TracedFrame], last: &str) -> RigError {
    let sent = trace.iter().rev().find(|f| f.sent);
    let heard: Vec<&super::TracedFrame> = trace.iter().filter(|f| !f.sent).collect();
    let t = &profile.transport;
    let reason = if heard.is_empty() {
        format!("not a byte came back ({last}): is the device on, are A and B the right way round, is the unit id {} ?", t.unit)
    } else if sent.is_some_and(|s| heard.iter().any(|h| h.bytes.starts_with(&s.bytes))) {
        "the own request came back: the adapter echoes; write `transport.local_echo = true` into the profile".into()
    } else if t.baud > 0 {
        format!(
            "bytes came back that are no reply ({last}): usually a wrong baud rate ({}), parity or stop bits; try the other rates of the device",
            t.baud
        )
    } else {
        format!("bytes came back that are no reply ({last}): is this a Modbus TCP port?")
    };
    RigError::Device { name: profile.name.clone(), reason }
}
