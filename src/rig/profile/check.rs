//! The checks of a profile as a whole: every key against the others, with the line of the key in the message.

use std::collections::BTreeMap;

use super::blocks::transaction;
use super::context::Context;
use super::file::*;
use super::guards;
use super::parts::*;
use super::signal::{FaultBit, Signal, SignalName};
use crate::digest;
use crate::units::{CURRENT, PRESSURE, Unit};

/// Longest time that a device watchdog may wait.
pub(super) const LONGEST_WATCHDOG_S: f64 = 0.5;

/// Checks the file and brings it to canonical units.
pub(super) fn check(file: ProfileFile, text: &str, source_name: &str) -> Result<Profile, ProfileError> {
    let c = Context { text, source_name };
    if file.schema != "hil.driver/1" {
        return Err(c.error("schema", format!("`{}` is not a driver profile of this version; write \"hil.driver/1\"", file.schema)));
    }
    let device = check_device(&c, &file.device)?;
    let transport = check_transport(&c, &file.transport)?;
    let signals = check_signals(&c, &file, &transport)?;
    let role = if file.signal.setpoint.is_some() { Role::Driver } else { Role::PressureSource };
    let cycle = check_cycle(&c, &file, &transport, &signals, role)?;
    let limit = check_limit(&c, &file, &signals)?;
    let watchdog = check_watchdog(&c, &file, role)?;
    let safe_state = check_safe_state(&c, &file, &signals, &cycle, role)?;
    let interlock = guards::interlock(&c, &file, &signals, &cycle)?;
    guards::frozen(&c, &file, &signals)?;
    for (key, list) in [("start.identity", &file.start.identity), ("start.init", &file.start.init)] {
        check_registers(&c, &file.transport, key, list, key == "start.init")?;
    }
    Ok(Profile {
        name: std::path::Path::new(source_name).file_name().map_or(source_name.into(), |n| n.to_string_lossy().into_owned()),
        sha256: digest::sha256(text),
        role,
        device,
        transport,
        signals,
        cycle,
        limit,
        watchdog,
        interlock,
        safe_state,
        start: file.start,
    })
}

fn check_device(c: &Context, d: &DeviceFile) -> Result<Device, ProfileError> {
    if d.sources.iter().all(|s| s.trim().is_empty()) {
        return Err(c.error("device.sources", "name the public text that the map was read from; a map without a source is not used"));
    }
    if d.update.value() <= 0.0 {
        return Err(c.error("device.update", "the device must renew its values; write for instance \"100 Hz\""));
    }
    Ok(Device {
        vendor: d.vendor.clone(),
        model: d.model.clone(),
        sources: d.sources.clone(),
        verified: d.verified,
        update_hz: d.update.value(),
        emulated: d.emulated,
    })
}

fn check_transport(c: &Context, t: &TransportFile) -> Result<Transport, ProfileError> {
    let line = t.kind == TransportKind::Line;
    let tcp = matches!(t.kind, TransportKind::Tcp | TransportKind::TcpGateway);
    let unit = match t.unit {
        None if line => 0,
        None => return Err(c.error("transport.unit", "the Modbus unit id is missing: 1 to 247")),
        Some(_) if line => return Err(c.error("transport.unit", "a line driver has no unit id; write it into the request")),
        Some(id) if (1..=247).contains(&id) || (t.kind == TransportKind::Tcp && (id == 0 || id == 255)) => id,
        Some(id) => {
            return Err(
                c.error("transport.unit", format!("{id} is reserved: 0 is the broadcast, which no device answers; allowed: 1 to 247"))
            );
        }
    };
    if t.kind == TransportKind::Tcp && (t.baud.is_some() || t.stop_bits.is_some()) {
        return Err(c.error("transport.baud", "Modbus TCP has no baud rate and no stop bits; remove them"));
    }
    let baud = match t.baud {
        None if tcp => 0,
        Some(baud) if (300..=4_000_000).contains(&baud) => baud,
        _ => return Err(c.error("transport.baud", "a serial line needs its baud rate: 300 to 4000000")),
    };
    let stop_bits = t.stop_bits.unwrap_or(1);
    if !(1..=2).contains(&stop_bits) {
        return Err(c.error("transport.stop_bits", format!("{stop_bits} stop bits do not exist; allowed: 1, 2")));
    }
    if !(0.0..=1.0).contains(&t.turnaround.value()) {
        return Err(c.error("transport.turnaround", "the answer time must be between 0 s and 1 s"));
    }
    if line != t.functions.is_empty() {
        let message = if line { "a line driver has no Modbus functions" } else { "list the function codes that the device documents" };
        return Err(c.error("transport.functions", message));
    }
    Ok(Transport {
        kind: t.kind,
        unit,
        baud,
        parity: t.parity,
        stop_bits,
        bits_per_character: 9 + u32::from(t.parity != Parity::None) + u32::from(stop_bits),
        low_latency: t.low_latency,
        local_echo: t.local_echo,
        turnaround_s: t.turnaround.value(),
        functions: t.functions.clone(),
    })
}

