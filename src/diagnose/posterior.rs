//! Posterior shares of models that could stand in each other's place.
//!
//! No candidate is exactly true, and a posterior that takes one for true jumps from certainty to certainty between two
//! records of the same valve. Bagging mends that: the posterior is averaged over bootstrap samples of the blocks of the
//! record, so that what a few stretches decide is not taken for decided (Huggins and Miller, Reproducible model selection
//! using bagged posteriors, Bayesian Analysis 18 (2023) 79). Evidence is BIC on effective samples, as in the search.
//!
//! Nor is any of the candidates the physics of the valve to the last detail, and evidence grows with every sample for the one whose
//! simplification happens to suit the record. So it counts as of fewer samples: it is raised to a power below one (Miller and Dunson,
//! Robust Bayesian inference via coarsening, J. Am. Stat. Assoc. 114 (2019) 1113).
//!
//! Where data of the good valve says how far a model is off when nothing is wrong, what is left on the record is noise in one
//! part and that error of form in the other. Of the error of form only its size is known, and that within a factor: models that
//! are off by no more than it cannot be told apart by being off less, as the more flexible of them has followed it.

use rand::{RngExt, SeedableRng};

use super::fit::{Fit, Fitter};
use super::heldout::blocks;
use super::loss;
use super::simulator::Simulator;

/// Bootstrap samples.
const BAGS: usize = 200;

/// The share of each of `fits`; they sum to one.
pub fn shares(fitter: &Fitter<'_>, fits: &[&Fit<'_>]) -> Vec<f64> {
    let block = blocks(fitter);
    let parts: Vec<(Vec<f64>, f64)> = fits.iter().map(|fit| (by_block(fitter, fit, &block), price(fitter, fit, &block))).collect();
    bagged(&parts, fitter.criteria.power)
}

/// The part of the error of a model that nothing is wrong with that is noise; the rest is form.
fn noise_part(fitter: &Fitter<'_>) -> f64 {
    (fitter.evidence.noise_bar / fitter.floor_bar).powi(2).min(1.0)
}

/// What an error of form makes of a fit that leaves more than it [nats]: its size on another record is known within a factor.
pub fn of_form(fitter: &Fitter<'_>, fit: &Fit<'_>) -> f64 {
    let beyond = (fit.rmse_bar / fitter.floor_bar).ln().max(0.0);
    0.5 * (1.0 - noise_part(fitter)) * (beyond / fitter.criteria.structure_known.ln()).powi(2)
}

