//! Does the loop oscillate, and how regularly: the zero crossings of the autocorrelation.
//!
//! Source: Thornhill, Huang and Zhang, J. Process Control 13 (2003) 91: a period is regular where the mean of the intervals
//! between crossings is more than three times their standard deviation (r > 1).

use realfft::RealFftPlanner;

/// Intervals that are looked at: later ones are noise.
const INTERVALS: usize = 10;

/// An oscillation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oscillation {
    /// Period [samples].
    pub period: f64,
    /// Regularity; above one the period is one.
    pub regularity: f64,
}

/// The oscillation of a signal; `None` where its autocorrelation crosses zero fewer than three times.
pub fn oscillation(signal: &[f64]) -> Option<Oscillation> {
    let r = autocorrelation(signal);
    let end = signal.len() * 3 / 4;
    let mut crossings: Vec<f64> = Vec::new();
    for k in 1..end.min(r.len()) {
        if r[k - 1] * r[k] < 0.0 {
            crossings.push(k as f64 - 1.0 + r[k - 1] / (r[k - 1] - r[k]));
        }
        if crossings.len() > INTERVALS {
            break;
        }
    }
    // The first crossing is a quarter of a period from the maximum.
    let intervals: Vec<f64> = crossings.windows(2).map(|w| w[1] - w[0]).collect();
    if intervals.len() < 2 {
        return None;
    }
    let n = intervals.len() as f64;
    let mean = intervals.iter().sum::<f64>() / n;
    let spread = (intervals.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    Some(Oscillation { period: 2.0 * mean, regularity: mean / (3.0 * spread).max(1e-9) })
}

/// Autocorrelation over the lags, one at lag 0.
fn autocorrelation(signal: &[f64]) -> Vec<f64> {
    let n = signal.len();
    let finite = signal.iter().filter(|v| v.is_finite());
    let mean = finite.clone().sum::<f64>() / finite.count().max(1) as f64;
    let size = (2 * n).next_power_of_two();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
    let mut padded: Vec<f64> = signal.iter().map(|v| if v.is_finite() { v - mean } else { 0.0 }).collect();
    padded.resize(size, 0.0);
    let mut spectrum = forward.make_output_vec();
    let mut out = inverse.make_output_vec();
    let done = forward.process(&mut padded, &mut spectrum).is_ok() && {
        spectrum.iter_mut().for_each(|c| *c = (c.norm_sqr()).into());
        inverse.process(&mut spectrum, &mut out).is_ok()
    };
    if !done || out[0] <= 0.0 {
        return vec![0.0; n];
    }
    let at_zero = out[0];
    out.truncate(n);
    out.iter_mut().for_each(|v| *v /= at_zero);
    out
}
