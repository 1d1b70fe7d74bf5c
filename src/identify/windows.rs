//! Long recordings: one reading of several, or windows that together show every current, in both directions, slow and fast.
//!
//! Some minutes at 1 kHz hold more readings than a fit needs, but not more turns: there, each tenth of a second tells of the valve what
//! a hundred readings of it do, and all of the recording stays. A day at 100 Hz holds hundreds of times what a fit needs. Windows are
//! taken greedily, each time the one that shows most of what the windows before it did not. The model that either gives is then judged
//! on all samples.

use std::borrow::Cow;
use std::ops::Range;

use super::segment::Segment;
use crate::course::{Course, Run};
use crate::valve::Input;

/// Recordings up to this many samples are fitted whole.
pub(super) const WHOLE: usize = 60_000;
/// And longer ones by one reading of several, these no farther apart: as valves are recorded [s].
const COARSEST_S: f64 = 0.01;
/// Samples of one window, and at most so many are simulated before it.
const WINDOW: usize = 2_500;
/// Windows that are taken.
const WINDOWS: usize = 16;
/// Bins of the current.
const BINS: usize = 20;
/// Kinds of movement: slow up, slow down, fast up, fast down.
const KINDS: usize = 4;
/// Samples simulated before a piece counts, when all samples are judged.
const RUN_UP: usize = 3_000;
/// Samples judged at a time.
const PIECE: usize = 1_000_000;

/// What is fitted of the recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Taken {
    /// All of them.
    All,
    /// One reading of so many, where the rate is the highest.
    Every(usize),
    /// Windows, of one reading of so many, where the rate is the highest.
    Windows(usize),
}

impl Taken {
    /// Whether readings between others were left out.
    pub fn is_thinned(self) -> bool {
        matches!(self, Self::Every(_)) || matches!(self, Self::Windows(every) if every > 1)
    }
}

/// The segments to fit, and what they are of the recordings; `input`: what the command does between its samples.
pub(super) fn segments(courses: &[Course], input: Input) -> (Vec<Segment>, Taken) {
    let samples = |every: usize| runs(courses).map(|(_, run)| run.len().div_ceil(every_of(run, every))).sum::<usize>();
    if samples(1) <= WHOLE {
        return (all(courses), Taken::All);
    }
    let most = runs(courses).map(|(_, run)| every_of(run, usize::MAX)).max().unwrap_or(1);
    if samples(most) > WHOLE {
        return (windowed(courses, input), Taken::Windows(most));
    }
    // The finest that will do: fewer remain of coarser ones.
    let (mut too_fine, mut every) = (1, most);
    while every - too_fine > 1 {
        let middle = too_fine + (every - too_fine) / 2;
        if samples(middle) > WHOLE {
            too_fine = middle;
        } else {
            every = middle;
        }
    }
    let thinned = |(source, run): (usize, &Run)| {
        let run = run.thinned(every_of(run, every), input);
        Segment::from_run(source, &run, 0..run.len())
    };
    (runs(courses).filter_map(thinned).filter(|s| s.len() >= 5).collect(), Taken::Every(every))
}

/// All of the recordings.
pub(super) fn all(courses: &[Course]) -> Vec<Segment> {
    runs(courses).filter_map(|(source, run)| Segment::from_run(source, run, 0..run.len())).filter(|s| s.len() >= 5).collect()
}

/// One reading of how many remains of a run where one of `every` would do.
fn every_of(run: &Run, every: usize) -> usize {
    every.min((COARSEST_S / run.dt_s + 1e-6) as usize).max(1)
}

/// A run of which as many readings are left out as may be.
fn coarsest(run: &Run, input: Input) -> Cow<'_, Run> {
    match every_of(run, usize::MAX) {
        1 => Cow::Borrowed(run),
        every => Cow::Owned(run.thinned(every, input)),
    }
}

