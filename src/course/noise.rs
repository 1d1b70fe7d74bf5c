//! How much a reading scatters about the pressure: the one estimate of the noise.
//!
//! It is taken from second differences of readings next to each other, which a course that is straight over three of them
//! does not reach, and from their smaller half, which leaves out what bends: turns, steps, single wild readings. Four
//! things that fool such an estimate are looked for.
//!
//! - A sensor that is slower than the grid repeats its reading: of each repetition one is used.
//! - Coarse steps of the reading: on a course slower than a step per sample nearly all differences are zero, though each
//!   reading is off by up to half a step. Readings q apart with a noise of sigma before rounding differ in the mean square
//!   by q sigma / sqrt(pi) while the course rests within a step (sigma < 0.3 q), and by sigma^2 + q^2 / 12 (Sheppard)
//!   while it passes steps; both are the error about the pressure of sigma^2 + q^2 / 12.
//! - Noise with a memory (a filter in the sensor) hides from neighbours: differences over more samples show it. A first-order
//!   memory grows with the distance at first and then no more; a course that bends grows with its fourth power.
//! - A sensor that is cut at zero shows no noise at the floor: readings there do not count where there are others.

use super::Run;

/// Readings that are looked at, at most: they give the noise within a percent.
const MOST: usize = 300_000;
/// Readings in one stretch where only some are looked at.
const STRETCH: usize = 10_000;
/// Fewest differences for an estimate.
const FEWEST: usize = 10;
/// Root mean square of the smaller half of normal values of deviation 1.
const SMALLER_HALF: f64 = 0.3778;
/// Distances over which a memory of the noise is looked for [samples].
const DISTANCES: [usize; 8] = [1, 2, 3, 4, 6, 8, 12, 16];
/// Fewest readings to look for a memory in.
const FEWEST_FOR_MEMORY: usize = 1000;
/// Correlations from one reading to the next that are tried: beyond, the memory is longer than the distances and cannot be
/// told from a slow course.
const MEMORIES: std::ops::RangeInclusive<usize> = 10..=46;
/// Below this mean square, in squares of the step, neighbouring readings rest within a step: there both laws meet.
const RESTS: f64 = 0.17;
/// How well a memory must describe the differences over all distances, as a share of each mean square.
const MEMORY_FITS: f64 = 0.08;
/// And how much of the noise at least must have it.
const MEMORY_SHARE: f64 = 0.5;

/// The noise of the readings.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Noise {
    /// Standard deviation of a reading about the pressure, all parts together [bar]; 0 where nothing shows it.
    pub bar: f64,
    /// The part that is independent from reading to reading, quantisation among it [bar].
    pub white_bar: f64,
    /// Time constant of the part that has a memory [s]; 0 where none has.
    pub memory_s: f64,
    /// Distance of neighbouring values that the sensor can give [bar], where it is coarse enough to matter.
    pub step_bar: Option<f64>,
    /// Samples from one new reading to the next; 1 but for a sensor that is slower than the grid.
    pub renewed_every: usize,
}

/// Readings in their order, with the places where they stand [samples].
type Stretch = Vec<(f64, f64)>;

impl Noise {
    /// The noise of all readings of the runs.
    pub fn of(runs: &[Run]) -> Self {
        let dt_s = runs.iter().map(|run| run.dt_s).fold(f64::INFINITY, f64::min);
        Self::of_stretches(stretches(runs), dt_s)
    }

    /// Standard deviation of the readings of any sensor about what it measures, by the same estimate, in their unit; they follow each
    /// other at even distances, and those that are absent are not numbers.
    pub fn deviation(readings: &[f64]) -> f64 {
        let place = |(k, value): (usize, &f64)| (k as f64, *value);
        Self::of_stretches(vec![readings.iter().enumerate().filter(|(_, v)| v.is_finite()).map(place).collect()], 1.0).bar
    }