fn check_signals(c: &Context, file: &ProfileFile, transport: &Transport) -> Result<Vec<Signal>, ProfileError> {
    let s = &file.signal;
    let all = [&s.setpoint, &s.control, &s.token, &s.status, &s.counter, &s.current, &s.pressure, &s.supply, &s.oil_temp];
    let mut signals: Vec<Signal> = Vec::new();
    for (name, signal) in SignalName::ALL.into_iter().zip(all) {
        if let Some(signal) = signal {
            signals.push(check_signal(c, name, signal, transport)?);
        }
    }
    if transport.kind == TransportKind::Line {
        return Ok(signals);
    }
    let mut taken: BTreeMap<(u8, Table, u16), SignalName> = BTreeMap::new();
    for signal in &signals {
        for word in 0..signal.words() {
            let key = (signal.unit_id, signal.table, signal.address.saturating_add(word));
            if let Some(other) = taken.insert(key, signal.name) {
                return Err(c.error(&format!("signal.{}.address", signal.name), format!("register {} also belongs to `{other}`", key.2)));
            }
        }
    }
    Ok(signals)
}

fn check_signal(c: &Context, name: SignalName, s: &SignalFile, transport: &Transport) -> Result<Signal, ProfileError> {
    let key = |k: &str| format!("signal.{name}.{k}");
    let line = transport.kind == TransportKind::Line;
    if line && (s.table.is_some() || s.address.is_some() || s.unit.is_some()) {
        return Err(c.error(&key("address"), "a line driver has no registers; name the signal in the request or the reply"));
    }
    let place = if line {
        (Table::Holding, 0)
    } else {
        let table = s.table.ok_or_else(|| c.error(&key("table"), "missing; allowed: holding, input"))?;
        (table, s.address.ok_or_else(|| c.error(&key("address"), "missing: the zero-based protocol address, 0 to 65535"))?)
    };
    if s.unit.is_some_and(|id| !(1..=247).contains(&id)) {
        return Err(c.error(&key("unit"), "allowed: 1 to 247"));
    }
    let (scale, offset) = match name.unit() {
        Some(unit) => conversion(c, &key, unit, s, line)?,
        None if s.scale.is_some() || s.offset.is_some() || s.map.is_some() => {
            return Err(c.error(&key("scale"), "this signal is a plain word, not a quantity"));
        }
        None if s.kind != RawType::U16 => return Err(c.error(&key("type"), "this signal is one word: \"u16\"")),
        None => (1.0, 0.0),
    };
    let window = |text: &(String, String)| -> Result<(f64, f64), ProfileError> {
        let unit = name.unit().ok_or_else(|| c.error(&key("valid"), "this signal is a plain word, not a quantity"))?;
        let low = unit.parse(&text.0).map_err(|e| c.error(&key("valid"), e.to_string()))?;
        let high = unit.parse(&text.1).map_err(|e| c.error(&key("valid"), e.to_string()))?;
        Ok((low, high))
    };
    let valid = s.valid.as_ref().map(window).transpose()?;
    for (k, w) in [("valid", valid), ("valid_raw", s.valid_raw)] {
        if w.is_some_and(|(low, high)| low.partial_cmp(&high) != Some(std::cmp::Ordering::Less)) {
            return Err(c.error(&key(k), "the first value must be below the second"));
        }
    }
    if let Some((bit, n)) = s.bits.iter().find(|(_, n)| **n > 15) {
        return Err(c.error(&key("bits"), format!("bit `{bit}` = {n}: a word has the bits 0 to 15")));
    }
    let mut faults = Vec::new();
    for (bit, state) in &s.fault_when {
        let Some(n) = s.bits.get(bit) else {
            let known: Vec<&str> = s.bits.keys().map(String::as_str).collect();
            return Err(c.error(&key("fault_when"), format!("no bit `{bit}`; known: {}", known.join(", "))));
        };
        faults.push(FaultBit { name: bit.clone(), bit: *n, fault_when: *state });
    }
    if name != SignalName::Status && !s.bits.is_empty() {
        return Err(c.error(&key("bits"), "only `status` has bits"));
    }
    if s.rate.is_some_and(|r| name != SignalName::Counter || r.value() <= 0.0) {
        return Err(c.error(&key("rate"), "only `counter` has a rate, above 0 Hz"));
    }
    let control = name == SignalName::Control;
    if control != s.constant.is_some() || (!control && s.safe.is_some()) {
        let message =
            if control { "missing: the word written with every set-point" } else { "only `control` has a constant and a safe word" };
        return Err(c.error(&key("constant"), message));
    }
    if (name == SignalName::Setpoint) != s.limit.is_some() {
        let message = if s.limit.is_some() {
            "only `setpoint` has a limit"
        } else {
            "missing: { min = \"0 mA\", max = \"..\" }; no current is sent without a limit"
        };
        return Err(c.error(&key("limit"), message));
    }
    Ok(Signal {
        name,
        table: place.0,
        address: place.1,
        unit_id: s.unit.unwrap_or(transport.unit),
        // Text has no registers whose size would round a quantity.
        kind: if line && name.unit().is_some() { RawType::F32 } else { s.kind },
        order: s.word_order,
        scale,
        offset,
        valid_raw: s.valid_raw,
        valid,
        constant: s.constant.unwrap_or(0),
        safe: s.safe,
        faults,
        bits: s.bits.iter().map(|(k, v)| (k.clone(), *v)).collect(),
        frozen_after_s: s.frozen_after.map(|q| q.value()),
        rate_hz: s.rate.map(|q| q.value()),
    })
}

