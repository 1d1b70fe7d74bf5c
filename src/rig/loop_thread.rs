//! The loop's own thread, and the supervisor that stays behind: signals, heartbeat, and what is known of the safe state
//! when the loop cannot say it any more.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

use super::SafeState;
use super::realtime::{Privileges, prepare};
use super::signals::{Caught, SIGNALS};

/// Priority of the loop's thread.
const PRIORITY: u8 = 50;
/// A loop that has not stepped for so long after it was asked to stop is given up.
/// The safe state may take 5 s, the silence for the watchdog 0.65 s, and a last look 0.5 s.
const GIVE_UP: Duration = Duration::from_secs(8);

/// Who asked a loop to stop where no signal did.
pub const OPERATOR: &str = "the operator";
/// [`OPERATOR`] among the indices of the signals.
const BY_OPERATOR: u8 = u8::MAX;

/// What loop and supervisor share. All of it can be touched from the loop without waiting.
#[derive(Debug, Default)]
pub struct LoopControl {
    stop: AtomicBool,
    /// Index of the signal that asked for it.
    signal: AtomicU8,
    heartbeat: AtomicU64,
    energised: AtomicBool,
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

    /// Asks the loop to stop at its next slot, in the name of a signal or of [`OPERATOR`].
    pub fn request_stop(&self, who: &str) {
        let of_signal = || SIGNALS.iter().position(|s| s.0 == who).unwrap_or(0) as u8;
        let index = if who == OPERATOR { BY_OPERATOR } else { of_signal() };
        self.signal.store(index, Ordering::Relaxed);
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Set once a stop was asked for.
    pub fn stop_flag(&self) -> &AtomicBool {
        &self.stop
    }

    /// The signal that asked the loop to stop, or [`OPERATOR`].
    pub fn stop_requested(&self) -> Option<&'static str> {
        let asked = self.stop.load(Ordering::Relaxed);
        let by = self.signal.load(Ordering::Relaxed);
        let name = if by == BY_OPERATOR { Some(OPERATOR) } else { SIGNALS.get(usize::from(by)).map(|s| s.0) };
        name.filter(|_| asked)
    }

    /// A set-point is about to be written: what was known of the safe state holds no more.
    pub fn energised(&self) {
        self.energised.store(true, Ordering::Relaxed);
    }

    /// Whether a set-point was written after which no safe state was confirmed.
    pub fn left_energised(&self) -> bool {
        self.energised.load(Ordering::Relaxed)
    }

    /// Keeps the outcome of the latest attempt to reach the safe state.
    pub fn note_safe(&self, state: &SafeState) {
        *self.safe.lock().unwrap_or_else(PoisonError::into_inner) = Some(state.clone());
        self.energised.store(!state.confirmed, Ordering::Relaxed);
    }

    /// The outcome of the latest attempt to reach the safe state; `None` where none was made since the last set-point.
    pub fn safe_state(&self) -> Option<SafeState> {
        let state = self.safe.lock().unwrap_or_else(PoisonError::into_inner).clone();
        state.filter(|s| !(s.confirmed && self.left_energised()))
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
    let caught = Caught::register();
    let (send, receive) = mpsc::sync_channel(1);
    let thread = std::thread::Builder::new().name("loop".into()).spawn(move || {
        let privileges = prepare(PRIORITY);
        let result = catch_unwind(AssertUnwindSafe(|| body(privileges)));
        let _ = send.send(result);
    });
    let thread = thread.map_err(|e| LoopError::Start(e.to_string()))?;
    // Also where this thread panics: the loop ends before the process does.
    let mut loop_thread = Joined { control, thread: Some(thread) };
    let mut asked: Option<Instant> = None;
    let result = loop {
        match receive.recv_timeout(Duration::from_millis(20)) {
            Ok(result) => break Some(result),
            Err(mpsc::RecvTimeoutError::Disconnected) => break None,
            Err(mpsc::RecvTimeoutError::Timeout) => {}
        }
        watch();
        if let Some(signal) = caught.first()
            && asked.is_none()
        {
            control.request_stop(signal);
        }
        if control.stop_requested().is_some() {
            asked.get_or_insert_with(Instant::now);
        }
        if asked.is_some_and(|t| t.elapsed() > GIVE_UP) {
            loop_thread.thread = None;
            return Err(LoopError::Hung);
        }
    };
    drop(caught);
    drop(loop_thread);
    match result {
        Some(Ok(value)) => Ok(value),
        Some(Err(panic)) => {
            let text = panic.downcast_ref::<&str>().map(|s| s.to_string()).or_else(|| panic.downcast_ref::<String>().cloned());
            Err(LoopError::Panicked { message: text.unwrap_or_else(|| "without a message".into()), safe: control.safe_state() })
        }
        None => Err(LoopError::Hung),
    }
}

/// The loop's thread; whoever lets go of it asks it to stop and waits for that.
struct Joined<'a> {
    control: &'a Arc<LoopControl>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Drop for Joined<'_> {
    fn drop(&mut self) {
        let Some(thread) = self.thread.take() else { return };
        if !thread.is_finished() {
            self.control.stop.store(true, Ordering::Relaxed);
        }
        let began = Instant::now();
        while !thread.is_finished() && began.elapsed() < GIVE_UP {
            std::thread::sleep(Duration::from_millis(5));
        }
        if thread.is_finished() {
            let _ = thread.join();
        }
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
                inside.note_safe(&SafeState::of(true, "0 A"));
                panic!("on purpose")
            },
            || (),
        );
        let error = result.unwrap_err();
        assert!(error.is_safe());
        assert_eq!(error.to_string(), "the loop panicked: on purpose; safe state confirmed: 0 A");
    }

    #[test]
    fn a_panic_of_the_supervisor_waits_for_the_loop() {
        let control = Arc::new(LoopControl::default());
        let inside = Arc::clone(&control);
        let body = move |_| {
            inside.energised();
            while inside.stop_requested().is_none() {
                std::thread::sleep(Duration::from_millis(1));
            }
            std::thread::sleep(Duration::from_millis(50));
            inside.note_safe(&SafeState::of(true, "0 A"));
        };
        let caught = catch_unwind(AssertUnwindSafe(|| run(&control, body, || panic!("on purpose"))));
        assert!(caught.is_err() && !control.left_energised(), "the process must not end before the loop has");
    }

    #[test]
    fn what_was_confirmed_before_a_set_point_is_not_what_is_known_after_it() {
        let control = LoopControl::default();
        control.note_safe(&SafeState::of(true, "0 A"));
        assert!(control.safe_state().is_some_and(|s| s.confirmed));
        control.energised();
        assert_eq!((control.safe_state(), control.left_energised()), (None, true));
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
