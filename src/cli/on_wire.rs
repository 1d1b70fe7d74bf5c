//! A run on hardware: the loop on its own thread, the supervisor here, and what both say to a person.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use rtrb::{Consumer, Producer, RingBuffer};

use super::last_word::{self, Watched};
use super::{CliError, exit};
use crate::plan::Plan;
use crate::record::{Dut, Outcome, TestRecord, Trace};
use crate::rig::loop_thread::{self, LoopControl, safe_text};
use crate::rig::profile::Profile;
use crate::rig::wire::TracedFrame;
use crate::rig::{Endpoint, Options, Quality, RigError, SafeState, open};
use crate::runner::{self, Observer, Progress, RunOptions};
use crate::units::{Current, Pressure};
use crate::valve::Valve;

/// The driver and the line to it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Hardware")]
pub struct WireArgs {
    /// Driver profile: a path, or the bare name of a file in drivers/.
    #[arg(long, value_name = "PROFILE", conflicts_with = "sim")]
    pub driver: Option<String>,
    /// Serial port of the driver, for instance /dev/serial/by-id/...
    #[arg(long, value_name = "DEV", requires = "driver", conflicts_with = "tcp")]
    pub port: Option<PathBuf>,
    /// Host and port of the driver.
    #[arg(long, value_name = "HOST:PORT", requires = "driver")]
    pub tcp: Option<String>,
    /// Profile of a second device that measures the pressure.
    #[arg(long, value_name = "PROFILE", requires = "driver")]
    pub pressure_driver: Option<String>,
    /// Serial port of the pressure source.
    #[arg(long, value_name = "DEV", requires = "pressure_driver", conflicts_with = "pressure_tcp")]
    pub pressure_port: Option<PathBuf>,
    /// Host and port of the pressure source.
    #[arg(long, value_name = "HOST:PORT", requires = "pressure_driver")]
    pub pressure_tcp: Option<String>,
    /// Largest current of this station; the smaller of this and the profile's holds.
    #[arg(long, value_name = "CURRENT", requires = "driver")]
    pub max_current: Option<Current>,
    /// Largest pressure of this station; the smaller of this and the profile's holds.
    #[arg(long, value_name = "PRESSURE", requires = "driver")]
    pub max_pressure: Option<Pressure>,
    /// Run although no watchdog of the device takes the current away when this program dies; the record shows it.
    #[arg(long, requires = "driver")]
    pub without_watchdog: bool,
    /// Show target, pressure, current and quality while it runs.
    #[arg(long, requires = "driver")]
    pub watch: bool,
}

/// Latest raw frames that stand in the record itself; the file beside it has the last seconds.
const SHOWN_FRAMES: usize = 12;

/// What a run on hardware gave.
pub struct WireRun {
    /// The record.
    pub record: TestRecord,
    /// The trace.
    pub trace: Trace,
    /// The latest raw frames, where anything was lost or the run did not come to its end.
    pub frames: Vec<TracedFrame>,
}

/// The endpoint that a pair of options names.
pub fn endpoint(port: &Option<PathBuf>, tcp: &Option<String>, what: &str) -> Result<Endpoint, CliError> {
    match (port, tcp) {
        (Some(port), _) => Ok(Endpoint::Serial(port.clone())),
        (None, Some(address)) => Ok(Endpoint::Tcp(address.clone())),
        (None, None) => Err(CliError::usage(format!("{what}: where is it? Give its serial port or its HOST:PORT"))),
    }
}

/// A profile by path or bare name.
pub fn load_profile(name: &str) -> Result<Profile, CliError> {
    Profile::find(name).and_then(|path| Profile::load(&path)).map_err(CliError::input)
}

/// A run that gave no record.
#[derive(Debug)]
pub struct Failed {
    /// Why.
    pub error: CliError,
    /// What is known of the safe state; `None` where nothing was written.
    pub safe: Option<SafeState>,
}

impl From<Failed> for CliError {
    fn from(failed: Failed) -> Self {
        failed.error
    }
}

impl From<CliError> for Failed {
    fn from(error: CliError) -> Self {
        Self { error, safe: None }
    }
}