    fn of_stretches(mut stretches: Vec<Stretch>, dt_s: f64) -> Self {
        let step_bar = step(&stretches);
        let renewed_every = renewal(&mut stretches, step_bar);
        let dt_s = dt_s * renewed_every as f64;
        above_the_floor(&mut stretches);
        let plain = |bar: f64| Self { bar, white_bar: bar, memory_s: 0.0, step_bar, renewed_every };
        if let Some(q) = step_bar {
            if let Some(neighbours) = within_steps(&stretches, q).filter(|v| *v < RESTS * q * q) {
                return plain(of_coarse_steps(neighbours, q).sqrt());
            }
            dither(&mut stretches, q);
        }
        // What the dither has added goes again.
        let added = step_bar.map_or(0.0, |q| q * q / 12.0);
        let Some(white) = variance(&stretches, 1).map(|v| (v - added).max(added)) else {
            // Too few readings to tell: no less than the steps of the reading.
            return plain(added.sqrt());
        };
        match memory(&stretches, added) {
            Some(Memory { white, coloured, correlation }) => Self {
                bar: (white + coloured).sqrt(),
                white_bar: white.sqrt(),
                memory_s: -dt_s / correlation.ln(),
                step_bar,
                renewed_every,
            },
            None => plain(white.sqrt()),
        }
    }

    /// What a user should know of it.
    pub fn say(&self, notes: &mut Vec<String>) {
        if self.renewed_every > 1 {
            notes.push(format!("the sensor gives a new reading every {} samples only", self.renewed_every));
        }
        if let Some(q) = self.step_bar.filter(|q| *q > self.bar) {
            notes.push(format!("pressure_bar is read in steps of {q:.4} bar"));
        }
        if self.memory_s > 0.0 {
            notes.push(format!(
                "the noise of pressure_bar has a memory of {:.1} ms: of {:.4} bar, {:.4} bar are new from reading to reading",
                1e3 * self.memory_s,
                self.bar,
                self.white_bar
            ));
        }
    }
}

/// The readings, or an even choice of stretches of them.
fn stretches(runs: &[Run]) -> Vec<Stretch> {
    let readings: usize = runs.iter().map(Run::readings).sum();
    let every = readings.div_ceil(MOST).max(1) * STRETCH;
    let mut out = Vec::new();
    for run in runs {
        let place = |k: usize| (run.reading_s(k) - run.start_s) / run.dt_s;
        let all = (0..run.len()).filter(|k| run.pressure_bar[*k].is_finite());
        if readings <= MOST {
            out.push(all.map(|k| (place(k), run.pressure_bar[k])).collect());
            continue;
        }
        for from in (0..run.len()).step_by(every) {
            let part = from..(from + STRETCH).min(run.len());
            out.push(part.filter(|k| run.pressure_bar[*k].is_finite()).map(|k| (place(k), run.pressure_bar[k])).collect());
        }
    }
    out
}

/// The distance between neighbouring values that the sensor gives, where the readings repeat the same values.
fn step(stretches: &[Stretch]) -> Option<f64> {
    let mut values: Vec<f64> = stretches.iter().flatten().map(|r| r.1).collect();
    let count = values.len();
    values.sort_unstable_by(f64::total_cmp);
    let tiny = 1e-9 * values.first().zip(values.last()).map_or(0.0, |(a, b)| a.abs().max(b.abs()));
    values.dedup_by(|b, a| *b - *a <= tiny);
    if values.len() < 3 || values.len() * 2 > count {
        return None;
    }
    let mut steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_unstable_by(f64::total_cmp);
    // A tenth of them may be wild; the others are whole steps.
    let q = steps[steps.len() / 10];
    let whole = steps.iter().filter(|s| ((*s / q).round() - *s / q).abs() < 0.05 * (*s / q).clamp(1.0, 4.0)).count();
    (whole * 10 >= steps.len() * 9).then_some(q)
}

