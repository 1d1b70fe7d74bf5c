//! A rig at the end of a wire: absolute slots, samples with a quality, interlocks, and a safe state that is read back.

use std::sync::Arc;

mod bus;
mod counter;
mod device;
mod endpoint;
mod interlock;
mod lock;
mod port;
mod probe;
mod proof;
mod proofs;
mod safe;
mod sequence;
mod start;

pub use bus::{Bus, Incoming, Loss, Outgoing, TRACED_BYTES, TracedFrame, exception_name};
pub use device::{Device, Losses, Reading};
pub use endpoint::{Endpoint, low_latency};
use lock::DeviceLock;
pub use port::{BusPort, Stream};
pub use probe::{Findings, Probed, probe};
use proofs::Proofs;
pub use sequence::{Sequence, rests_on_setpoint};

use super::line::LineBus;
use super::loop_thread::LoopControl;
use super::modbus::ModbusBus;
use super::profile::{Profile, Role, SignalName, TransportKind};
use super::realtime::{Clock, Privileges};
use super::{Quality, Rig, RigError, RigIdentity, SafeState, Sample};

/// Left of a slot for the computation that follows the reply [s].
const GUARD_S: f64 = 0.3e-3;

/// What a run may change of a profile, and what it shares with its supervisor.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// A station's limit of the current [A]; the smaller of this and the profile's holds.
    pub current_max_a: Option<f64>,
    /// A station's limit of the pressure [bar]; the smaller of this and the profile's holds.
    pub pressure_max_bar: Option<f64>,
    /// Run although the device has no watchdog that takes the current away; recorded.
    pub without_watchdog: bool,
    /// A second device that measures the pressure.
    pub pressure_source: Option<(Profile, Endpoint)>,
    /// Shared with the supervisor.
    pub control: Arc<LoopControl>,
    /// What the system permitted the loop's thread.
    pub privileges: Option<Privileges>,
}

/// A rig of one current driver, and where it cannot measure the pressure, one pressure source.
pub struct WireRig {
    driver: Device,
    source: Option<Device>,
    clock: Clock,
    period_s: f64,
    options: Options,
    details: Vec<(String, String)>,
    /// Clock time of rig time 0 [s]; set by the first step.
    origin_s: Option<f64>,
    last: Sample,
    last_command_a: f64,
    /// Smallest and largest of the present and the last command: a reply may show either [A].
    commands_a: (f64, f64),
    last_good: Option<(f64, f64)>,
    deviates_since_s: Option<f64>,
    lost_in_a_row: u32,
    proofs: Proofs,
    emulated: bool,
    safe: bool,
    // Held for as long as the rig lives.
    _locks: Vec<DeviceLock>,
}

/// Opens one bus.
fn bus(profile: &Profile, endpoint: &Endpoint, clock: Clock) -> Result<Box<dyn Bus>, RigError> {
    Ok(match profile.transport.kind {
        TransportKind::Line => Box::new(LineBus::open(profile, endpoint, clock)?),
        _ => Box::new(ModbusBus::open(profile, endpoint, clock)?),
    })
}

/// A token that a reply from before this program cannot carry by habit.
fn first_token() -> u16 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    (since.subsec_micros() ^ std::process::id()) as u16
}

/// Opens a single device, for a look at it; nothing is written.
pub fn open_device(profile: &Profile, endpoint: &Endpoint) -> Result<(Device, Clock), RigError> {
    let clock = Clock::new();
    Ok((Device::new(profile.clone(), bus(profile, endpoint, clock)?, first_token(), f64::INFINITY), clock))
}

