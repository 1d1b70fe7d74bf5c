//! A sticking spool, told by its rests: while the current goes one way the pressure stands, jumps, and stands again, each time
//! after the same way of the current. Where it slips is chance, so that no free simulation keeps step with it; that it rests
//! and jumps is not.
//!
//! Each stretch over which the current goes one way is parted into levels and held against a smooth function of the simulated
//! pressure, and against a line from level to level, which needs no model.

use std::f64::consts::TAU;
use std::ops::Range;

use super::effect::{Scatter, ScatterFinding};
use super::levels::{from_level_to_level, levels, smooth};
use super::monotone::monotone;

/// Share of the current's span that is no turn.
const TURN: f64 = 0.002;
/// Most points of a stretch; more are averaged.
const POINTS: usize = 1500;
/// Most readings that count as one.
const TAU_SAMPLES: f64 = 6.0;
/// A jump has ended after so many lags of the valve.
const LAGS: f64 = 3.0;
/// Most paces of the current up to which it is tried whether it shows.
const PACES: usize = 100;
/// Least gain of likelihood over a smooth course [nats]: a hundred to one among so many.
const LEAST_NATS: f64 = 10.0;
/// Fewest slips from one rest to the next.
const FEWEST_SLIPS: usize = 4;
/// At rest the pressure goes less than this share of its way from level to level, two standard errors allowed: a course that goes on
/// goes all of it, whatever the model makes of it.
const RESTS: f64 = 0.3;
/// Jumps against the movement, as a share of those along it.
const AGAINST: f64 = 0.1;
/// The jumps make up this share of the way at least.
const WAY: f64 = 0.5;
/// Spread of the ways of the current from jump to jump, as a share of their median: one friction lets go after one way.
const ALIKE: f64 = 0.35;
/// Share of equal neighbouring readings beyond which the sensor holds its value.
const HELD: f64 = 0.5;
/// Jumps that stand on one lattice of the current, from so many stretches on and with this resultant length: steps of the driver.
const LATTICE: (usize, f64) = (4, 0.8);

/// The sticking in a recording, where there is one: band, share of it left after a slip and pace, as `stiction` has them.
pub(super) fn stick_slip(of: &Scatter<'_>) -> Option<ScatterFinding> {
    if held(of.measured_bar) > HELD {
        return None;
    }
    let mut courses: Vec<Course> = of.runs.iter().flat_map(|run| courses(of, run)).collect();
    courses.sort_by(|a, b| a.pace.total_cmp(&b.pace));
    // It shows up to some pace of the current, beyond which the spool slides on, or slips faster than the readings tell.
    let slowest = (1..=courses.len()).rev().step_by(courses.len().div_ceil(PACES).max(1));
    let sticking = slowest.filter_map(|count| Sticking::on(&courses[..count], of));
    let found = sticking.max_by(|a, b| a.nats.total_cmp(&b.nats))?;
    if of_the_driver(&courses, found.slip_a) {
        return None;
    }
    let courses = found.courses;
    let [(band_a, band_error_a), (left, left_error)] = band(courses, (found.slip_a, found.error_a));
    let mut steps: Vec<f64> = courses.iter().flat_map(|c| c.steps_bar.iter().map(|s| s.abs())).collect();
    let (step_bar, _) = median_and_spread(&mut steps);
    let mut spread_bar = vec![0.0; of.measured_bar.len()];
    // A sawtooth of that height.
    courses.iter().for_each(|c| spread_bar[c.samples.clone()].fill(step_bar / 12f64.sqrt()));
    Some(ScatterFinding {
        theta: vec![band_a, left, 100.0],
        std_errors: vec![band_error_a, left_error, f64::NAN],
        gain_nats: found.nats,
        masked: Vec::new(),
        spread_bar,
        shows_up_to_a_per_s: courses.last().map(|c| c.pace),
        is_event: true,
        evidence: format!(
            "where the current goes one way at up to {:.3} A/s the pressure rests and jumps: {} times by {:.2} bar after {:.1} mA each, and between jumps it goes {:.0} % of its way (the augmented model is without it: where the spool slips is chance)",
            courses.last().map_or(0.0, |c| c.pace),
            steps.len(),
            step_bar,
            1e3 * found.slip_a,
            100.0 * found.moved.max(0.0)
        ),
        ..ScatterFinding::default()
    })
}

