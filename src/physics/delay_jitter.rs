//! # Delay jitter
//!
//! What it is: the dead time of each command varies by chance, for instance with the load of a bus.
//!
//! Model: each new command is late by spread |n|, n a standard normal of its own, and none overtakes another; without a
//! seed the mean course.
//!
//! Signature: the scatter of the error grows with |dP/dt| and is as small as the sensor noise in holds; the mean
//! error stays small. Judged by likelihood, since no simulation can follow it. Where one shift of all movements takes four fifths
//! of the error, that is a dead time and no jitter.
//!
//! What to check on the bench: time stamps of the messages on the bus, task priorities of the controller.
//!
//! Source: Nilsson, Real-Time Control Systems with Delays, Lund 1998, chapter 3.

use std::collections::VecDeque;

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::block::{Block, Pointwise, Through};
use super::effect::{Context, Effect, Kind, LinearForm, Parameter, Scatter, ScatterFinding, Stage, Theta};
use super::signal::Point;
use crate::units::TIME;

/// The effect `delay_jitter`.
pub struct DelayJitter;

impl Effect for DelayJitter {
    fn id(&self) -> &'static str {
        "delay_jitter"
    }
    fn source_text(&self) -> &'static str {
        include_str!("delay_jitter.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Delay
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "spread",
            unit: &TIME,
            range: (0.0, 0.2),
            starts: &[0.01],
            default: None,
            meaning: "standard deviation of the dead time",
        }];
        &PARAMETERS
    }
    fn scatter_nats(&self, found: &ScatterFinding, of: &Scatter<'_>) -> Option<f64> {
        let of_size = |spread_s: f64| slopes(of).map(|slope| of.noise_bar.hypot(spread_s * slope)).collect::<Vec<f64>>();
        let found_bar = of_size(found.theta[0]);
        // A model that is a little late or early speaks for any jitter rather than none: this one has to be likelier than half of it.
        let over = |share: f64| nats(of, &of_size(share * found.theta[0]), &found_bar);
        Some(over(0.0).min(over(0.5)))
    }
    /// The error over the slope of the pressure where it is steep: a time shift of its own for each message.
    fn scatter(&self, of: &Scatter<'_>) -> Option<ScatterFinding> {
        let n = of.measured_bar.len();
        // What scatters in holds as well is no jitter: the noise is what the calm samples show.
        let mut calm: Vec<f64> = (1..n.saturating_sub(1))
            .filter(|k| (of.simulated_bar[k + 1] - of.simulated_bar[k - 1]).abs() < 0.02 * of.noise_bar)
            .map(|k| (of.measured_bar[k] - of.simulated_bar[k]).abs())
            .filter(|e| e.is_finite())
            .collect();
        if calm.len() < FEWEST {
            return None;
        }
        let middle = calm.len() / 2;
        let noise_bar = of.noise_bar.max(1.4826 * *calm.select_nth_unstable_by(middle, f64::total_cmp).1);
        let steep = STEEP * noise_bar / 0.005;
        let mut shifts: Vec<(usize, f64)> = Vec::new();
        let slopes: Vec<f64> = slopes(of).collect();
        for (k, slope) in slopes.iter().enumerate() {
            let error = of.measured_bar[k] - of.simulated_bar[k];
            if slope.abs() > steep && error.is_finite() {
                shifts.push((k, -error / slope));
            }
        }
        let events = 1 + shifts.windows(2).filter(|w| w[1].0 > w[0].0 + 20).count();
        if shifts.len() < FEWEST || events < FEWEST_EVENTS || is_one_shift(of) {
            return None;
        }
        let median = |mut v: Vec<f64>| {
            let middle = v.len() / 2;
            *v.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let centre = median(shifts.iter().map(|s| s.1).collect());
        let spread_s = 1.4826 * median(shifts.iter().map(|s| (s.1 - centre).abs()).collect());
        // Neighbouring shifts of one slope: alike for a wrong model, each of its own for a jitter.
        let clip = |s: f64| (s - centre).clamp(-3.0 * spread_s, 3.0 * spread_s);
        let at = |lag: usize| {
            let (mut sum, mut count) = (0.0, 0usize);
            let mut j = 0;
            for (k, s) in &shifts {
                while j < shifts.len() && shifts[j].0 < k + lag {
                    j += 1;
                }
                if j < shifts.len() && shifts[j].0 == k + lag {
                    sum += clip(*s) * clip(shifts[j].1);
                    count += 1;
                }
            }
            if count < FEWEST / 2 { f64::NAN } else { sum / count as f64 }
        };
        let variance = shifts.iter().map(|s| clip(s.1).powi(2)).sum::<f64>() / shifts.len() as f64;
        let alike = at(3) / variance;
        let own = median(shifts.iter().map(|(k, _)| noise_bar / slopes[*k].abs()).collect());
        let spread_s = (spread_s * spread_s - own * own).max(0.0).sqrt();
        // A loaded bus delays a whole movement, so that neighbours are alike; a wrong model errs alike at like operating points.
        let in_bursts = || spread_s > SMALLEST_BURST_S && explained(&shifts, &slopes, of.simulated_bar, clip) < 0.3;
        if spread_s < SMALLEST_S || !(alike < 0.35 || in_bursts()) || by_place(&shifts, of.simulated_bar, clip) > BY_PLACE {
            return None;
        }
        let spread_bar: Vec<f64> = slopes.iter().map(|s| spread_s * s.abs()).collect();
        let gain_nats = nats(of, &vec![noise_bar; n], &spread_bar.iter().map(|s| noise_bar.hypot(*s)).collect::<Vec<f64>>());
        (gain_nats > 20.0).then(|| ScatterFinding {
            is_event: false,
            theta: vec![spread_s],
            std_errors: vec![spread_s / (2.0 * shifts.len() as f64).sqrt()],
            gain_nats,
            masked: Vec::new(),
            spread_bar,
            evidence: format!(
                "on {} steep samples of {events} movements the time shift of the pressure scatters by {:.1} ms; {}",
                shifts.len(),
                1e3 * spread_s,
                if alike < 0.35 {
                    format!("shifts three samples apart are not alike (correlation {alike:.2})")
                } else {
                    "it does not depend on pressure, direction or slope".to_string()
                }
            ),
            ..ScatterFinding::default()
        })
    }
    fn linear(&self, theta: Theta<'_>) -> Option<LinearForm> {
        Some(LinearForm { delay_spread_s: theta[0], ..LinearForm::NEUTRAL })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        match context.seed {
            None => Block::pointwise(Through),
            Some(seed) => Block::pointwise(Jitter {
                spread_steps: theta[0] / context.dt_s,
                random: Pcg64::seed_from_u64(seed ^ 0x6a69_7474),
                sent: 0.0,
                arrived: 0.0,
                under_way: VecDeque::new(),
            }),
        }
    }
}

