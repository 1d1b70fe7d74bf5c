//! What a recording holds before anything is fitted: noise, outliers, flat bottom and top, covered range, directions.

use super::segment::{Segment, shortest_step_s};
use super::settled::{Look, STEADY_HALF_WINDOW, Seen, sorted, used};

/// Half-width of the window of the outlier test, in samples.
const OUTLIER_HALF_WINDOW: usize = 2;
/// An outlier is this many noise deviations away from the median of its neighbours.
const OUTLIER_SIGMAS: f64 = 8.0;
/// Delay that is assumed before one is known, in samples.
const FIRST_DELAY_STEPS: f64 = 3.0;
/// A direction of the current counts after it has moved by this share of its range.
const PLAY_SHARE: f64 = 0.02;
/// A covered range that ends this share of the recorded one before it, or less, ends with it.
const HAIR_SHARE: f64 = 0.01;
/// A floor above zero is seen over this share of the range of the current.
const FLOOR_SHARE: f64 = 0.05;
/// Readings on a floor lie within three deviations of the noise, or this share of the range of the pressure.
const FLOOR_WIDTH: f64 = 1e-3;
/// And so many times as dense as those right above it: those of a current that passes are as dense there.
const DENSER: usize = 5;
/// Bins of the current in which both directions must have been seen.
pub(super) const DIRECTION_BINS: usize = 20;

/// The findings.
#[derive(Debug, Clone)]
pub(super) struct Survey {
    /// Range of the pressure, without outliers [bar].
    pub span_bar: f64,
    /// Deviation of the sensor noise [bar].
    pub noise_bar: f64,
    /// Level of a flat bottom [bar].
    pub floor_bar: Option<f64>,
    /// Level of a flat top [bar].
    pub ceiling_bar: Option<f64>,
    /// Range of all recorded currents [A].
    pub recorded_a: (f64, f64),
    /// Range of current in which the curves can be seen [A].
    pub covered_a: (f64, f64),
    /// Samples marked as outliers.
    pub outliers: usize,
    /// Samples that lie on the flat top.
    pub on_ceiling: usize,
    /// Samples that are steady enough to lie on a static curve.
    pub steady: usize,
    /// Samples with current and pressure.
    pub samples: usize,
    /// Bins of the covered current in which rising and falling currents were both seen.
    pub both_directions: usize,
    /// Median speed of the moving current [A/s].
    pub rate_a_per_s: f64,
    /// Reversals of the current by more than the play.
    pub reversals: usize,
    /// Steps: the current jumped by more than 5 % of its range from one sample to the next.
    pub steps: usize,
}

/// Looks at the segments, and sets the weight of outliers and of samples on a flat top to 0.
pub(super) fn survey(segments: &mut [Segment], noise_bar: f64) -> Survey {
    let mut pressures = sorted(segments.iter().flat_map(|s| s.pressure_bar.iter().copied()));
    let span = |p: &[f64]| quantile(p, 0.999) - quantile(p, 0.001);
    let outliers = segments.iter_mut().map(|s| mark_outliers(s, (OUTLIER_SIGMAS * noise_bar).max(0.005 * span(&pressures)))).sum();
    pressures = sorted(segments.iter().flat_map(|s| used(s).map(|k| s.pressure_bar[k])));
    let samples = pressures.len();
    let span_bar = pressures.last().copied().unwrap_or(0.0) - pressures.first().copied().unwrap_or(0.0);
    let currents = sorted(segments.iter().flat_map(|s| s.current_a.iter().copied()));
    let recorded_a = (currents.first().copied().unwrap_or(0.0), currents.last().copied().unwrap_or(0.0));
    let floor_bar = floor(segments, &pressures, noise_bar, span_bar, recorded_a);
    let ceiling_bar = ceiling(segments, &pressures, noise_bar, span_bar, recorded_a);
    let mut on_ceiling = 0;
    if let Some(level) = ceiling_bar {
        for s in segments.iter_mut() {
            for (w, p) in s.weight.iter_mut().zip(&s.pressure_bar) {
                if *w > 0.0 && *p > level - 5.0 * noise_bar - 0.002 * span_bar {
                    *w = 0.0;
                    on_ceiling += 1;
                }
            }
        }
    }
    let mut survey = Survey {
        span_bar,
        noise_bar,
        floor_bar,
        ceiling_bar,
        recorded_a,
        covered_a: recorded_a,
        outliers,
        on_ceiling,
        steady: 0,
        samples,
        both_directions: 0,
        rate_a_per_s: rate(segments, recorded_a),
        reversals: 0,
        steps: segments.iter().map(|s| jumps(&s.current_a, 0.05 * (recorded_a.1 - recorded_a.0))).sum(),
    };
    survey.cover_first(segments);
    survey
}

