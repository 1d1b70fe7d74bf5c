//! A rig at the end of a wire: absolute slots, samples with a quality, interlocks, and a safe state that is read back.

use std::sync::Arc;

mod bus;
mod device;
mod endpoint;
mod port;
mod probe;
mod safe;
mod sequence;
mod start;

pub use bus::{Bus, Incoming, Loss, Outgoing, TRACED_BYTES, TracedFrame, exception_name};
pub use device::{Device, Losses, Reading};
pub use endpoint::{Endpoint, low_latency};
pub use port::{BusPort, Stream};
pub use probe::{Findings, probe};
pub use sequence::{OutsideLimits, Sequence, rests_on_setpoint};

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
    safe: bool,
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
    Ok((Device::new(profile.clone(), bus(profile, endpoint, clock)?, first_token()), clock))
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
        profile.limit.max_a = profile.limit.max_a.min(max_a);
    }
    if let Some(max_bar) = options.pressure_max_bar {
        profile.interlock.pressure_max_bar = Some(profile.interlock.pressure_max_bar.map_or(max_bar, |own| own.min(max_bar)));
    }
    let clock = Clock::new();
    let source = match (&options.pressure_source, profile.signal(SignalName::Pressure)) {
        (None, None) => return Err(wrong("it measures no pressure; name a pressure source beside it".into())),
        (Some((source, at)), _) => {
            let wrong = |reason: String| RigError::Profile { name: source.name.clone(), reason };
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
            Some(Device::new(source.clone(), bus(source, at, clock)?, first_token()))
        }
        _ => None,
    };
    let driver = Device::new(profile.clone(), bus(&profile, endpoint, clock)?, first_token());
    let nothing = Sample {
        time_s: 0.0,
        pressure_bar: f64::NAN,
        current_a: None,
        oil_temp_c: None,
        supply_bar: None,
        quality: Quality::Held,
        lateness_s: 0.0,
        round_trip_s: 0.0,
        missed_slots: 0,
    };
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

    /// The latest raw frames of the driver's line.
    pub fn trace(&self) -> Vec<TracedFrame> {
        self.driver.bus.trace()
    }

    /// One slot on all devices; the values of the source are put beside those of the driver.
    fn exchange(&mut self, command_a: f64, time_s: f64, within_s: f64) -> Result<Sample, RigError> {
        let out = self.driver.outgoing(command_a, false).map_err(RigError::Refused)?;
        let began_s = self.clock.now_s();
        let reading = self.driver.slot(&out, time_s, within_s, &self.clock);
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
            let reading = source.slot(&out, time_s, rest_s, &self.clock);
            if let Some(error) = reading.exception.and_then(|code| source.refusal(code)) {
                return Err(error);
            }
            sample.quality = reading.quality;
            if reading.quality == Quality::Good {
                pressure_bar = source.value(&reading.values, SignalName::Pressure);
            }
        }
        if let (Quality::Good, Some(bar)) = (sample.quality, pressure_bar) {
            sample.pressure_bar = bar;
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

    fn interlocks(&mut self, sample: &Sample) -> Result<(), RigError> {
        let limits = self.driver.profile.interlock;
        let over = |what: &str, value: f64, limit: Option<f64>, unit: &str| match limit {
            Some(limit) if value > limit => {
                Err(RigError::Interlock { what: format!("{what} {value:.3} {unit} above {limit:.3} {unit} at {:.3} s", sample.time_s) })
            }
            _ => Ok(()),
        };
        over("pressure", sample.pressure_bar, limits.pressure_max_bar, "bar")?;
        over("measured current", sample.current_a.unwrap_or(0.0), limits.current_max_a, "A")?;
        self.current_follows(sample)?;
        if let Some((time_s, pressure_bar)) = self.last_good.replace((sample.time_s, sample.pressure_bar))
            && sample.time_s > time_s
        {
            let rate = (sample.pressure_bar - pressure_bar).abs() / (sample.time_s - time_s);
            over("rate of pressure", rate, limits.pressure_rate_max_bar_per_s, "bar/s")?;
        }
        Ok(())
    }

    /// A coil that does not take the commanded current for some time is a broken wire or a dead driver.
    fn current_follows(&mut self, sample: &Sample) -> Result<(), RigError> {
        let (Some((by_a, for_s)), Some(measured_a)) = (self.driver.profile.interlock.current_deviation, sample.current_a) else {
            return Ok(());
        };
        let (low_a, high_a) = self.commands_a;
        if measured_a >= low_a - by_a && measured_a <= high_a + by_a {
            self.deviates_since_s = None;
            return Ok(());
        }
        let since_s = *self.deviates_since_s.get_or_insert(sample.time_s);
        if sample.time_s - since_s < for_s {
            return Ok(());
        }
        let what = format!(
            "measured current {measured_a:.4} A does not follow the commanded {high_a:.4} A since {since_s:.3} s: a broken wire, or a driver that is not enabled"
        );
        Err(RigError::Interlock { what })
    }

    fn check_slew(&self, command_a: f64) -> Result<(), RigError> {
        let change = (command_a - self.last_command_a).abs() / self.period_s;
        match self.driver.profile.limit.slew_a_per_s {
            Some(limit) if change > limit * (1.0 + 1e-9) => Err(RigError::Slew { change_a_per_s: change, limit_a_per_s: limit }),
            _ => Ok(()),
        }
    }
}

impl Rig for WireRig {
    fn identity(&self) -> RigIdentity {
        let p = &self.driver.profile;
        let kind = if p.transport.kind == TransportKind::Line { "serial" } else { "modbus" };
        RigIdentity { kind: kind.into(), name: p.name.clone(), sha256: p.sha256.clone(), details: self.details.clone() }
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
        self.safe = false;
        let sample = self.exchange(command_a, time_s, within_s)?;
        self.commands_a = (command_a.min(self.last_command_a), command_a.max(self.last_command_a));
        self.last_command_a = command_a;
        let sample = Sample { lateness_s, missed_slots, ..sample };
        self.last = sample;
        self.count_loss(sample.quality, 0)?;
        if sample.quality == Quality::Good {
            self.interlocks(&sample)?;
        }
        Ok(sample)
    }

    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        let state = self.reach_safe_state();
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
