//! The emulated device: registers, coil, watchdog and a valve behind them, on a clock that the caller gives.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::rig::profile::{Profile, RegisterValue, Signal, SignalName, Table, WatchdogKind};

/// Where every emulated device says of itself what it is, whatever device it stands for.
pub const SIGNATURE_ADDRESS: u16 = 0xFE00;
/// What stands there: "HIL EMULATOR" in ASCII.
pub const SIGNATURE: [u16; 6] = [0x4849, 0x4C20, 0x454D, 0x554C, 0x4154, 0x4F52];

/// What the coil acts on.
pub enum Load {
    /// A valve: pressure [bar] one step after a current [A] was applied, and the step [s].
    Valve {
        /// One step of the valve.
        step: Box<dyn FnMut(f64) -> f64 + Send>,
        /// Its length [s].
        period_s: f64,
    },
    /// Another device has the valve; this one measures its pressure [bar].
    Measured(Box<dyn FnMut() -> f64 + Send>),
    /// Every request is answered with another pressure, so that a reply can be told by its value.
    RequestNumber,
}

/// What the device saw, for tests and for people.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DeviceReport {
    /// Requests received.
    pub requests: u64,
    /// Requests since the first set-point other than zero.
    pub cycles: u64,
    /// Current in the coil [A].
    pub coil_a: f64,
    /// Largest current that was ever in the coil [A].
    pub largest_coil_a: f64,
    /// Whether the watchdog is armed.
    pub armed: bool,
    /// Whether current flowed before the watchdog was armed.
    pub energised_unarmed: bool,
    /// Trips of the watchdog.
    pub trips: u64,
    /// Raw pressure in the latest reply.
    pub served_pressure_raw: Option<f64>,
    /// Number of the request and raw pressure of the latest replies, at most sixteen.
    pub served: Vec<(u64, f64)>,
    /// Pressure at the valve [bar].
    pub pressure_bar: f64,
    /// What happened, with the device's time [s]; the newest last, at most some hundreds.
    pub events: Vec<(f64, String)>,
}

/// State that faults impose on the device.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Defects {
    /// Measured values and counter stand still.
    pub frozen: bool,
    /// The coil is open.
    pub wire_break: bool,
    /// The pressure sensor is open.
    pub sensor_break: bool,
    /// Set-points above this become this [A].
    pub clamp_a: Option<f64>,
}

/// The emulated device.
pub struct Device {
    profile: Arc<Profile>,
    registers: BTreeMap<(u8, Table, u16), u16>,
    load: Load,
    stepped_s: f64,
    setpoint_a: f64,
    enabled: bool,
    tripped: bool,
    trip_shown: bool,
    last_request_s: f64,
    first_current_s: Option<f64>,
    conversions: u64,
    held: Option<(f64, u64)>,
    /// Imposed by faults.
    pub defects: Defects,
    report: DeviceReport,
}

impl Device {
    /// A device at rest, its clock at 0.
    pub fn new(profile: Arc<Profile>, load: Load) -> Self {
        let mut registers = BTreeMap::new();
        let mut add = |unit: Option<u8>, r: &RegisterValue, value: u16| {
            registers.insert((unit.or(r.unit).unwrap_or(profile.transport.unit), r.table, r.address), value);
        };
        let w = &profile.watchdog;
        for r in w.set.iter().chain(&w.check).chain(&w.reset).chain(&profile.start.init) {
            add(None, r, 0);
        }
        for r in &profile.start.identity {
            add(None, r, r.value);
        }
        for t in &profile.cycle.transactions {
            for (block, table) in [(&t.write, Table::Holding), (&t.read, if t.function == 4 { Table::Input } else { Table::Holding })] {
                for word in block.iter().flat_map(|b| b.address..b.address.saturating_add(b.words + t.spare)) {
                    registers.entry((t.unit_id, table, word)).or_insert(0);
                }
            }
        }
        let units: std::collections::BTreeSet<u8> = registers.keys().map(|k: &(u8, Table, u16)| k.0).collect();
        for (unit, (address, word)) in units.into_iter().flat_map(|u| (SIGNATURE_ADDRESS..).zip(SIGNATURE).map(move |w| (u, w))) {
            registers.entry((unit, Table::Holding, address)).or_insert(word);
        }
        let enabled = profile.signal(SignalName::Control).is_none();
        let armed = profile.watchdog.kind == WatchdogKind::Fixed;
        Self {
            profile,
            registers,
            load,
            stepped_s: 0.0,
            setpoint_a: 0.0,
            enabled,
            tripped: false,
            trip_shown: false,
            last_request_s: 0.0,
            first_current_s: None,
            conversions: 0,
            held: None,
            defects: Defects::default(),
            report: DeviceReport { armed, ..DeviceReport::default() },
        }
    }