/// Runs a plan on hardware, on a thread of its own.
pub fn run(plan: &Plan, model: &Valve, dut: &Dut, seed: u64, args: &WireArgs) -> Result<WireRun, Failed> {
    let profile = load_profile(args.driver.as_deref().unwrap_or_default())?;
    let at = endpoint(&args.port, &args.tcp, "--driver")?;
    let pressure_source = match &args.pressure_driver {
        Some(name) => Some((load_profile(name)?, endpoint(&args.pressure_port, &args.pressure_tcp, "--pressure-driver")?)),
        None => None,
    };
    let control = Arc::new(LoopControl::default());
    let _watched = Watched(Arc::clone(&control));
    let (producer, mut view) = live_view(args.watch);
    let (plan, model, dut) = (plan.clone(), model.clone(), dut.clone());
    let options = Options {
        current_max_a: args.max_current.map(|q| q.value()),
        pressure_max_bar: args.max_pressure.map(|q| q.value()),
        without_watchdog: args.without_watchdog,
        pressure_source,
        control: Arc::clone(&control),
        privileges: None,
    };
    let inside = Arc::clone(&control);
    let body = move |privileges| -> Result<WireRun, RigError> {
        let options = Options { privileges: Some(privileges), ..options };
        let mut rig = open(&profile, &at, plan.period_s, options)?;
        let run = RunOptions { model: &model, dut: &dut, seed, stop: Some(inside.stop_flag()), prepared: None };
        let (mut record, trace) = runner::run(&plan, &mut rig, &run, &mut Feed(producer));
        let (losses, last) = rig.losses();
        if rig.watchdog_proofs() > 0 {
            record.rig.details.push(("watchdog re-proven".into(), format!("{} times during the run", rig.watchdog_proofs())));
        }
        let lost = losses.lost + losses.stale + losses.exceptions + losses.implausible > 0;
        if lost {
            let counts = format!(
                "{} without a reply, {} stale, {} exceptions, {} implausible; the last: {last}",
                losses.lost, losses.stale, losses.exceptions, losses.implausible
            );
            record.rig.details.push(("lost samples".into(), counts));
        }
        if let Some(signal) = inside.stop_requested() {
            record.rig.details.push(("stopped by".into(), signal.into()));
        }
        let ended_badly = lost || !matches!(record.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail | Outcome::NotRun);
        let frames = if ended_badly { rig.trace() } else { Vec::new() };
        if let (Some(first), Some(last)) = (frames.first(), frames.last()) {
            let what = format!("{} of the last {:.1} s in frames.txt", frames.len(), last.time_s - first.time_s);
            record.rig.details.push(("raw frames".into(), what));
            for frame in frames.iter().rev().take(SHOWN_FRAMES).rev() {
                record.rig.details.push(("frame".into(), frame_text(frame)));
            }
        }
        Ok(WireRun { record, trace, frames })
    };
    let result = loop_thread::run(&control, body, || view.show());
    view.finish();
    match result {
        Ok(Ok(run)) => {
            // What the record says is said, also where a later attempt reached what this one did not.
            if let Some(state) = run.record.safe_state.as_ref().filter(|s| !s.confirmed) {
                last_word::unconfirmed(&state.evidence);
            }
            Ok(run)
        }
        Ok(Err(error)) => Err(Failed { error: failed(error, &control), safe: control.safe_state() }),
        Err(error) => {
            let code = if error.is_safe() { exit::INTERNAL } else { exit::RIG };
            let unknown = || control.left_energised().then(|| SafeState::of(false, "the loop ended before it could be read back"));
            Err(Failed { error: CliError { code, message: error.to_string() }, safe: control.safe_state().or_else(unknown) })
        }
    }
}

/// The exit code of a rig that did not start.
fn failed(error: RigError, control: &LoopControl) -> CliError {
    let safe = control.safe_state();
    match error {
        RigError::Profile { .. } => CliError::input(error),
        RigError::Stopped { .. } if safe.as_ref().is_some_and(|s| s.confirmed) => {
            CliError { code: exit::ABORTED, message: format!("{error}; {}", safe_text(&safe)) }
        }
        // Nothing was written to a device that could not be opened or did not show what it is.
        error if safe.is_none() => CliError::rig(error),
        error => CliError::rig(format!("{error}; {}", safe_text(&safe))),
    }
}