/// Stretches on which the spool sticks.
struct Sticking<'c> {
    courses: &'c [Course],
    nats: f64,
    /// Way of the current from jump to jump and the error of its median [A].
    slip_a: f64,
    error_a: f64,
    /// What the pressure goes at rest, as a share of its way from level to level.
    moved: f64,
}

impl<'c> Sticking<'c> {
    fn on(courses: &'c [Course], of: &Scatter<'_>) -> Option<Self> {
        let sum = |of: fn(&Course) -> f64| courses.iter().map(of).sum::<f64>();
        let nats = sum(|c| c.nats);
        let (along, against) = (sum(|c| c.jumps(1.0)), sum(|c| c.jumps(-1.0)));
        let (moved, error) = moved(courses, of.noise_bar);
        let mut slips: Vec<f64> = courses.iter().flat_map(|c| c.at_a.windows(2).map(|w| (w[1] - w[0]).abs())).collect();
        if nats < LEAST_NATS
            || slips.len() < FEWEST_SLIPS
            || moved.abs() + 2.0 * error > RESTS
            || against > AGAINST * along
            || along < WAY * sum(|c| c.way_bar)
        {
            return None;
        }
        let (slip_a, spread_a) = median_and_spread(&mut slips);
        let error_a = spread_a / (slips.len() as f64).sqrt();
        (spread_a <= ALIKE * slip_a).then_some(Self { courses, nats, slip_a, error_a, moved })
    }
}

/// What the pressure goes at rest, as a share of its way from level to level, with its error: each stretch counts by its travel, as a
/// spool that sticks sticks on all that are as slow, however many readings and large steps one of them has.
fn moved(courses: &[Course], noise_bar: f64) -> (f64, f64) {
    let (mut sum, mut squared, mut travel_a) = (0.0, 0.0, 0.0);
    for course in courses.iter().filter(|c| c.inner.1 > 0.0) {
        sum += course.travel_a * course.inner.0 / course.inner.1;
        squared += (course.travel_a * noise_bar).powi(2) * TAU_SAMPLES / course.inner.1;
        travel_a += course.travel_a;
    }
    if travel_a > 0.0 { (sum / travel_a, squared.sqrt() / travel_a) } else { (1.0, 0.0) }
}

/// What recordings of the good valve say for sticking [nats]: against it only where they move as slowly and do not show it.
pub(super) fn stick_slip_elsewhere(found: &ScatterFinding, of: &Scatter<'_>) -> f64 {
    let most = found.shows_up_to_a_per_s.unwrap_or(f64::INFINITY);
    let would_show = |c: &Course| c.travel_a > (FEWEST_SLIPS + 1) as f64 * found.theta[0] && c.pace <= most;
    let against: f64 = of.runs.iter().flat_map(|run| courses(of, run)).filter(would_show).map(|c| c.nats).sum();
    if against < -LEAST_NATS { against } else { LEAST_NATS }
}

/// A stretch over which the current goes one way.
struct Course {
    samples: Range<usize>,
    /// Mean pace of the current [A/s] and its travel [A].
    pace: f64,
    travel_a: f64,
    /// Which way the current goes.
    sign: f64,
    /// The way that the pressure should go [bar].
    way_bar: f64,
    /// Gain of the likelihood by levels over a smooth course [nats].
    nats: f64,
    /// Current at each jump [A], and the steps of the pressure along the movement [bar].
    at_a: Vec<f64>,
    steps_bar: Vec<f64>,
    /// What the pressure goes within its levels: see [`inner`].
    inner: (f64, f64),
}

impl Course {
    /// The jumps of one sign [bar].
    fn jumps(&self, sign: f64) -> f64 {
        self.steps_bar.iter().map(|s| (sign * s).max(0.0)).sum()
    }
}

/// The stretches of one run on which something may be told.
fn courses(of: &Scatter<'_>, run: &Range<usize>) -> Vec<Course> {
    let late = (of.delay_s / of.dt_s).round().max(0.0) as usize;
    let current_a = &of.current_a[run.start..run.end.saturating_sub(late).max(run.start)];
    let (low, high) = current_a.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), i| (l.min(*i), h.max(*i)));
    let one = |s: Range<usize>| course(of, &current_a[s.clone()], run.start + late + s.start..run.start + late + s.end);
    monotone(current_a, TURN * (high - low), of.dt_s).into_iter().filter_map(one).collect()
}