    /// Pressure at the valve [bar].
    pub fn pressure_bar(&self) -> f64 {
        self.report.pressure_bar
    }

    /// What the device saw so far.
    pub fn report(&self) -> DeviceReport {
        self.report.clone()
    }

    /// Time since the first set-point other than zero [s].
    pub fn since_first_current_s(&self, now_s: f64) -> Option<f64> {
        self.first_current_s.map(|t| now_s - t)
    }

    fn serve(&mut self, raw: f64) {
        self.report.served_pressure_raw = Some(raw);
        if self.report.served.len() >= 16 {
            self.report.served.remove(0);
        }
        self.report.served.push((self.report.requests, raw));
    }

    fn event(&mut self, now_s: f64, text: String) {
        if self.report.events.len() >= 400 {
            self.report.events.remove(0);
        }
        self.report.events.push((now_s, text));
    }

    /// Brings watchdog and valve to the time `now_s`.
    pub fn advance(&mut self, now_s: f64) {
        let w = &self.profile.watchdog;
        let deadline_s = self.last_request_s + w.time_s;
        if self.report.armed && !self.tripped && now_s > deadline_s {
            self.run_valve(deadline_s);
            self.trip(deadline_s);
        }
        self.run_valve(now_s);
    }

    /// Steps the valve while the host is silent: whole steps that are over by half a step and more.
    fn run_valve(&mut self, now_s: f64) {
        let coil_a = self.report.coil_a;
        if let Load::Measured(pressure) = &mut self.load {
            self.report.pressure_bar = pressure();
        }
        if let Load::Valve { step, period_s } = &mut self.load {
            while now_s - self.stepped_s >= 1.5 * *period_s {
                self.report.pressure_bar = step(coil_a);
                self.stepped_s += *period_s;
            }
        }
        self.conversions = (now_s * self.profile.device.update_hz) as u64;
    }

    /// Steps the valve in time with the host: a set-point that comes a little early or late still begins one step, so
    /// that a loop of the valve's own period sees the simulated valve sample by sample.
    fn step_with_host(&mut self, now_s: f64) {
        let coil_a = self.report.coil_a;
        if let Load::Valve { step, period_s } = &mut self.load
            && now_s - self.stepped_s >= 0.5 * *period_s
        {
            self.report.pressure_bar = step(coil_a);
            self.stepped_s = now_s;
        }
    }

    /// The watchdog trips: the current goes.
    pub fn trip(&mut self, now_s: f64) {
        self.tripped = true;
        self.report.trips += 1;
        self.setpoint_a = 0.0;
        let profile = Arc::clone(&self.profile);
        if let Some((_, signal)) = profile.signal(SignalName::Setpoint) {
            self.store(signal, signal.to_raw(0.0).unwrap_or(0.0));
        }
        self.event(now_s, "watchdog tripped, current 0 A".into());
        self.drive(now_s);
    }

    /// A request has come in: feeds the watchdog and counts.
    pub fn received(&mut self, now_s: f64) -> (u64, Option<u64>) {
        self.advance(now_s);
        self.last_request_s = now_s;
        if self.profile.watchdog.kind == WatchdogKind::Fixed && self.tripped {
            // Without a register to clear it, a trip is shown in one reply and is over with the next request.
            self.tripped = !std::mem::replace(&mut self.trip_shown, true);
            self.trip_shown &= self.tripped;
        }
        self.report.requests += 1;
        if self.first_current_s.is_some() {
            self.report.cycles += 1;
        }
        (self.report.requests, self.first_current_s.map(|_| self.report.cycles))
    }