impl Survey {
    /// The findings with a floor at zero, where none was seen and the lowest readings could stand there: a fit tells.
    pub fn with_floor_at_zero(&self, segments: &[Segment]) -> Option<Self> {
        let pressures = sorted(segments.iter().flat_map(|s| used(s).map(|k| s.pressure_bar[k])));
        near_zero(&pressures, self.noise_bar, self.span_bar).filter(|_| self.floor_bar.is_none())?;
        let mut survey = Self { floor_bar: Some(0.0), ..self.clone() };
        survey.cover_first(segments);
        Some(survey)
    }

    /// Covers what can be covered before a delay is known.
    fn cover_first(&mut self, segments: &[Segment]) {
        let step_s = shortest_step_s(segments);
        self.cover(segments, FIRST_DELAY_STEPS * step_s, STEADY_HALF_WINDOW as f64 * step_s);
    }

    /// Pressure above which a sample shows a curve and not the floor [bar].
    pub fn above_bar(&self) -> f64 {
        self.floor_bar.map_or(f64::NEG_INFINITY, |f| f + (4.0 * self.noise_bar).max(0.003 * self.span_bar))
    }

    /// Finds the range of current in which the curves can be seen, when the pressure answers the current of `delay_s`
    /// ago and has settled after `settling_s` more.
    pub fn cover(&mut self, segments: &[Segment], delay_s: f64, settling_s: f64) {
        let above = self.above_bar();
        let tolerance_bar = (6.0 * self.noise_bar).max(0.015 * self.span_bar);
        let range_a = self.recorded_a.1 - self.recorded_a.0;
        let Seen { steady, settled, passed } =
            Look { above_bar: above, tolerance_bar, span_bar: self.span_bar, range_a, samples: self.samples }
                .at(segments, delay_s, settling_s);
        self.steady = steady;
        // Where neither floor nor ceiling hides the pressure, a current that was only passed shows its curve as well.
        let covered = (
            if self.floor_bar.is_none() { settled.0.min(passed.0) } else { settled.0 },
            if self.ceiling_bar.is_none() { settled.1.max(passed.1) } else { settled.1 },
        );
        let wide = covered.0.partial_cmp(&covered.1) == Some(std::cmp::Ordering::Less);
        self.covered_a = if wide { self.to_the_turns(covered) } else { self.recorded_a };
        (self.both_directions, self.reversals) = directions(segments, self.covered_a, above);
    }
}

impl Survey {
    /// A covered range that ends within a hair of the recorded one ends where that does: the last samples before a turn
    /// were only cut off as possible stragglers. Straight lines over that hair would change the width of the loop right
    /// at the turn, which is where a triangle shows its delay.
    fn to_the_turns(&self, (low, high): (f64, f64)) -> (f64, f64) {
        let hair = HAIR_SHARE * (self.recorded_a.1 - self.recorded_a.0);
        (
            if low - hair <= self.recorded_a.0 { self.recorded_a.0 } else { low },
            if high + hair >= self.recorded_a.1 { self.recorded_a.1 } else { high },
        )
    }
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    match sorted.len() {
        0 => 0.0,
        n => sorted[((n - 1) as f64 * share).round() as usize],
    }
}

