//! A progress bar on stderr for long runs; nothing where stderr is no terminal.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::lock::lock;
use crate::diagnose::{Tried, tell_of_candidates};
use crate::runner::{Observer, Progress};

/// Shows where a run stands, once it takes longer than a moment.
pub struct Bar {
    bar: Option<ProgressBar>,
    started: Instant,
    shown: Instant,
}

impl Bar {
    /// A bar that appears after half a second.
    pub fn new() -> Self {
        Self { bar: None, started: Instant::now(), shown: Instant::now() }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Observer for Bar {
    fn sample(&mut self, progress: &Progress<'_>) {
        // Looking at the clock at every simulated sample would cost more than the sample.
        if !progress.sample.is_multiple_of(256) || self.shown.elapsed() < Duration::from_millis(100) {
            return;
        }
        self.shown = Instant::now();
        if self.bar.is_none() && super::manners::chatty() && self.started.elapsed() > Duration::from_millis(500) {
            let bar = ProgressBar::new(progress.samples as u64);
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} % {msg} {eta} left") {
                bar.set_style(style);
            }
            self.bar = Some(bar);
        }
        if let Some(bar) = &self.bar {
            bar.set_position(progress.sample as u64);
            bar.set_message(format!("{}: {:.2} bar at {:.3} A", progress.phase, progress.measured.pressure_bar, progress.current_a));
        }
    }
}

/// A line with the time that has passed, for work of which nobody knows how long it takes; gone when it is dropped, and
/// never there where stderr is no terminal or nobody wants to hear.
pub struct Working(Option<ProgressBar>);

impl Working {
    /// Begins to show that something is at work.
    pub fn on(what: &str) -> Self {
        if !super::manners::chatty() {
            return Self(None);
        }
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}, {elapsed}") {
            bar.set_style(style);
        }
        bar.set_message(what.to_string());
        bar.enable_steady_tick(Duration::from_millis(200));
        Self(Some(bar))
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

/// The search of a diagnosis: how many candidates of its present step have been tried, and the time that is left of the step. How
/// many steps there will be, nobody knows before.
pub struct Searching {
    _line: Working,
}

/// The bar that the fits of all threads move.
static SEARCH: Mutex<Option<ProgressBar>> = Mutex::new(None);

impl Searching {
    /// Begins to show it.
    pub fn show() -> Self {
        let working = Working::on("diagnosing");
        *lock(&SEARCH) = working.0.clone();
        if working.0.is_some() {
            tell_of_candidates(Self::tried);
        }
        Self { _line: working }
    }

    fn tried(tried: &Tried) {
        let bar = lock(&SEARCH);
        let Some(bar) = bar.as_ref() else { return };
        // What the model has grown by tells the step.
        let step = format!("diagnosing, step {}", tried.beside.len() + 1);
        if bar.message() != step || bar.length().is_some_and(|of| bar.position() >= of) {
            // The time that has passed is that of all steps.
            bar.set_position(0);
            bar.set_length(tried.of as u64);
            bar.reset_eta();
            bar.set_message(step);
            if let Ok(style) = ProgressStyle::with_template("{msg}: {pos} of {len} candidates, {eta} left of it, {elapsed}") {
                bar.set_style(style);
            }
        }
        bar.inc(1);
    }
}

impl Drop for Searching {
    fn drop(&mut self) {
        *lock(&SEARCH) = None;
    }
}

/// About how long is left of work of which `done` of `of` pieces are done since `begun`: `, about 3 min left`; nothing at its begin.
pub fn left(begun: Instant, done: usize, of: usize) -> String {
    if done == 0 {
        return String::new();
    }
    let seconds = begun.elapsed().as_secs_f64() * of.saturating_sub(done) as f64 / done as f64;
    if seconds < 90.0 { format!(", about {seconds:.0} s left") } else { format!(", about {:.0} min left", (seconds / 60.0).ceil()) }
}

/// A bar with the time left, for work that is counted.
pub struct Counted(Option<ProgressBar>);

impl Counted {
    /// A bar over `total` pieces of work.
    pub fn new(what: &str, total: usize) -> Self {
        if !super::manners::chatty() {
            return Self(None);
        }
        let bar = ProgressBar::new(total as u64);
        if let Ok(style) = ProgressStyle::with_template("{msg} {bar:30} {pos} of {len}, {eta} left") {
            bar.set_style(style);
        }
        bar.set_message(what.to_string());
        Self(Some(bar))
    }

    /// One piece more is done.
    pub fn step(&self) {
        if let Some(bar) = &self.0 {
            bar.inc(1);
        }
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}
