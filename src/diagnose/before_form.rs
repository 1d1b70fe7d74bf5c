//! A cause goes before a free form that imitates it.
//!
//! A free form of the curve bends wherever the curve has moved, for whatever reason, and follows the record at least as well as the
//! reason itself; beside it, the reason then looks needless. So where a form has been left alone, the causes that came near are fitted
//! in its place, and one that leaves next to nothing beyond the floor stays.

use rayon::prelude::*;

use super::confirm::confirmed;
use super::fit::{Fit, Fitter};
use super::hollow::explains;
use super::search::Search;
use crate::physics::Kind;

/// Most causes that are tried in the place of a form.
const MOST: usize = 3;

/// Puts a cause in the place of a free form that was found without any, where it explains the record by itself and takes more than
/// half of what the form does; on healthy valves none does, since what a model's curves lack has the course of no cause.
pub fn cause_before_form(fitter: &Fitter<'_>, search: &mut Search<'_>) {
    let chosen = &search.chosen;
    let (mut has_form, mut has_cause) = (None, false);
    for (k, effect) in chosen.model.effects.iter().enumerate() {
        match effect.kind() {
            Kind::Form => has_form = Some(k),
            _ => has_cause |= !effect.imitates_form(),
        }
    }
    let (Some(k), false, Some(round)) = (has_form, has_cause, search.rounds.first()) else { return };
    let effective = fitter.effective();
    let less = fitter.refit_without(chosen, k);
    let causes: Vec<_> = round.causes().filter(|r| round.gain(&r.fit) > fitter.criteria.very_strong).take(MOST).collect();
    let fitted: Vec<Fit<'_>> = causes.into_par_iter().map(|r| round.beside(fitter, r.effect, &less)).collect();
    let Some(best) = fitted.into_iter().min_by(|a, b| a.bic(effective).total_cmp(&b.bic(effective))) else { return };
    let gains = |fit: &Fit<'_>| less.bic(effective) - fit.bic(effective);
    if gains(&best) > fitter.criteria.cause_first * gains(chosen) && explains(fitter, &search.null, &best) {
        let count = best.model.effects.len();
        let held = confirmed(fitter, best, false, &[]);
        if held.model.effects.len() == count {
            search.chosen = held;
        }
    }
}