fn course(of: &Scatter<'_>, current_a: &[f64], samples: Range<usize>) -> Option<Course> {
    let each = samples.len().div_ceil(POINTS);
    let mean = |values: &[f64]| values.chunks_exact(each).map(|c| c.iter().sum::<f64>() / each as f64).collect::<Vec<f64>>();
    let (measured, simulated) = (mean(&of.measured_bar[samples.clone()]), mean(&of.simulated_bar[samples.clone()]));
    let at_a = mean(current_a);
    let count = measured.len();
    if measured.iter().any(|y| !y.is_finite()) {
        return None;
    }
    let mut hops: Vec<f64> = measured.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    let noise_bar = (median_and_spread(&mut hops).0 / 0.6745 / 2f64.sqrt()).max(1e-9);
    let way_bar = (simulated[count - 1] - simulated[0]).abs();
    if way_bar < 4.0 * noise_bar {
        return None;
    }
    let skip = (LAGS * of.lag_s / (of.dt_s * each as f64)).ceil() as usize;
    let levels = levels(&measured, skip, 2.0 * (count as f64).ln() * TAU_SAMPLES * noise_bar * noise_bar);
    let moments = |values: &[f64]| {
        let middle = values.iter().sum::<f64>() / values.len() as f64;
        (middle, values.iter().map(|v| (v - middle).powi(2)).sum::<f64>())
    };
    let stands: Vec<(f64, f64)> = levels.iter().map(|l| moments(&measured[l.clone()])).collect();
    let kept: Vec<usize> = levels.iter().flat_map(Clone::clone).collect();
    let rest = |level: &Range<usize>, stand: f64| measured[level.clone()].iter().map(|y| y - stand).collect::<Vec<f64>>();
    let rests: Vec<Vec<f64>> = levels.iter().zip(&stands).map(|(level, (stand, _))| rest(level, *stand)).collect();
    let in_levels: f64 = stands.iter().map(|(_, squares)| squares).sum::<f64>().max(1e-12);
    let with_next: f64 = rests.iter().flat_map(|rest| rest.windows(2).map(|w| w[0] * w[1])).sum();
    let memory = (with_next / in_levels).clamp(0.0, 0.99);
    let tau_samples = ((1.0 + memory) / (1.0 - memory)).min(TAU_SAMPLES);
    let smooth = smooth(&kept, &measured, &simulated).min(from_level_to_level(&levels, &measured)).max(1e-12);
    let jumps = stands.len() - 1;
    let sign = (at_a[count - 1] - at_a[0]).signum();
    let upwards = (simulated[count - 1] - simulated[0]).signum();
    Some(Course {
        pace: (at_a[count - 1] - at_a[0]).abs() / (samples.len() as f64 * of.dt_s),
        travel_a: (at_a[count - 1] - at_a[0]).abs(),
        sign,
        way_bar,
        // A jump has its height and its place, a smooth course three coefficients against one level.
        nats: 0.5 * kept.len() as f64 / tau_samples * (smooth / in_levels).ln() - (jumps as f64 - 1.0) * (count as f64).ln(),
        steps_bar: stands.windows(2).map(|w| upwards * (w[1].0 - w[0].0)).collect(),
        inner: inner(&rests, &levels, (&stands, &at_a), each as f64),
        at_a: levels[1..].iter().map(|l| at_a[l.start.saturating_sub(skip)]).collect(),
        samples,
    })
}

/// Within the levels: what the pressure goes times what it would with the current on its way from the level before to the level behind,
/// and the latter squared, for each of `weight` samples [bar^2]. The first may still rest after a turn, the last not have ended.
fn inner(rests: &[Vec<f64>], levels: &[Range<usize>], (stands, at_a): (&[(f64, f64)], &[f64]), weight: f64) -> (f64, f64) {
    let middle = |k: usize| at_a[levels[k].clone()].iter().sum::<f64>() / levels[k].len() as f64;
    let each = (1..levels.len().saturating_sub(1)).map(|k| {
        let travel_a = middle(k + 1) - middle(k - 1);
        let slope = if travel_a == 0.0 { 0.0 } else { (stands[k + 1].0 - stands[k - 1].0) / travel_a };
        let way = |i: &f64| slope * (i - middle(k));
        let of = |(y, i): (&f64, &f64)| (y * way(i), way(i).powi(2));
        rests[k].iter().zip(&at_a[levels[k].clone()]).map(of).fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1))
    });
    let sum = each.fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
    (weight * sum.0, weight * sum.1)
}

