//! One device on its line: a slot's transactions with their proofs of freshness and plausibility.

use super::bus::{Bus, Incoming, Loss, Outgoing};
use super::counter::Counter;
use super::sequence::{Sequence, rests_on_setpoint};
use crate::rig::OutsideLimits;
use crate::rig::profile::{Freshness, Profile, SignalName, TransportKind};
use crate::rig::realtime::Clock;
use crate::rig::{Quality, RigError};

/// The set-point must have moved so far before an unchanged raw value is a frozen sensor [A].
const FROZEN_MOVE_A: f64 = 0.05;

/// What a slot gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Whether it can be trusted; values are only set where it can.
    pub quality: Quality,
    /// The raw numbers.
    pub values: Incoming,
    /// Code of an exception.
    pub exception: Option<u8>,
}

/// How often what was lost.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Losses {
    /// No reply in time, or none that was one.
    pub lost: u64,
    /// Replies to another request.
    pub stale: u64,
    /// Exceptions.
    pub exceptions: u64,
    /// Values that cannot be.
    pub implausible: u64,
}

/// A device with its bus and what is needed to judge the next reply.
pub struct Device {
    /// Its profile.
    pub profile: Profile,
    /// Its line.
    pub bus: Box<dyn Bus>,
    /// What was lost so far.
    pub losses: Losses,
    /// What the latest loss was, for a message.
    pub last_loss: Option<String>,
    sequence: Sequence,
    alternate: bool,
    counter: Counter,
    frozen: Frozen,
    /// Set by a new connection; whoever acts on it clears it.
    pub reconnected: bool,
}

/// Watches for a raw value that stands still while the set-point moves.
#[derive(Debug, Clone, Copy, Default)]
struct Frozen {
    raw: f64,
    since_s: f64,
    low_a: f64,
    high_a: f64,
}

impl Device {
    /// A device at rest, in a loop of this period; an infinite one where no loop runs.
    pub fn new(profile: Profile, bus: Box<dyn Bus>, first_token: u16, period_s: f64) -> Self {
        let alternate = rests_on_setpoint(&profile) || profile.cycle.transactions.iter().any(|t| t.function == 6);
        let alternate = alternate && profile.transport.kind != TransportKind::Tcp;
        let rate_hz = profile.signal(SignalName::Counter).and_then(|(_, s)| s.rate_hz).unwrap_or(profile.device.update_hz);
        Self {
            profile,
            bus,
            losses: Losses::default(),
            last_loss: None,
            sequence: Sequence::new(first_token),
            alternate,
            counter: Counter::new(rate_hz, period_s),
            reconnected: false,
            frozen: Frozen { raw: f64::NAN, ..Frozen::default() },
        }
    }

    /// What is sent in the next slot for a current [A].
    pub fn outgoing(&mut self, current_a: f64, safe: bool) -> Result<Outgoing, OutsideLimits> {
        let setpoint = match self.profile.signal(SignalName::Setpoint) {
            Some((index, _)) => {
                let (signal, limit) = (&self.profile.signals[index], &self.profile.limit);
                self.sequence.setpoint(current_a, signal, limit, self.alternate)?
            }
            None => 0.0,
        };
        let control =
            self.profile.signal(SignalName::Control).map_or(0, |(_, s)| if safe { s.safe.unwrap_or(s.constant) } else { s.constant });
        Ok(Outgoing { setpoint, control, token: self.sequence.token(), extra: self.sequence.extra() })
    }

    /// One slot: all transactions, within `within_s`. `current_a` is the current of the driver, by which a frozen pressure shows.
    pub fn slot(&mut self, out: &Outgoing, current_a: f64, within_s: f64, clock: &Clock) -> Reading {
        let mut values = Incoming::default();
        let sent_s = clock.now_s();
        let end_s = sent_s + within_s;
        for index in 0..self.profile.cycle.transactions.len() {
            let rest_s = (end_s - clock.now_s()).min(self.profile.cycle.timeout_s);
            let transaction = &self.profile.cycle.transactions[index];
            if let Err(loss) = self.bus.transact(transaction, out, rest_s, &mut values) {
                return self.lost(&loss, (end_s - clock.now_s()).max(0.001));
            }
        }
        let quality = self.judge(&values, out, current_a, (sent_s, clock.now_s()));
        match quality {
            Quality::Stale => self.losses.stale += 1,
            Quality::Implausible => self.losses.implausible += 1,
            _ => {}
        }
        Reading { quality, values, exception: None }
    }

    /// All transactions without a judgement, for start and safe state; a loss is recovered from and named.
    pub fn transact_all(&mut self, out: &Outgoing, within_s: f64, clock: &Clock) -> Result<Incoming, String> {
        let mut values = Incoming::default();
        let end_s = clock.now_s() + within_s;
        for transaction in &self.profile.cycle.transactions {
            let rest_s = (end_s - clock.now_s()).min(self.profile.cycle.timeout_s.max(0.02));
            if transaction.freshness == Freshness::None {
                return Err("the profile has no proof of freshness, so no reply confirms anything".into());
            }
            if let Err(loss) = self.bus.transact(transaction, out, rest_s, &mut values) {
                self.reconnected |= self.bus.recover(self.profile.cycle.timeout_s.max(0.02));
                return Err(loss.to_string());
            }
        }
        Ok(values)
    }