/// Opens a rig and proves it safe to energise: identity, watchdog, current zero. Nothing but zero is written.
pub fn open(profile: &Profile, endpoint: &Endpoint, period_s: f64, options: Options) -> Result<WireRig, RigError> {
    let wrong = |reason: String| RigError::Profile { name: profile.name.clone(), reason };
    if profile.role != Role::Driver {
        return Err(wrong("it has no set-point: it is a pressure source, and needs a current driver beside it".into()));
    }
    let mut profile = profile.clone();
    profile.check_period(period_s).map_err(wrong)?;
    if let Some(max_a) = options.current_max_a {
        // By magnitude: a current of the wrong sign opens a valve too.
        profile.limit.max_a = profile.limit.max_a.min(max_a);
        profile.limit.min_a = profile.limit.min_a.max(-max_a);
    }
    if let Some(max_bar) = options.pressure_max_bar {
        profile.interlock.pressure_max_bar = Some(profile.interlock.pressure_max_bar.map_or(max_bar, |own| own.min(max_bar)));
    }
    let clock = Clock::new();
    let at = std::iter::once((&profile, endpoint)).chain(options.pressure_source.iter().map(|(p, at)| (p, at)));
    let locks = at.map(|(p, at)| lock::hold(&p.transport, at)).filter_map(Result::transpose).collect::<Result<Vec<_>, _>>()?;
    let source = match (&options.pressure_source, profile.signal(SignalName::Pressure)) {
        (None, None) => return Err(wrong("it measures no pressure; name a pressure source beside it".into())),
        (Some((source, at)), _) => {
            let wrong = |reason: String| RigError::Profile { name: source.name.clone(), reason };
            if source.signal(SignalName::Pressure).is_none() {
                return Err(wrong("it has no `pressure`, so it is no pressure source".into()));
            }
            source.check_period(period_s).map_err(wrong)?;
            if profile.budget().total_s + source.budget().total_s > super::profile::LARGEST_SHARE * period_s {
                let reason = format!(
                    "driver and pressure source together need {:.2} ms of a period of {:.2} ms on the wire; 80 % is the most:\n{}\n{}",
                    (profile.budget().total_s + source.budget().total_s) * 1e3,
                    period_s * 1e3,
                    profile.budget().arithmetic,
                    source.budget().arithmetic
                );
                return Err(wrong(reason));
            }
            Some(Device::new(source.clone(), bus(source, at, clock)?, first_token(), period_s))
        }
        _ => None,
    };
    let driver = Device::new(profile.clone(), bus(&profile, endpoint, clock)?, first_token(), period_s);
    let nothing = Sample { quality: Quality::Held, ..Sample::simulated(0.0, f64::NAN) };
    let mut rig = WireRig {
        driver,
        source,
        clock,
        period_s,
        options,
        details: Vec::new(),
        origin_s: None,
        last: nothing,
        last_command_a: 0.0,
        commands_a: (0.0, 0.0),
        last_good: None,
        deviates_since_s: None,
        lost_in_a_row: 0,
        proofs: Proofs::default(),
        emulated: false,
        _locks: locks,
        // Nothing is written to a device that has not shown what it is, not even zero.
        safe: true,
    };
    rig.start()?;
    Ok(rig)
}

impl WireRig {
    /// What was lost since the start, on both devices, and what the last loss was.
    pub fn losses(&self) -> (Losses, String) {
        let mut sum = self.driver.losses;
        let mut last = self.driver.last_loss.clone().unwrap_or_default();
        if let Some(source) = &self.source {
            let l = source.losses;
            sum.lost += l.lost;
            sum.stale += l.stale;
            sum.exceptions += l.exceptions;
            sum.implausible += l.implausible;
            last = source.last_loss.clone().unwrap_or(last);
        }
        (sum, last)
    }

    /// How often the watchdog was shown to be armed since the start.
    pub fn watchdog_proofs(&self) -> u64 {
        self.proofs.count
    }

    /// The latest raw frames of the driver's line.
    pub fn trace(&self) -> Vec<TracedFrame> {
        self.driver.bus.trace()
    }

    /// One slot on all devices; the values of the source are put beside those of the driver.
    fn exchange(&mut self, command_a: f64, time_s: f64, within_s: f64) -> Result<Sample, RigError> {
        let out = self.driver.outgoing(command_a, false).map_err(RigError::Refused)?;
        let began_s = self.clock.now_s();
        let reading = self.driver.slot(&out, command_a, within_s, &self.clock);
        let mut sample = Sample { time_s, quality: reading.quality, missed_slots: 0, ..self.last };
        if let Some(error) = reading.exception.and_then(|code| self.driver.refusal(code)) {
            return Err(error);
        }
        let mut pressure_bar = None;
        if reading.quality == Quality::Good {
            let value = |name| self.driver.value(&reading.values, name);
            pressure_bar = value(SignalName::Pressure);
            sample.current_a = value(SignalName::Current);
            sample.oil_temp_c = value(SignalName::OilTemp);
            sample.supply_bar = value(SignalName::Supply);
        }
        if let (Some(source), Quality::Good) = (&mut self.source, sample.quality) {
            let out = source.outgoing(0.0, false).map_err(RigError::Refused)?;
            let rest_s = within_s - (self.clock.now_s() - began_s);
            let reading = source.slot(&out, command_a, rest_s, &self.clock);
            if let Some(error) = reading.exception.and_then(|code| source.refusal(code)) {
                return Err(error);
            }
            sample.quality = reading.quality;
            if reading.quality == Quality::Good {
                pressure_bar = source.value(&reading.values, SignalName::Pressure);
            }
        }
        match (sample.quality, pressure_bar) {
            (Quality::Good, Some(bar)) if bar.is_finite() => sample.pressure_bar = bar,
            // Whatever else the reply holds: without a pressure there is nothing to control by.
            (Quality::Good, _) => {
                sample.quality = Quality::Implausible;
                self.driver.losses.implausible += 1;
                self.driver.last_loss = Some("no pressure in the reply".into());
            }
            _ => {}
        }
        sample.round_trip_s = self.clock.now_s() - began_s;
        Ok(sample)
    }

