//! Causes in name only: what was found, fitted as well as it can be, and still leaves half of the error.
//!
//! Where the physics is none of the library, the effect that imitates it best takes a part of the error, on this record
//! alone. Such a name is worse than none, and the model with it is no better on another drive.

use super::fit::{Fit, Fitter};
use super::heldout::{carried_forward, held_out};
use super::model::Simulator;
use super::scatter::Scattered;
use super::search::Search;
use crate::physics::Kind;

/// Takes causes in name only out of what was chosen; their ids. Where all together do not explain enough, as many of the first
/// ones stay as are needed to halve the held-out error, and go on to do so beyond the data of their fit: physics that is there
/// beside more that nothing in the library holds.
///
/// `of_form`: whether a form of the loop may be called a cause, as data of the good valve makes it.
pub fn drop_hollow(fitter: &Fitter<'_>, search: &mut Search<'_>, of_form: bool) -> Vec<&'static str> {
    if explains(fitter, &search.null, &search.chosen) {
        return Vec::new();
    }
    let held = |fit: &Fit<'_>| held_out(fitter, fit, HELD_STEPS).weighed_bar();
    let enough = HALF * held(&search.null);
    let mut dropped = Vec::new();
    let mut fit = search.chosen.clone();
    let mut stays = None;
    while let Some(k) = fit.model.effects.iter().rposition(|e| !e.imitates_form() || of_form && e.kind() != Kind::Form) {
        if held(&fit) < enough && carried_forward(fitter, &fit, &search.null) > fitter.criteria.carried {
            stays = Some((fit.clone(), dropped.len()));
        }
        dropped.push(fit.model.effects[k].id());
        fit = fitter.refit_without(&fit, k);
    }
    let (chosen, count) = stays.unwrap_or((fit, dropped.len()));
    dropped.truncate(count);
    dropped.reverse();
    if !dropped.is_empty() {
        search.chosen = chosen;
    }
    dropped
}

/// Takes out what spoils readings where most of the error lies in the others: the readings stay out of the fit, and no cause is
/// named for them.
pub fn drop_hollow_scatter(fitter: &Fitter<'_>, search: &Search<'_>, scattered: &mut Vec<Scattered>) -> Vec<&'static str> {
    let (spoilt, kept): (Vec<Scattered>, Vec<Scattered>) =
        std::mem::take(scattered).into_iter().partition(|s| !s.finding.masked.is_empty());
    let all = fitter.evidence.pressure_bar();
    let squares = |fit: &Fit<'_>, measured: &[f64]| {
        let mut residual = Vec::new();
        Simulator::new(fitter.evidence).residual(&fit.model, &fit.theta, measured, &mut residual);
        fitter.weigh(&mut residual);
        let finite = residual.iter().filter(|e| e.is_finite());
        finite.map(|e| e * e - fitter.floor_bar.powi(2)).sum::<f64>()
    };
    let (before, after) = (squares(&search.null, &all), squares(&search.chosen, &fitter.measured));
    *scattered = kept;
    if after <= (1.0 - fitter.criteria.explains) * before {
        scattered.extend(spoilt);
        return Vec::new();
    }
    spoilt.iter().map(|s| s.effect.id()).collect()
}

/// Part of the held-out error that causes may leave where others are missing,
const HALF: f64 = 0.5;
/// and the steps of the fits that are held out.
const HELD_STEPS: usize = 4;

/// Whether the effects take enough of what is beyond the floor, by the squared error or by the scale of the residual; where
/// a parameter of the base had to stand in for them, or a signature speaks, the error does not say it.
pub fn explains(fitter: &Fitter<'_>, null: &Fit<'_>, chosen: &Fit<'_>) -> bool {
    let criteria = &fitter.criteria;
    let floor2 = fitter.floor_bar.powi(2);
    let part = |before: f64, after: f64| (before * before - after * after) / (before * before - floor2).max(0.1 * floor2);
    let stood_in = null.prior_nats - chosen.prior_nats > 0.5 * criteria.very_strong;
    let signed = chosen.model.signature_nats() > criteria.very_strong;
    stood_in || signed || part(null.rmse_bar, chosen.rmse_bar).max(part(null.scale_bar, chosen.scale_bar)) > criteria.explains
}