/// Scale and offset of a quantity in its canonical unit.
fn conversion(
    c: &Context,
    key: &dyn Fn(&str) -> String,
    unit: &'static Unit,
    s: &SignalFile,
    line: bool,
) -> Result<(f64, f64), ProfileError> {
    let parse = |k: &str, text: &str| unit.parse(text).map_err(|e| c.error(&key(k), e.to_string()));
    let (scale, offset) = match (&s.scale, &s.map) {
        (None, None) if line => (1.0, 0.0),
        _ if line => return Err(c.error(&key("scale"), "a line driver writes quantities with their unit in the template; remove it")),
        (Some(scale), None) => (parse("scale", scale)?, s.offset.as_ref().map_or(Ok(0.0), |o| parse("offset", o))?),
        (None, Some(map)) if s.offset.is_none() => {
            let (v0, v1) = (parse("map", &map.value.0)?, parse("map", &map.value.1)?);
            let slope = (v1 - v0) / (map.raw.1 - map.raw.0);
            (slope, v0 - slope * map.raw.0)
        }
        (None, None) => {
            return Err(c.error(
                &key("scale"),
                format!("missing: what one count is worth, for instance \"1 {}\", or a `map` of two points", unit.symbol),
            ));
        }
        _ => return Err(c.error(&key("map"), "give either `scale` with `offset`, or `map`")),
    };
    if !scale.is_finite() || scale == 0.0 || !offset.is_finite() {
        return Err(c.error(&key("scale"), "one count must be worth something: the two points are the same, or the scale is 0"));
    }
    Ok((scale, offset))
}

fn check_limit(c: &Context, file: &ProfileFile, signals: &[Signal]) -> Result<SetpointLimit, ProfileError> {
    let Some((limit, signal)) = file.signal.setpoint.as_ref().and_then(|s| s.limit.as_ref()).zip(signals.first()) else {
        return Ok(SetpointLimit { min_a: 0.0, max_a: 0.0, slew_a_per_s: None });
    };
    let (min_a, max_a) = (limit.min.value(), limit.max.value());
    if !(min_a <= 0.0 && max_a > 0.0) {
        return Err(c.error(
            "signal.setpoint.limit",
            format!("`min` {} and `max` {}: the safe current 0 A must lie between them", limit.min, limit.max),
        ));
    }
    for (k, value) in [("min", min_a), ("max", max_a)] {
        if signal.to_raw(value).is_none() {
            return Err(c.error("signal.setpoint.limit", format!("`{k}` = {value} A does not fit the raw type")));
        }
    }
    if limit.slew.is_some_and(|s| s.value() <= 0.0) {
        return Err(c.error("signal.setpoint.limit", "`slew` must be above 0 A/s"));
    }
    Ok(SetpointLimit { min_a, max_a, slew_a_per_s: limit.slew.map(|s| s.value()) })
}