/// Samples far from the median of their neighbours. On a monotone stretch, however steep, the median is the
/// sample itself, so that a step is never an outlier.
fn mark_outliers(s: &mut Segment, limit_bar: f64) -> usize {
    let mut count = 0;
    if limit_bar <= 0.0 {
        return 0;
    }
    for k in OUTLIER_HALF_WINDOW..s.len().saturating_sub(OUTLIER_HALF_WINDOW) {
        let mut window: [f64; 5] = std::array::from_fn(|j| s.pressure_bar[k + j - OUTLIER_HALF_WINDOW]);
        if window.iter().any(|p| !p.is_finite()) {
            continue;
        }
        window.sort_unstable_by(f64::total_cmp);
        if (s.pressure_bar[k] - window[2]).abs() > limit_bar {
            s.weight[k] = 0.0;
            count += 1;
        }
    }
    count
}

/// The level of the bottom, where the pressure stands near zero, or at one level over a range of currents, and never falls
/// below.
fn floor(segments: &[Segment], pressures: &[f64], noise_bar: f64, span_bar: f64, recorded_a: (f64, f64)) -> Option<f64> {
    let near = near_zero(pressures, noise_bar, span_bar)?;
    let lowest = quantile(pressures, 0.01);
    let bottom: Vec<f64> = pressures.iter().copied().take_while(|p| *p < lowest + near).collect();
    let level = quantile(&bottom, 0.5);
    if level.abs() < (3.0 * noise_bar).max(0.05) {
        return Some(0.0);
    }
    // Few readings stand on a floor at zero where a step test was there once: they lie closer together than what is right above.
    let narrow = (3.0 * noise_bar).max(FLOOR_WIDTH * span_bar);
    let below = |bar: f64| pressures.partition_point(|p| *p < bar);
    let (on_floor, above) = (below(lowest + narrow), below(lowest + 2.0 * narrow) - below(lowest + narrow));
    if on_floor > DENSER * above && quantile(&pressures[..on_floor], 0.5).abs() < 3.0 * noise_bar {
        return Some(0.0);
    }
    // The lowest level of a step test stands too, but at one current.
    let on = |s: &Segment, k: usize| (s.pressure_bar[k] - level).abs() < 3.0 * noise_bar;
    let currents = sorted(segments.iter().flat_map(|s| used(s).filter(move |k| on(s, *k)).map(|k| s.current_a[k])));
    let wide = quantile(&currents, 0.95) - quantile(&currents, 0.05);
    (wide > FLOOR_SHARE * (recorded_a.1 - recorded_a.0)).then_some(level)
}

/// How near to zero the lowest readings are, if they could stand there [bar].
fn near_zero(pressures: &[f64], noise_bar: f64, span_bar: f64) -> Option<f64> {
    let lowest = quantile(pressures, 0.01);
    let near = 6.0 * noise_bar + 0.005 * span_bar;
    (-near..=near.max(0.015 * span_bar)).contains(&lowest).then_some(near)
}

/// The level of the top, where the pressure stands still while the current moves on.
fn ceiling(segments: &[Segment], pressures: &[f64], noise_bar: f64, span_bar: f64, recorded_a: (f64, f64)) -> Option<f64> {
    let top = quantile(pressures, 0.995);
    let from = top - (5.0 * noise_bar).max(0.005 * span_bar);
    let mut points: Vec<(f64, f64)> =
        segments.iter().flat_map(|s| used(s).map(|k| (s.current_a[k], s.pressure_bar[k]))).filter(|(_, p)| *p > from).collect();
    points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let n = points.len();
    if n < 50 {
        return None;
    }
    let (low, high) = (points[n / 20].0, points[n - 1 - n / 20].0);
    let half = |part: &[(f64, f64)]| quantile(&sorted(part.iter().map(|p| p.1)), 0.5);
    let (lower, upper) = (half(&points[n / 20..n / 2]), half(&points[n / 2..n - n / 20]));
    let flat = high - low > 0.08 * (recorded_a.1 - recorded_a.0) && (upper - lower).abs() < (1.5 * noise_bar).max(0.002 * span_bar);
    // On a true ceiling nearly every sample above that current lies; after a delay or a lag many do not.
    let begin = points[n / 5].0;
    let beyond = segments.iter().flat_map(|s| used(s).map(|k| (s.current_a[k], s.pressure_bar[k]))).filter(|(i, _)| *i > begin);
    let (on, all) = beyond.fold((0usize, 0usize), |(on, all), (_, p)| (on + usize::from(p > from), all + 1));
    (flat && on * 10 >= all * 9).then(|| half(&points[n / 20..]))
}

