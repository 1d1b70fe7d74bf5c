//! Do model and recording belong together? Asked before anything is fitted.
//!
//! What the model explains of the variance of the pressure, after the freest recalibration that a valve could need (any
//! gain and zero that a valve can have, any rising curve, a shift of time up to a second), is held against chance: the
//! same figure after circular shifts of the pressure. Where the recording fails, it is tried as other people make
//! recordings: other units, signs, clocks, exchanged channels. What then fits names the mistake.

use realfft::RealFftPlanner;

use super::evidence::Evidence;
use super::mistake::{Mistake, SECOND_S};
use crate::physics::{PhysicsError, Pipeline, signals};
use crate::valve::Valve;

/// Gains that a valve can have against its calibration: three halves of it and less is what wear, temperature and supply
/// do (the widest range of an effect is 1.3); twice as much and twice as little is another valve or another unit.
const GAINS: (f64, f64) = (0.5, 2.0);
/// Part of the model's own span by which the zero of a valve may be off.
const ZERO: f64 = 0.35;
/// Below this share of the variance the pressure does not follow the model, whatever chance says.
const FOLLOWS: f64 = 0.3;
/// Below this share it must beat chance.
const PLAINLY: f64 = 0.8;
/// Of this many circular shifts the true one must be better than all but one in twenty.
const CHANCE: f64 = 0.05;
/// Another reading of the file is believed where it leaves at most this part of the variance that is left otherwise.
const CLEARLY: f64 = 0.25;
/// Swing below which a signal stands still, in units of the sensor noise.
const STILL: f64 = 2.0;
/// Part of the span of the curves within which a signal that hardly moves stays.
const UNMOVED: f64 = 0.02;
/// A clock that makes a valve of a process is believed where it leaves less than this part.
const NO_WORSE: f64 = 0.9;
/// Bins of the rising curve.
const BINS: usize = 40;
/// Longest grid that is looked at as it is; a longer one is thinned [samples].
const LONGEST: usize = 1 << 16;

/// How a simulation and a pressure agree.
#[derive(Debug, Clone, Copy, Default)]
struct Agreement {
    /// Share of the variance that a straight line explains at the best allowed shift of time.
    share: f64,
    /// Slope of that line: the gain of the valve over that of the model.
    gain: f64,
    /// Its value at the middle of the simulation less the simulation [bar].
    zero_bar: f64,
    /// The best allowed shift [s]: positive where the pressure is later than the model.
    shift_s: f64,
    /// The share at the best shift of all, and that shift [s].
    anywhere: (f64, f64),
    /// Share of circular shifts that are as good.
    chance: f64,
    /// Standard deviations of simulation and pressure [bar].
    swing_bar: (f64, f64),
    /// Range of the simulation [bar].
    span_bar: f64,
}

impl Agreement {
    /// Whether the straight line is one that a valve can have.
    fn is_a_valve(&self) -> bool {
        (GAINS.0..=GAINS.1).contains(&self.gain) && self.zero_bar.abs() <= ZERO * self.span_bar
    }
}