/// Keeps one of the readings that a slow sensor repeats, and says every how many samples a new one comes.
fn renewal(stretches: &mut [Stretch], step_bar: Option<f64>) -> usize {
    // Lengths of the repetitions between changes by more than a few steps of the sensor: a coarse sensor repeats itself too.
    let large = 4.0 * step_bar.unwrap_or(0.0);
    let mut lengths: Vec<usize> = Vec::new();
    for stretch in stretches.iter() {
        let changes: Vec<usize> = (1..stretch.len()).filter(|k| stretch[*k].1 != stretch[*k - 1].1).collect();
        let moves = |k: usize| (stretch[k].1 - stretch[k - 1].1).abs() > large;
        lengths.extend(changes.windows(2).filter(|w| moves(w[0]) && moves(w[1])).map(|w| w[1] - w[0]));
    }
    if lengths.len() < FEWEST {
        return 1;
    }
    let middle = lengths.len() / 2;
    let usual = *lengths.select_nth_unstable(middle).1;
    let alike = lengths.iter().filter(|l| l.abs_diff(usual) * 4 <= usual).count();
    if usual < 2 || alike * 5 < lengths.len() * 4 {
        return 1;
    }
    for stretch in stretches.iter_mut() {
        let mut last = (f64::NEG_INFINITY, f64::NAN);
        stretch.retain(|(at, value)| {
            let new = *value != last.1 || at - last.0 >= usual as f64;
            if new {
                last = (*at, *value);
            }
            new
        });
    }
    usual
}

/// Takes out the readings at the bottom, where a sensor may be cut, if enough others are left.
fn above_the_floor(stretches: &mut [Stretch]) {
    let mut values: Vec<f64> = stretches.iter().flatten().map(|r| r.1).collect();
    if values.len() < 10 * FEWEST {
        return;
    }
    values.sort_unstable_by(f64::total_cmp);
    let low = values[values.len() / 100];
    let noise = variance(stretches, 1).map_or(0.0, f64::sqrt);
    let edge = low + 6.0 * noise + 0.005 * (values[values.len() - 1] - low);
    let share = values.partition_point(|v| *v <= edge) as f64 / values.len() as f64;
    if (0.1..0.7).contains(&share) {
        // A reading that goes leaves a hole, so that no difference spans the floor.
        stretches.iter_mut().for_each(|s| s.retain(|r| r.1 > edge));
    }
}

/// Second differences over `distance` readings, scaled so that white noise has its own variance.
fn differences(stretches: &[Stretch], distance: usize) -> Vec<f64> {
    let mut widths: Vec<f64> = stretches.iter().flat_map(|s| s.windows(2)).map(|w| w[1].0 - w[0].0).collect();
    if widths.is_empty() {
        return Vec::new();
    }
    let middle = widths.len() / 2;
    let usual = *widths.select_nth_unstable_by(middle, f64::total_cmp).1 * distance as f64;
    let mut out = Vec::new();
    for s in stretches {
        for k in distance..s.len().saturating_sub(distance) {
            let (a, b, c) = (s[k - distance], s[k], s[k + distance]);
            let (before, after) = (b.0 - a.0, c.0 - b.0);
            if before > 1.5 * usual || after > 1.5 * usual || before <= 0.0 || after <= 0.0 {
                continue;
            }
            let (u, v) = (after / (before + after), before / (before + after));
            out.push((b.1 - u * a.1 - v * c.1) / (1.0 + u * u + v * v).sqrt());
        }
    }
    out
}

/// Variance of the readings about a straight line over `distance` of them on each side [bar^2].
fn variance(stretches: &[Stretch], distance: usize) -> Option<f64> {
    let mut squares: Vec<f64> = differences(stretches, distance).into_iter().map(|d| d * d).collect();
    if squares.len() < FEWEST {
        return None;
    }
    let half = squares.len() / 2;
    squares.select_nth_unstable_by(half, f64::total_cmp);
    Some(squares[..half].iter().sum::<f64>() / half as f64 / (SMALLER_HALF * SMALLER_HALF))
}

