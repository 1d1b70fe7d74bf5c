//! At which currents the readings show the static curves: where they stand still, and where they go along them.

use super::segment::Segment;
use crate::valve::Input;

/// Half-width of the steadiness test, in samples.
pub(super) const STEADY_HALF_WINDOW: usize = 5;
/// The current is still where it moves by less than this share of its range while the pressure settles,
const STILL_SHARE: f64 = 0.02;
/// and the pressure goes along a curve, a little behind, where the current moves by less than this share on a straight line meanwhile.
const ALONG_SHARE: f64 = 0.1;
/// What goes along counts where what stands still leaves out more than this share of the range: of ramps of which a slow logger leaves
/// ten readings a second, none stands still.
const LEFT_OUT_SHARE: f64 = 0.05;
/// A curve is so many times as steep as its mean, at most.
const STEEPEST: f64 = 2.0;

/// How the readings are looked at.
pub(super) struct Look {
    /// Pressure above which a reading shows a curve and not the floor [bar].
    pub above_bar: f64,
    /// By how much a pressure that stands still may change [bar].
    pub tolerance_bar: f64,
    /// Range of the pressure [bar].
    pub span_bar: f64,
    /// Range of the current [A].
    pub range_a: f64,
    /// Readings that count.
    pub samples: usize,
}

/// What they show.
pub(super) struct Seen {
    /// How many stand still.
    pub steady: usize,
    /// From which current to which one they lie on the curves, as far as readings above the floor tell; not a number where none does [A].
    pub settled: (f64, f64),
    /// Between which currents all that count lie [A].
    pub passed: (f64, f64),
}

impl Look {
    /// What the readings show, when the pressure answers the current of `delay_s` ago and has settled after `settling_s` more.
    pub fn at(&self, segments: &[Segment], delay_s: f64, settling_s: f64) -> Seen {
        let is_steady = |s: &Segment, k: usize| s.weight[k] > 0.0 && change_bar(s, k).is_some_and(|change| change < self.tolerance_bar);
        let steady = segments.iter().map(|s| (0..s.len()).filter(|k| is_steady(s, *k)).count()).sum();
        let enough = steady * 10 > self.samples;
        let (mut still, mut along, mut passed) = (Vec::new(), Vec::new(), Vec::new());
        for s in segments {
            let felt = Felt::of(s, delay_s, settling_s, self.range_a);
            let is_still = |k: usize| !enough || is_steady(s, k) && felt.moved(k) <= STILL_SHARE;
            let above: Vec<usize> = used(s).filter(|k| s.pressure_bar[*k] > self.above_bar).collect();
            still.extend(above.iter().filter(|k| is_still(**k)).map(|k| felt.now[*k]));
            along.extend(above.iter().filter(|k| self.goes_along(s, &felt, **k)).map(|k| felt.now[*k]));
            passed.extend(used(s).map(|k| felt.now[k]));
        }
        let (still, along, passed) = (ends(still), ends(along), ends(passed));
        let left_out = LEFT_OUT_SHARE * self.range_a;
        let settled =
            (if along.0 < still.0 - left_out { along.0 } else { still.0 }, if along.1 > still.1 + left_out { along.1 } else { still.1 });
        Seen { steady, settled, passed }
    }

    /// Whether the current moves evenly and slowly, and the pressure by no more than that asks of it.
    fn goes_along(&self, s: &Segment, felt: &Felt, k: usize) -> bool {
        let bar_per_a = STEEPEST * self.span_bar / self.range_a;
        let asked = || bar_per_a * (felt.now[k + STEADY_HALF_WINDOW] - felt.now[k - STEADY_HALF_WINDOW]).abs();
        let follows = || change_bar(s, k).is_some_and(|change| change < self.tolerance_bar + asked());
        felt.moved(k) <= ALONG_SHARE && felt.bend(k) <= STILL_SHARE && follows()
    }
}

/// The current that the pressure answers at each sample, and those of half the time and all of it that the pressure takes to settle
/// before [A].
struct Felt {
    now: Vec<f64>,
    middle: Vec<f64>,
    before: Vec<f64>,
    range_a: f64,
}

impl Felt {
    fn of(s: &Segment, delay_s: f64, settling_s: f64, range_a: f64) -> Self {
        let [now, middle, before] = [0.0, 0.5, 1.0].map(|share| {
            let mut current_a = vec![0.0; s.len()];
            s.delayed(delay_s + share * settling_s, Input::Held, &mut current_a);
            current_a
        });
        Self { now, middle, before, range_a }
    }

    /// By which share of its range the current has moved meanwhile.
    fn moved(&self, k: usize) -> f64 {
        (self.now[k] - self.before[k]).abs() / self.range_a
    }

    /// By which share of its range it has moved more in one half than in the other: a step all in one.
    fn bend(&self, k: usize) -> f64 {
        (2.0 * self.middle[k] - self.now[k] - self.before[k]).abs() / self.range_a
    }
}

/// By how much the pressure changes about a sample, where there are as many on both sides [bar].
fn change_bar(s: &Segment, k: usize) -> Option<f64> {
    let end = s.pressure_bar.get(k + STEADY_HALF_WINDOW)?;
    Some((end - s.pressure_bar[k.checked_sub(STEADY_HALF_WINDOW)?]).abs())
}

/// The lowest and the highest value without a thousandth of them.
fn ends(values: Vec<f64>) -> (f64, f64) {
    let sorted = sorted(values);
    (nth(&sorted, sorted.len() / 1000), nth(&sorted, sorted.len().saturating_sub(1 + sorted.len() / 1000)))
}

/// The value at a rank, at least four samples away from both ends, so that a straggler decides nothing.
fn nth(sorted: &[f64], rank: usize) -> f64 {
    let last = sorted.len().saturating_sub(1);
    let margin = 4.min(last / 2);
    sorted.get(rank.clamp(margin, last - margin)).copied().unwrap_or(f64::NAN)
}

/// The samples that count.
pub(super) fn used(s: &Segment) -> impl Iterator<Item = usize> + '_ {
    (0..s.len()).filter(|k| s.weight[*k] > 0.0)
}

/// The finite values in order.
pub(super) fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut v: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    v.sort_unstable_by(f64::total_cmp);
    v
}
