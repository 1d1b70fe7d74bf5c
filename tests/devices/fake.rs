//! A device of our own on Modbus TCP: the emulated one, with whatever a test wants done to its requests and replies.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use hil::rig::Endpoint;
use hil::rig::emulator::{Device, Load, Parsed, parse_tcp, tcp};
use hil::rig::profile::Profile;

use super::wire::simple_valve;

/// What a test may do with one request.
pub struct Turn<'a> {
    /// The device behind the server.
    pub device: &'a mut Device,
    /// Time of the device [s].
    pub now_s: f64,
    /// Id of the request.
    pub id: u16,
    /// Unit of the request.
    pub unit: u8,
    /// The request.
    pub request: Vec<u8>,
    /// What the device answers; what the test leaves here is sent under the request's own id.
    pub reply: Option<Vec<u8>>,
    /// Whole frames that are sent before it, whatever their ids.
    pub before: Vec<Vec<u8>>,
    /// Requests that reach the device so much later [s], when the line has given up on them.
    pub later: Vec<(f64, Vec<u8>)>,
    /// Set to close the connection after this turn.
    pub close: bool,
}

impl Turn<'_> {
    /// A reply as a frame under another id.
    pub fn frame(&self, id: u16, pdu: &[u8]) -> Vec<u8> {
        tcp(id, self.unit, pdu, false)
    }
    /// Whether the request is one of the loop: function 23.
    pub fn is_slot(&self) -> bool {
        self.request.first() == Some(&23)
    }
    /// Puts two registers as a float into the reply of a slot, at this word.
    pub fn put_float(&mut self, word: usize, value: f32) {
        if let Some(reply) = self.reply.as_mut().filter(|r| r.len() >= 6 + 2 * word) {
            reply[2 + 2 * word..6 + 2 * word].copy_from_slice(&value.to_bits().to_be_bytes());
        }
    }
    /// Puts one register into the reply of a slot, at this word.
    pub fn put_word(&mut self, word: usize, value: u16) {
        if let Some(reply) = self.reply.as_mut().filter(|r| r.len() >= 4 + 2 * word) {
            reply[2 + 2 * word..4 + 2 * word].copy_from_slice(&value.to_be_bytes());
        }
    }
    /// One register of the reply of a slot.
    pub fn word(&self, word: usize) -> u16 {
        self.reply.as_ref().map_or(0, |r| u16::from_be_bytes([r[2 + 2 * word], r[3 + 2 * word]]))
    }
}

/// Words of a slot's reply in `drivers/emulator-tcp.toml`: set-point, token, status, counter, current, pressure.
pub const COUNTER: usize = 4;
pub const CURRENT: usize = 5;
pub const PRESSURE: usize = 7;

type Meddle = Box<dyn FnMut(&mut Turn<'_>) + Send>;

struct Inside {
    device: Device,
    meddle: Meddle,
    /// Requests with the time at which the device gets them.
    late: Vec<(f64, u8, Vec<u8>)>,
    start: Instant,
}

/// A running device.
pub struct Fake {
    inside: Arc<Mutex<Inside>>,
    stop: Arc<AtomicBool>,
    /// Where it listens.
    pub address: String,
}

impl Fake {
    /// Serves a device with this profile and a valve of 40 bar/A behind it.
    pub fn start(profile: &Profile, meddle: impl FnMut(&mut Turn<'_>) + Send + 'static) -> Self {
        Self::with(profile, simple_valve(), meddle)
    }

    /// Serves a device with this load.
    pub fn with(profile: &Profile, load: Load, meddle: impl FnMut(&mut Turn<'_>) + Send + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        listener.set_nonblocking(true).unwrap();
        let device = Device::new(Arc::new(profile.clone()), load);
        let inside = Arc::new(Mutex::new(Inside { device, meddle: Box::new(meddle), late: Vec::new(), start: Instant::now() }));
        let stop = Arc::new(AtomicBool::new(false));
        let (shared, ended) = (Arc::clone(&inside), Arc::clone(&stop));
        std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                if let Ok((stream, _)) = listener.accept() {
                    let (shared, ended) = (Arc::clone(&shared), Arc::clone(&ended));
                    std::thread::spawn(move || serve(stream, &shared, &ended));
                }
                std::thread::sleep(Duration::from_millis(1));
                let Inside { device, late, start, .. } = &mut *shared.lock().unwrap();
                let now_s = start.elapsed().as_secs_f64();
                for (_, unit, request) in late.extract_if(.., |l| l.0 <= now_s) {
                    device.received(now_s);
                    device.execute(now_s, unit, &request);
                }
                device.advance(now_s);
            }
        });
        Self { inside, stop, address }
    }

    /// Where a driver finds it.
    pub fn endpoint(&self) -> Endpoint {
        Endpoint::Tcp(self.address.clone())
    }

    /// Current in the coil [A].
    pub fn coil_a(&self) -> f64 {
        self.inside.lock().unwrap().device.report().coil_a
    }

    /// How often its watchdog took the current away.
    pub fn trips(&self) -> u64 {
        self.inside.lock().unwrap().device.report().trips
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn serve(mut stream: TcpStream, shared: &Mutex<Inside>, ended: &AtomicBool) {
    stream.set_nonblocking(false).unwrap();
    stream.set_nodelay(true).unwrap();
    stream.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let (mut buffer, mut chunk) = (Vec::new(), [0u8; 512]);
    while !ended.load(Ordering::Relaxed) {
        match stream.read(&mut chunk) {
            Ok(0) => return,
            Ok(n) => buffer.extend_from_slice(&chunk[..n]),
            Err(_) => continue,
        }
        while let Parsed::Request(request) = parse_tcp(&buffer) {
            buffer.drain(..request.length);
            let mut guard = shared.lock().unwrap();
            let Inside { device, meddle, late, start } = &mut *guard;
            let now_s = start.elapsed().as_secs_f64();
            device.received(now_s);
            let reply = device.execute(now_s, request.unit, &request.pdu);
            let (id, unit) = (request.transaction, request.unit);
            let mut turn =
                Turn { device, now_s, id, unit, request: request.pdu, reply, before: Vec::new(), later: Vec::new(), close: false };
            meddle(&mut turn);
            late.extend(turn.later.drain(..).map(|(in_s, pdu)| (now_s + in_s, unit, pdu)));
            let frames: Vec<Vec<u8>> = turn.before.drain(..).chain(turn.reply.as_ref().map(|pdu| tcp(id, unit, pdu, false))).collect();
            let close = turn.close;
            drop(guard);
            if frames.iter().any(|frame| stream.write_all(frame).is_err()) || close {
                return;
            }
        }
    }
}