    /// The set-point of a line driver, or of a register block, in A.
    pub fn set_current(&mut self, now_s: f64, current_a: f64) {
        if self.tripped {
            return;
        }
        self.setpoint_a = self.defects.clamp_a.map_or(current_a, |limit| current_a.min(limit));
        self.drive(now_s);
        self.step_with_host(now_s);
    }

    fn drive(&mut self, now_s: f64) {
        let on = self.enabled && !self.tripped && !self.defects.wire_break;
        let coil_a = if on { self.setpoint_a } else { 0.0 };
        let before = self.report.coil_a;
        if coil_a != before && (coil_a == 0.0 || before == 0.0) {
            self.event(now_s, format!("current {coil_a:.4} A"));
        }
        // Dither of the last counts around zero is not yet a current.
        if coil_a > 0.001 {
            self.first_current_s.get_or_insert(now_s);
            self.report.energised_unarmed |= self.profile.watchdog.kind == WatchdogKind::Register && !self.report.armed;
        }
        self.report.coil_a = coil_a;
        self.report.largest_coil_a = self.report.largest_coil_a.max(coil_a);
    }

    fn store(&mut self, signal: &Signal, raw: f64) {
        let words = signal.encode(raw);
        for word in 0..signal.words() {
            self.registers.insert((signal.unit_id, signal.table, signal.address + word), words[usize::from(word)]);
        }
    }

    /// A measured value as the device shows it now, in its canonical unit or as a word.
    pub fn shown(&mut self, name: SignalName) -> f64 {
        let profile = Arc::clone(&self.profile);
        if self.defects.frozen {
            self.held.get_or_insert((self.report.pressure_bar, self.conversions));
        } else {
            self.held = None;
        }
        let (pressure_bar, conversions) = self.held.unwrap_or((self.report.pressure_bar, self.conversions));
        match name {
            SignalName::Pressure => pressure_bar,
            SignalName::Counter => (conversions & 0xFFFF) as f64,
            SignalName::Current => self.report.coil_a,
            SignalName::Setpoint => self.setpoint_a,
            SignalName::Supply => 30.0,
            SignalName::OilTemp => 40.0,
            SignalName::Status => f64::from(profile.signal(SignalName::Status).map_or(0, |(_, s)| self.status_word(s))),
            SignalName::Control | SignalName::Token => 0.0,
        }
    }

    /// A value for the reply of a line driver.
    pub fn line_value(&mut self, name: SignalName) -> f64 {
        if name == SignalName::Pressure && matches!(self.load, Load::RequestNumber) && !self.defects.frozen {
            self.report.pressure_bar = (self.report.requests % 997) as f64 * 0.01;
        }
        let value = if self.defects.sensor_break && name == SignalName::Pressure { 999.0 } else { self.shown(name) };
        if name == SignalName::Pressure {
            self.serve(value);
        }
        value
    }

    fn status_word(&self, signal: &Signal) -> u16 {
        let mut word = signal.healthy_word();
        for (bit, on) in [("watchdog", self.tripped), ("open", self.defects.wire_break)] {
            if let (true, Some(fault)) = (on, signal.faults.iter().find(|f| f.name == bit)) {
                word = if fault.fault_when { word | (1 << fault.bit) } else { word & !(1 << fault.bit) };
            }
        }
        word
    }

    fn refresh(&mut self) {
        let profile = Arc::clone(&self.profile);
        for signal in &profile.signals {
            if matches!(signal.name, SignalName::Setpoint | SignalName::Control | SignalName::Token) {
                continue;
            }
            let value = self.shown(signal.name);
            let (low, high) = signal.valid_raw.unwrap_or((0.0, 1000.0));
            let mut raw = signal.to_raw(value).unwrap_or(if value > 0.0 { high } else { low });
            if signal.name == SignalName::Pressure {
                let float = signal.kind == crate::rig::profile::RawType::F32;
                if matches!(self.load, Load::RequestNumber) && !self.defects.frozen {
                    let tag = (self.report.requests % 997) as f64;
                    raw = if float { f64::from((tag * 0.05) as f32) } else { low.max(0.0) + tag };
                } else if matches!(self.load, Load::RequestNumber) {
                    raw = self.report.served_pressure_raw.unwrap_or(low);
                }
                if self.defects.sensor_break {
                    raw = if float { f64::NAN } else { (low - 500.0).max(0.0) };
                }
                self.serve(raw);
            }
            self.store(signal, raw);
        }
    }