/// Why model and recording do not belong together; `None` where they do.
///
/// # Errors
/// [`PhysicsError`] where the model cannot be simulated.
pub fn mistake(evidence: &Evidence, valve: &Valve) -> Result<Option<(Mistake, f64)>, PhysicsError> {
    let of = |reading: Reading| agreement(evidence, valve, reading);
    let plain = of(Reading::default())?;
    let noise = evidence.noise_bar;
    let found = |mistake: Mistake| Ok(Some((mistake, plain.share)));
    let (bottom, top) = valve.curves.pressure_range_bar();
    let still = |swing_bar: f64| swing_bar < STILL * noise && swing_bar < UNMOVED * (top - bottom).abs();
    let (unmoved, rests) = (still(plain.swing_bar.0), still(plain.swing_bar.1));
    let fits = !rests && plain.is_a_valve() && plain.share > FOLLOWS;
    let left = |share: f64| 1.0 - share;
    // The clock first: whatever else is wrong, the shift of time would take a wrong clock for its own.
    // What a foreign model would say to another clock or command is not known.
    let clocks: &[f64] = if evidence.base.is_some() { &[] } else { &CLOCKS };
    for factor in clocks.iter().copied() {
        let other = of(Reading { clock: factor, ..Reading::default() })?;
        // A model whose whole answer fits between two samples was not made from recordings with this clock.
        let between = factor < 1.0 && evidence.is_slow() && valve.delay_s + valve.lag_s < 0.5 * evidence.step_s();
        let most = if between { NO_WORSE } else { CLEARLY };
        if other.is_a_valve() && other.share > PLAINLY && left(other.share) < most * left(plain.share) && valve_sized(valve) {
            return found(Mistake::Clock { factor });
        }
    }
    if !rests && plain.gain > 0.0 && plain.anywhere.0 > FOLLOWS && left(plain.anywhere.0) < CLEARLY * left(plain.share) {
        return found(Mistake::Shifted { by_s: plain.anywhere.1 });
    }
    if fits && (plain.share > PLAINLY || plain.chance <= CHANCE) {
        return Ok(None);
    }
    if rests {
        return found(if unmoved { Mistake::NoExcitation } else { Mistake::PressureRests });
    }
    let points = points(evidence, valve, plain.shift_s)?;
    // A rising curve of any form: a limit, a fill phase or another characteristic bends the line.
    if plain.gain > 0.0 && plain.share > FOLLOWS && plain.is_a_valve() && rising(points.clone()) > PLAINLY {
        return Ok(None);
    }
    // Where its curves do not hold, a model says nothing, and may be off by any factor.
    if plain.gain > 0.0 && follows_within(points, valve, &plain) {
        return Ok(None);
    }
    let mut best: Option<(f64, Mistake)> = None;
    let mut consider = |share: f64, mistake: Mistake| {
        if share > PLAINLY && best.as_ref().is_none_or(|b| share > b.0 + 1e-3) {
            best = Some((share, mistake));
        }
    };
    let mut readings = vec![(Reading { exchanged: true, ..Reading::default() }, Mistake::Exchanged)];
    readings.extend(CURRENTS.iter().map(|f| (Reading { current: *f, ..Reading::default() }, Mistake::Current { factor: *f })));
    for (reading, mistake) in readings.into_iter().filter(|_| evidence.base.is_none()) {
        let other = of(reading)?;
        if other.is_a_valve() {
            consider(other.share, mistake);
        }
    }
    if plain.gain > 0.0 && !plain.is_a_valve() {
        let (factor, named) = unit_near(plain.gain);
        consider(
            plain.share,
            if named { Mistake::Pressure { factor } } else { Mistake::OtherValve { gain: plain.gain, zero_bar: plain.zero_bar } },
        );
    }
    if plain.gain < 0.0 {
        let falling = mean(evidence.grids.iter().flat_map(|g| &g.pressure_bar)) > 0.0;
        consider(plain.share, if falling { Mistake::Falling } else { Mistake::Sign });
    }
    if let Some((_, mistake)) = best {
        return found(mistake);
    }
    if unmoved {
        return found(Mistake::NoExcitation);
    }
    let follows = plain.gain > 0.0 && plain.share > FOLLOWS && plain.chance <= CHANCE;
    found(if follows {
        Mistake::OtherValve { gain: plain.gain, zero_bar: plain.zero_bar }
    } else {
        Mistake::Unrelated { chance: plain.chance }
    })
}

/// Factors by which a current is off where its unit is another.
const CURRENTS: [f64; 8] = [-1.0, 1e-3, 1e-2, 0.1, 10.0, 100.0, 1e3, 1e-6];
/// Factors by which a time is off: milliseconds, microseconds, minutes.
const CLOCKS: [f64; 3] = [1e-3, 1e-6, 60.0];
/// Factors by which a pressure is off where its unit is another.
const PRESSURES: [f64; 9] = [0.1, 10.0, 14.503_773_8, 0.068_947_573, 100.0, 1e3, 1e5, 0.01, 1e-5];

/// The factor of [`PRESSURES`] nearest to a gain, and whether a valve's own gain may make up the difference.
fn unit_near(gain: f64) -> (f64, bool) {
    let apart = |f: &f64| (gain / f).ln().abs();
    let nearest = PRESSURES.into_iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(1.0);
    (nearest, apart(&nearest) < 0.3 && apart(&nearest) < gain.ln().abs())
}

/// Whether the dynamics of a model are those of a valve, so that a clock can be judged by them.
fn valve_sized(valve: &Valve) -> bool {
    valve.delay_s + valve.lag_s < SECOND_S
}

/// The way in which a file is read.
#[derive(Debug, Clone, Copy)]
struct Reading {
    /// Factor on the current.
    current: f64,
    /// Factor on the time.
    clock: f64,
    /// Whether current and pressure change places.
    exchanged: bool,
}

impl Default for Reading {
    fn default() -> Self {
        Self { current: 1.0, clock: 1.0, exchanged: false }
    }
}

fn mean<'v>(values: impl Iterator<Item = &'v f64>) -> f64 {
    let (sum, n) = values.filter(|v| v.is_finite()).fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    sum / n.max(1) as f64
}

