//! How much is said, and in which colours: `--quiet`, `--verbose`, `--color`.

use std::sync::atomic::{AtomicU8, Ordering};

/// 0 quiet, 1 usual, 2 verbose.
static LEVEL: AtomicU8 = AtomicU8::new(1);

/// Takes the options that every command has.
pub fn set(color: clap::ColorChoice, quiet: bool, verbose: bool) {
    LEVEL.store(if quiet { 0 } else { 1 + u8::from(verbose) }, Ordering::Relaxed);
    let choice = match color {
        clap::ColorChoice::Auto => anstream::ColorChoice::Auto,
        clap::ColorChoice::Always => anstream::ColorChoice::Always,
        clap::ColorChoice::Never => anstream::ColorChoice::Never,
    };
    choice.write_global();
}

/// Whether hints and progress are wanted.
pub fn chatty() -> bool {
    LEVEL.load(Ordering::Relaxed) > 0
}

/// A line on stderr that nobody misses who asked for quiet: where something was stored, what to do next.
pub fn say(text: &str) {
    if chatty() {
        super::note(text);
    }
}

/// A line on stderr for whoever wants to know more.
pub fn detail(text: impl FnOnce() -> String) {
    if LEVEL.load(Ordering::Relaxed) > 1 {
        super::note(&text());
    }
}
