//! A progress bar on stderr for long runs; nothing where stderr is no terminal.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

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