/// Simulation and pressure of one grid as read; a long one thinned.
fn pair(evidence: &Evidence, number: usize, valve: &Valve, reading: Reading) -> Result<(Vec<f64>, Vec<f64>, f64), PhysicsError> {
    let grid = &evidence.grids[number];
    let pipeline = Pipeline { input: evidence.input, ..Pipeline::of(valve)? };
    let dt_s = grid.dt_s * reading.clock;
    let held = |values: &[f64]| {
        let mut last = values.iter().copied().find(|v| v.is_finite()).unwrap_or(0.0);
        values
            .iter()
            .map(|v| {
                if v.is_finite() {
                    last = *v;
                }
                last
            })
            .collect::<Vec<f64>>()
    };
    let (current, pressure) = if reading.exchanged {
        (held(&grid.pressure_bar), grid.current_a.clone())
    } else {
        (grid.current_a.clone(), grid.pressure_bar.clone())
    };
    let current: Vec<f64> = current.iter().map(|i| i * reading.current).collect();
    let (mut work, mut simulated) = (Vec::new(), Vec::new());
    match &evidence.base {
        Some(base) => simulated = base.as_read(number, grid.dt_s),
        None => pipeline.run(0.0, dt_s, &signals(grid).with_current(&current), &mut work, &mut simulated),
    }
    // One sample in so many; delays of a valve stay several of them up to 100 Hz.
    let every = simulated.len().div_ceil(LONGEST).max(1);
    let thin = |v: Vec<f64>| v.into_iter().step_by(every).collect::<Vec<f64>>();
    Ok((thin(simulated), thin(pressure), dt_s * every as f64))
}

/// How the simulation of this reading agrees with its pressure.
fn agreement(evidence: &Evidence, valve: &Valve, reading: Reading) -> Result<Agreement, PhysicsError> {
    let mut pairs = Vec::new();
    for number in 0..evidence.grids.len() {
        pairs.push(pair(evidence, number, valve, reading)?);
    }
    let (g_mean, y_mean) = (mean(pairs.iter().flat_map(|p| &p.0)), mean(pairs.iter().flat_map(|p| &p.1)));
    let longest = pairs.iter().map(|p| p.0.len()).max().unwrap_or(0);
    let dt_s = pairs.first().map_or(1.0, |p| p.2);
    let size = 2 * longest.next_power_of_two();
    let mut cross = vec![0.0; size];
    let mut circular = Vec::new();
    let (mut g2, mut y2, mut n) = (0.0, 0.0, 0.0);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (simulated, pressure, _) in &pairs {
        let centred = |v: &[f64], mean: f64| v.iter().map(|x| if x.is_finite() { x - mean } else { 0.0 }).collect::<Vec<f64>>();
        let (g, y) = (centred(simulated, g_mean), centred(pressure, y_mean));
        for (a, b) in g.iter().zip(&y) {
            (g2, y2, n) = (g2 + a * a, y2 + b * b, n + 1.0);
        }
        (low, high) = simulated.iter().filter(|v| v.is_finite()).fold((low, high), |(l, h), v| (l.min(*v), h.max(*v)));
        for (sum, c) in cross.iter_mut().zip(correlation(&g, &y, size)) {
            *sum += c;
        }
        if g.len() == longest && circular.is_empty() {
            circular = correlation(&g, &y, longest);
        }
    }
    if !(g2 > 0.0 && y2 > 0.0 && g2.is_finite() && y2.is_finite()) {
        let swing_bar = ((g2 / f64::max(n, 1.0)).max(0.0).sqrt(), (y2 / f64::max(n, 1.0)).max(0.0).sqrt());
        return Ok(Agreement { swing_bar, chance: 1.0, ..Agreement::default() });
    }
    let norm = (g2 * y2).sqrt();
    let at = |lag: i64| cross[lag.rem_euclid(size as i64) as usize] / norm;
    // A valve answers after the current, within a second; the model's own delay may be too long by itself.
    let slow = (dt_s / 0.01).max(1.0);
    let allowed_s = if valve_sized(valve) { SECOND_S } else { SECOND_S * slow };
    let first = -((valve.delay_s + 0.03) / dt_s).ceil() as i64 - 2;
    let last = (allowed_s / dt_s).ceil() as i64 + 1;
    // No farther than the recording lasts, however short its samples are as read.
    let end = longest as i64;
    let best = |from: i64, to: i64| (from.max(-end)..=to.min(end)).max_by(|a, b| at(*a).abs().total_cmp(&at(*b).abs())).unwrap_or(0);
    let lag = best(first, last);
    let far = best(-(longest as i64) / 2, longest as i64 / 2);
    let outside = !(first..=last).contains(&far) && at(far) > 0.0;
    let r = at(lag);
    let most = circular.iter().map(|c| c.abs()).fold(0.0, f64::max).max(1e-300);
    let here = circular.get(lag.rem_euclid(longest.max(1) as i64) as usize).map_or(0.0, |c| c.abs());
    let as_good = circular.iter().filter(|c| c.abs() > 0.98 * here.min(most)).count();
    let gain = r * (y2 / g2).sqrt();
    let middle = 0.5 * (low + high);
    Ok(Agreement {
        share: r * r,
        gain,
        zero_bar: y_mean + gain * (middle - g_mean) - middle,
        shift_s: lag as f64 * dt_s,
        anywhere: if outside { (at(far).powi(2), far as f64 * dt_s) } else { (r * r, lag as f64 * dt_s) },
        chance: as_good as f64 / circular.len().max(1) as f64,
        swing_bar: ((g2 / n).sqrt(), (y2 / n).sqrt()),
        span_bar: high - low,
    })
}

