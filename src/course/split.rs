//! Where a run is split: the one rule for gaps.
//!
//! Between two recorded commands the command is known by the convention of the input, as long as no message is missing for
//! long. After many missing messages it may have been anywhere, and with it the hysteresis: there the run ends, and what
//! follows starts anew. How long is long is told by the messages around: the same file may change its rate. A pressure
//! that is missing splits nothing, since a simulation does not need it.

use std::ops::Range;

use crate::recording::Run;

/// So many usual steps without a command are a gap that splits. A tenth of a second and more at 100 Hz is longer than a
/// valve's delay and lag together, so nothing that the valve does after it can be told from what is known before.
const LONG_GAP: f64 = 20.0;
/// Steps that say what is usual.
const AROUND: usize = 11;
/// Steps that must be shorter before the rate counts as changed: one short step is a message that came late.
const AHEAD: usize = 5;
/// A command that stands at the same value before and after messages are missing, while readings go on, has rested: a
/// logger that writes changes only. The same is within this share of the run's range.
const RESTED: f64 = 0.02;

/// How a run is split.
pub struct Parts {
    /// The samples of each part.
    pub samples: Vec<Range<usize>>,
    /// The longest gap that splits [s].
    pub longest_gap_s: f64,
    /// Readings of the pressure outside of all parts.
    pub outside: usize,
}

/// Splits the samples `within` of a run at its long gaps.
pub fn parts(run: &Run, within: Range<usize>) -> Parts {
    let known = |k: &usize| run.current_a[*k].is_finite();
    let Some(first) = within.clone().find(known) else {
        return Parts { samples: Vec::new(), longest_gap_s: 0.0, outside: readings(run, within) };
    };
    let rested = RESTED * range(&run.current_a[within.clone()]);
    let mut usual = Usual::new(run, first, within.end);
    let (mut samples, mut longest_gap_s, mut outside) = (Vec::new(), 0.0f64, readings(run, within.start..first));
    let (mut from, mut last) = (first, first);
    for k in (first + 1..within.end).filter(known) {
        let step_s = run.time_s[k] - run.time_s[last];
        let splits = usual.is_broken_by(step_s, run, k, within.end);
        let rests = k > last + 1 && (run.current_a[k] - run.current_a[last]).abs() <= rested;
        if splits && !rests {
            samples.push(from..last + 1);
            outside += readings(run, last + 1..k);
            longest_gap_s = longest_gap_s.max(step_s);
            from = k;
            usual = Usual::new(run, k, within.end);
        } else if !splits {
            usual.add(step_s);
        }
        last = k;
    }
    // Behind the last command it stands for as long as a gap may be.
    let end_s = run.time_s[last] + LONG_GAP * usual.step_s();
    let end = last + 1 + run.time_s[last + 1..within.end].partition_point(|t| *t <= end_s);
    samples.push(from..end);
    outside += readings(run, end..within.end);
    Parts { samples, longest_gap_s, outside }
}

fn readings(run: &Run, samples: Range<usize>) -> usize {
    run.pressure_bar.as_ref().map_or(0, |p| p[samples].iter().filter(|p| p.is_finite()).count())
}

fn range(values: &[f64]) -> f64 {
    let (low, high) = values.iter().filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    (high - low).max(0.0)
}

/// The usual time from one command to the next, from the last few.
struct Usual {
    last: [f64; AROUND],
    count: usize,
    median_s: f64,
}

impl Usual {
    /// From the commands that follow sample `from`.
    fn new(run: &Run, from: usize, end: usize) -> Self {
        let mut usual = Self { last: [0.0; AROUND], count: 0, median_s: 0.0 };
        usual.median_s = ahead(run, from, end, AROUND);
        usual
    }

    fn step_s(&self) -> f64 {
        self.median_s
    }

    fn add(&mut self, step_s: f64) {
        self.last[self.count % AROUND] = step_s;
        self.count += 1;
        // The median is sought again only where a step differs from it.
        if self.count >= AROUND && !(0.7..1.4).contains(&(step_s / self.median_s)) {
            let mut sorted = self.last;
            sorted.sort_unstable_by(f64::total_cmp);
            self.median_s = sorted[AROUND / 2];
        }
    }

    /// Whether a step to sample `k` is a long gap, or the first of steps that are so much shorter that another recording
    /// begins here.
    fn is_broken_by(&self, step_s: f64, run: &Run, k: usize, end: usize) -> bool {
        if self.median_s <= 0.0 {
            return false;
        }
        // The commands that follow may come as slowly: then this is no gap but the end of a faster stretch.
        let ratio = step_s / self.median_s;
        ratio > LONG_GAP || (ratio < 1.0 / LONG_GAP && ahead(run, k, end, AHEAD) < self.median_s / LONG_GAP)
    }
}

/// The median time between the `count` commands that follow sample `from` [s]; 0 where none follows.
fn ahead(run: &Run, from: usize, end: usize, count: usize) -> f64 {
    let mut times = (from..end).filter(|k| run.current_a[*k].is_finite()).map(|k| run.time_s[k]).take(count + 1);
    let Some(mut last) = times.next() else { return 0.0 };
    let mut steps: Vec<f64> = times
        .map(|t| {
            let before = std::mem::replace(&mut last, t);
            t - before
        })
        .collect();
    steps.sort_unstable_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}