/// Whether the same shift of all movements takes most of the error: that is a dead time, and no scatter of it.
fn is_one_shift(of: &Scatter<'_>) -> bool {
    let squares = |late: usize| -> f64 {
        let errors = of.measured_bar[late..].iter().zip(of.simulated_bar).map(|(y, p)| (y - p).powi(2));
        errors.filter(|e| e.is_finite()).sum()
    };
    let most = ((LATEST_S / of.dt_s) as usize).min(of.measured_bar.len() / 2);
    let every = (most / SHIFTS).max(1);
    let least = (every..=most).step_by(every).map(squares).fold(f64::INFINITY, f64::min);
    least < (1.0 - ONE_SHIFT) * squares(0)
}

/// Slope of the simulated pressure at each sample [bar/s]; 0 at the ends.
fn slopes(of: &Scatter<'_>) -> impl Iterator<Item = f64> {
    let n = of.simulated_bar.len();
    let inside = move |k: usize| k > 0 && k + 1 < n;
    (0..n).map(move |k| if inside(k) { (of.simulated_bar[k + 1] - of.simulated_bar[k - 1]) / (2.0 * of.dt_s) } else { 0.0 })
}

/// What the readings say for errors of these standard deviations at each sample rather than of those [nats].
fn nats(of: &Scatter<'_>, those_bar: &[f64], these_bar: &[f64]) -> f64 {
    (0..these_bar.len())
        .filter(|k| of.measured_bar[*k].is_finite())
        .map(|k| {
            let e2 = (of.measured_bar[k] - of.simulated_bar[k]).powi(2);
            let (v0, v1) = (those_bar[k].powi(2), these_bar[k].powi(2));
            // Bounded, so that single events do not decide.
            (0.5 * (e2.min(40.0 * v1) / v0 - e2.min(40.0 * v1) / v1 - (v1 / v0).ln())).min(50.0)
        })
        .sum()
}