    /// Carries out a request and gives the reply PDU; `None` where no such unit is here.
    pub fn execute(&mut self, now_s: f64, unit: u8, pdu: &[u8]) -> Option<Vec<u8>> {
        if !self.registers.keys().any(|k| k.0 == unit) {
            return None;
        }
        let function = pdu.first().copied().unwrap_or(0);
        Some(self.answer(now_s, unit, function, pdu).unwrap_or_else(|code| vec![function | 0x80, code]))
    }

    fn answer(&mut self, now_s: f64, unit: u8, function: u8, pdu: &[u8]) -> Result<Vec<u8>, u8> {
        const ILLEGAL_FUNCTION: u8 = 1;
        const ILLEGAL_VALUE: u8 = 3;
        let word = |at: usize| pdu.get(at..at + 2).map(|b| u16::from_be_bytes([b[0], b[1]])).ok_or(ILLEGAL_VALUE);
        let words = |from: usize, n: u16| -> Result<Vec<u16>, u8> { (0..usize::from(n)).map(|i| word(from + 2 * i)).collect() };
        match function {
            3 | 4 => self.read(unit, if function == 3 { Table::Holding } else { Table::Input }, function, word(1)?, word(3)?),
            6 => {
                let address = word(1)?;
                self.write(now_s, unit, address, &[word(3)?])?;
                let stored = self.registers.get(&(unit, Table::Holding, address)).copied().unwrap_or(0);
                Ok([&pdu[..3], &stored.to_be_bytes()[..]].concat())
            }
            16 => {
                self.write(now_s, unit, word(1)?, &words(6, word(3)?)?)?;
                Ok(pdu[..5].to_vec())
            }
            23 => {
                self.write(now_s, unit, word(5)?, &words(10, word(7)?)?)?;
                self.read(unit, Table::Holding, function, word(1)?, word(3)?)
            }
            _ => Err(ILLEGAL_FUNCTION),
        }
    }

    fn read(&mut self, unit: u8, table: Table, function: u8, address: u16, count: u16) -> Result<Vec<u8>, u8> {
        const ILLEGAL_ADDRESS: u8 = 2;
        if count == 0 || count > 125 {
            return Err(3);
        }
        self.refresh();
        let mut reply = vec![function, (count * 2) as u8];
        for i in 0..count {
            let at = address.checked_add(i).ok_or(ILLEGAL_ADDRESS)?;
            let value = self.registers.get(&(unit, table, at)).ok_or(ILLEGAL_ADDRESS)?;
            reply.extend_from_slice(&value.to_be_bytes());
        }
        Ok(reply)
    }

    fn write(&mut self, now_s: f64, unit: u8, address: u16, values: &[u16]) -> Result<(), u8> {
        const ILLEGAL_ADDRESS: u8 = 2;
        if values.is_empty() || values.len() > 121 {
            return Err(3);
        }
        let keys: Vec<(u8, Table, u16)> = (0..values.len() as u16).map(|i| (unit, Table::Holding, address.wrapping_add(i))).collect();
        if keys.iter().any(|k| !self.registers.contains_key(k)) {
            return Err(ILLEGAL_ADDRESS);
        }
        for (key, value) in keys.iter().zip(values) {
            self.registers.insert(*key, *value);
        }
        self.watchdog_registers(now_s, &keys);
        let profile = Arc::clone(&self.profile);
        if let Some((_, control)) = profile.signal(SignalName::Control)
            && keys.contains(&(control.unit_id, control.table, control.address))
        {
            let word = self.registers.get(&(control.unit_id, control.table, control.address)).copied().unwrap_or(0);
            self.enabled = word == control.constant;
            self.drive(now_s);
        }
        if let Some((_, setpoint)) = profile.signal(SignalName::Setpoint)
            && keys.contains(&(setpoint.unit_id, setpoint.table, setpoint.address))
        {
            let raw: Vec<u16> = (0..setpoint.words())
                .filter_map(|w| self.registers.get(&(setpoint.unit_id, setpoint.table, setpoint.address + w)).copied())
                .collect();
            let value = setpoint.decode(&raw).map_or(0.0, |r| setpoint.from_raw(r));
            self.set_current(now_s, value);
            // What the register shows afterwards is what the device made of it.
            let shown = setpoint.to_raw(self.setpoint_a).unwrap_or(0.0);
            self.store(setpoint, shown);
        }
        Ok(())
    }

