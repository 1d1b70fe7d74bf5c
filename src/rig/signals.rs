//! The signals that end a run: every one that can be caught and would end or stop the process.
//!
//! Those of a broken program (SIGSEGV, SIGBUS, SIGILL, SIGFPE) are not caught: whoever runs on after them writes anything.
//! They, SIGKILL, SIGSTOP and a dead computer are the watchdog's business.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts as number;

/// First and last real-time signal; they have numbers and no names.
const REAL_TIME: (i32, i32) = (34, 64);

/// Names and numbers.
pub const SIGNALS: &[(&str, i32)] = &[
    ("SIGINT", number::SIGINT),
    ("SIGTERM", number::SIGTERM),
    ("SIGHUP", number::SIGHUP),
    ("SIGQUIT", number::SIGQUIT),
    ("SIGABRT", number::SIGABRT),
    ("SIGUSR1", number::SIGUSR1),
    ("SIGUSR2", number::SIGUSR2),
    ("SIGALRM", number::SIGALRM),
    ("SIGVTALRM", number::SIGVTALRM),
    ("SIGPROF", number::SIGPROF),
    ("SIGXCPU", number::SIGXCPU),
    ("SIGXFSZ", number::SIGXFSZ),
    ("SIGIO", number::SIGIO),
    ("SIGTRAP", number::SIGTRAP),
    ("SIGSYS", number::SIGSYS),
    ("SIGTSTP", number::SIGTSTP),
    ("SIGTTIN", number::SIGTTIN),
    ("SIGTTOU", number::SIGTTOU),
    #[cfg(target_os = "linux")]
    ("SIGSTKFLT", 16),
    #[cfg(target_os = "linux")]
    ("SIGPWR", 30),
    #[cfg(target_os = "linux")]
    ("a real-time signal", REAL_TIME.0),
];

/// The number itself, or all real-time signals.
fn all(number: i32) -> std::ops::RangeInclusive<i32> {
    number..=if number == REAL_TIME.0 { REAL_TIME.1 } else { number }
}

/// The numbers of all signals that end a run.
pub fn numbers() -> impl Iterator<Item = i32> {
    SIGNALS.iter().flat_map(|s| all(s.1))
}

/// The signals while they are caught; afterwards they do nothing, until the process ends.
pub struct Caught {
    flags: Vec<(&'static str, Arc<AtomicBool>)>,
    registered: Vec<signal_hook::SigId>,
}

impl Caught {
    /// Catches every signal of the list that the system lets be caught.
    pub fn register() -> Self {
        let flags: Vec<_> = SIGNALS.iter().map(|s| (s.0, Arc::new(AtomicBool::new(false)))).collect();
        let registered = SIGNALS
            .iter()
            .zip(&flags)
            .flat_map(|(signal, flag)| all(signal.1).filter_map(|number| signal_hook::flag::register(number, Arc::clone(&flag.1)).ok()));
        let registered = registered.collect();
        Self { flags, registered }
    }

    /// The first of the list that came.
    pub fn first(&self) -> Option<&'static str> {
        self.flags.iter().find(|f| f.1.load(Ordering::Relaxed)).map(|f| f.0)
    }
}

impl Drop for Caught {
    fn drop(&mut self) {
        for id in self.registered.drain(..) {
            signal_hook::low_level::unregister(id);
        }
    }
}