/// Windows of the recordings, of readings no closer together than they have to be.
fn windowed(courses: &[Course], input: Input) -> Vec<Segment> {
    let (low, high) = range(courses);
    let mut windows: Vec<(usize, Range<usize>)> = Vec::new();
    let runs: Vec<(usize, Cow<'_, Run>)> = runs(courses).map(|(source, run)| (source, coarsest(run, input))).collect();
    for (k, (_, run)) in runs.iter().enumerate() {
        let mut from = 0;
        while from < run.len() {
            let to = (from + WINDOW).min(run.len());
            if to - from >= WINDOW / 4 {
                windows.push((k, from..to));
            }
            from = to;
        }
    }
    let shown: Vec<[u32; BINS * KINDS]> = windows.iter().map(|(k, w)| shown(&runs[*k].1, w, low, high)).collect();
    let mut count = [0.0f64; BINS * KINDS];
    let mut taken: Vec<usize> = Vec::new();
    while taken.len() < WINDOWS.min(windows.len()) {
        let worth = |n: usize| -> f64 {
            // Twenty samples of a kind are as good as more; what was seen often is worth little.
            shown[n].iter().zip(&count).map(|(s, c)| f64::from((*s).min(20)) / ((1.0 + c) * (1.0 + c))).sum()
        };
        let free = (0..windows.len()).filter(|n| !taken.contains(n));
        let Some(best) = free.max_by(|a, b| worth(*a).total_cmp(&worth(*b)).then(b.cmp(a))) else { break };
        for (c, s) in count.iter_mut().zip(&shown[best]) {
            *c += f64::from(*s) / 20.0;
        }
        taken.push(best);
    }
    taken.sort_unstable();
    let chosen = taken.iter().filter_map(|n| {
        let (number, window) = &windows[*n];
        let (source, run) = &runs[*number];
        let begin = window.start.saturating_sub(WINDOW);
        let mut segment = Segment::from_run(*source, run, begin..window.end)?;
        // What came before the window is simulated, and does not count: so nothing depends on where the valve stood then.
        let before = segment.len().saturating_sub(window.len());
        segment.weight[..before].fill(0.0);
        Some(segment)
    });
    chosen.filter(|s| s.len() >= 5).collect()
}

/// The runs of all recordings, each with the number of its recording.
fn runs(courses: &[Course]) -> impl Iterator<Item = (usize, &Run)> {
    courses.iter().enumerate().flat_map(|(source, r)| r.runs.iter().map(move |run| (source, run)))
}

/// Range of the recorded currents [A].
pub(super) fn range(courses: &[Course]) -> (f64, f64) {
    let wide = |(low, high): (f64, f64), (l, h): (f64, f64)| (low.min(l), high.max(h));
    courses.iter().map(Course::current_range_a).fold((f64::INFINITY, f64::NEG_INFINITY), wide)
}

/// How many samples of each kind of movement in each bin of the current a window holds.
fn shown(run: &Run, window: &Range<usize>, low: f64, high: f64) -> [u32; BINS * KINDS] {
    let mut out = [0; BINS * KINDS];
    let span = (high - low).max(f64::MIN_POSITIVE);
    let moves = run.current_a[window.clone()].windows(2).zip(&run.pressure_bar[window.start + 1..window.end]);
    for (pair, pressure_bar) in moves {
        let now = pair[1];
        let change = (now - pair[0]) / span;
        if !pressure_bar.is_finite() || change.is_nan() || change == 0.0 {
            continue;
        }
        let bin = (((now - low) / span * BINS as f64) as usize).min(BINS - 1);
        let kind = usize::from(change < 0.0) + 2 * usize::from(change.abs() > 0.02);
        out[KINDS * bin + kind] += 1;
    }
    out
}

/// Calls `with` for pieces of all runs: the piece with its run-up, and the number of samples that belong to the run-up.
pub(super) fn pieces(courses: &[Course], mut with: impl FnMut(&Segment, usize)) {
    for (source, run) in runs(courses) {
        let mut from = 0;
        while from < run.len() {
            let to = (from + PIECE).min(run.len());
            let begin = from.saturating_sub(RUN_UP);
            if let Some(segment) = Segment::from_run(source, run, begin..to) {
                // The segment may begin later, at the first sample that holds both channels.
                let dropped = (to - begin) - segment.len();
                with(&segment, (from - begin).saturating_sub(dropped));
            }
            from = to;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::course::Preparation;
    use crate::recording::{self, Recording};

    fn course(current_a: Vec<f64>) -> [Course; 1] {
        let time_s = (0..current_a.len()).map(|k| k as f64 * 0.01).collect();
        let run = recording::Run { time_s, pressure_bar: Some(current_a.clone()), current_a, ..recording::Run::default() };
        [Course::take(Recording { runs: vec![run], ..Recording::default() }, &Preparation::default()).unwrap()]
    }

    #[test]
    fn the_only_window_that_moves_is_taken_first_and_a_short_recording_is_taken_whole() {
        let current: Vec<f64> =
            (0..200_000).map(|k| if (100_000..102_000).contains(&k) { 0.3 + 0.2 * (k as f64 * 0.01).sin() } else { 0.3 }).collect();
        let (chosen, taken) = segments(&course(current.clone()), Input::Ramp);
        assert!(taken == Taken::Windows(1) && chosen.len() == WINDOWS);
        assert!(chosen.iter().any(|s| s.time_s[0] <= 1000.0 && s.time_s[s.len() - 1] >= 1000.0));
        assert_eq!(segments(&course(current[..1000].to_vec()), Input::Ramp).1, Taken::All);
    }

    #[test]
    fn of_fast_recordings_so_many_readings_remain_as_are_fitted_whole() {
        let at = |step_s: f64, samples: usize| {
            let time_s = (0..samples).map(|k| k as f64 * step_s).collect();
            let current_a: Vec<f64> = (0..samples).map(|k| 0.3 + 0.2 * (k as f64 * step_s).sin()).collect();
            let run = recording::Run { time_s, pressure_bar: Some(current_a.clone()), current_a, ..recording::Run::default() };
            Course::take(Recording { runs: vec![run], ..Recording::default() }, &Preparation::default()).unwrap()
        };
        let lengths = |courses: &[Course]| {
            let (segments, taken) = segments(courses, Input::Ramp);
            (segments.iter().map(Segment::len).collect::<Vec<_>>(), taken)
        };
        assert_eq!(lengths(&[at(0.001, WHOLE + 2)]), (vec![WHOLE / 2 + 1], Taken::Every(2)));
        // A slow one stays as it is beside a fast one.
        assert_eq!(lengths(&[at(0.001, 200_000), at(0.01, 12_000)]), (vec![40_000, 12_000], Taken::Every(5)));
        assert_eq!(lengths(&[at(0.004, 2 * WHOLE + 2), at(0.01, 10)]).1, Taken::Windows(2));
        // Windows of what remains of a longer one are as long as those of a slower one.
        let (longer, taken) = segments(&[at(0.001, 11 * WHOLE)], Input::Ramp);
        assert!(taken == Taken::Windows(10) && longer.iter().all(|s| (s.step_s - 0.01).abs() < 1e-9), "{taken:?}");
    }

    #[test]
    fn pieces_cover_every_sample_once() {
        let n = 2 * PIECE + 1;
        let mut seen = 0;
        pieces(&course(vec![0.5; n]), |s, skip| seen += s.len() - skip);
        assert_eq!(seen, n);
    }
}