/// The same over one reading for readings in steps of `q`, whose differences have no smaller half: all but those of a
/// moving course count.
fn within_steps(stretches: &[Stretch], q: f64) -> Option<f64> {
    let all = differences(stretches, 1);
    let rest: Vec<f64> = all.iter().map(|d| d * d).filter(|s| *s <= 2.7 * q * q).collect();
    (rest.len() >= FEWEST && rest.len() * 2 > all.len()).then(|| rest.iter().sum::<f64>() / rest.len() as f64)
}

/// Spreads readings evenly over their step, so that their differences are no longer whole steps; always the same way.
fn dither(stretches: &mut [Stretch], q: f64) {
    for (k, reading) in stretches.iter_mut().flatten().enumerate() {
        // SplitMix64 of the number of the reading (Steele, Lea and Flood, OOPSLA 2014).
        let mut z = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let even = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        reading.1 += q * (even - 0.5);
    }
}

/// The error about the pressure of readings in steps of `q` [bar^2] whose neighbours differ by `neighbours`.
fn of_coarse_steps(neighbours: f64, q: f64) -> f64 {
    let share = neighbours / (q * q);
    q * q * (std::f64::consts::PI * share * share + 1.0 / 12.0)
}

/// Noise in two parts, one with a first-order memory.
struct Memory {
    white: f64,
    coloured: f64,
    /// Correlation from one reading to the next.
    correlation: f64,
}

/// The memory of the noise, where differences over more and more readings show one.
fn memory(stretches: &[Stretch], added: f64) -> Option<Memory> {
    if stretches.iter().map(Vec::len).sum::<usize>() < FEWEST_FOR_MEMORY {
        return None;
    }
    let seen: Vec<f64> = DISTANCES.iter().map(|d| variance(stretches, *d).map(|v| v - added)).collect::<Option<_>>()?;
    if seen.iter().any(|v| *v <= 0.0) {
        return None;
    }
    let fits = MEMORIES.map(|n| {
        let correlation = n as f64 / 50.0;
        // A second difference over m samples of noise with the correlation r: 1 - 4/3 r^m + 1/3 r^2m of its variance.
        let columns: Vec<[f64; 3]> = DISTANCES
            .iter()
            .map(|d| {
                let r = correlation.powi(*d as i32);
                [1.0, 1.0 - 4.0 / 3.0 * r + r * r / 3.0, (*d as f64 / 16.0).powi(4)]
            })
            .collect();
        let (parts, off) = not_negative(&columns, &seen);
        (off, correlation, parts)
    });
    let (off, correlation, [white, coloured, bend]) = fits.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let real = coloured > MEMORY_SHARE * white && coloured > bend && off < MEMORY_FITS && correlation < *MEMORIES.end() as f64 / 50.0;
    real.then_some(Memory { white, coloured, correlation })
}

/// Least squares of the relative error with no part below zero: all choices of parts are tried. Returns the root mean
/// square of the relative error, too.
fn not_negative(columns: &[[f64; 3]], seen: &[f64]) -> ([f64; 3], f64) {
    use nalgebra::{DMatrix, DVector};
    let mut best = ([0.0; 3], f64::INFINITY);
    for chosen in 1..8usize {
        let parts: Vec<usize> = (0..3).filter(|p| chosen >> p & 1 == 1).collect();
        let a = DMatrix::from_fn(seen.len(), parts.len(), |row, p| columns[row][parts[p]] / seen[row]);
        let one = DVector::from_element(seen.len(), 1.0);
        let Some(solution) = (a.transpose() * &a).cholesky().map(|c| c.solve(&(a.transpose() * &one))) else { continue };
        if solution.iter().any(|s| *s < 0.0) {
            continue;
        }
        let off = ((&a * &solution - one).norm_squared() / seen.len() as f64).sqrt();
        if off < best.1 {
            let mut all = [0.0; 3];
            parts.iter().zip(solution.iter()).for_each(|(p, s)| all[*p] = *s);
            best = (all, off);
        }
    }
    best
}
