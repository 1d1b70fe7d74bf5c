//! What is left after the effects, and on what it depends.

use rand::{RngExt, SeedableRng};

use super::diagnosis::Remainder;
use super::evidence::{Evidence, rms};
use super::locate::{bins, locate, variables};

/// Bins of the conditional mean.
const BINS: usize = 25;
/// Circular shifts of the residual: the null that keeps its correlation.
const SHIFTS: usize = 199;

/// A variable on which the rest depends.
struct Dependence {
    name: &'static str,
    /// Correlation ratio: share of the variance that the binned conditional mean has.
    share: f64,
    /// Chance of it by circular shifts.
    p_value: f64,
    /// Held-out gain of a table over it [bar].
    gain_bar: f64,
}

/// The remainder of a residual, or `None` where its RMS beyond the noise is below what is allowed; `(noise_bar, accuracy_bar)`: the
/// noise, and what may be left beyond it [bar]; `weighed`: the residual, each reading as much as it weighs, by which that is decided.
pub fn remainder(
    evidence: &Evidence,
    (residual, weighed): (&[f64], &[f64]),
    simulated_bar: &[f64],
    block: &[usize],
    (noise_bar, accuracy_bar): (f64, f64),
) -> Option<Remainder> {
    let beyond = |residual: &[f64]| (rms(residual).powi(2) - noise_bar.powi(2)).max(0.0).sqrt();
    if beyond(weighed) <= accuracy_bar {
        return None;
    }
    let mut random = rand_pcg::Pcg64::seed_from_u64(0x7265_6d61);
    let mut found: Vec<Dependence> = variables(evidence, simulated_bar)
        .iter()
        .map(|v| {
            let all = bins(&v.values, residual, BINS);
            let share = correlation_ratio(&all, residual, 0);
            let n = residual.len();
            let by_chance =
                (0..SHIFTS).filter(|_| correlation_ratio(&all, residual, random.random_range(n / 20..n - n / 20)) >= share).count();
            let p_value = (by_chance + 1) as f64 / (SHIFTS + 1) as f64;
            Dependence { name: v.name, share, p_value, gain_bar: table_gain(&all, residual, block) }
        })
        .collect();
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    let depends_on = found.iter().filter(|d| d.p_value <= 0.01 && d.share > 0.02).map(|d| (d.name.to_string(), d.share)).take(3).collect();
    let gain = found.iter().filter(|d| d.p_value <= 0.01).map(|d| d.gain_bar).fold(0.0, f64::max);
    Some(Remainder {
        rms_bar: beyond(residual),
        depends_on,
        table_heldout_gain_bar: gain,
        windows: locate(evidence, residual, simulated_bar).windows,
    })
}

/// Variance of the binned conditional mean over the variance, with the residual turned by `shift` samples.
fn correlation_ratio(bins: &[(f64, f64, Vec<usize>)], residual: &[f64], shift: usize) -> f64 {
    let n = residual.len();
    let (mut sum, mut square, mut count, mut between) = (0.0, 0.0, 0.0, 0.0);
    for (_, _, members) in bins {
        let (mut s, mut m) = (0.0, 0.0);
        for k in members {
            let e = residual[(k + shift) % n];
            if e.is_finite() {
                s += e;
                m += 1.0;
                square += e * e;
            }
        }
        if m > 0.0 {
            between += s * s / m;
        }
        sum += s;
        count += m;
    }
    let mean = sum * sum / f64::max(count, 1.0);
    (between - mean) / (square - mean).max(1e-300)
}

/// How much a table of the conditional mean, made on one half of the blocks, lowers the RMSE of the other [bar].
fn table_gain(bins: &[(f64, f64, Vec<usize>)], residual: &[f64], block: &[usize]) -> f64 {
    let mut corrected = residual.to_vec();
    for (_, _, members) in bins {
        for half in 0..2 {
            let other: Vec<f64> = members.iter().filter(|k| block[**k] % 2 != half).map(|k| residual[*k]).collect();
            let mean = other.iter().sum::<f64>() / (other.len() as f64 + 3.0);
            members.iter().filter(|k| block[**k] % 2 == half).for_each(|k| corrected[*k] -= mean);
        }
    }
    (rms(residual) - rms(&corrected)).max(0.0)
}