fn check_cycle(c: &Context, file: &ProfileFile, transport: &Transport, signals: &[Signal], role: Role) -> Result<Cycle, ProfileError> {
    let timeout_s = file.cycle.timeout.value();
    if timeout_s <= 0.0 {
        return Err(c.error("cycle.timeout", "must be above 0 s"));
    }
    let mut transactions: Vec<Transaction> = Vec::new();
    for (index, t) in file.cycle.transaction.iter().enumerate() {
        let checked = transaction(c, index, t, file, transport, signals, &transactions)?;
        transactions.push(checked);
    }
    let covers = |name: SignalName, write: bool| {
        transactions.iter().any(|t| match &t.line {
            Some(line) => (if write { &line.request } else { &line.reply }).signals().any(|n| n == name),
            None => (if write { &t.write } else { &t.read }).iter().any(|b| b.signals.iter().any(|i| signals[*i].name == name)),
        })
    };
    for signal in signals {
        let (write, name) = (matches!(signal.name, SignalName::Setpoint | SignalName::Control | SignalName::Token), signal.name);
        if !covers(name, write) {
            let verb = if write { "written" } else { "read" };
            return Err(c.error("cycle.transaction", format!("no transaction has `{name}` among what is {verb}")));
        }
    }
    if role == Role::PressureSource && !covers(SignalName::Pressure, false) {
        return Err(c.error("signal", "neither a `setpoint` (a current driver) nor a `pressure` (a pressure source)"));
    }
    Ok(Cycle { timeout_s, transactions })
}

fn check_registers(c: &Context, t: &TransportFile, key: &str, list: &[RegisterValue], write: bool) -> Result<(), ProfileError> {
    if list.is_empty() {
        return Ok(());
    }
    if t.kind == TransportKind::Line {
        return Err(c.error(key, "a line driver has no registers"));
    }
    for r in list {
        let needed: &[u8] = match (write, r.table) {
            (true, Table::Input) => return Err(c.error(key, "an input register cannot be written")),
            (true, Table::Holding) => &[6, 16],
            (false, Table::Holding) => &[3],
            (false, Table::Input) => &[4],
        };
        if !needed.iter().any(|f| t.functions.contains(f)) {
            return Err(
                c.error(key, format!("register {} needs one of the functions {needed:?}, and `transport.functions` has none", r.address))
            );
        }
    }
    Ok(())
}

fn check_watchdog(c: &Context, file: &ProfileFile, role: Role) -> Result<Watchdog, ProfileError> {
    let w = &file.watchdog;
    let time_s = w.time.map_or(0.0, |q| q.value());
    if w.kind == WatchdogKind::None && (w.time.is_some() || !w.set.is_empty() || !w.check.is_empty() || !w.reset.is_empty()) {
        return Err(c.error("watchdog.kind", "\"none\" with registers or a time; allowed: register, fixed, none"));
    }
    if w.kind != WatchdogKind::None && !(time_s > 0.0 && time_s <= LONGEST_WATCHDOG_S) {
        return Err(
            c.error("watchdog.time", format!("a watchdog must act within {:.0} ms, and its time must be known", LONGEST_WATCHDOG_S * 1e3))
        );
    }
    if w.kind == WatchdogKind::Register && (w.set.is_empty() || w.check.is_empty()) {
        return Err(c.error("watchdog.set", "name the registers that arm it (`set`) and those that show that it is armed (`check`)"));
    }
    if role == Role::PressureSource && w.kind != WatchdogKind::None {
        return Err(c.error("watchdog.kind", "a pressure source drives nothing: \"none\""));
    }
    check_registers(c, &file.transport, "watchdog.set", &w.set, true)?;
    check_registers(c, &file.transport, "watchdog.check", &w.check, false)?;
    check_registers(c, &file.transport, "watchdog.reset", &w.reset, true)?;
    Ok(Watchdog { kind: w.kind, time_s, on_trip: w.on_trip, set: w.set.clone(), check: w.check.clone(), reset: w.reset.clone() })
}

fn check_safe_state(
    c: &Context,
    file: &ProfileFile,
    signals: &[Signal],
    cycle: &Cycle,
    role: Role,
) -> Result<Option<SafeConfirmation>, ProfileError> {
    let Some(s) = &file.safe_state else {
        return match role {
            Role::PressureSource => Ok(None),
            Role::Driver => Err(c.error("safe_state", "missing: a driver must say how its safe state is confirmed")),
        };
    };
    let has = |name| signals.iter().any(|x| x.name == name);
    let name = match s.confirm.as_str() {
        "current" if has(SignalName::Current) => SignalName::Current,
        "pressure" if !has(SignalName::Current) => SignalName::Pressure,
        _ => {
            let message = format!("`{}` cannot confirm it; allowed: current where the device measures it, otherwise pressure", s.confirm);
            return Err(c.error("safe_state.confirm", message));
        }
    };
    let unit = if name == SignalName::Current { &CURRENT } else { &PRESSURE };
    let below = unit.parse(&s.below).map_err(|e| c.error("safe_state.below", e.to_string()))?;
    let within_s = s.within.value();
    if below <= 0.0 {
        return Err(c.error("safe_state.below", "must be above zero"));
    }
    if !(within_s >= cycle.timeout_s && within_s <= 5.0) {
        return Err(c.error("safe_state.within", "must be at least `cycle.timeout` and at most 5 s"));
    }
    Ok(Some(SafeConfirmation { name, below, within_s }))
}