/// The frames as lines of text: time, direction, bytes in hex.
pub fn frames_text(frames: &[TracedFrame]) -> String {
    let lines = frames.iter().map(|frame| frame_text(frame) + "\n");
    std::iter::once("# time_s direction bytes\n".to_string()).chain(lines).collect()
}

fn frame_text(frame: &TracedFrame) -> String {
    let bytes: Vec<String> = frame.bytes.iter().map(|b| format!("{b:02X}")).collect();
    format!("{:.4} {} {}", frame.time_s, if frame.sent { ">" } else { "<" }, bytes.join(" "))
}

/// One line of the live view.
#[derive(Debug, Clone, Copy)]
struct Glance {
    sample: usize,
    samples: usize,
    time_s: f64,
    target_bar: f64,
    pressure_bar: f64,
    current_a: f64,
    quality: Quality,
    lateness_s: f64,
}

impl Glance {
    /// The columns of [`Glance::line`].
    const HEADING: &'static str = " done  time s target bar pressure bar current A late ms quality     not good";

    /// Within 80 columns, so that a narrow terminal does not wrap it.
    fn line(&self, not_good: u64) -> String {
        let number = |value: f64, digits: usize| if value.is_finite() { format!("{value:.digits$}") } else { "-".into() };
        format!(
            "{:>3} % {:>7.1} {:>10} {:>12} {:>9} {:>7} {:<11} {:>8}",
            100 * self.sample / self.samples.max(1),
            self.time_s,
            number(self.target_bar, 2),
            number(self.pressure_bar, 2),
            number(self.current_a, 3),
            number(self.lateness_s * 1e3, 2),
            self.quality.name(),
            not_good
        )
    }
}

/// The loop's end of the queue: a full queue drops the glance, the loop never waits.
struct Feed(Producer<Glance>);

impl Observer for Feed {
    fn sample(&mut self, p: &Progress<'_>) {
        let _ = self.0.push(Glance {
            sample: p.sample,
            samples: p.samples,
            time_s: p.measured.time_s,
            target_bar: p.target_bar,
            pressure_bar: p.measured.pressure_bar,
            current_a: p.current_a,
            quality: p.measured.quality,
            lateness_s: p.measured.lateness_s,
        });
    }
}

/// The supervisor's end: draws at most ten times a second.
struct View {
    queue: Consumer<Glance>,
    watch: bool,
    shown: Instant,
    bad: u64,
    drawn: bool,
}

fn live_view(watch: bool) -> (Producer<Glance>, View) {
    let (producer, queue) = RingBuffer::new(256);
    (producer, View { queue, watch, shown: Instant::now(), bad: 0, drawn: false })
}

impl View {
    fn show(&mut self) {
        let mut last = None;
        while let Ok(glance) = self.queue.pop() {
            self.bad += u64::from(glance.quality != Quality::Good);
            last = Some(glance);
        }
        let Some(g) = last.filter(|_| self.watch && self.shown.elapsed() > Duration::from_millis(100)) else { return };
        self.shown = Instant::now();
        let line = g.line(self.bad);
        // On a terminal one line is written over and over; elsewhere each stands for itself.
        use std::io::{IsTerminal, Write};
        let mut err = std::io::stderr();
        if !std::mem::replace(&mut self.drawn, true) {
            let _ = writeln!(err, "{}", Glance::HEADING);
        }
        let _ = if err.is_terminal() { write!(err, "\r{line}\x1b[K") } else { writeln!(err, "{line}") };
        let _ = err.flush();
    }

    fn finish(&mut self) {
        use std::io::IsTerminal;
        if self.drawn && std::io::stderr().is_terminal() {
            super::note("");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_live_view_fits_80_columns() {
        let glance = Glance {
            sample: 359_999,
            samples: 360_000,
            time_s: 3599.99,
            target_bar: 123.456,
            pressure_bar: f64::NAN,
            current_a: 1.2,
            quality: Quality::Implausible,
            lateness_s: 0.01234,
        };
        insta::assert_snapshot!(format!("{}\n{}", Glance::HEADING, glance.line(123_456)), @"
         done  time s target bar pressure bar current A late ms quality     not good
         99 %  3600.0     123.46            -     1.200   12.34 implausible   123456
        ");
        assert!(Glance::HEADING.len() < 80 && glance.line(123_456).len() < 80);
    }
}
