//! What is seen of each sample while a run goes on: through a bounded ring, so that the loop never waits for whoever looks.

use rtrb::{Consumer, Producer, RingBuffer};

use super::{Observer, Progress};
use crate::plan::Phase;
use crate::rig::Quality;

/// One sample as it is seen by those who watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Glance {
    /// Samples so far, this one among them.
    pub sample: usize,
    /// Planned samples.
    pub samples: usize,
    /// Place of the phase in the plan.
    pub phase: usize,
    /// Rig time [s].
    pub time_s: f64,
    /// Target pressure [bar]; NaN in open loop.
    pub target_bar: f64,
    /// Measured pressure [bar].
    pub pressure_bar: f64,
    /// Commanded current [A].
    pub current_a: f64,
    /// Measured current [A]; NaN where the rig has none.
    pub current_meas_a: f64,
    /// Whether the sample is fresh and plausible.
    pub quality: Quality,
    /// How late the slot began [s].
    pub lateness_s: f64,
}

/// The loop's end of the ring: a full ring drops the glance, the loop never waits.
pub struct Feed {
    ring: Producer<Glance>,
    phase: usize,
}

/// A ring that holds `capacity` glances: the loop's end, and that of whoever looks.
pub fn glances(capacity: usize) -> (Feed, Consumer<Glance>) {
    let (ring, seen) = RingBuffer::new(capacity);
    (Feed { ring, phase: 0 }, seen)
}

impl Observer for Feed {
    fn phase(&mut self, index: usize, _phase: &Phase) {
        self.phase = index;
    }

    fn sample(&mut self, p: &Progress<'_>) {
        let _ = self.ring.push(Glance {
            sample: p.sample,
            samples: p.samples,
            phase: self.phase,
            time_s: p.measured.time_s,
            target_bar: p.target_bar,
            pressure_bar: p.measured.pressure_bar,
            current_a: p.current_a,
            current_meas_a: p.measured.current_a.unwrap_or(f64::NAN),
            quality: p.measured.quality,
            lateness_s: p.measured.lateness_s,
        });
    }
}
