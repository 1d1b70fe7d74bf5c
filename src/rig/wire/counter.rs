//! The counter of conversions: values are new where it has moved forwards, by no more than the elapsed time allows, and
//! where it keeps the pace that the profile says, by no less.

/// A counter is one word: it begins again behind 65535.
const WIDTH: f64 = 65_536.0;
/// What a device's clock may be off, and more: 2 %.
const CLOCK: f64 = 0.02;
/// Pace at which the freshest reading is forgotten: 1 %, more than two clocks drift apart.
const DRIFT: f64 = 0.01;
/// Readings, and time [s], after which the pace of a counter is known.
const PACE_AFTER: (u32, f64) = (10, 0.2);
/// A counter keeps the pace where its rate is that of the profile within this share; others only count something.
const PACE: f64 = 0.1;

/// What is known of a device's counter.
#[derive(Debug, Clone, PartialEq)]
pub struct Counter {
    rate_hz: f64,
    period_s: f64,
    last: Option<Reading>,
    first: Option<Reading>,
    readings: u32,
    /// Smallest time by which the counter ever lagged the clock [s]: that of the freshest reading.
    freshest_s: f64,
    /// When that was looked at last [s].
    looked_s: f64,
}

/// A count, all turns of the counter included, with the time of its request.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reading {
    raw: f64,
    count: f64,
    sent_s: f64,
}

impl Counter {
    /// A counter of `rate_hz` conversions a second, read every `period_s`; an infinite period where no loop runs.
    pub fn new(rate_hz: f64, period_s: f64) -> Self {
        Self { rate_hz, period_s, last: None, first: None, readings: 0, freshest_s: f64::INFINITY, looked_s: f64::INFINITY }
    }

    /// Takes the next reading, requested at `sent_s` and here at `got_s`. What is refused changes nothing, so that a device which
    /// restarted stays refused; with `rebase` the next reading is judged against this one.
    ///
    /// # Errors
    /// Why the reading is not new, in words.
    pub fn take(&mut self, raw: f64, sent_s: f64, got_s: f64, rebase: bool) -> Result<(), String> {
        let Some(last) = self.last else {
            let reading = Reading { raw, count: 0.0, sent_s };
            (self.last, self.first) = (Some(reading), Some(reading));
            return Ok(());
        };
        let moved = (raw - last.raw).rem_euclid(WIDTH);
        let reading = Reading { raw, count: last.count + moved, sent_s };
        let verdict = self.judge(&reading, moved, last.sent_s, got_s);
        if verdict.is_ok() {
            self.last = Some(reading);
            self.readings += 1;
        } else if rebase {
            *self = Self { last: Some(Reading { count: 0.0, ..reading }), ..Self::new(self.rate_hz, self.period_s) };
        }
        verdict
    }

    fn judge(&mut self, reading: &Reading, moved: f64, before_s: f64, got_s: f64) -> Result<(), String> {
        let raw = reading.raw;
        if moved == 0.0 {
            return Err(format!("the counter of conversions stands at {raw}"));
        }
        // The conversions lie between the request before and this reply; two more for the ends.
        let most = (got_s - before_s) * self.rate_hz * (1.0 + CLOCK) + 2.0;
        if moved > most && most < WIDTH - 1.0 {
            return Err(format!(
                "the counter of conversions went from {} to {raw}; in {:.1} ms it may move by {most:.0} at {} a second: an old reply, or a device that restarted",
                (raw - moved).rem_euclid(WIDTH),
                (got_s - before_s) * 1e3,
                self.rate_hz
            ));
        }
        // No conversion is later than its reply: the freshest one shows how the counter stands to the clock. It is forgotten
        // slowly, so that two clocks that differ do not make all readings old.
        let converted_s = reading.count / self.rate_hz;
        self.freshest_s = (self.freshest_s + DRIFT * (got_s - self.looked_s).max(0.0)).min(got_s - converted_s);
        self.looked_s = got_s;
        let before_request_s = reading.sent_s - converted_s - self.freshest_s;
        // The value that a device has at a request may be one conversion old, and the count is whole: half of one more.
        if self.keeps_pace(reading) && before_request_s > 1.5 / self.rate_hz {
            return Err(format!(
                "the counter of conversions at {raw} is from {:.1} ms before its request: an old reply",
                before_request_s * 1e3
            ));
        }
        Ok(())
    }

    fn keeps_pace(&self, reading: &Reading) -> bool {
        let Some(first) = self.first else { return false };
        let elapsed_s = reading.sent_s - first.sent_s;
        let known = self.period_s.is_finite() && self.readings >= PACE_AFTER.0 && elapsed_s >= PACE_AFTER.1;
        known && (reading.count / (elapsed_s * self.rate_hz) - 1.0).abs() < PACE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A loop of 100 Hz on a counter of 500 a second, whose readings are `age_s(k)` old.
    fn refused(age_s: impl Fn(u32) -> f64) -> Vec<u32> {
        let mut counter = Counter::new(500.0, 0.01);
        (0..200)
            .filter(|k| {
                let sent_s = f64::from(*k) * 0.01;
                let raw = (((sent_s + 100.0 - age_s(*k)) * 500.0).floor() + 65_000.0).rem_euclid(WIDTH);
                counter.take(raw, sent_s, sent_s + 0.003, false).is_err()
            })
            .collect()
    }

    #[test]
    fn a_fresh_counter_passes_also_over_its_end_and_after_lost_replies() {
        assert!(refused(|_| 0.0).is_empty());
        assert!(refused(|k| if k % 7 == 0 { -0.0025 } else { 0.0 }).is_empty(), "a reply that took 2.5 ms longer");
        let mut counter = Counter::new(500.0, 0.01);
        for k in [0u32, 1, 2, 3, 40, 41, 42, 43, 44, 45, 46, 47, 48, 49, 50, 51] {
            let sent_s = f64::from(k) * 0.01;
            assert_eq!(counter.take((sent_s * 500.0).floor(), sent_s, sent_s + 0.003, false), Ok(()));
        }
    }

    #[test]
    fn a_counter_that_runs_late_is_old() {
        for slots in [1.0, 3.0] {
            let late = refused(|k| if k >= 100 { slots * 0.01 } else { 0.0 });
            assert!((100..110).all(|k| late.contains(&k)), "{slots} slots: {late:?}");
            assert!(!late.iter().any(|k| *k < 100));
        }
    }

    #[test]
    fn a_counter_that_runs_backwards_stands_or_jumps_is_not_new() {
        let all = |step: f64| {
            let mut counter = Counter::new(500.0, 0.01);
            (0..50u32)
                .filter(|k| {
                    counter
                        .take((1000.0 + f64::from(*k) * step).rem_euclid(WIDTH), f64::from(*k) * 0.01, f64::from(*k) * 0.01 + 0.003, false)
                        .is_err()
                })
                .count()
        };
        assert_eq!((all(-5.0), all(0.0), all(100.0)), (49, 49, 49));
        // A counter of something else than time is new as long as it moves forwards.
        assert_eq!((all(1.0), all(5.0)), (0, 0));
    }

    #[test]
    fn a_restarted_device_stays_refused_unless_it_is_asked_anew() {
        let mut counter = Counter::new(500.0, 0.01);
        assert!(counter.take(30_000.0, 0.0, 0.003, false).is_ok());
        assert!(counter.take(3.0, 0.1, 0.103, false).is_err() && counter.take(8.0, 0.11, 0.113, false).is_err());
        assert!(counter.take(13.0, 0.12, 0.123, true).is_err() && counter.take(18.0, 0.13, 0.133, true).is_ok());
    }
}
