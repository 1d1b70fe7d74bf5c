//! Friction or none, by the shape of the oscillation: the course that the output gives through a lag, over the whole record.
//!
//! One step ahead much of an oscillation is in the past values already, and where the readings are noisy little is left to tell
//! by. Over its course a stem that slips gives corners that no lag makes of the output itself, nor a sine beside it.
//!
//! Source: Rossi and Scali, J. Process Control 15 (2005) 505 (the response to a relay against a sine); Bacci di Capaci, Scali and
//! Pannocchia, Comput. Chem. Eng. 84 (2016) 345 (grid of stems in front of a linear process).

use rayon::prelude::*;

use super::heldout::{FOLDS, Heldout};
use super::regression::{ALL, LONGEST_DELAY, Solved, Sums, Used};
use super::stick_slip::StickSlip;

/// Lags that are tried [samples]; the last is an integrator.
const LAGS: [f64; 10] = [0.0, 1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 35.0, 70.0, f64::INFINITY];
/// Delays of the course behind a stem [samples]; the output itself is tried at each.
const DELAYS: [usize; 8] = [1, 2, 3, 4, 6, 8, 11, LONGEST_DELAY];
/// Bands that are tried, as shares of the output's range: from, to, how many.
const BANDS: (f64, f64, usize) = (0.1, 1.1, 18);
/// Jumps that are tried, as shares of the band.
const JUMPS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
/// A stem that breaks away less often shows no shape.
const FEWEST_SLIPS: usize = 3;

/// A course through a lag.
struct Form {
    lag: f64,
    delay: usize,
    sums: Sums,
}

/// A process of first order behind a stem, fitted by its course; values scaled as they were given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Process {
    /// Process value over position.
    pub gain: f64,
    /// Process value where the position is zero.
    pub offset: f64,
    /// Lag [samples].
    pub lag: f64,
    /// Delay [samples].
    pub delay: usize,
}

/// What the courses say.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Mean squared error of the best course with friction and of the best without, on the blocks that were held out.
    pub heldout: (f64, f64),
    /// Chance of such gains on the blocks.
    pub p_value: f64,
    /// 95 % interval of the mean gain over the blocks [nats].
    pub gain: (f64, f64),
}

/// Compares the courses; `period` of the oscillation, where there is one [samples].
pub fn shape(value: &[f64], output: &[f64], range: f64, period: Option<f64>) -> Option<Shape> {
    let stems = StickSlip::grid((BANDS.0 * range, BANDS.1 * range, BANDS.2), &JUMPS);
    let with: Vec<Form> = stems.par_iter().flat_map_iter(|stem| behind(value, output, *stem, &LAGS)).collect();
    let mut forms = Vec::new();
    for lag in LAGS {
        for delay in 0..=LONGEST_DELAY {
            for curved in [false, true] {
                forms.extend([None, period].map(|period| (lag, delay, curved, period)));
            }
        }
    }
    let without: Vec<Form> =
        forms.into_par_iter().map(|(lag, delay, curved, period)| plain(value, output, (lag, delay), curved, period)).collect();
    let mut heldout = Heldout::default();
    for fold in 0..FOLDS {
        let used = Heldout::used(fold);
        let ((f, with), (r, without)) = (best(&with, &used)?, best(&without, &used)?);
        heldout.fold(&used, |b| r.sums.error(&without.theta, b), |b| f.sums.error(&with.theta, b));
    }
    let (without, with) = heldout.mean_squares();
    Some(Shape { heldout: (with, without), p_value: heldout.p_value(), gain: heldout.gain() })
}

/// The process behind this stem.
pub fn process(value: &[f64], output: &[f64], stem: StickSlip) -> Option<Process> {
    let all = behind(value, output, stem, &LAGS[..LAGS.len() - 1]);
    let (form, solved) = best(&all, &ALL)?;
    Some(Process { offset: solved.theta[0], gain: solved.theta[2], lag: form.lag, delay: form.delay })
}

fn best<'f>(forms: &'f [Form], used: &Used) -> Option<(&'f Form, Solved)> {
    let solved = forms.par_iter().filter_map(|form| Some((form, form.sums.solve(used)?)));
    solved.min_by(|a, b| a.1.variance.total_cmp(&b.1.variance))
}

/// The courses behind a stem.
fn behind(value: &[f64], output: &[f64], stem: StickSlip, lags: &[f64]) -> Vec<Form> {
    let mut position = Vec::new();
    if stem.follow(output, &mut position) < FEWEST_SLIPS {
        return Vec::new();
    }
    let of_lag = |lag: &f64| {
        let z = lagged(&position, *lag);
        DELAYS.map(|delay| {
            let sums = Sums::over(value, 3, |t, row| row.extend([1.0, share(t, value), z[t - delay]]));
            Form { lag: *lag, delay, sums }
        })
    };
    lags.iter().flat_map(of_lag).collect()
}

/// The course of the output itself, its square and cube, and a sine where asked for.
fn plain(value: &[f64], output: &[f64], (lag, delay): (f64, usize), curved: bool, period: Option<f64>) -> Form {
    let powers: Vec<Vec<f64>> =
        (1..=if curved { 3 } else { 1 }).map(|p| lagged(&output.iter().map(|u| u.powi(p)).collect::<Vec<_>>(), lag)).collect();
    let width = 2 + powers.len() + if period.is_some() { 2 } else { 0 };
    let sums = Sums::over(value, width, |t, row| {
        row.extend([1.0, share(t, value)]);
        row.extend(powers.iter().map(|z| z[t - delay]));
        if let Some(period) = period {
            let (sin, cos) = (std::f64::consts::TAU * t as f64 / period).sin_cos();
            row.extend([sin, cos]);
        }
    });
    Form { lag, delay, sums }
}

/// Where in the record a sample stands, about its middle.
fn share(t: usize, value: &[f64]) -> f64 {
    t as f64 / value.len() as f64 - 0.5
}

/// A signal through a first-order lag; through an integrator where the lag is without end.
fn lagged(signal: &[f64], lag: f64) -> Vec<f64> {
    let n = signal.len() as f64;
    if lag.is_infinite() {
        let mean = signal.iter().sum::<f64>() / n;
        let sum = signal.iter().scan(0.0, |sum, v| {
            *sum += (v - mean) / n;
            Some(*sum)
        });
        return sum.collect();
    }
    let kept = if lag > 0.0 { (-1.0 / lag).exp() } else { 0.0 };
    let first = signal.first().copied().unwrap_or(0.0);
    let course = signal.iter().scan(first, |z, v| {
        *z = kept * *z + (1.0 - kept) * v;
        Some(*z)
    });
    course.collect()
}
