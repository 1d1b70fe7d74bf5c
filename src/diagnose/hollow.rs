//! Causes in name only: what was found, fitted as well as it can be, and still leaves half of the error.
//!
//! Where the physics is none of the library, the effect that imitates it best takes a part of the error, on this record
//! alone. Such a name is worse than none, and the model with it is no better on another drive.

use super::fit::{Fit, Fitter};
use super::search::Search;

/// Takes causes in name only out of what was chosen; their ids.
pub fn drop_hollow(fitter: &Fitter<'_>, search: &mut Search<'_>) -> Vec<&'static str> {
    let mut dropped = Vec::new();
    if explains(fitter, &search.null, &search.chosen) {
        return dropped;
    }
    let mut fit = search.chosen.clone();
    while let Some(k) = fit.model.effects.iter().position(|e| !e.imitates_form()) {
        dropped.push(fit.model.effects[k].id());
        let mut start = fit.theta.clone();
        start.drain(fit.model.place(k));
        fit = fitter.refit(&fit.model.without(k), &start);
    }
    if !dropped.is_empty() {
        search.chosen = fit;
    }
    dropped
}

/// Whether the effects take enough of what is beyond the floor, by the squared error or by the scale of the residual; where
/// a parameter of the base had to stand in for them, or a signature speaks, the error does not say it.
fn explains(fitter: &Fitter<'_>, null: &Fit<'_>, chosen: &Fit<'_>) -> bool {
    let criteria = &fitter.criteria;
    let floor2 = fitter.floor_bar.powi(2);
    let part = |before: f64, after: f64| (before * before - after * after) / (before * before - floor2).max(0.1 * floor2);
    let stood_in = null.prior_nats - chosen.prior_nats > 0.5 * criteria.very_strong;
    let signed = chosen.model.signature_nats() > criteria.very_strong;
    stood_in || signed || part(null.rmse_bar, chosen.rmse_bar).max(part(null.scale_bar, chosen.scale_bar)) > criteria.explains
}
