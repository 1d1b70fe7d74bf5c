//! The loop's clock and priority: absolute deadlines, SCHED_FIFO, locked memory and fine timers, each where the
//! system permits it, and each outcome recorded.

use std::time::Duration;

use rustix::time::{ClockId, Timespec, clock_gettime};

/// What the system permitted, in the order in which it is printed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Privileges {
    /// SCHED_FIFO with this priority.
    pub priority: Option<u8>,
    /// Whether all memory is locked.
    pub memory_locked: bool,
    /// Whether timers fire without slack.
    pub fine_timers: bool,
}

impl Privileges {
    /// The outcomes for the record.
    pub fn details(&self) -> Vec<(String, String)> {
        let yes = |b: bool| if b { "yes" } else { "not permitted" }.to_string();
        vec![
            ("real-time priority".into(), self.priority.map_or("not permitted".into(), |p| format!("SCHED_FIFO {p}"))),
            ("memory locked".into(), yes(self.memory_locked)),
            ("timer slack 1 ns".into(), yes(self.fine_timers)),
        ]
    }
}

/// Gives the calling thread SCHED_FIFO priority and fine timers, where permitted.
pub fn prioritize(priority: u8) -> Privileges {
    use thread_priority::unix::{RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id};
    use thread_priority::{ThreadPriority, ThreadPriorityValue};
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let granted = ThreadPriorityValue::try_from(priority)
        .is_ok_and(|value| set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy).is_ok());
    Privileges { priority: granted.then_some(priority), memory_locked: false, fine_timers: fine_timers() }
}

#[cfg(target_os = "linux")]
fn fine_timers() -> bool {
    rustix::thread::set_current_timer_slack(std::num::NonZeroU64::new(1)).is_ok()
}

#[cfg(not(target_os = "linux"))]
fn fine_timers() -> bool {
    false
}

#[cfg(target_os = "linux")]
fn memory_locked() -> bool {
    use rustix::mm::{MlockAllFlags, mlockall};
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).is_ok()
}

#[cfg(not(target_os = "linux"))]
fn memory_locked() -> bool {
    false
}

/// Sleeps until this time of the monotonic clock, where the system can.
#[cfg(target_os = "linux")]
fn sleep_absolute(deadline: &Timespec) -> rustix::io::Result<()> {
    rustix::thread::clock_nanosleep_absolute(ClockId::Monotonic, deadline)
}

#[cfg(not(target_os = "linux"))]
fn sleep_absolute(_: &Timespec) -> rustix::io::Result<()> {
    Err(rustix::io::Errno::NOSYS)
}

/// Prepares the calling thread for a control loop: priority, locked memory, fine timers, each where permitted.
pub fn prepare(priority: u8) -> Privileges {
    Privileges { memory_locked: memory_locked(), ..prioritize(priority) }
}

/// A clock with its zero where it was made, for absolute deadlines.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    start: Timespec,
}

impl Default for Clock {
    fn default() -> Self {
        Self::new()
    }
}

impl Clock {
    /// A clock that starts now.
    pub fn new() -> Self {
        Self { start: clock_gettime(ClockId::Monotonic) }
    }

    /// Time since the start [s].
    pub fn now_s(&self) -> f64 {
        let now = clock_gettime(ClockId::Monotonic);
        (now.tv_sec - self.start.tv_sec) as f64 + (now.tv_nsec - self.start.tv_nsec) as f64 * 1e-9
    }

    /// Moves the zero of the clock to `time_s` of its present time.
    pub fn set_zero(&mut self, time_s: f64) {
        self.start = self.at(time_s);
    }

    fn at(&self, time_s: f64) -> Timespec {
        let nanoseconds = (time_s * 1e9).round() as i64 + self.start.tv_nsec;
        Timespec { tv_sec: self.start.tv_sec + nanoseconds.div_euclid(1_000_000_000), tv_nsec: nanoseconds.rem_euclid(1_000_000_000) }
    }

    /// Sleeps until `time_s`; returns at once when that has passed.
    pub fn sleep_until(&self, time_s: f64) {
        let deadline = self.at(time_s);
        loop {
            match sleep_absolute(&deadline) {
                Err(rustix::io::Errno::INTR) => {}
                Ok(()) => return,
                Err(_) => {
                    // No absolute sleep here: a relative one serves, at the cost of some lateness.
                    let rest = time_s - self.now_s();
                    if rest > 0.0 {
                        std::thread::sleep(Duration::from_secs_f64(rest));
                    }
                    return;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deadline_is_never_early() {
        let clock = Clock::new();
        for k in 1..=5 {
            let deadline_s = f64::from(k) * 0.002;
            clock.sleep_until(deadline_s);
            assert!(clock.now_s() >= deadline_s);
        }
        let before_s = clock.now_s();
        clock.sleep_until(0.001);
        assert!(clock.now_s() - before_s < 0.5, "a deadline in the past does not wait");
    }

    #[test]
    fn the_zero_can_be_moved() {
        let mut clock = Clock::new();
        clock.set_zero(10.25);
        assert!((clock.now_s() + 10.25).abs() < 0.5);
    }
}