/// Nats of each block, on effective samples: the mean of the two likelihoods of [`Fit::bic`].
fn by_block(fitter: &Fitter<'_>, fit: &Fit<'_>, block: &[usize]) -> Vec<f64> {
    let mut residual = Vec::new();
    fitter.residual(&mut Simulator::new(fitter.evidence), &fit.model, &fit.theta, &mut residual);
    let per_sample = noise_part(fitter) * fitter.effective() / fitter.used().max(1) as f64;
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
fn price(fitter: &Fitter<'_>, fit: &Fit<'_>, block: &[usize]) -> f64 {
    let (noise, blocks) = (noise_part(fitter), block.last().map_or(1.0, |b| *b as f64 + 1.0));
    // An error of form is one draw in each block.
    let effective = noise * fitter.effective() + (1.0 - noise) * blocks;
    // What can go one way only, as a leak, had all of its prior on that side: twice the density of what might have gone either way.
    let either_way = fit.model.two_sided_parameters() as f64 * std::f64::consts::LN_2;
    let parameters = 0.5 * fit.model.extra_parameters() as f64 * effective.ln() + either_way;
    fit.prior_nats - fit.model.signature_nats() + parameters + of_form(fitter, fit)
}

/// Mean over bootstrap samples of the blocks of each model's posterior, of which the evidence is raised to `power`; `parts`: nats of
/// each block, and the price.
fn bagged(parts: &[(Vec<f64>, f64)], power: f64) -> Vec<f64> {
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
        evidence.iter_mut().for_each(|e| *e *= power);
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
    use crate::diagnose::base::AT;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::diagnose::model::Model;

    #[test]
    fn what_can_go_one_way_only_had_staked_all_on_it() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |k, _| if k % 2 == 0 { 0.02 } else { -0.02 })]);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let fitter = Fitter::new(&evidence);
        let block = blocks(&fitter);
        let priced = |id: &str, values: &[f64], held: &[usize]| {
            let model = held.iter().fold(base.with(crate::physics::effect(id).unwrap(), 0.0), |model, j| model.holding(*j).unwrap());
            let theta = [base.calibrated().as_slice(), values].concat();
            let fit = fitter.score(&mut Simulator::new(&evidence), &model, &theta, &mut Vec::new());
            price(&fitter, &fit, &block)
        };
        let (gain, leak) = (priced("sensor_gain", &[-1e-9], &[]), priced("leakage", &[1e-9, 1.0, 0.0], &[1, 2]));
        assert!((gain - leak - std::f64::consts::LN_2).abs() < 1e-6, "{gain} {leak}");
    }

    #[test]
    fn equal_models_share_equally_and_a_better_one_everywhere_takes_all() {
        let even: Vec<f64> = (0..24).map(|b| f64::from(b % 5)).collect();
        let better: Vec<f64> = even.iter().map(|e| e - 1.0).collect();
        let shares = bagged(&[(even.clone(), 0.0), (even.clone(), 0.0)], 1.0);
        assert!((shares[0] - 0.5).abs() < 1e-9);
        assert!(bagged(&[(even.clone(), 0.0), (better, 0.0)], 1.0)[1] > 0.999);
        // Twenty to one in nats is no more than four to one where no model is true.
        let near: Vec<f64> = even.iter().map(|e| e - 3.0 / 24.0).collect();
        let of = |power: f64| bagged(&[(even.clone(), 0.0), (near.clone(), 0.0)], power)[1];
        assert!(of(1.0) > 0.94 && (0.78..0.85).contains(&of(0.5)), "{} {}", of(1.0), of(0.5));
        // A parameter more has its price.
        assert!(bagged(&[(even.clone(), 3.0), (even, 0.0)], 1.0)[0] < 0.06);
    }

    #[test]
    fn models_that_leave_less_than_the_good_valve_does_are_not_told_apart_by_it() {
        let valve = straight();
        let wander = |k: usize, _| if (k / 40).is_multiple_of(2) { 0.1 } else { -0.1 };
        let evidence = held(vec![straight_run(waves(6000), wander)]);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let shares_at = |floor_bar: f64, gain: f64| {
            let fitter = Fitter { floor_bar, ..Fitter::new(&evidence) };
            let mut theta = base.calibrated();
            let mut of = |gain: f64| {
                theta[AT.gain] = gain;
                let fit = fitter.score(&mut Simulator::new(&evidence), &base, &theta, &mut Vec::new());
                Fit { prior_nats: 0.0, ..fit }
            };
            let (near, far) = (of(0.0), of(gain));
            shares(&fitter, &[&near, &far])[1]
        };
        // 0.10 bar of RMSE against 0.14: decided where noise is all that there is, open where the good valve leaves 0.15 bar.
        assert!(shares_at(0.02, 0.0095) < 0.01, "{}", shares_at(0.02, 0.0095));
        assert!(shares_at(0.15, 0.0095) > 0.1, "{}", shares_at(0.15, 0.0095));
        // Three times as far off as the good valve is another matter.
        assert!(shares_at(0.15, 0.045) < 0.02, "{}", shares_at(0.15, 0.045));
    }

    #[test]
    fn what_one_stretch_decides_is_not_decided() {
        let even = vec![1.0; 24];
        let mut once = even.clone();
        once[7] -= 30.0;
        let shares = bagged(&[(even, 0.0), (once, 5.0)], 1.0);
        // The block is absent from (1 - 1/24)^24 = 36 % of the bootstrap samples, and there the other wins.
        assert!((0.25..0.45).contains(&shares[0]), "{shares:?}");
    }
}
