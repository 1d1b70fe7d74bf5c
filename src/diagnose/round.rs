//! A round of a search: what could be added to a model, each candidate fitted.

use super::fit::{Fit, Fitter};
use crate::physics::Effect;

/// One candidate of one round.
pub struct Ranked<'a> {
    /// The effect that was tried.
    pub effect: &'static dyn Effect,
    /// The fit of the incumbent with it.
    pub fit: Fit<'a>,
}

/// One round: the incumbent and what could be added to it.
pub struct Round<'a> {
    /// The model before.
    pub incumbent: Fit<'a>,
    /// The candidates, best first.
    pub ranked: Vec<Ranked<'a>>,
    /// Effective samples that they were compared on.
    pub effective: f64,
}

impl<'a> Round<'a> {
    /// How much better a fit is than the model before, as a difference of BIC.
    pub fn gain(&self, fit: &Fit<'_>) -> f64 {
        self.incumbent.bic(self.effective) - fit.bic(self.effective)
    }

    /// The candidates that are causes, best first.
    pub fn causes(&self) -> impl Iterator<Item = &Ranked<'a>> {
        self.ranked.iter().filter(|r| r.effect.is_cause())
    }

    /// The effects whose candidates have gained this share of what the best one has, best first.
    pub fn promising(&self, share: f64) -> impl Iterator<Item = &'static dyn Effect> {
        let least = self.ranked.first().map_or(0.0, |best| share * self.gain(&best.fit));
        self.ranked.iter().take_while(move |candidate| self.gain(&candidate.fit) >= least).map(|candidate| candidate.effect)
    }

    /// Whether this effect was tried in it.
    pub fn tried(&self, id: &str) -> bool {
        self.ranked.iter().any(|c| c.effect.id() == id)
    }

    /// Where the fit of an effect has ended.
    pub fn end_of(&self, effect: &dyn Effect) -> Option<Vec<f64>> {
        let fit = &self.ranked.iter().find(|c| c.effect.id() == effect.id())?.fit;
        Some(fit.theta[fit.model.place(fit.model.effects.len() - 1)].to_vec())
    }

    /// `less` with an effect more, fitted also from where its fit has ended here.
    pub fn beside(&self, fitter: &Fitter<'_>, effect: &'static dyn Effect, less: &Fit<'a>) -> Fit<'a> {
        fitter.simplified(fitter.fit_new(&less.model.with(effect, 0.0), less, &Vec::from_iter(self.end_of(effect))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::diagnose::model::Model;
    use crate::physics::effect;

    #[test]
    fn who_gains_less_than_half_of_what_the_best_one_does_is_not_promising() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(1000), |_, _| 0.0)]);
        let fitter = Fitter::new(&evidence);
        let incumbent = fitter.recalibrate(&Model::base(&valve).unwrap().on(&evidence), &[]);
        let effective = fitter.effective();
        let gaining = |id: &str, nats: f64| {
            let fit = Fit { mean_nats: incumbent.mean_nats - nats / effective, ..incumbent.clone() };
            Ranked { effect: effect(id).unwrap(), fit }
        };
        let ranked = vec![gaining("creep", 90.0), gaining("leakage", 46.0), gaining("stiction", 44.0), gaining("sensor_drift", -3.0)];
        let ids = |round: &Round<'_>| round.promising(0.5).map(|e| e.id()).collect::<Vec<_>>();
        assert_eq!(ids(&Round { incumbent: incumbent.clone(), ranked, effective }), ["creep", "leakage"]);
        assert!(ids(&Round { incumbent, ranked: Vec::new(), effective }).is_empty());
    }
}