    fn watchdog_registers(&mut self, now_s: f64, written: &[(u8, Table, u16)]) {
        let profile = Arc::clone(&self.profile);
        let key = |r: &RegisterValue| (r.unit.unwrap_or(profile.transport.unit), r.table, r.address);
        let w = &profile.watchdog;
        let holds = |d: &Self, r: &RegisterValue| d.registers.get(&key(r)) == Some(&r.value);
        if w.set.iter().any(|r| written.contains(&key(r))) {
            let armed = w.set.iter().all(|r| holds(self, r));
            if armed != self.report.armed {
                self.report.armed = armed;
                self.event(now_s, if armed { "watchdog armed" } else { "watchdog off" }.into());
            }
        }
        if !w.reset.is_empty() && w.reset.iter().any(|r| written.contains(&key(r))) && w.reset.iter().all(|r| holds(self, r)) {
            if self.tripped {
                self.event(now_s, "watchdog cleared".into());
            }
            self.tripped = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device() -> Device {
        let text = include_str!("../../../drivers/emulator.toml");
        let profile = Profile::from_toml(text, "emulator.toml").unwrap();
        let mut pressure = 0.0;
        let step = move |current_a: f64| {
            pressure += 0.1 * (40.0 * current_a - pressure);
            pressure
        };
        Device::new(Arc::new(profile), Load::Valve { step: Box::new(step), period_s: 0.002 })
    }

    fn write(d: &mut Device, now_s: f64, address: u16, value: u16) -> Vec<u8> {
        d.received(now_s);
        let mut pdu = vec![6];
        pdu.extend(address.to_be_bytes());
        pdu.extend(value.to_be_bytes());
        d.execute(now_s, 1, &pdu).unwrap()
    }

    #[test]
    fn a_set_point_drives_the_valve_and_reads_back() {
        let mut d = device();
        write(&mut d, 0.0015, 0, 5000);
        d.received(0.101);
        // 6 registers from 0: set-point, token, status, counter, current, pressure.
        let reply = d.execute(0.101, 1, &[3, 0, 0, 0, 6]).unwrap();
        let words: Vec<u16> = reply[2..].chunks(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
        assert_eq!(words[..5], [5000, 0, 1, 50, 5000]);
        // 50 steps of the first-order load towards 20 bar, at 200 counts per bar above 4000.
        assert_eq!(words[5], (4000.0f64 + 200.0 * 20.0 * (1.0 - 0.9f64.powi(50))).round() as u16);
        assert!(d.report().energised_unarmed);
    }

    #[test]
    fn silence_trips_the_armed_watchdog_and_a_reset_clears_it() {
        let mut d = device();
        write(&mut d, 0.0, 16, 200);
        write(&mut d, 0.01, 0, 5000);
        d.advance(0.2);
        assert_eq!(d.report().coil_a, 0.5);
        d.advance(0.3);
        assert_eq!((d.report().coil_a, d.report().trips), (0.0, 1));
        write(&mut d, 0.4, 0, 5000);
        assert_eq!(d.report().coil_a, 0.0, "tripped: no current before the reset");
        write(&mut d, 0.41, 17, 1);
        write(&mut d, 0.42, 0, 5000);
        assert_eq!(d.report().coil_a, 0.5);
        assert!(!d.report().energised_unarmed);
    }

    #[test]
    fn exceptions_are_those_of_the_protocol() {
        let mut d = device();
        assert_eq!(d.execute(0.0, 1, &[3, 0, 99, 0, 1]), Some(vec![0x83, 2]));
        assert_eq!(d.execute(0.0, 1, &[3, 0, 0, 0, 0]), Some(vec![0x83, 3]));
        assert_eq!(d.execute(0.0, 1, &[7]), Some(vec![0x87, 1]));
        assert_eq!(d.execute(0.0, 1, &[23, 0, 0]), Some(vec![0x97, 3]));
        assert_eq!(d.execute(0.0, 9, &[3, 0, 0, 0, 1]), None);
    }
}