    /// Exactly zero, whatever the last set-points were.
    pub fn outgoing_zero(&mut self) -> Result<Outgoing, OutsideLimits> {
        let exact = std::mem::replace(&mut self.alternate, false);
        let out = self.outgoing(0.0, true);
        self.alternate = exact;
        out
    }

    /// Whether the counter of conversions, where there is one, has moved since the last reply, at rest: a device that restarted may
    /// count from zero. With the times of its request and its reply.
    pub fn shows_new_conversion(&mut self, values: &Incoming, (sent_s, got_s): (f64, f64)) -> Result<(), String> {
        values.get(SignalName::Counter).map_or(Ok(()), |raw| self.counter.take(raw, sent_s, got_s, true))
    }

    fn lost(&mut self, loss: &Loss, within_s: f64) -> Reading {
        let (quality, exception) = match loss {
            Loss::Stale(_) => (Quality::Stale, None),
            Loss::Exception(code) => (Quality::Exception, Some(*code)),
            Loss::Timeout | Loss::Malformed(_) | Loss::Transport(_) => (Quality::Held, None),
        };
        match quality {
            Quality::Stale => self.losses.stale += 1,
            Quality::Exception => self.losses.exceptions += 1,
            _ => self.losses.lost += 1,
        }
        self.last_loss = Some(loss.to_string());
        self.reconnected |= self.bus.recover(within_s);
        Reading { quality, values: Incoming::default(), exception }
    }

    /// Freshness of what the transactions did not already prove, then what the device and its sensors say.
    fn judge(&mut self, values: &Incoming, out: &Outgoing, current_a: f64, (sent_s, got_s): (f64, f64)) -> Quality {
        if self.profile.cycle.transactions.iter().any(|t| t.freshness == Freshness::None) {
            self.last_loss = Some("the profile has no proof of freshness".into());
            return Quality::Stale;
        }
        if let Some(raw) = values.get(SignalName::Counter)
            && let Err(why) = self.counter.take(raw, sent_s, got_s, false)
        {
            self.last_loss = Some(why);
            return Quality::Stale;
        }
        if let (Some((_, signal)), Some(raw)) = (self.profile.signal(SignalName::Status), values.get(SignalName::Status))
            && let Some(fault) = signal.fault(raw as u16)
        {
            self.last_loss = Some(format!("status bit `{}` is {}", fault.name, u8::from(fault.fault_when)));
            return Quality::Implausible;
        }
        let echoed = values.get(SignalName::Setpoint).is_none_or(|raw| raw == out.setpoint)
            && values.get(SignalName::Control).is_none_or(|raw| raw == f64::from(out.control));
        if !echoed {
            // With a token the reply is shown to be fresh, so the device did something else; without, it may be an old reply.
            self.last_loss = Some(format!("set-point {:?} read back for {}", values.get(SignalName::Setpoint), out.setpoint));
            return if rests_on_setpoint(&self.profile) { Quality::Stale } else { Quality::Implausible };
        }
        for signal in &self.profile.signals {
            let Some(raw) = values.get(signal.name) else { continue };
            if !signal.plausible(raw) {
                self.last_loss = Some(format!("raw {} = {raw} is outside what the sensor delivers", signal.name));
                return Quality::Implausible;
            }
        }
        if self.is_frozen(values, current_a, got_s) { Quality::Implausible } else { Quality::Good }
    }

    fn is_frozen(&mut self, values: &Incoming, current_a: f64, now_s: f64) -> bool {
        let Some((_, pressure)) = self.profile.signal(SignalName::Pressure) else { return false };
        let (Some(limit_s), Some(raw)) = (pressure.frozen_after_s, values.get(SignalName::Pressure)) else { return false };
        let f = &mut self.frozen;
        if raw != f.raw {
            *f = Frozen { raw, since_s: now_s, low_a: current_a, high_a: current_a };
            return false;
        }
        (f.low_a, f.high_a) = (f.low_a.min(current_a), f.high_a.max(current_a));
        let frozen = now_s - f.since_s > limit_s && f.high_a - f.low_a > FROZEN_MOVE_A;
        if frozen {
            self.last_loss = Some(format!("raw pressure stands at {raw} while the current moves"));
        }
        frozen
    }

    /// A measured value in its canonical unit.
    pub fn value(&self, values: &Incoming, name: SignalName) -> Option<f64> {
        let (_, signal) = self.profile.signal(name)?;
        Some(signal.from_raw(values.get(name)?))
    }

    /// An exception that a later attempt cannot cure.
    pub fn refusal(&self, code: u8) -> Option<RigError> {
        let advice = match code {
            1..=3 => "the profile does not fit this device",
            4 => "the device has failed",
            10 | 11 => "the gateway does not reach the device",
            _ => return None,
        };
        Some(RigError::Device { name: self.profile.name.clone(), reason: format!("{}: {advice}", Loss::Exception(code)) })
    }
}
