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
        if self.bar.is_none() && self.started.elapsed() > Duration::from_millis(500) {
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