/// Longest dead time that is tried [s], and about how many.
const LATEST_S: f64 = 0.5;
const SHIFTS: usize = 50;
/// Share of the squared error that one shift takes of a dead time; of half a normal it takes 0.64.
const ONE_SHIFT: f64 = 0.8;

/// Share of the variance of the shifts that direction, pressure and slope of the movement explain.
fn explained(shifts: &[(usize, f64)], slopes: &[f64], pressure_bar: &[f64], clip: impl Fn(f64) -> f64) -> f64 {
    let row = |k: usize| {
        let (sign, p, steep) = (slopes[k].signum(), pressure_bar[k], slopes[k].abs().ln());
        [1.0, sign, p, p * p, sign * p, steep, sign * steep]
    };
    let rows: Vec<[f64; 7]> = shifts.iter().map(|(k, _)| row(*k)).collect();
    let values: Vec<f64> = shifts.iter().map(|s| clip(s.1)).collect();
    let total = about_mean(&values);
    match left_over(&rows, values) {
        Some(left) if total > 0.0 => 1.0 - left / total,
        _ => 1.0,
    }
}

/// Share of the variance of the shifts that follows from the place within the movement, its size and its direction, degrees of freedom
/// taken off: a model of the wrong form errs alike at like places of like movements, however little neighbouring readings are alike.
fn by_place(shifts: &[(usize, f64)], pressure_bar: &[f64], clip: impl Fn(f64) -> f64) -> f64 {
    // It is steep nowhere at the ends of the recording, so that each movement has a sample before it and one behind.
    let row = |movement: &[(usize, f64)]| {
        let way = pressure_bar[movement[movement.len() - 1].0 + 1] - pressure_bar[movement[0].0 - 1];
        [1.0, way.abs(), way * way, way.signum(), way]
    };
    let movements: Vec<_> = shifts.chunk_by(|a, b| b.0 == a.0 + 1).map(|movement| (row(movement), movement)).collect();
    let (mut all, mut left, mut free) = (Vec::new(), 0.0, 0.0);
    for place in 0..PLACES {
        let at_place = movements.iter().filter_map(|(row, movement)| Some((*row, clip(movement.get(place)?.1))));
        let (rows, values): (Vec<[f64; 5]>, Vec<f64>) = at_place.unzip();
        if rows.len() <= FEWEST {
            break;
        }
        all.extend_from_slice(&values);
        let Some(left_here) = left_over(&rows, values) else { return 0.0 };
        (left, free) = (left + left_here, free + 5.0);
    }
    let (count, total) = (all.len() as f64, about_mean(&all));
    if count > 2.0 * free && total > 0.0 { 1.0 - left / (count - free) / (total / (count - 1.0)) } else { 0.0 }
}

/// Sum of the squares about the mean.
fn about_mean(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| (v - mean).powi(2)).sum()
}

/// Sum of the squares that no linear combination of the columns takes; `None` where there is no solution.
fn left_over<const N: usize>(rows: &[[f64; N]], values: Vec<f64>) -> Option<f64> {
    let (x, y) = (DMatrix::from_fn(rows.len(), N, |j, c| rows[j][c]), DVector::from_vec(values));
    let fitted = x.clone().svd(true, true).solve(&y, 1e-9).ok()?;
    Some((y - x * fitted).norm_squared())
}

/// Each new command is late by a chance of its own, and none overtakes another: a bus keeps the order.
struct Jitter {
    spread_steps: f64,
    random: Pcg64,
    sent: f64,
    arrived: f64,
    /// Steps until it arrives, and the command.
    under_way: VecDeque<(f64, f64)>,
}