/// The band and the share of it that is left after a slip, with their errors: along the movement the spool lets go after what it has
/// slipped, after a turn after that and twice what was left.
fn band(courses: &[Course], (slip_a, slip_error_a): (f64, f64)) -> [(f64, f64); 2] {
    let mut in_time: Vec<&Course> = courses.iter().filter(|c| !c.at_a.is_empty()).collect();
    in_time.sort_by_key(|c| c.samples.start);
    let turns = in_time.windows(2).filter(|w| w[0].samples.end.abs_diff(w[1].samples.start) <= 1 && w[0].sign * w[1].sign < 0.0);
    let mut over: Vec<f64> = turns.map(|w| (w[0].at_a[w[0].at_a.len() - 1] - w[1].at_a[0]).abs()).collect();
    if over.is_empty() {
        return [(slip_a, slip_error_a), (0.0, f64::NAN)];
    }
    let (turn_a, spread_a) = median_and_spread(&mut over);
    let turn_a = turn_a.max(slip_a);
    // Two of them tell no spread.
    let turn_error_a = if over.len() > 2 { spread_a / (over.len() as f64).sqrt() } else { f64::NAN };
    let (both_a, left) = (turn_a + slip_a, (turn_a - slip_a) / (turn_a + slip_a));
    let left_error = 2.0 * (slip_a * turn_error_a).hypot(turn_a * slip_error_a) / both_a.powi(2);
    [(0.5 * both_a, 0.5 * turn_error_a.hypot(slip_error_a)), (left.min(0.95), left_error)]
}

/// Whether the jumps stand at the same currents, whichever way it goes: a driver whose current comes in steps does that.
fn of_the_driver(courses: &[Course], slip_a: f64) -> bool {
    let many = courses.iter().filter(|c| !c.at_a.is_empty()).count() >= LATTICE.0;
    let places: Vec<f64> = courses.iter().flat_map(|c| c.at_a.iter().copied()).collect();
    let resultant = |step_a: f64| {
        let turn = |i: &f64| (TAU * i / step_a).sin_cos();
        let (sine, cosine) = places.iter().map(turn).fold((0.0, 0.0), |sum, t| (sum.0 + t.0, sum.1 + t.1));
        sine.hypot(cosine) / places.len() as f64
    };
    many && (-300..=300).any(|k| resultant(slip_a * (1.0 + 1e-4 * f64::from(k))) > LATTICE.1)
}

/// Share of neighbouring readings that are equal.
fn held(measured_bar: &[f64]) -> f64 {
    let pairs = || measured_bar.windows(2).filter(|w| w[0].is_finite() && w[1].is_finite());
    pairs().filter(|w| w[0] == w[1]).count() as f64 / pairs().count().max(1) as f64
}

