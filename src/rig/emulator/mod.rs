//! An emulated current driver with a simulated valve behind it, on a pseudo terminal or on TCP, that can misbehave.
//!
//! It serves any driver profile: the registers are those of the profile, the coil drives the valve in real time,
//! and a fault script says what goes wrong and when.

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

mod device;
mod faults;
mod frames;
mod link;
mod serve;

pub use device::{Defects, Device, DeviceReport, Load, SIGNATURE, SIGNATURE_ADDRESS};
pub use faults::{Fault, FaultScript, Faults, Kind, Random, Scheduled};
pub use frames::{Parsed, Request, parse_rtu, parse_tcp, rtu, tcp};

use super::profile::{Profile, TransportKind};
use link::Pty;
use serve::Shared;

/// Where the emulator listens.
#[derive(Debug, Clone, PartialEq)]
pub enum Listen {
    /// A pseudo terminal, with a symbolic link to its device.
    Pty(Option<PathBuf>),
    /// A TCP address; port 0 takes a free one.
    Tcp(SocketAddr),
}

/// How a driver reaches the emulator.
#[derive(Debug, Clone, PartialEq)]
pub enum Listening {
    /// The device of the pseudo terminal.
    Serial(PathBuf),
    /// The bound address.
    Tcp(SocketAddr),
}

/// Why an emulator cannot start.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// The profile is for another kind of line.
    #[error("{profile}: its transport is {kind:?}, which does not go over {listen}; use {instead}")]
    Transport {
        /// The profile.
        profile: String,
        /// Its transport.
        kind: TransportKind,
        /// What was asked for.
        listen: &'static str,
        /// What to ask for.
        instead: &'static str,
    },
    /// The pseudo terminal or the port cannot be opened.
    #[error("cannot listen on {place}: {source}")]
    Open {
        /// Where.
        place: String,
        /// What the operating system says.
        source: std::io::Error,
    },
}

/// A running emulator; it ends when it is dropped.
pub struct Emulator {
    shared: Arc<Shared>,
    listening: Listening,
    threads: Vec<JoinHandle<()>>,
}

impl Emulator {
    /// Starts an emulated device. `paced`: frames take the time that the wire would take.
    pub fn start(profile: Arc<Profile>, load: Load, listen: &Listen, faults: Faults, paced: bool) -> Result<Self, EmulatorError> {
        let wrong =
            |listen, instead| EmulatorError::Transport { profile: profile.name.clone(), kind: profile.transport.kind, listen, instead };
        match (listen, profile.transport.kind) {
            (Listen::Pty(_), TransportKind::Tcp | TransportKind::TcpGateway | TransportKind::RtuOverTcp) => {
                return Err(wrong("a pseudo terminal", "--tcp"));
            }
            (Listen::Tcp(_), TransportKind::Rtu) => return Err(wrong("TCP", "--pty")),
            _ => {}
        }
        let shared = Arc::new(Shared {
            state: Mutex::new((Device::new(Arc::clone(&profile), load), faults)),
            profile,
            start: Instant::now(),
            stop: AtomicBool::new(false),
            paced,
        });
        let for_thread = Arc::clone(&shared);
        let (listening, thread) = match listen {
            Listen::Pty(link) => {
                let failed = |source| EmulatorError::Open {
                    place: link.as_ref().map_or("a pseudo terminal".into(), |l| l.display().to_string()),
                    source,
                };
                let mut pty = Pty::open(link.as_deref()).map_err(failed)?;
                let path = pty.path().to_path_buf();
                let thread = std::thread::spawn(move || {
                    let _ = crate::rig::realtime::prioritize(60);
                    // The line closes when the script says so; the device itself lives on.
                    let _ = serve::serve(&for_thread, &mut pty);
                });
                (Listening::Serial(path), thread)
            }
            Listen::Tcp(address) => {
                let failed = |source| EmulatorError::Open { place: address.to_string(), source };
                let listener = TcpListener::bind(address).map_err(failed)?;
                let bound = listener.local_addr().map_err(failed)?;
                listener.set_nonblocking(true).map_err(failed)?;
                (Listening::Tcp(bound), std::thread::spawn(move || accept(&for_thread, &listener)))
            }
        };
        Ok(Self { shared, listening, threads: vec![thread] })
    }

    /// Where a driver finds it.
    pub fn listening(&self) -> &Listening {
        &self.listening
    }

    /// What the device saw until now.
    pub fn report(&self) -> DeviceReport {
        let now_s = self.shared.now_s();
        let mut guard = self.shared.lock();
        guard.0.advance(now_s);
        guard.0.report()
    }

    /// The pressure at this device's valve, for a second device that measures it.
    pub fn pressure(&self) -> Load {
        let shared = Arc::clone(&self.shared);
        Load::Measured(Box::new(move || {
            let now_s = shared.now_s();
            let mut guard = shared.lock();
            guard.0.advance(now_s);
            guard.0.pressure_bar()
        }))
    }

    /// Whether the line is still served.
    pub fn is_serving(&self) -> bool {
        self.threads.iter().any(|t| !t.is_finished())
    }

    /// Ends the line, as if the cable were pulled.
    pub fn stop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.stop();
    }
}

fn accept(shared: &Arc<Shared>, listener: &TcpListener) {
    let mut connections: Vec<JoinHandle<()>> = Vec::new();
    while !shared.stop.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((mut stream, _)) => {
                let shared = Arc::clone(shared);
                let _ = stream.set_nonblocking(false).and_then(|()| stream.set_nodelay(true));
                connections.push(std::thread::spawn(move || {
                    let _ = crate::rig::realtime::prioritize(60);
                    let _ = serve::serve(&shared, &mut stream);
                }));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(2)),
        }
        connections.retain(|c| !c.is_finished());
        let now_s = shared.now_s();
        shared.lock().0.advance(now_s);
    }
    for connection in connections {
        let _ = connection.join();
    }
}
