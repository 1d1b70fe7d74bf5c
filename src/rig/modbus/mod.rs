//! Modbus RTU and TCP: one transaction of a profile as one checked request and reply.
//!
//! Every reply is compared with its request here, also where the codec only would in a debug build; after anything
//! unexpected the codec is built anew, and on TCP the connection too, because neither can be trusted to be in step.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::time::Duration;

use tokio::runtime::Runtime;
use tokio_modbus::client::{Client, Context, rtu, tcp};
use tokio_modbus::prelude::SlaveContext;
use tokio_modbus::{Error, Request, Response, Slave};

use super::RigError;
use super::profile::{Block, Freshness, Profile, RegisterValue, SignalName, Table, Transaction, TransportKind};
use super::realtime::Clock;
use super::wire::{Bus, BusPort, Endpoint, Incoming, Loss, Outgoing, TracedFrame, low_latency};

/// Time for the first connection.
const CONNECT: Duration = Duration::from_secs(3);

/// A Modbus line to one or more units.
pub struct ModbusBus {
    runtime: Runtime,
    port: BusPort,
    context: Context,
    endpoint: Endpoint,
    profile: Profile,
    broken: bool,
    latency: Option<&'static str>,
    /// Transactions on the present connection, and the id that the first of them had.
    calls: u16,
    first_id: u16,
    /// Unit, address and registers of the last write that was answered, where the profile reads them back.
    written: Option<(u8, u16, Vec<u16>)>,
    /// What was written of late, answered or not: a connection that was lost, or a gateway, may carry it out late.
    recent: VecDeque<Vec<u16>>,
}

mod renumbered;

use renumbered::Renumbered;

/// Writes that are remembered: more than may be lost in a row before a run ends.
const RECENT: usize = 256;

/// Ids of a new connection begin at the next multiple of this behind those of the last.
const ID_STEP: u16 = 256;

impl ModbusBus {
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
        let stream = runtime.block_on(endpoint.open(t, CONNECT))?;
        let port = BusPort::new(stream, t.local_echo, clock);
        let context = runtime.block_on(async { attach(t.kind, &port, t.unit, 0) });
        Ok(Self {
            runtime,
            port,
            context,
            endpoint: endpoint.clone(),
            profile: profile.clone(),
            broken: false,
            latency,
            calls: 0,
            first_id: 0,
            written: None,
            recent: VecDeque::with_capacity(RECENT),
        })
    }

    /// One request with its reply, nothing compared yet.
    fn call(&mut self, unit: u8, request: Request<'_>, timeout_s: f64) -> Result<Response, Loss> {
        if self.broken {
            return Err(Loss::Transport("the connection is lost".into()));
        }
        self.port.purge();
        self.calls = self.calls.wrapping_add(1);
        self.context.set_slave(Slave(unit));
        let limit = Duration::from_secs_f64(timeout_s.max(0.0));
        let context = &mut self.context;
        let result = self.runtime.block_on(async { tokio::time::timeout(limit, context.call(request)).await });
        match result {
            Err(_) => {
                self.broken = true;
                Err(Loss::Timeout)
            }
            Ok(Ok(Ok(response))) => Ok(response),
            Ok(Ok(Err(exception))) => Err(Loss::Exception(exception.into())),
            Ok(Err(error)) => {
                self.broken = true;
                Err(match error {
                    Error::Protocol(e) => Loss::Malformed(e.to_string()),
                    Error::Transport(e) => Loss::Transport(e.to_string()),
                })
            }
        }
    }

    /// A loss that the codec did not see: what comes next cannot be trusted either.
    fn lost(&mut self, loss: Loss) -> Loss {
        self.broken = true;
        loss
    }

    /// Remembers what was written, where the profile shows that these registers can be read back.
    fn note_written(&mut self, t: &Transaction, address: u16, written: Vec<u16>) {
        let Some(block) = &t.write else { return };
        let reads = |i: &usize| self.profile.cycle.transactions.iter().any(|t| t.read.as_ref().is_some_and(|b| b.signals.contains(i)));
        if block.signals.iter().all(reads) {
            self.written = Some((t.unit_id, address, written));
        }
    }

    fn words(&self, block: &Block, out: &Outgoing) -> Vec<u16> {
        let mut words = Vec::with_capacity(usize::from(block.words));
        for index in &block.signals {
            let signal = &self.profile.signals[*index];
            let encoded = signal.encode(out.raw(signal.name));
            words.extend_from_slice(&encoded[..usize::from(signal.words())]);
        }
        words
    }

    fn take(&self, block: &Block, words: &[u16], into: &mut Incoming) {
        let mut at = 0;
        for index in &block.signals {
            let signal = &self.profile.signals[*index];
            if let Some(raw) = words.get(at..).and_then(|w| signal.decode(w)) {
                into.set(signal.name, raw);
            }
            at += usize::from(signal.words());
        }
    }
}

