//! Lines of text: a request and a reply with values in them, as a profile writes them down, so that an ASCII current
//! driver needs no Rust.

use std::time::Duration;

use tokio::runtime::Runtime;

use super::RigError;
use super::profile::{Freshness, Profile, RegisterValue, SignalName, Transaction};
use super::realtime::Clock;
use super::wire::{Bus, BusPort, Endpoint, Incoming, Loss, Outgoing, TracedFrame, low_latency};

/// Longest line that is read.
const LONGEST: usize = 512;

/// A line driver on a serial port or behind a TCP serial server.
pub struct LineBus {
    runtime: Runtime,
    port: BusPort,
    endpoint: Endpoint,
    profile: Profile,
    broken: bool,
    latency: Option<&'static str>,
    request: Vec<u8>,
    received: Vec<u8>,
}

impl LineBus {
    /// Opens the line of a profile.
    pub fn open(profile: &Profile, endpoint: &Endpoint, clock: Clock) -> Result<Self, RigError> {
        let t = &profile.transport;
        endpoint.check(t.kind, &profile.name)?;
        let failed = |e: std::io::Error| RigError::Open { place: endpoint.to_string(), reason: e.to_string() };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
        let latency = match endpoint {
            Endpoint::Serial(path) if t.low_latency => Some(low_latency(path)),
            _ => None,
        };
        let stream = runtime.block_on(endpoint.open(t, Duration::from_secs(3)))?;
        let port = BusPort::new(stream, t.local_echo, clock);
        Ok(Self {
            runtime,
            port,
            endpoint: endpoint.clone(),
            profile: profile.clone(),
            broken: false,
            latency,
            request: Vec::with_capacity(LONGEST),
            received: Vec::with_capacity(LONGEST),
        })
    }

    /// Reads until the terminator; what follows it belongs to nobody and is thrown away by the next purge.
    fn exchange(&mut self, terminator: &[u8], timeout_s: f64) -> Result<usize, Loss> {
        let (port, request, received) = (&self.port, &self.request, &mut self.received);
        received.clear();
        let read = async {
            port.write_all(request).await?;
            let mut chunk = [0u8; 128];
            loop {
                let n = port.read(&mut chunk).await?;
                if n == 0 || received.len() + n > LONGEST {
                    return Err(std::io::Error::other(if n == 0 { "the line is closed" } else { "a line without end" }));
                }
                received.extend_from_slice(&chunk[..n]);
                if let Some(end) = received.windows(terminator.len()).position(|w| w == terminator) {
                    return Ok(end);
                }
            }
        };
        let limit = Duration::from_secs_f64(timeout_s.max(0.0));
        match self.runtime.block_on(async { tokio::time::timeout(limit, read).await }) {
            Err(_) => Err(Loss::Timeout),
            Ok(Err(e)) => {
                self.broken = true;
                Err(Loss::Transport(e.to_string()))
            }
            Ok(Ok(end)) => Ok(end),
        }
    }
}

impl Bus for LineBus {
    fn transact(&mut self, t: &Transaction, out: &Outgoing, timeout_s: f64, into: &mut Incoming) -> Result<(), Loss> {
        let Some(line) = &t.line else { return Err(Loss::Malformed("no line in this transaction".into())) };
        if self.broken {
            return Err(Loss::Transport("the connection is lost".into()));
        }
        self.port.purge();
        self.request.clear();
        line.request.write(&mut self.request, |name| out.raw(name));
        let end = self.exchange(line.reply.terminator.as_bytes(), timeout_s)?;
        let mut found = Incoming::default();
        if line.reply.read(&self.received[..end], |name, value| found.set(name, value)).is_none() {
            let text = String::from_utf8_lossy(&self.received[..end.min(60)]).into_owned();
            return Err(Loss::Malformed(format!("`{}`", text.escape_debug())));
        }
        if t.freshness == Freshness::Echo && found.get(SignalName::Token) != Some(f64::from(out.token)) {
            return Err(Loss::Stale(format!("token {:?} for {}", found.get(SignalName::Token), out.token)));
        }
        for name in line.reply.signals() {
            if let Some(raw) = found.get(name) {
                into.set(name, raw);
            }
        }
        Ok(())
    }

    fn read_register(&mut self, _: &RegisterValue, _: f64) -> Result<u16, Loss> {
        Err(Loss::Malformed("a line driver has no registers".into()))
    }

    fn write_register(&mut self, _: &RegisterValue, _: f64) -> Result<(), Loss> {
        Err(Loss::Malformed("a line driver has no registers".into()))
    }

    fn recover(&mut self, within_s: f64) -> bool {
        if !self.broken {
            return false;
        }
        match &self.endpoint {
            Endpoint::Serial(path) => {
                self.broken = !path.exists();
                false
            }
            Endpoint::Tcp(_) => {
                let limit = Duration::from_secs_f64(within_s.max(1e-3));
                let Ok(stream) = self.runtime.block_on(self.endpoint.open(&self.profile.transport, limit)) else { return false };
                self.port.replace(stream);
                self.port.purge();
                self.broken = false;
                true
            }
        }
    }

    fn trace(&self) -> Vec<TracedFrame> {
        self.port.trace()
    }

    fn details(&self) -> Vec<(String, String)> {
        let mut details = vec![("line".to_string(), format!("text on {}, {} baud", self.endpoint, self.profile.transport.baud))];
        details.extend(self.latency.map(|l| ("low latency".to_string(), l.to_string())));
        details
    }
}