impl Pointwise for Jitter {
    fn start(&mut self, _: &Point, input: f64) {
        (self.sent, self.arrived) = (input, input);
        self.under_way.clear();
    }
    /// The mean of what has arrived over the step that begins here.
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        if input != self.sent {
            self.sent = input;
            let normal: f64 = StandardNormal.sample(&mut self.random);
            let before = self.under_way.back().map_or(0.0, |last| last.0);
            self.under_way.push_back(((self.spread_steps * normal.abs()).max(before), input));
        }
        let (mut mean, mut since) = (0.0, 0.0);
        while let Some((due, command)) = self.under_way.front().copied().filter(|next| next.0 < 1.0) {
            mean += (due - since) * self.arrived;
            (since, self.arrived) = (due, command);
            self.under_way.pop_front();
        }
        for (due, _) in &mut self.under_way {
            *due -= 1.0;
        }
        mean + (1.0 - since) * self.arrived
    }
}

/// A slope is steep where a shift of 5 ms exceeds the noise this many times.
const STEEP: f64 = 2.5;
/// A jitter is chance for most of its variance.
const BY_PLACE: f64 = 0.5;
/// Places within a movement that are looked at: its first samples.
const PLACES: usize = 20;
/// Fewest steep samples.
const FEWEST: usize = 40;
/// Fewest separate movements that they must come from.
const FEWEST_EVENTS: usize = 12;
/// Smallest spread that is claimed [s]: below it lies the accuracy of any model of the dynamics.
const SMALLEST_S: f64 = 0.003;
/// The same for shifts that a whole movement shares [s].
const SMALLEST_BURST_S: f64 = 0.005;

#[cfg(test)]
mod tests {
    use super::*;

