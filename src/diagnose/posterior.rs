//! Posterior shares of models that could stand in each other's place.
//!
//! No candidate is exactly true, and a posterior that takes one for true jumps from certainty to certainty between two
//! records of the same valve. Bagging mends that: the posterior is averaged over bootstrap samples of the blocks of the
//! record, so that what a few stretches decide is not taken for decided (Huggins and Miller, Reproducible model selection
//! using bagged posteriors, Bayesian Analysis 18 (2023) 79). Evidence is BIC on effective samples, as in the search.

use rand::{RngExt, SeedableRng};

use super::fit::{Fit, Fitter};
use super::heldout::blocks;
use super::loss;
use super::model::Simulator;

/// Bootstrap samples.
const BAGS: usize = 200;

/// The share of each of `fits`; they sum to one.
pub fn shares(fitter: &Fitter<'_>, fits: &[&Fit<'_>]) -> Vec<f64> {
    let block = blocks(fitter);
    let parts: Vec<(Vec<f64>, f64)> = fits.iter().map(|fit| (by_block(fitter, fit, &block), price(fitter, fit))).collect();
    bagged(&parts)
}

/// Nats of each block, on effective samples: the mean of the two likelihoods of [`Fit::bic`].
fn by_block(fitter: &Fitter<'_>, fit: &Fit<'_>, block: &[usize]) -> Vec<f64> {
    let mut residual = Vec::new();
    Simulator::new(fitter.evidence).residual(&fit.model, &fit.theta, &fitter.measured, &mut residual);
    let per_sample = fitter.effective() / fitter.used().max(1) as f64;
    let (scale2, rmse2) = (fit.scale_bar.powi(2), fit.rmse_bar.powi(2));
    let mut sums = vec![0.0; block.last().map_or(0, |b| b + 1)];
    for (e, b) in residual.iter().zip(block).filter(|(e, _)| e.is_finite()) {
        let heavy = 0.5 * scale2.ln() + 0.5 * (loss::DEGREES + 1.0) * (e * e / (loss::DEGREES * scale2)).ln_1p();
        let normal = 0.5 * rmse2.ln() + 0.5 * e * e / rmse2;
        sums[*b] += 0.5 * (heavy + normal) * per_sample;
    }
    sums
}

/// What a model pays before any data [nats].
fn price(fitter: &Fitter<'_>, fit: &Fit<'_>) -> f64 {
    fit.prior_nats - fit.model.signature_nats() + 0.5 * fit.model.extra_parameters() as f64 * fitter.effective().ln()
}

/// Mean over bootstrap samples of the blocks of each model's posterior; `parts`: nats of each block, and the price.
fn bagged(parts: &[(Vec<f64>, f64)]) -> Vec<f64> {
    let blocks = parts.first().map_or(0, |p| p.0.len());
    let mut random = rand_pcg::Pcg64::seed_from_u64(0x6261_6773);
    let mut shares = vec![0.0; parts.len()];
    for _ in 0..BAGS {
        let mut evidence: Vec<f64> = parts.iter().map(|p| -p.1).collect();
        for _ in 0..blocks {
            let b = random.random_range(0..blocks);
            for (sum, part) in evidence.iter_mut().zip(parts) {
                *sum -= part.0[b];
            }
        }
        let most = evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = evidence.iter().map(|e| (e - most).exp()).sum();
        for (share, e) in shares.iter_mut().zip(&evidence) {
            *share += (e - most).exp() / total / BAGS as f64;
        }
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_models_share_equally_and_a_better_one_everywhere_takes_all() {
        let even: Vec<f64> = (0..24).map(|b| f64::from(b % 5)).collect();
        let better: Vec<f64> = even.iter().map(|e| e - 1.0).collect();
        let shares = bagged(&[(even.clone(), 0.0), (even.clone(), 0.0)]);
        assert!((shares[0] - 0.5).abs() < 1e-9);
        assert!(bagged(&[(even.clone(), 0.0), (better, 0.0)])[1] > 0.999);
        // A parameter more has its price.
        assert!(bagged(&[(even.clone(), 3.0), (even, 0.0)])[0] < 0.06);
    }

    #[test]
    fn what_one_stretch_decides_is_not_decided() {
        let even = vec![1.0; 24];
        let mut once = even.clone();
        once[7] -= 30.0;
        let shares = bagged(&[(even, 0.0), (once, 5.0)]);
        // The block is absent from (1 - 1/24)^24 = 36 % of the bootstrap samples, and there the other wins.
        assert!((0.25..0.45).contains(&shares[0]), "{shares:?}");
    }
}