/// State of a play operator of the width `2 radius`, scaled to -1 (falling) to 1 (rising).
pub(super) fn play(current_a: &[f64], radius_a: f64) -> Vec<f64> {
    let Some(mut center) = current_a.first().copied() else { return Vec::new() };
    current_a
        .iter()
        .map(|i| {
            center = center.clamp(i - radius_a, i + radius_a);
            (i - center) / radius_a
        })
        .collect()
}

/// Bins of the covered current seen in both directions, and reversals by more than the play.
fn directions(segments: &[Segment], covered_a: (f64, f64), above_bar: f64) -> (usize, usize) {
    let width = covered_a.1 - covered_a.0;
    let (mut rising, mut falling) = ([0usize; DIRECTION_BINS], [0usize; DIRECTION_BINS]);
    let mut reversals = 0;
    for s in segments {
        let states = play(&s.current_a, PLAY_SHARE * width);
        let mut last = 0.0;
        for (k, state) in states.iter().enumerate() {
            if state.abs() < 0.999 {
                continue;
            }
            if last * state < 0.0 {
                reversals += 1;
            }
            last = *state;
            let place = (s.current_a[k] - covered_a.0) / width;
            if s.weight[k] > 0.0 && s.pressure_bar[k] > above_bar && (0.0..=1.0).contains(&place) {
                let bin = ((place * DIRECTION_BINS as f64) as usize).min(DIRECTION_BINS - 1);
                if *state > 0.0 {
                    rising[bin] += 1;
                } else {
                    falling[bin] += 1;
                }
            }
        }
    }
    ((0..DIRECTION_BINS).filter(|b| rising[*b] >= 5 && falling[*b] >= 5).count(), reversals)
}

/// Median speed where the current moves [A/s].
fn rate(segments: &[Segment], recorded_a: (f64, f64)) -> f64 {
    let still = 1e-5 * (recorded_a.1 - recorded_a.0);
    let speeds = segments.iter().flat_map(|s| {
        s.current_a
            .windows(2)
            .zip(s.time_s.windows(2))
            .filter(move |(i, _)| (i[1] - i[0]).abs() > still)
            .map(|(i, t)| (i[1] - i[0]).abs() / (t[1] - t[0]))
    });
    quantile(&sorted(speeds), 0.5)
}

fn jumps(current_a: &[f64], size_a: f64) -> usize {
    current_a.windows(2).filter(|w| (w[1] - w[0]).abs() > size_a).count()
}

/// Different levels of current at which a steady pressure was seen, at most one per hundredth of the covered range:
/// a curve of order n needs n + 1 of them.
pub(super) fn levels(segments: &[Segment], survey: &Survey) -> usize {
    const BINS: usize = 100;
    let (low, high) = survey.covered_a;
    let above = survey.above_bar();
    let mut seen = [0usize; BINS + 1];
    for s in segments {
        for k in used(s).filter(|k| s.pressure_bar[*k] > above) {
            let place = (s.current_a[k] - low) / (high - low);
            if (0.0..=1.0).contains(&place) {
                seen[(place * BINS as f64).round() as usize] += 1;
            }
        }
    }
    // Neighbouring bins are one level unless the current swept through them.
    let filled = seen.iter().filter(|n| **n >= 3).count();
    let groups = seen.windows(2).filter(|w| w[0] < 3 && w[1] >= 3).count() + usize::from(seen[0] >= 3);
    if filled > 4 * groups { filled } else { groups }
}