    /// Counts lost samples and missed slots in a row; too many are silence, whoever is to blame.
    fn count_loss(&mut self, quality: Quality, missed_slots: u32) -> Result<(), RigError> {
        if quality == Quality::Good && missed_slots == 0 {
            self.lost_in_a_row = 0;
            return Ok(());
        }
        self.lost_in_a_row += missed_slots + u32::from(quality != Quality::Good);
        if self.lost_in_a_row < self.driver.profile.interlock.lost_max {
            return Ok(());
        }
        let source = self.source.as_ref().and_then(|s| s.last_loss.clone());
        let last = self.driver.last_loss.clone().or(source).unwrap_or_else(|| "slots missed by the loop itself".into());
        Err(RigError::Lost { name: self.driver.profile.name.clone(), count: self.lost_in_a_row, last })
    }
}

impl Rig for WireRig {
    fn identity(&self) -> RigIdentity {
        let p = &self.driver.profile;
        let kind = if p.transport.kind == TransportKind::Line { "serial" } else { "modbus" };
        let (name, sha256, details) = (p.name.clone(), p.sha256.clone(), self.details.clone());
        RigIdentity { kind: kind.into(), name, sha256, emulated: self.emulated, details }
    }

    fn step(&mut self, command_a: f64, until_s: f64) -> Result<Sample, RigError> {
        self.options.control.beat();
        self.check_slew(command_a)?;
        // The first slot begins one period from now, wherever the run's clock begins.
        let origin_s = *self.origin_s.get_or_insert(self.clock.now_s() + 2.0 * self.period_s - until_s);
        let mut time_s = until_s - self.period_s;
        let mut missed_slots = 0;
        let (lateness_s, within_s) = loop {
            let begin_s = origin_s + time_s;
            self.clock.sleep_until(begin_s);
            let lateness_s = (self.clock.now_s() - begin_s).max(0.0);
            let within_s = self.period_s - lateness_s - GUARD_S;
            if within_s >= 0.5 * self.driver.profile.cycle.timeout_s {
                break (lateness_s, within_s);
            }
            // A slot whose reply cannot come before the next one begins is skipped, never made up for.
            missed_slots += 1;
            time_s += self.period_s;
        };
        if missed_slots > 0 {
            self.count_loss(Quality::Good, missed_slots)?;
        }
        let slot_end_s = origin_s + time_s + self.period_s - GUARD_S;
        self.safe = false;
        self.options.control.energised();
        self.look_for_another_master(slot_end_s)?;
        let within_s = within_s.min(slot_end_s - self.clock.now_s());
        let sample = self.exchange(command_a, time_s, within_s)?;
        self.commands_a = (command_a.min(self.last_command_a), command_a.max(self.last_command_a));
        self.last_command_a = command_a;
        let sample = Sample { lateness_s, missed_slots, ..sample };
        self.last = sample;
        self.count_loss(sample.quality, 0)?;
        if sample.quality == Quality::Good {
            self.interlocks(&sample)?;
        }
        self.prove_watchdog(slot_end_s, sample.quality)?;
        Ok(sample)
    }

    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        let (driver, source) = (&mut self.driver, self.source.as_mut());
        let mut state = safe::Ending { driver, source, clock: &self.clock }.reach();
        // After a run, not at its start, where it is armed only then.
        if state.confirmed && self.origin_s.is_some() {
            state.fault = proofs::watchdog_at_end(&mut self.driver, &self.clock);
        }
        self.safe = state.confirmed;
        self.options.control.note_safe(&state);
        Ok(state)
    }
}

impl Drop for WireRig {
    /// The last way out: whatever ended the run, the current is taken away and that is read back.
    fn drop(&mut self) {
        if !self.safe {
            let _ = self.make_safe();
        }
    }
}