/// Whether frames carry the header of Modbus TCP.
fn has_ids(kind: TransportKind) -> bool {
    matches!(kind, TransportKind::Tcp | TransportKind::TcpGateway)
}

fn attach(kind: TransportKind, port: &BusPort, unit: u8, first_id: u16) -> Context {
    match kind {
        kind if has_ids(kind) => tcp::attach_slave(Renumbered::new(port.clone(), first_id), Slave(unit)),
        _ => rtu::attach_slave(port.clone(), Slave(unit)),
    }
}

impl Bus for ModbusBus {
    fn transact(&mut self, t: &Transaction, out: &Outgoing, timeout_s: f64, into: &mut Incoming) -> Result<(), Loss> {
        let written = t.write.as_ref().map(|b| self.words(b, out)).unwrap_or_default();
        let write_address = t.write.as_ref().map_or(0, |b| b.address);
        let extra = if t.freshness == Freshness::Quantity { out.extra * t.step } else { 0 };
        let (read_address, count) = t.read.as_ref().map_or((0, 0), |b| (b.address, b.words + extra));
        let request = match t.function {
            3 => Request::ReadHoldingRegisters(read_address, count),
            4 => Request::ReadInputRegisters(read_address, count),
            6 => Request::WriteSingleRegister(write_address, written.first().copied().unwrap_or(0)),
            16 => Request::WriteMultipleRegisters(write_address, Cow::Borrowed(&written)),
            _ => Request::ReadWriteMultipleRegisters(read_address, count, write_address, Cow::Borrowed(&written)),
        };
        if !written.is_empty() {
            self.written = None;
            if self.recent.len() == RECENT {
                self.recent.pop_front();
            }
            self.recent.push_back(written.clone());
        }
        let response = self.call(t.unit_id, request, timeout_s)?;
        let words = match response {
            Response::WriteSingleRegister(address, value) => {
                if address == write_address && written.first() == Some(&value) {
                    self.note_written(t, write_address, written);
                    return Ok(());
                }
                let what = format!("{value} in register {address} for {written:?} in {write_address}");
                return Err(self.lost(Loss::Stale(what)));
            }
            Response::WriteMultipleRegisters(address, n) => {
                if address == write_address && usize::from(n) == written.len() {
                    self.note_written(t, write_address, written);
                    return Ok(());
                }
                return Err(self.lost(Loss::Stale(format!("{n} registers from {address}"))));
            }
            Response::ReadHoldingRegisters(w) | Response::ReadInputRegisters(w) | Response::ReadWriteMultipleRegisters(w) => w,
            other => return Err(self.lost(Loss::Malformed(format!("{other:?}")))),
        };
        if words.len() != usize::from(count) {
            let what = format!("{} registers where {count} were asked for", words.len());
            let loss = if t.freshness == Freshness::Quantity { Loss::Stale(what) } else { Loss::Malformed(what) };
            return Err(self.lost(loss));
        }
        if let Some(block) = &t.read {
            self.take(block, &words, into);
        }
        if t.freshness == Freshness::Echo && into.get(SignalName::Token).is_some_and(|token| token != f64::from(out.token)) {
            return Err(self.lost(Loss::Stale(format!("token {:?} for {}", into.get(SignalName::Token), out.token))));
        }
        if t.write.is_some() {
            self.note_written(t, write_address, written);
        }
        Ok(())
    }

