//! A phase that asks a person: the last current is held, every interlock watches, nothing of it is measured.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::{Bench, Ended, STOPPED};
use crate::plan::{Phase, Prompt};
use crate::record::Outcome;
use crate::runner::{Attendant, Reply};

/// How often a simulation looks for an answer [s]; it has no slots that pass by themselves.
const LOOK_S: f64 = 0.01;

/// Takes the question back on every way out.
struct Asked<'a>(&'a dyn Attendant);

impl Drop for Asked<'_> {
    fn drop(&mut self) {
        self.0.done();
    }
}

impl Bench<'_> {
    /// Asks, and waits for the answer.
    pub(super) fn ask(&mut self, index: usize, phase: &Phase, prompt: &Prompt, attendant: Option<&dyn Attendant>) -> Result<Reply, Ended> {
        let Some(attendant) = attendant else {
            let reason = format!("phase `{}` asks \u{201c}{}\u{201d}, and nobody is there to answer", phase.name, prompt.text);
            return Err(Ended { outcome: Outcome::Error, reason });
        };
        attendant.ask(index, phase, prompt);
        let _asked = Asked(attendant);
        // What comes next begins from the current that is held.
        self.closed = false;
        self.controller.follow(self.last_current_a);
        let mut waited_s = 0.0;
        loop {
            if self.options.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
                return Err(Ended { outcome: Outcome::Aborted, reason: STOPPED.into() });
            }
            if let Some(reply) = attendant.reply() {
                return Ok(reply);
            }
            if waited_s > prompt.timeout_s {
                let reason = format!("phase `{}`: nobody answered within {} s", phase.name, prompt.timeout_s);
                return Err(Ended { outcome: Outcome::Aborted, reason });
            }
            waited_s += if self.simulated {
                std::thread::sleep(Duration::from_secs_f64(LOOK_S));
                LOOK_S
            } else {
                self.hold()?
            };
        }
    }

    /// One slot with the last current; how long it took [s].
    fn hold(&mut self) -> Result<f64, Ended> {
        let until_s = (self.slot + 1) as f64 * self.plan.period_s;
        let sample =
            self.guard.step(self.last_current_a, until_s).map_err(|error| Ended { outcome: Outcome::Error, reason: error.to_string() })?;
        let slots = 1 + u64::from(sample.missed_slots);
        self.slot += slots;
        self.interlock(&sample, self.plan.interlocks)?;
        self.last = Some(sample);
        Ok(slots as f64 * self.plan.period_s)
    }
}
