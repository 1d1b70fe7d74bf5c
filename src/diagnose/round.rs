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