/// Sums of products of `g` with `y` so many samples later, around a circle of `size`.
fn correlation(g: &[f64], y: &[f64], size: usize) -> Vec<f64> {
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
    let transform = |values: &[f64]| {
        let mut input = values.to_vec();
        input.resize(size, 0.0);
        let mut spectrum = forward.make_output_vec();
        forward.process(&mut input, &mut spectrum).ok().map(|()| spectrum)
    };
    let (Some(a), Some(b)) = (transform(g), transform(y)) else { return vec![0.0; size] };
    let mut product: Vec<_> = a.iter().zip(&b).map(|(a, b)| a.conj() * b).collect();
    for end in [0, product.len() - 1] {
        // Real by construction; rounding must not make the transform refuse them.
        product[end].im = if end == 0 || size.is_multiple_of(2) { 0.0 } else { product[end].im };
    }
    let mut out = inverse.make_output_vec();
    if inverse.process(&mut product, &mut out).is_err() {
        return vec![0.0; size];
    }
    out.iter_mut().for_each(|v| *v /= size as f64);
    out
}

/// Simulation and pressure at each sample, the pressure shifted by `shift_s` [bar].
fn points(evidence: &Evidence, valve: &Valve, shift_s: f64) -> Result<Vec<(f64, f64)>, PhysicsError> {
    let mut points = Vec::new();
    for number in 0..evidence.grids.len() {
        let (simulated, pressure, dt_s) = pair(evidence, number, valve, Reading::default())?;
        let lag = (shift_s / dt_s).round() as i64;
        points.extend(simulated.iter().enumerate().filter_map(|(k, g)| {
            let y = *pressure.get(usize::try_from(k as i64 + lag).ok()?)?;
            (g.is_finite() && y.is_finite()).then_some((*g, y))
        }));
    }
    Ok(points)
}

/// Whether the pressure plainly follows the model on a line that a valve can have wherever the model's own curves hold.
fn follows_within(mut points: Vec<(f64, f64)>, valve: &Valve, plain: &Agreement) -> bool {
    let (bottom, top) = valve.curves.pressure_range_bar();
    points.retain(|p| (bottom..=top).contains(&p.0));
    if points.len() < BINS {
        return false;
    }
    let (g_mean, y_mean) = (mean(points.iter().map(|p| &p.0)), mean(points.iter().map(|p| &p.1)));
    let sum = |of: fn(f64, f64) -> f64| points.iter().map(|p| of(p.0 - g_mean, p.1 - y_mean)).sum::<f64>();
    let (g2, y2, gy) = (sum(|g, _| g * g), sum(|_, y| y * y), sum(|g, y| g * y));
    let (gain, middle) = (gy / g2, 0.5 * (bottom + top));
    let line = Agreement { share: gy * gy / (g2 * y2), gain, zero_bar: y_mean + gain * (middle - g_mean) - middle, ..*plain };
    line.share > PLAINLY && line.is_a_valve()
}

/// Share of the variance of the pressure that any rising curve over the simulation explains.
fn rising(mut points: Vec<(f64, f64)>) -> f64 {
    if points.len() < BINS {
        return 0.0;
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mean = points.iter().map(|p| p.1).sum::<f64>() / points.len() as f64;
    let total: f64 = points.iter().map(|p| (p.1 - mean).powi(2)).sum();
    // Pool adjacent violators over bins of equal count: sum, count.
    let mut pools: Vec<(f64, f64)> = Vec::new();
    for bin in points.chunks(points.len().div_ceil(BINS)) {
        pools.push((bin.iter().map(|p| p.1).sum(), bin.len() as f64));
        while let [.., a, b] = pools.as_slice() {
            if a.0 / a.1 <= b.0 / b.1 {
                break;
            }
            let joined = (a.0 + b.0, a.1 + b.1);
            pools.truncate(pools.len() - 2);
            pools.push(joined);
        }
    }
    let between: f64 = pools.iter().map(|(s, n)| n * (s / n - mean).powi(2)).sum();
    between / total.max(1e-300)
}
