//! The emulated device's side of the line: requests in, replies out, with the time that the wire would take and with
//! the faults of the script.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::device::Device;
use super::faults::{Fault, Faults, Kind};
use super::frames::{self, Parsed, Request};
use super::link::Link;
use crate::rig::profile::{Profile, SignalName, TransportKind, silence_s};

/// The device with its clock and its faults, shared by all connections.
pub struct Shared {
    /// The profile.
    pub profile: Arc<Profile>,
    /// Device and faults.
    pub state: Mutex<(Device, Faults)>,
    /// Start of the device's clock.
    pub start: Instant,
    /// Set to end all threads.
    pub stop: AtomicBool,
    /// Whether frames take the time that the wire would take.
    pub paced: bool,
}

impl Shared {
    /// The device's time [s].
    pub fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Device and faults; a thread that panicked does not take the others with it.
    pub fn lock(&self) -> MutexGuard<'_, (Device, Faults)> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether frames carry the header of Modbus TCP.
fn has_ids(kind: TransportKind) -> bool {
    matches!(kind, TransportKind::Tcp | TransportKind::TcpGateway)
}

/// What is written back for one request.
struct Reply {
    frames: Vec<(f64, Vec<u8>)>,
    close: bool,
}

/// Serves one connection until it closes, the script closes it, or the emulator stops.
pub fn serve(shared: &Shared, link: &mut dyn Link) -> std::io::Result<()> {
    let mut buffer: Vec<u8> = Vec::with_capacity(512);
    let mut chunk = [0u8; 256];
    let mut previous: Vec<u8> = Vec::new();
    // Silence ends a frame: what is incomplete then never will be complete.
    let silence = Duration::from_millis(20);
    while !shared.stop.load(Ordering::Relaxed) {
        match link.read(&mut chunk, silence)? {
            None => {
                buffer.clear();
                let now_s = shared.now_s();
                shared.lock().0.advance(now_s);
                continue;
            }
            Some(0) => return Ok(()),
            Some(n) => buffer.extend_from_slice(&chunk[..n]),
        }
        let mut arrived = Instant::now();
        loop {
            let (reply, used) = match shared.profile.transport.kind {
                TransportKind::Line => {
                    match buffer.windows(2).position(|w| w == b"\r\n").map(|p| p + 2).or_else(|| end_of_line(shared, &buffer)) {
                        None => break,
                        Some(end) => (line(shared, &buffer[..end], &mut previous, &mut arrived), end),
                    }
                }
                kind => match if has_ids(kind) { frames::parse_tcp(&buffer) } else { frames::parse_rtu(&buffer) } {
                    Parsed::Incomplete => break,
                    Parsed::Garbage(n) => {
                        buffer.drain(..n.clamp(1, buffer.len()));
                        continue;
                    }
                    Parsed::Request(request) => {
                        let raw = buffer[..request.length].to_vec();
                        (modbus(shared, &request, &raw, &mut previous, &mut arrived), request.length)
                    }
                },
            };
            buffer.drain(..used);
            for (wait_s, frame) in &reply.frames {
                if *wait_s > 0.0 {
                    std::thread::sleep(Duration::from_secs_f64(*wait_s));
                }
                link.write(frame)?;
            }
            if reply.close {
                return Ok(());
            }
        }
    }
    Ok(())
}

fn end_of_line(shared: &Shared, buffer: &[u8]) -> Option<usize> {
    let terminator = shared.profile.cycle.transactions.first()?.line.as_ref()?.request.terminator.as_bytes();
    buffer.windows(terminator.len()).position(|w| w == terminator).map(|p| p + terminator.len())
}

/// Waits until the request would have been received over the wire and the device has thought about it.
fn pace(shared: &Shared, bytes: usize, arrived: &mut Instant) {
    if !shared.paced {
        return;
    }
    let t = &shared.profile.transport;
    let gap = if t.baud == 0 { 0.0 } else { silence_s(t.baud, t.bits_per_character) };
    *arrived += Duration::from_secs_f64(shared.profile.characters_s(bytes) + gap + t.turnaround_s);
    std::thread::sleep(arrived.saturating_duration_since(Instant::now()));
}

/// The faults of this request, those of the state already imposed on the device.
fn faults(device: &mut Device, script: &mut Faults, now_s: f64) -> Vec<Fault> {
    let (request, cycle) = device.received(now_s);
    let faults = script.at(request, cycle, device.since_first_current_s(now_s));
    let has = |kind: Kind| faults.iter().find(|f| f.kind == kind);
    device.defects.frozen = has(Kind::FrozenSensor).is_some();
    device.defects.wire_break = has(Kind::WireBreak).is_some();
    device.defects.sensor_break = has(Kind::SensorBreak).is_some();
    device.defects.clamp_a = has(Kind::Clamped).map(|f| f.at_a);
    if has(Kind::WatchdogTrip).is_some() {
        device.trip(now_s);
    }
    faults
}

fn modbus(shared: &Shared, request: &Request, raw: &[u8], previous: &mut Vec<u8>, arrived: &mut Instant) -> Reply {
    pace(shared, raw.len(), arrived);
    let now_s = shared.now_s();
    let mut guard = shared.lock();
    let (device, script) = &mut *guard;
    let faults = faults(device, script, now_s);
    let has = |kind: Kind| faults.iter().find(|f| f.kind == kind);
    let closed = has(Kind::ClosedLine).is_some();
    let refused = has(Kind::Exception).map(|f| vec![request.pdu.first().copied().unwrap_or(0) | 0x80, f.number]);
    let dead = has(Kind::EchoOnly).is_some();
    let answer = match refused {
        Some(pdu) => Some(pdu),
        None if dead || closed => None,
        None => device.execute(now_s, request.unit, &request.pdu),
    };
    drop(guard);
    let Some(mut pdu) = answer else {
        return Reply { frames: if dead { vec![(0.0, raw.to_vec())] } else { vec![] }, close: closed };
    };
    if has(Kind::WrongFunction).is_some() {
        // An exception stays one, of another function.
        pdu[0] = pdu[0] & 0x80 | if pdu[0] & 0x7F == 3 { 4 } else { 3 };
    }
    if has(Kind::ExtraRegister).is_some() && matches!(pdu[0], 3 | 4 | 23) {
        pdu[1] = pdu[1].wrapping_add(2);
        pdu.extend_from_slice(&[0x12, 0x34]);
    }
    if has(Kind::MissingRegister).is_some() && matches!(pdu[0], 3 | 4 | 23) && pdu.len() > 3 {
        pdu[1] -= 2;
        pdu.truncate(pdu.len() - 2);
    }
    let unit = if has(Kind::WrongUnit).is_some() { request.unit.wrapping_add(1) } else { request.unit };
    let wrong = has(Kind::WrongCrc).is_some();
    let frame = match shared.profile.transport.kind {
        kind if has_ids(kind) => frames::tcp(request.transaction, unit, &pdu, wrong),
        _ => frames::rtu(unit, &pdu, wrong),
    };
    finish(shared, raw, frame, previous, &faults)
}

fn line(shared: &Shared, raw: &[u8], previous: &mut Vec<u8>, arrived: &mut Instant) -> Reply {
    pace(shared, raw.len(), arrived);
    let now_s = shared.now_s();
    let nothing = |close| Reply { frames: vec![], close };
    let found = shared.profile.cycle.transactions.iter().filter_map(|t| t.line.as_ref()).find_map(|exchange| {
        let text = raw.strip_suffix(exchange.request.terminator.as_bytes())?;
        let mut values = Vec::new();
        exchange.request.read(text, |name, value| values.push((name, value))).map(|()| (exchange, values))
    });
    let Some((exchange, values)) = found else { return nothing(false) };
    let mut guard = shared.lock();
    let (device, script) = &mut *guard;
    let faults = faults(device, script, now_s);
    let has = |kind: Kind| faults.iter().any(|f| f.kind == kind);
    if has(Kind::ClosedLine) {
        return nothing(true);
    }
    if has(Kind::EchoOnly) {
        return Reply { frames: vec![(0.0, raw.to_vec())], close: false };
    }
    let written = |name: SignalName| values.iter().find(|v| v.0 == name).map(|v| v.1);
    if let Some(current_a) = written(SignalName::Setpoint) {
        device.set_current(now_s, current_a);
    }
    let shown: Vec<(SignalName, f64)> = exchange
        .reply
        .signals()
        .map(|n| (n, if n == SignalName::Token { written(n).unwrap_or(0.0) } else { device.line_value(n) }))
        .collect();
    drop(guard);
    let mut frame = Vec::new();
    exchange.reply.write(&mut frame, |n| shown.iter().find(|v| v.0 == n).map_or(0.0, |v| v.1));
    if has(Kind::WrongCrc) || has(Kind::WrongFunction) || has(Kind::WrongUnit) {
        frame[0] ^= 1;
    }
    if has(Kind::Exception) {
        frame = [b"ERR".as_slice(), exchange.reply.terminator.as_bytes()].concat();
    }
    finish(shared, raw, frame, previous, &faults)
}

/// Applies the faults that concern the frame as a whole, and the wire time of the reply.
fn finish(shared: &Shared, raw: &[u8], frame: Vec<u8>, previous: &mut Vec<u8>, faults: &[Fault]) -> Reply {
    let has = |kind: Kind| faults.iter().find(|f| f.kind == kind);
    let wire_s = if shared.paced { shared.profile.characters_s(frame.len()) } else { 0.0 };
    let served = std::mem::replace(previous, frame.clone());
    if has(Kind::Silent).is_some() {
        return Reply { frames: vec![], close: false };
    }
    let mut bytes = if has(Kind::Previous).is_some() && !served.is_empty() { served } else { frame.clone() };
    if has(Kind::Truncated).is_some() {
        bytes.truncate(bytes.len().saturating_sub(3));
    }
    if let Some(f) = has(Kind::Garbage) {
        let noise: Vec<u8> = (0..f.number).map(|i| 0xA5u8.wrapping_mul(i | 1)).collect();
        bytes.splice(0..0, noise);
    }
    if has(Kind::GarbageHeader).is_some() {
        bytes.splice(0..0, [1, 3, 0x40]);
    }
    if has(Kind::LocalEcho).is_some() {
        bytes.splice(0..0, raw.iter().copied());
    }
    let late_s = has(Kind::Late).map_or(0.0, |f| f.by_s);
    let tail = has(Kind::Gap).map(|f| (f.by_s, bytes.split_off(bytes.len() / 2)));
    let mut frames = vec![(wire_s + late_s, bytes)];
    frames.extend(tail);
    if let Some(f) = has(Kind::Duplicate) {
        frames.push((f.by_s, frame));
    }
    Reply { frames, close: false }
}