/// Median, and standard deviation by the median of the absolute deviations.
fn median_and_spread(values: &mut [f64]) -> (f64, f64) {
    let median = |values: &mut [f64]| {
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let centre = median(values);
    let mut away: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
    (centre, 1.4826 * median(&mut away))
}

#[cfg(test)]
mod tests {
    use super::super::effect::Effect;
    use super::super::stiction::Stiction;
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    const BAR_PER_A: f64 = 40.0;

    /// Triangles between 0.2 A and 0.8 A, `half_s` from turn to turn.
    fn triangles(half_s: f64) -> Vec<f64> {
        (0..9600).map(|k| 0.2 + 0.6 * (1.0 - ((0.01 * f64::from(k) / half_s) % 2.0 - 1.0).abs())).collect()
    }

    /// What is found where the pressure answers to a current as told, beside one that it should answer to.
    fn look<T>(half_s: f64, noise_bar: f64, answer: impl FnMut(f64) -> f64, ask: impl Fn(&Scatter<'_>) -> T) -> T {
        let current_a = triangles(half_s);
        let mut random = rand_pcg::Pcg64::seed_from_u64(5);
        let normal = Normal::new(0.0, noise_bar).unwrap();
        let measured_bar: Vec<f64> = current_a.iter().copied().map(answer).map(|i| BAR_PER_A * i + normal.sample(&mut random)).collect();
        let simulated_bar: Vec<f64> = current_a.iter().map(|i| BAR_PER_A * i).collect();
        let runs = 0..current_a.len();
        ask(&Scatter {
            current_a: &current_a,
            runs: std::slice::from_ref(&runs),
            ..Scatter::between(&measured_bar, &simulated_bar, noise_bar)
        })
    }

    /// A spool that lets go at `band_a` and keeps the share `left` of it.
    fn sticking(band_a: f64, left: f64) -> impl FnMut(f64) -> f64 {
        let mut at_a = 0.2;
        move |i| {
            if (i - at_a).abs() > band_a {
                at_a = i - (left * band_a).copysign(i - at_a);
            }
            at_a
        }
    }

    #[test]
    fn the_band_and_what_is_left_of_it_are_read_from_the_jumps() {
        for (band_a, left) in [(0.01, 0.1), (0.02, 0.4), (0.04, 0.2)] {
            let found = look(13.7, 0.05, sticking(band_a, left), stick_slip).unwrap_or_else(|| panic!("{band_a} A is not found"));
            assert!((found.theta[0] / band_a - 1.0).abs() < 0.06, "{} for {band_a}", found.theta[0]);
            assert!((found.theta[1] - left).abs() < 0.08, "{} for {left}", found.theta[1]);
            assert!(found.std_errors[0] < 0.05 * band_a && found.std_errors[1] < 0.05, "{:?}", found.std_errors);
            assert!(found.gain_nats > LEAST_NATS && found.is_event && found.masked.is_empty());
        }
    }

    #[test]
    fn what_goes_on_between_its_jumps_does_not_stick() {
        assert!(look(13.7, 0.05, |i| i, stick_slip).is_none());
        // A loop of 20 mA, and one of 2 mA under a noise of twice that.
        for (width_a, noise_bar) in [(0.01, 0.02), (0.001, 0.16)] {
            let mut at_a: f64 = 0.2;
            let play = move |i: f64| {
                at_a = at_a.clamp(i - width_a, i + width_a);
                at_a
            };
            assert!(look(13.7, noise_bar, play, stick_slip).is_none(), "{width_a}");
        }
        // A model that bends where the valve does not, and a valve that rests long after each turn.
        assert!(look(13.7, 0.02, |i| i - 0.03 * (20.0 * i).sin(), stick_slip).is_none());
        let mut at_a: f64 = 0.2;
        let late = move |i: f64| {
            at_a = at_a.clamp(i - 0.15, i + 0.15);
            at_a - 0.03 * (20.0 * i).sin()
        };
        assert!(look(13.7, 0.02, late, stick_slip).is_none());
        // Twice as long at one current, where the pressure goes on for a while.
        let mut felt_a: f64 = 0.2;
        let lags = move |i: f64| {
            felt_a += 0.01 * (i.clamp(0.35, 0.65) - felt_a);
            2.0 * felt_a
        };
        assert!(look(13.7, 0.02, lags, stick_slip).is_none());
        let mut at = 0;
        let knocked = move |i: f64| {
            at += 1;
            i + 0.004 * f64::from((at / 150) % 3)
        };
        assert!(look(13.7, 0.02, knocked, stick_slip).is_none());
    }

    #[test]
    fn noise_that_hangs_together_about_a_course_that_the_model_misses_is_no_friction() {
        // The model rests where the valve goes on, and the noise goes up and down over tenths of a second.
        for (noise_bar, dead_a, seed) in
            [(0.05, 0.15, 36), (0.05, 0.15, 43), (0.05, 0.15, 54), (0.1, 0.15, 7), (0.1, 0.15, 9), (0.1, 0.3, 41)]
        {
            let (memory, current_a) = (0.9, triangles(6.0));
            let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
            let normal = Normal::new(0.0, noise_bar * (1.0 - f64::powi(memory, 2)).sqrt()).unwrap();
            let (mut wander_bar, mut held_a) = (0.0, 0.2f64);
            let measured: Vec<f64> = current_a
                .iter()
                .map(|i| {
                    wander_bar = memory * wander_bar + normal.sample(&mut random);
                    3.0 * i + wander_bar
                })
                .collect();
            let simulated: Vec<f64> = current_a
                .iter()
                .map(|i| {
                    held_a = held_a.clamp(i - dead_a, i + dead_a);
                    3.0 * held_a
                })
                .collect();
            let runs = 0..current_a.len();
            let of = Scatter {
                current_a: &current_a,
                runs: std::slice::from_ref(&runs),
                ..Scatter::between(&measured, &simulated, noise_bar * (1.0 - memory).sqrt())
            };
            let found = stick_slip(&of);
            assert!(found.is_none(), "{noise_bar} {dead_a} {seed}: {}", found.map_or(String::new(), |f| f.evidence));
        }
    }

    #[test]
    fn rests_that_no_friction_makes_are_none() {
        // It lets go after a way that is another each time, by up to sixteen times.
        let mut random = rand_pcg::Pcg64::seed_from_u64(7);
        let (mut at_a, mut band_a) = (0.2, 0.005);
        let any_way = move |i: f64| {
            if f64::abs(i - at_a) > band_a {
                (at_a, band_a) = (i, 0.005 * rand::RngExt::random_range(&mut random, 0.0..4.0f64).exp2());
            }
            at_a
        };
        assert!(look(13.7, 0.05, any_way, stick_slip).is_none());
        // Jumps to and fro, always after 50 readings.
        let (mut count, mut held_a) = (0, 0.2);
        let to_and_fro = move |i: f64| {
            if count % 50 == 0 {
                held_a = i + if count % 100 == 0 { 0.05 } else { -0.05 };
            }
            count += 1;
            held_a
        };
        assert!(look(13.7, 0.05, to_and_fro, stick_slip).is_none());
        // A pressure that goes less than half of its way has more than friction.
        let mut sticks = sticking(0.02, 0.4);
        assert!(look(13.7, 0.05, |i| 0.2 + 0.4 * (sticks(i) - 0.2), stick_slip).is_none());
    }

    #[test]
    fn steps_of_the_driver_and_readings_that_are_held_are_no_friction() {
        assert!(look(13.7, 0.05, |i| (i / 0.02).round() * 0.02, stick_slip).is_none());
        assert!(look(13.7, 0.0, sticking(0.02, 0.4), stick_slip).is_none());
    }

    /// Two stretches: that the pressure goes on at rest by `share` of its way on one of travel `travel_a`, and rests on a steeper one.
    fn parts(share: f64, travel_a: f64) -> [Course; 2] {
        let course = |share: f64, travel_a: f64, way_squared: f64| Course {
            samples: 0..1000,
            pace: 0.01,
            travel_a,
            sign: 1.0,
            way_bar: 4.0,
            nats: 100.0,
            at_a: (0..20).map(|k| 0.01 * f64::from(k)).collect(),
            steps_bar: vec![0.2; 20],
            inner: (share * way_squared, way_squared),
        };
        [course(share, travel_a, 1.0), course(0.0, 0.2, 100.0)]
    }

    #[test]
    fn a_spool_that_goes_on_where_the_current_is_as_slow_does_not_stick_elsewhere() {
        let is_found = |share: f64, travel_a: f64| look(13.7, 0.001, |i| i, |of| Sticking::on(&parts(share, travel_a), of).is_some());
        assert_eq!([(0.1, 0.2), (0.9, 0.02), (0.9, 0.2)].map(|(share, travel_a)| is_found(share, travel_a)), [true, true, false]);
    }

    #[test]
    fn a_band_that_no_spool_has_is_another_thing() {
        let both = look(13.7, 0.05, sticking(0.02, 0.4), |of| {
            // A fiftieth of the current for the same jumps.
            let faint_a: Vec<f64> = of.current_a.iter().map(|i| 0.02 * i).collect();
            [Stiction.scatter(of), Stiction.scatter(&Scatter { current_a: &faint_a, ..*of })].map(|found| found.is_some())
        });
        assert_eq!(both, [true, false]);
    }

    #[test]
    fn a_good_valve_speaks_against_it_only_where_it_has_moved_as_slowly() {
        let found = |most| ScatterFinding { theta: vec![0.02], shows_up_to_a_per_s: most, ..ScatterFinding::default() };
        let elsewhere = |of: &Scatter<'_>| stick_slip_elsewhere(&found(None), of);
        assert!(look(13.7, 0.05, |i| i, elsewhere) < 0.0);
        assert!(look(0.05, 0.05, |i| i, elsewhere) > 0.0);
        assert!(look(13.7, 0.05, sticking(0.02, 0.4), elsewhere) > 0.0);
        // A spool that slides at 0.044 A/s may yet stick at 0.03 A/s.
        assert!(look(13.7, 0.05, |i| i, |of| stick_slip_elsewhere(&found(Some(0.03)), of)) > 0.0);
        assert!(look(13.7, 0.05, |i| i, |of| stick_slip_elsewhere(&found(Some(0.05)), of)) < 0.0);
    }
}