    fn holds_last_write(&mut self, timeout_s: f64) -> Result<Option<String>, Loss> {
        let Some((unit, address, written)) = self.written.clone() else { return Ok(None) };
        match self.call(unit, Request::ReadHoldingRegisters(address, written.len() as u16), timeout_s)? {
            Response::ReadHoldingRegisters(found) if found == written => Ok(None),
            Response::ReadHoldingRegisters(found) if self.recent.contains(&found) => {
                Err(self.lost(Loss::Stale(format!("{found:?}, which this program wrote before {written:?}"))))
            }
            Response::ReadHoldingRegisters(found) if found.len() == written.len() => {
                Ok(Some(format!("the registers from {address} hold {found:?} where {written:?} was written last")))
            }
            other => Err(self.lost(Loss::Malformed(format!("{other:?}")))),
        }
    }

    fn read_block(&mut self, address: u16, count: u16, timeout_s: f64) -> Result<Vec<u16>, Loss> {
        match self.call(self.profile.transport.unit, Request::ReadHoldingRegisters(address, count), timeout_s)? {
            Response::ReadHoldingRegisters(words) if words.len() == usize::from(count) => Ok(words),
            other => Err(self.lost(Loss::Malformed(format!("{other:?}")))),
        }
    }

    fn read_register(&mut self, r: &RegisterValue, timeout_s: f64) -> Result<u16, Loss> {
        let unit = r.unit.unwrap_or(self.profile.transport.unit);
        let request = match r.table {
            Table::Holding => Request::ReadHoldingRegisters(r.address, 1),
            Table::Input => Request::ReadInputRegisters(r.address, 1),
        };
        match self.call(unit, request, timeout_s)? {
            Response::ReadHoldingRegisters(w) | Response::ReadInputRegisters(w) if w.len() == 1 => Ok(w[0]),
            other => Err(self.lost(Loss::Malformed(format!("{other:?}")))),
        }
    }

    fn write_register(&mut self, r: &RegisterValue, timeout_s: f64) -> Result<(), Loss> {
        let unit = r.unit.unwrap_or(self.profile.transport.unit);
        let single = self.profile.cycle.transactions.iter().all(|t| t.function != 16);
        let request = if single {
            Request::WriteSingleRegister(r.address, r.value)
        } else {
            Request::WriteMultipleRegisters(r.address, Cow::Owned(vec![r.value]))
        };
        match self.call(unit, request, timeout_s)? {
            Response::WriteSingleRegister(address, value) if address == r.address && value == r.value => Ok(()),
            Response::WriteMultipleRegisters(address, 1) if address == r.address => Ok(()),
            other => Err(self.lost(Loss::Malformed(format!("{other:?} to register {} = {}", r.address, r.value)))),
        }
    }

    fn recover(&mut self, within_s: f64) -> bool {
        if !self.broken {
            return false;
        }
        let t = &self.profile.transport;
        let reconnected = match &self.endpoint {
            // A serial port stays open: opening it again would move its control lines and lose its lock.
            Endpoint::Serial(path) if path.exists() => false,
            Endpoint::Serial(_) => return false,
            Endpoint::Tcp(_) => {
                let limit = Duration::from_secs_f64(within_s.max(1e-3));
                let Ok(stream) = self.runtime.block_on(self.endpoint.open(t, limit)) else { return false };
                self.port.replace(stream);
                self.port.purge();
                true
            }
        };
        // The ids go on behind those of the last connection: an old reply that comes over the new one finds no request.
        self.first_id = self.first_id.wrapping_add(self.calls.div_ceil(ID_STEP).max(1).wrapping_mul(ID_STEP));
        self.calls = 0;
        let (kind, port, first_id) = (t.kind, self.port.clone(), self.first_id);
        self.context = self.runtime.block_on(async { attach(kind, &port, self.profile.transport.unit, first_id) });
        self.broken = false;
        reconnected
    }

    fn trace(&self) -> Vec<TracedFrame> {
        self.port.trace()
    }

    fn details(&self) -> Vec<(String, String)> {
        let t = &self.profile.transport;
        let line = match t.kind {
            TransportKind::Tcp => format!("Modbus TCP to {}", self.endpoint),
            TransportKind::TcpGateway => format!("Modbus TCP to the gateway {}", self.endpoint),
            _ => format!("Modbus RTU on {}, {} baud", self.endpoint, t.baud),
        };
        let mut details = vec![("line".to_string(), line)];
        details.extend(self.latency.map(|l| ("low latency".to_string(), l.to_string())));
        details
    }
}
