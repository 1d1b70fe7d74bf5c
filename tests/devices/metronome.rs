//! Whether this machine kept time while a test ran. A line of 10 ms slots cannot be judged on a machine that stood still for
//! three of them, which a shared one does now and then.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What a plan allows where other tests keep the machine busy, and losses are not what is looked at; put before the plan.
pub const BUSY: &str = "timing.max_lost = \"60 %\"\ntiming.max_stale = \"60 %\"\ntiming.max_missed = \"90 %\"\n";

const BEAT: Duration = Duration::from_millis(1);
const ATTEMPTS: usize = 5;

/// A thread that asks to be woken every millisecond and notes how late it was.
struct Metronome {
    ended: Arc<AtomicBool>,
    latest_us: Arc<AtomicU64>,
    beating: JoinHandle<()>,
}

impl Metronome {
    fn start() -> Self {
        let (ended, latest_us) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let (until, latest) = (Arc::clone(&ended), Arc::clone(&latest_us));
        let mut asked = Instant::now();
        let beating = std::thread::spawn(move || {
            loop {
                std::thread::sleep(BEAT);
                let late = asked.elapsed().saturating_sub(BEAT);
                latest.fetch_max(u64::try_from(late.as_micros()).unwrap_or(u64::MAX), Ordering::Relaxed);
                if until.load(Ordering::Relaxed) {
                    return;
                }
                asked = Instant::now();
            }
        });
        Self { ended, latest_us, beating }
    }

    /// How late it was at worst [s].
    fn stop(self) -> f64 {
        self.ended.store(true, Ordering::Relaxed);
        self.beating.join().unwrap();
        self.latest_us.load(Ordering::Relaxed) as f64 * 1e-6
    }
}

/// Within its slot a request and its reply wake four threads, one after the other: each may be late by this share.
const EACH_LATE: f64 = 0.25;

/// Makes an attempt that needs a machine in time: what fails while the machine was late by a quarter of a slot or more is tried again.
///
/// Only what a late machine can spoil (losses, an ended run) is told as `Err`; what must hold on any machine, a good sample that
/// is fresh and a safe state, is asserted within the attempt.
///
/// # Panics
/// Where an attempt fails on a machine that kept time, or five do on one that did not.
pub fn in_time(slot_s: f64, attempt: impl Fn() -> Result<(), String>) {
    let mut told = Vec::new();
    for _ in 0..ATTEMPTS {
        let metronome = Metronome::start();
        let found = attempt();
        let late_s = metronome.stop();
        let Err(what) = found else { return };
        assert!(late_s >= EACH_LATE * slot_s, "{what} (the machine was {:.1} ms late at worst)", late_s * 1e3);
        told.push(format!("{what}; the machine was {:.0} ms late", late_s * 1e3));
    }
    panic!("this machine does not keep time: {told:#?}");
}

#[test]
fn a_machine_that_kept_time_excuses_nothing() {
    let slot_s = 3600.0;
    let failed = std::panic::catch_unwind(|| in_time(slot_s, || Err("no sample".into())));
    assert!(failed.unwrap_err().downcast_ref::<String>().unwrap().contains("no sample (the machine was"));
}

#[test]
fn what_a_late_machine_spoiled_is_tried_again() {
    let tries = std::cell::Cell::new(0);
    // No sleep is in time to the nanosecond.
    in_time(1e-9, || {
        std::thread::sleep(Duration::from_millis(3));
        tries.set(tries.get() + 1);
        if tries.get() < 3 { Err("spoiled".into()) } else { Ok(()) }
    });
    assert_eq!(tries.get(), 3);
}
