//! The loop's own thread, and the supervisor that stays behind: signals, heartbeat, and what is known of the safe state
//! when the loop cannot say it any more.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

use super::SafeState;
use super::realtime::{Privileges, prepare};

/// Priority of the loop's thread.
const PRIORITY: u8 = 50;
/// A loop that has not stepped for so long after it was asked to stop is given up.
const GIVE_UP: Duration = Duration::from_secs(6);

/// The signals that end a run, in the order of their numbers here.
const SIGNALS: [(&str, i32); 3] =
    [("SIGINT", signal_hook::consts::SIGINT), ("SIGTERM", signal_hook::consts::SIGTERM), ("SIGHUP", signal_hook::consts::SIGHUP)];

/// What loop and supervisor share. All of it can be touched from the loop without waiting.
#[derive(Debug, Default)]
pub struct LoopControl {
    stop: AtomicBool,
    /// Index of the signal that asked for it.
    signal: AtomicU8,
    heartbeat: AtomicU64,
    safe: Mutex<Option<SafeState>>,
}

impl LoopControl {
    /// The loop lives.
    pub fn beat(&self) {
        self.heartbeat.fetch_add(1, Ordering::Relaxed);
    }

    /// Steps so far.
    pub fn heartbeat(&self) -> u64 {
        self.heartbeat.load(Ordering::Relaxed)
    }

    /// Asks the loop to stop at its next slot, in the name of a signal.
    pub fn request_stop(&self, signal: &str) {
        let index = SIGNALS.iter().position(|s| s.0 == signal).unwrap_or(0);
        self.signal.store(index as u8, Ordering::Relaxed);
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Set once a stop was asked for.
    pub fn stop_flag(&self) -> &AtomicBool {
        &self.stop
    }

    /// The signal that asked the loop to stop.
    pub fn stop_requested(&self) -> Option<&'static str> {
        let asked = self.stop.load(Ordering::Relaxed);
        SIGNALS.get(usize::from(self.signal.load(Ordering::Relaxed))).filter(|_| asked).map(|s| s.0)
    }

    /// Keeps the outcome of the latest attempt to reach the safe state.
    pub fn note_safe(&self, state: &SafeState) {
        *self.safe.lock().unwrap_or_else(PoisonError::into_inner) = Some(state.clone());
    }

    /// The outcome of the latest attempt to reach the safe state.
    pub fn safe_state(&self) -> Option<SafeState> {
        self.safe.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Why the loop gave no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LoopError {
    /// It panicked; the rig was made safe while the thread ended.
    #[error("the loop panicked: {message}; {}", safe_text(.safe))]
    Panicked {
        /// The message.
        message: String,
        /// What is known of the safe state.
        safe: Option<SafeState>,
    },
    /// It did not stop.
    #[error("the loop does not answer; SAFE STATE NOT CONFIRMED - remove power")]
    Hung,
    /// The thread could not be started.
    #[error("the loop's thread cannot be started: {0}")]
    Start(String),
}

impl LoopError {
    /// Whether the safe state was confirmed nevertheless.
    pub fn is_safe(&self) -> bool {
        matches!(self, Self::Panicked { safe: Some(state), .. } if state.confirmed)
    }
}

/// One line on the safe state, as every report has it.
pub fn safe_text(safe: &Option<SafeState>) -> String {
    match safe {
        Some(state) if state.confirmed => format!("safe state confirmed: {}", state.evidence),
        Some(state) => format!("SAFE STATE NOT CONFIRMED - remove power: {}", state.evidence),
        None => "SAFE STATE NOT CONFIRMED - remove power".into(),
    }
}

/// Runs `body` on a thread with real-time priority and locked memory, as far as permitted, and watches over it: the
/// first signal asks it to stop through `control`, further ones change nothing, because the safe state is under way.
pub fn run<T: Send + 'static>(
    control: &Arc<LoopControl>,
    body: impl FnOnce(Privileges) -> T + Send + 'static,
    mut watch: impl FnMut(),
) -> Result<T, LoopError> {
    let flags: Vec<Arc<AtomicBool>> = SIGNALS.iter().map(|_| Arc::default()).collect();
    let registered: Vec<_> =
        SIGNALS.iter().zip(&flags).filter_map(|(s, flag)| signal_hook::flag::register(s.1, Arc::clone(flag)).ok()).collect();
    let (send, receive) = mpsc::sync_channel(1);
    let thread = std::thread::Builder::new().name("loop".into()).spawn(move || {
        let privileges = prepare(PRIORITY);
        let result = catch_unwind(AssertUnwindSafe(|| body(privileges)));
        let _ = send.send(result);
    });
    let thread = thread.map_err(|e| LoopError::Start(e.to_string()))?;
    let mut asked: Option<Instant> = None;
    let result = loop {
        match receive.recv_timeout(Duration::from_millis(20)) {
            Ok(result) => break Some(result),
            Err(mpsc::RecvTimeoutError::Disconnected) => break None,
            Err(mpsc::RecvTimeoutError::Timeout) => {}
        }
        watch();
        if let Some((signal, _)) = SIGNALS.iter().zip(&flags).find(|(_, f)| f.load(Ordering::Relaxed)) {
            if asked.is_none() {
                control.request_stop(signal.0);
            }
            asked.get_or_insert_with(Instant::now);
        }
        if asked.is_some_and(|t| t.elapsed() > GIVE_UP) {
            return Err(LoopError::Hung);
        }
    };
    for id in registered {
        signal_hook::low_level::unregister(id);
    }
    let _ = thread.join();
    match result {
        Some(Ok(value)) => Ok(value),
        Some(Err(panic)) => {
            let text = panic.downcast_ref::<&str>().map(|s| s.to_string()).or_else(|| panic.downcast_ref::<String>().cloned());
            Err(LoopError::Panicked { message: text.unwrap_or_else(|| "without a message".into()), safe: control.safe_state() })
        }
        None => Err(LoopError::Hung),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_caught_and_says_what_is_known_of_the_safe_state() {
        let control = Arc::new(LoopControl::default());
        let inside = Arc::clone(&control);
        let result: Result<(), _> = run(
            &control,
            move |_| {
                inside.note_safe(&SafeState { confirmed: true, evidence: "0 A".into() });
                panic!("on purpose")
            },
            || (),
        );
        let error = result.unwrap_err();
        assert!(error.is_safe());
        assert_eq!(error.to_string(), "the loop panicked: on purpose; safe state confirmed: 0 A");
    }

    #[test]
    fn a_request_to_stop_reaches_the_loop() {
        let control = Arc::new(LoopControl::default());
        let inside = Arc::clone(&control);
        control.request_stop("SIGTERM");
        let seen = run(&control, move |_| inside.stop_requested(), || ()).unwrap();
        assert_eq!(seen, Some("SIGTERM"));
    }
}
