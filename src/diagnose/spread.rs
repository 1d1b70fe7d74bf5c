//! How far the parameters of a model move from one model to the next that the recording allows.
//!
//! A standard error takes the model for granted. With one effect more, which the recording neither asks for nor excludes, the same
//! parameters would stand elsewhere. So their variance has a second part: that between the models, each by its weight (Draper, J. R.
//! Stat. Soc. B 57 (1995) 45, eq. 6).

use super::fit::{Fit, Fitter};
use super::round::Round;

/// The variance between models of each parameter of `chosen`, in its own unit: from the round of the search in which nothing more was
/// worth adding to it. All that was tried there together is as likely beforehand as nothing more.
pub fn between_models(fitter: &Fitter<'_>, chosen: &Fit<'_>, rounds: &[Round<'_>]) -> Vec<f64> {
    let own = chosen.theta.len();
    let mut variance = vec![0.0; own];
    let Some(round) = rounds.iter().rev().find(|round| round.incumbent.ids() == chosen.ids()) else { return variance };
    let usual = round.incumbent.bic(round.effective);
    let weight = |fit: &Fit<'_>| {
        let nats = -0.5 * fitter.criteria.power * (fit.bic(round.effective) - usual);
        // What is much better than the incumbent and yet was not taken is no better as a model of it.
        nats.min(0.0).exp() / round.ranked.len() as f64
    };
    let weights: Vec<f64> = round.ranked.iter().map(|tried| weight(&tried.fit)).collect();
    let all = 1.0 + weights.iter().sum::<f64>();
    for (tried, weight) in round.ranked.iter().zip(weights) {
        for (v, (there, here)) in variance.iter_mut().zip(tried.fit.theta.iter().zip(&round.incumbent.theta)) {
            *v += weight / all * (there - here).powi(2);
        }
    }
    variance
}

#[cfg(test)]
mod tests {
    use super::super::base::AT;
    use super::super::model::Model;
    use super::super::round::Ranked;
    use super::super::simulator::Simulator;
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::physics::EFFECTS;

    #[test]
    fn a_parameter_that_another_likely_model_would_move_is_known_less_well() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(6000), |k, _| if k.is_multiple_of(2) { 0.02 } else { -0.02 })]);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let fitter = Fitter::new(&evidence);
        let incumbent = fitter.score(&mut Simulator::new(&evidence), &base, &base.calibrated(), &mut Vec::new());
        let moved = |gain: f64, mean_nats: f64| {
            let mut fit = incumbent.clone();
            fit.theta[AT.gain] += gain;
            fit.mean_nats += mean_nats;
            Ranked { effect: EFFECTS[0], fit }
        };
        let spread = |tried: Vec<Ranked<'_>>| {
            let rounds = [Round { incumbent: incumbent.clone(), ranked: tried, effective: 300.0 }];
            between_models(&fitter, &incumbent, &rounds)[AT.gain].sqrt()
        };
        // As likely as the incumbent, and alone: half of the weight is elsewhere.
        assert!((spread(vec![moved(0.02, 0.0)]) - 0.02 * 0.5f64.sqrt()).abs() < 1e-12);
        assert!(spread(vec![moved(0.02, 0.0), moved(0.0, 0.0)]) < 0.011);
        assert!(spread(vec![moved(0.02, 1.0)]) < 1e-6, "a model that is far less likely says nothing");
        assert!(between_models(&fitter, &incumbent, &[]).iter().all(|v| *v == 0.0));
    }
}