    /// Forty movements between 5 and 25 bar with rests between them, the measured pressure late by `late` [s] of the movement; what
    /// `seen` sees of them.
    fn look<T>(late: impl Fn(usize, f64) -> f64, seen: impl Fn(&Scatter<'_>) -> T) -> T {
        let level = |j: usize| 5.0 + ((j * 7) % 11) as f64 * 2.0;
        let at = |t: f64| {
            let j = (t / 2.0).max(0.0) as usize;
            let part = ((t - 2.0 * j as f64 - 0.5) / 0.6).clamp(0.0, 1.0);
            level(j) + (level(j + 1) - level(j)) * part
        };
        let simulated: Vec<f64> = (0..8000).map(|k| at(k as f64 * 0.01)).collect();
        let noise = |k: usize| 0.05 * (((k * 7919) % 101) as f64 / 50.0 - 1.0);
        let measured: Vec<f64> = (0..8000)
            .map(|k| {
                let t = k as f64 * 0.01;
                at(t - late((t / 2.0) as usize, simulated[k])) + noise(k)
            })
            .collect();
        seen(&Scatter::between(&measured, &simulated, 0.03))
    }

    fn found(late: impl Fn(usize, f64) -> f64) -> bool {
        look(late, |of| DelayJitter.scatter(of).is_some())
    }

    #[test]
    fn what_scatters_as_much_speaks_for_a_jitter_of_that_size_and_what_hardly_does_against_it() {
        let by_chance = |movement: usize, of_s: f64| if (movement * 2_654_435_761) % 97 < 40 { of_s } else { 0.0 };
        let nats = |late_s: f64| {
            look(
                |movement, _| by_chance(movement, late_s),
                |of| DelayJitter.scatter_nats(&ScatterFinding { theta: vec![0.02], ..ScatterFinding::default() }, of),
            )
        };
        assert!(nats(0.04).is_some_and(|nats| nats > 100.0), "{:?}", nats(0.04));
        assert!(nats(0.004).is_some_and(|nats| nats < -100.0), "{:?}", nats(0.004));
        // What scatters a quarter as much would rather have any jitter than none, and yet this one not.
        assert!(nats(0.01).is_some_and(|nats| nats < -100.0), "{:?}", nats(0.01));
    }

    /// Mean lateness [s] of steps held for 50 ms, sampled every `dt_s`.
    fn lateness_s(dt_s: f64) -> f64 {
        let mut jitter =
            Jitter { spread_steps: 0.01 / dt_s, random: Pcg64::seed_from_u64(5), sent: 0.0, arrived: 0.0, under_way: VecDeque::new() };
        let per_step = (0.05 / dt_s).round() as usize;
        let at = Point::current(0.0);
        let missing: f64 = (1..=4000).flat_map(|k| std::iter::repeat_n(f64::from(k), per_step)).map(|i| i - jitter.step(&at, i)).sum();
        missing * dt_s / 4000.0
    }

    #[test]
    fn a_step_is_late_by_the_mean_of_half_a_normal_however_often_is_sampled() {
        let expected = 0.01 * (2.0 / std::f64::consts::PI).sqrt();
        for dt_s in [0.002, 0.01, 0.05] {
            let late = lateness_s(dt_s);
            assert!((late - expected).abs() < 0.03 * expected, "{dt_s}: {late}");
        }
    }

    #[test]
    fn movements_that_are_late_by_chance_are_a_jitter() {
        assert!(found(|movement, _| if (movement * 2_654_435_761) % 97 < 40 { 0.05 } else { 0.0 }));
    }

    #[test]
    fn movements_that_are_late_by_their_pressure_or_alike_are_not() {
        assert!(!found(|_, pressure| 0.004 * (25.0 - pressure)));
        assert!(!found(|_, _| 0.02));
        assert!(!found(|_, _| 0.0));
    }

    #[test]
    fn steps_that_are_all_late_by_more_than_they_take_are_a_dead_time() {
        // A step every four seconds, over within a tenth of one.
        let at = |t: f64| {
            let step = (t / 4.0).max(0.0) as usize;
            let level = |j: usize| 5.0 + 3.0 * ((j * 7) % 5) as f64;
            let before = if step == 0 { level(0) } else { level(step - 1) };
            level(step) + (before - level(step)) * (-(t - 4.0 * step as f64) / 0.025).exp()
        };
        let time = |k: usize| 0.01 * k as f64;
        let simulated: Vec<f64> = (0..8000).map(|k| at(time(k))).collect();
        let noise = |k: usize| 0.03 * (((k * 7919) % 101) as f64 / 50.0 - 1.0);
        let finds = |late: &dyn Fn(usize) -> f64| {
            let measured: Vec<f64> = (0..8000).map(|k| at(time(k) - late(k / 400)) + noise(k)).collect();
            DelayJitter.scatter(&Scatter::between(&measured, &simulated, 0.03)).is_some()
        };
        assert!(!finds(&|_| 0.1));
        assert!(finds(&|step| 0.02 * ((step * 5) % 7) as f64));
    }

    #[test]
    fn steps_that_the_model_answers_in_another_form_are_no_jitter() {
        // A step every second, by one to eleven bar, up and down; the valve fills at a constant rate near its goal, the model with a lag.
        let level = |step: usize| 5.0 + ((step * 7) % 12) as f64;
        let answer = |t: f64, over: &dyn Fn(f64, f64) -> f64| {
            let step = (t.max(0.0)) as usize;
            let before = level(step.saturating_sub(1));
            before + over(t - step as f64, level(step) - before)
        };
        let lag = |t: f64, way: f64| way * (1.0 - (-t / 0.03).exp());
        let filling = |t: f64, way: f64| way.signum() * (160.0 * t).min(way.abs()).min(0.6 * way.abs() + 60.0 * t);
        let noise = |k: usize| 0.03 * (((k * 7919) % 101) as f64 / 50.0 - 1.0);
        let course = |over: &dyn Fn(f64, f64) -> f64| (0..30_000).map(|k| answer(0.01 * f64::from(k), over)).collect::<Vec<f64>>();
        let simulated = course(&lag);
        let measured: Vec<f64> = course(&filling).into_iter().enumerate().map(|(k, p)| p + noise(k)).collect();
        let found = DelayJitter.scatter(&Scatter::between(&measured, &simulated, 0.03));
        assert!(found.is_none(), "{}", found.map_or(String::new(), |f| f.evidence));
    }
}
