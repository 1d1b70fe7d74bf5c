//! A run on hardware: the loop on its own thread, the supervisor here, and what both say to a person.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use rtrb::Consumer;

use super::answers::Answers;
use super::last_word::{self, Watched};
use super::seat::Seat;
use super::{CliError, exit};
use crate::plan::Plan;
use crate::record::{Dut, Outcome, TestRecord, Trace};
use crate::rig::loop_thread::{self, LoopControl, OPERATOR, safe_text};
use crate::rig::profile::Profile;
use crate::rig::wire::TracedFrame;
use crate::rig::{Endpoint, Options, Quality, RigError, SafeState, open};
use crate::runner::{self, Attended, Feed, Glance, Prepared, RunOptions, STOPPED, glances};
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
    #[arg(long, value_name = "HOST:PORT", requires = "driver", value_parser = host_port)]
    pub tcp: Option<String>,
    /// Profile of a second device that measures the pressure.
    #[arg(long, value_name = "PROFILE", requires = "driver")]
    pub pressure_driver: Option<String>,
    /// Serial port of the pressure source.
    #[arg(long, value_name = "DEV", requires = "pressure_driver", conflicts_with = "pressure_tcp")]
    pub pressure_port: Option<PathBuf>,
    /// Host and port of the pressure source.
    #[arg(long, value_name = "HOST:PORT", requires = "pressure_driver", value_parser = host_port)]
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
        (None, None) => {
            let line = what.trim_end_matches("driver");
            Err(CliError::usage(format!("{what}: where is it? Give its serial port, {line}port DEV, or its address, {line}tcp HOST:PORT")))
        }
    }
}

/// Host and port, as they are typed.
pub fn host_port(text: &str) -> Result<String, String> {
    let port = text.rsplit_once(':').filter(|(host, _)| !host.is_empty()).and_then(|(_, port)| port.parse::<u16>().ok());
    port.map(|_| text.to_string()).ok_or_else(|| "HOST:PORT is wanted, for instance 192.168.0.10:502".into())
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

/// Runs a plan on hardware, on a thread of its own, with a person at the terminal.
pub fn run(plan: &Plan, model: &Valve, dut: &Dut, seed: u64, args: &WireArgs, answers: &Answers) -> Result<WireRun, Failed> {
    let (feed, mut view) = live_view(args.watch);
    let seat = Seat { feed: Some(feed), look: Box::new(|| view.show()), attendant: answers.attendant(), ..Seat::empty() };
    let run = run_seated(plan, model, dut, seed, args, seat, None);
    view.finish();
    run
}

/// Runs a plan on hardware, on a thread of its own, with `seat` beside it.
pub fn run_seated(
    plan: &Plan,
    model: &Valve,
    dut: &Dut,
    seed: u64,
    args: &WireArgs,
    seat: Seat<'_>,
    prepared: Option<&Prepared>,
) -> Result<WireRun, Failed> {
    let Seat { control, mut look, feed, attendant, .. } = seat;
    let mut observer = Attended { observer: feed.unwrap_or_else(|| glances(1).0), attendant };
    let prepared = prepared.cloned();
    let profile = load_profile(args.driver.as_deref().unwrap_or_default())?;
    let at = endpoint(&args.port, &args.tcp, "--driver")?;
    for (option, value) in
        [("--max-current", args.max_current.map(|q| q.value())), ("--max-pressure", args.max_pressure.map(|q| q.value()))]
    {
        if value.is_some_and(|v| v <= 0.0) {
            return Err(CliError::usage(format!("{option}: is not positive, so nothing could be tested")).into());
        }
    }
    let pressure_source = match &args.pressure_driver {
        Some(name) => Some((load_profile(name)?, endpoint(&args.pressure_port, &args.pressure_tcp, "--pressure-driver")?)),
        None => None,
    };
    let _watched = Watched(Arc::clone(&control));
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
        let run = RunOptions { model: &model, dut: &dut, seed, stop: Some(inside.stop_flag()), prepared: prepared.as_ref() };
        let (mut record, trace) = runner::run(&plan, &mut rig, &run, &mut observer);
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
        if let Some(who) = inside.stop_requested() {
            record.rig.details.push(("stopped by".into(), who.into()));
            name_the_operator(&mut record, who);
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
    let result = loop_thread::run(&control, body, &mut look);
    look();
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

/// A run that a person stopped says so, instead of a signal.
pub fn name_the_operator(record: &mut TestRecord, who: &str) {
    if who == OPERATOR {
        let reasons = record.reasons.iter_mut().chain(record.phases.iter_mut().filter_map(|p| p.reason.as_mut()));
        reasons.filter(|r| *r == STOPPED).for_each(|r| *r = format!("stopped by {OPERATOR}"));
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

/// The columns of [`line`].
const HEADING: &str = " done  time s target bar pressure bar current A late ms quality     not good";

/// Within 80 columns, so that a narrow terminal does not wrap it.
fn line(glance: &Glance, not_good: u64) -> String {
    let number = |value: f64, digits: usize| if value.is_finite() { format!("{value:.digits$}") } else { "-".into() };
    format!(
        "{:>3} % {:>7.1} {:>10} {:>12} {:>9} {:>7} {:<11} {:>8}",
        100 * glance.sample / glance.samples.max(1),
        glance.time_s,
        number(glance.target_bar, 2),
        number(glance.pressure_bar, 2),
        number(glance.current_a, 3),
        number(glance.lateness_s * 1e3, 2),
        glance.quality.name(),
        not_good
    )
}

/// The supervisor's end: draws at most ten times a second.
struct View {
    queue: Consumer<Glance>,
    watch: bool,
    shown: Instant,
    bad: u64,
    drawn: bool,
}

fn live_view(watch: bool) -> (Feed, View) {
    let (feed, queue) = glances(256);
    (feed, View { queue, watch, shown: Instant::now(), bad: 0, drawn: false })
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
        let line = line(&g, self.bad);
        // On a terminal one line is written over and over; elsewhere each stands for itself.
        use std::io::{IsTerminal, Write};
        let mut err = std::io::stderr();
        if !std::mem::replace(&mut self.drawn, true) {
            let _ = writeln!(err, "{HEADING}");
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
            phase: 0,
            current_meas_a: f64::NAN,
            time_s: 3599.99,
            target_bar: 123.456,
            pressure_bar: f64::NAN,
            current_a: 1.2,
            quality: Quality::Implausible,
            lateness_s: 0.01234,
        };
        insta::assert_snapshot!(format!("{HEADING}\n{}", line(&glance, 123_456)), @"
         done  time s target bar pressure bar current A late ms quality     not good
         99 %  3600.0     123.46            -     1.200   12.34 implausible   123456
        ");
        assert!(HEADING.len() < 80 && line(&glance, 123_456).len() < 80);
    }
}
