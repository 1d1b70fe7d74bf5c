//! The yardstick for the size of an effect: what a plain model of the healthy valve leaves of a record.
//!
//! A plain model is one play operator and a polynomial of the fourth degree, fitted to the sweep by least squares, with the delay known. It
//! belongs to the challenge, so that the size of an effect does not depend on the program that is put to the test.

use nalgebra::{DMatrix, DVector};

use super::case::Case;
use super::memory::Play;
use super::session::healthy_sweep;

/// RMSE [bar] of the plain model on the record of the healthy valve in open loop (its currents and pressures), noise
/// included.
pub(super) fn floor_bar(case: &Case, currents: &[f64], measured: &[f64]) -> f64 {
    let sweep = healthy_sweep(case);
    let swept = sweep.pressure_bar.as_deref().unwrap_or_default();
    let behind = (case.delay_s() * case.rate_hz).round() as usize + 1;
    let best = (0..8)
        .map(|k| 0.004 + 0.002 * f64::from(k))
        .filter_map(|radius_a| {
            let rows = features(&sweep.current_a, radius_a, behind);
            let weights = fitted(&rows, swept)?;
            Some((rmse(&rows, swept, &weights), radius_a, weights))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let noise = case.noise_bar();
    best.map_or(noise, |(_, radius_a, weights)| rmse(&features(currents, radius_a, behind), measured, &weights).max(noise))
}

/// Powers of the played current of a delay ago.
fn features(current_a: &[f64], radius_a: f64, behind: usize) -> Vec<[f64; 5]> {
    let mut play = Play::new(radius_a, current_a[0]);
    let felt: Vec<f64> = current_a.iter().map(|i| play.step(*i)).collect();
    (0..felt.len()).map(|k| felt[k.saturating_sub(behind)]).map(|i| [1.0, i, i * i, i.powi(3), i.powi(4)]).collect()
}

/// Where the clutch is empty there is no curve to fit.
const BEARS_BAR: f64 = 0.5;

fn fitted(rows: &[[f64; 5]], y: &[f64]) -> Option<DVector<f64>> {
    let mut normal = DMatrix::<f64>::zeros(5, 5);
    let mut right = DVector::<f64>::zeros(5);
    for (row, p) in rows.iter().zip(y).filter(|(_, p)| **p > BEARS_BAR) {
        for a in 0..5 {
            right[a] += row[a] * p;
            for b in 0..5 {
                normal[(a, b)] += row[a] * row[b];
            }
        }
    }
    normal.lu().solve(&right)
}

fn rmse(rows: &[[f64; 5]], y: &[f64], weights: &DVector<f64>) -> f64 {
    let square = |(row, p): (&[f64; 5], &f64)| (row.iter().zip(weights.iter()).map(|(x, w)| x * w).sum::<f64>().max(0.0) - p).powi(2);
    (rows.iter().zip(y).map(square).sum::<f64>() / y.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::draw::placed;
    use super::super::session::in_open_loop;
    use super::*;

    #[test]
    fn a_plain_model_leaves_the_noise_and_the_form_of_the_loop() {
        for seed in [3, 8, 12] {
            let case = placed(seed, Vec::new());
            let (currents, measured) = in_open_loop(&case, &[]);
            let floor = floor_bar(&case, &currents, &measured);
            assert!((1.0 * case.noise_bar()..0.8).contains(&floor), "seed {seed}: {floor} at noise {}", case.noise_bar());
        }
    }
}
