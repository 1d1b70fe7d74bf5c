//! Whether all of a recording, held out in stretches, confirms the effects that were found.

use super::base::AT;
use super::fit::{Fit, Fitter};
use super::heldout::{BLOCK_S, HeldOut, carried_forward, held_out};
use crate::physics::Kind;

/// The effects less those that held-out stretches do not confirm: the last one to have been found is looked at first, and after one has
/// gone all that remain once more, as what repaired the work of that one is worth nothing without it. An effect that takes the place of a
/// recalibration needs no gain of its own, nor does one with a signature. Where the search has looked at a part only, very strong evidence
/// is asked for on all. `stood`: the models that the search has gone through, one of which may be the one without an effect, and nearer its
/// optimum than where a refit without that effect ends.
pub fn confirmed<'a>(fitter: &Fitter<'_>, mut fit: Fit<'a>, anew: bool, stood: &[&Fit<'a>]) -> Fit<'a> {
    // What the fit predicts of stretches held out, where that is known already.
    let mut known: Option<HeldOut> = None;
    let mut k = fit.model.effects.len();
    while k > 0 {
        k -= 1;
        let less = fitter.refit_without(&fit, k);
        let wanted = less.ids();
        let as_they_stood = stood.iter().filter(|stood| stood.ids() == wanted).map(|stood| fitter.refit(&stood.model, &stood.theta));
        let less = as_they_stood.fold(less, |best, next| fitter.better(best, next));
        // A model is no worse than one that it holds within it: its own fit had stopped short.
        if less.rmse_bar < fit.rmse_bar {
            let again = fitter.refit(&fit.model, &put_back(&fit, k, &less));
            if fitter.objective(&again) < fitter.objective(&fit) {
                (fit, known) = (again, None);
            }
        }
        if !confirms(fitter, (&fit, k), &less, &mut known, anew) {
            k = less.model.effects.len();
            fit = less;
        }
    }
    fit
}

/// The values of `less` with effect number `k` of a fit beside them, and as much less dead time as that effect brings.
fn put_back(fit: &Fit<'_>, k: usize, less: &Fit<'_>) -> Vec<f64> {
    let place = fit.model.place(k);
    let values = &fit.theta[place.clone()];
    let mut theta = less.theta.clone();
    theta.splice(place.start..place.start, values.iter().copied());
    theta[AT.late] = (theta[AT.late] - fit.model.effects[k].dead_time_s(values)).max(0.0);
    theta
}

/// Whether all that `fitter` sees confirms effect number `k` of a fit against `less`, the model without it; `known`: what the fit predicts
/// of stretches held out, and then what the one of the two does that stays.
fn confirms(fitter: &Fitter<'_>, (fit, k): (&Fit<'_>, usize), less: &Fit<'_>, known: &mut Option<HeldOut>, anew: bool) -> bool {
    let effective = fitter.effective();
    let is_weak = anew && less.bic(effective) < fit.bic(effective) + fitter.criteria.very_strong;
    // Blocks in turn tell of a change that is slower than they are; it has to go on as it says.
    let slow = fit.model.effects[k].memory_s(&fit.theta[fit.model.place(k)]) > BLOCK_S;
    if is_weak || slow && carried_forward(fitter, fit, less) < fitter.criteria.carried {
        *known = None;
        return false;
    }
    let (with, without) = rayon::join(|| known.take().unwrap_or_else(|| held_out(fitter, fit, 4)), || held_out(fitter, less, 4));
    let is_confirmed = is_confirmed(fitter, (fit, k), less, (&with, &without));
    *known = Some(if is_confirmed { with } else { without });
    is_confirmed
}

/// Whether held-out stretches confirm effect number `k` of a fit against `less`, the model without it; what the two predict there.
fn is_confirmed(fitter: &Fitter<'_>, (fit, k): (&Fit<'_>, usize), less: &Fit<'_>, (with, without): (&HeldOut, &HeldOut)) -> bool {
    let criteria = &fitter.criteria;
    // A wander of which nothing is known takes the place of a name that does not go on better than it.
    let signed = fit.model.signature_nats() - less.model.signature_nats() > criteria.very_strong;
    let is_name = !fitter.corrects && fit.model.effects[k].kind() == Kind::Course;
    let (gain, interval, p_value) = with.gain_over(without);
    // In steps few readings decide between a cause and a recalibration that predicts as well, nor would a wander about it say more: it is
    // no other answer where calibration does not allow it.
    let is_denied = criteria.denies(less.prior_nats - fit.prior_nats);
    let in_its_place = fitter.squared && is_denied && gain.abs() < criteria.worth * without.rmse_bar();
    if is_name && !signed && !in_its_place && with.loses_to_disturbance(fitter, without) {
        return false;
    }
    // Few events lie in few blocks, which no test of blocks finds certain; what is gained there is as much as was claimed.
    let carried = gain > criteria.carried * (less.rmse_bar - fit.rmse_bar) && fit.rmse_bar < less.rmse_bar;
    let recalibrates = fit.model.effects[k].recalibrates();
    let stood_in = in_its_place || (!fitter.squared || recalibrates) && is_denied;
    // Beside a cause that was found, a recalibration that does as well is the plainer answer; beside a form alone it is none where
    // gain or zero would go beyond what calibration allows.
    let beside_cause = fit.model.effects[..k].iter().any(|e| !e.imitates_form());
    let shifted = criteria.denies(less.recalibration_nats() - fit.recalibration_nats());
    if k > 0 && !signed && (beside_cause || !shifted) && gain < criteria.worth * without.rmse_bar() {
        return false;
    }
    // Beside a recalibration that data of the good valve does not allow, what adds little to it repairs the repair.
    let repairs = fitter.is_vouched && criteria.denies(fit.reshaping_nats());
    if repairs && !signed && gain < criteria.alone * with.rmse_bar() {
        return false;
    }
    stood_in || signed || carried || p_value <= criteria.confirmed || interval.is_none_or(|i| i.0 > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run};
    use crate::diagnose::heldout::blocks;
    use crate::diagnose::model::Model;
    use crate::physics::effect;

    #[test]
    fn in_steps_a_recalibration_that_predicts_as_well_and_that_no_calibration_allows_denies_no_cause() {
        let valve = straight();
        let levels = [0.3, 0.6, 0.45, 0.75, 0.35, 0.55];
        let steps: Vec<f64> = (0..6_000).map(|k| levels[k / 250 % levels.len()]).collect();
        // Four samples late.
        let late = |k: usize, i: f64| 20.0 * (steps[k.saturating_sub(4)] - i) + if k.is_multiple_of(2) { 0.02 } else { -0.02 };
        let evidence = held(vec![straight_run(steps.clone(), late)]);
        let fitter = Fitter::new(&evidence);
        assert!(fitter.squared);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let delayed = |late_s: f64| {
            let mut theta = base.calibrated();
            theta[AT.late] += late_s;
            theta
        };
        let without = fitter.refit(&base, &delayed(0.04));
        let more = base.with(effect("transport_delay").unwrap(), 0.0);
        let with = fitter.refit(&more, &[delayed(0.0), vec![0.04]].concat());
        assert!((with.rmse_bar / without.rmse_bar - 1.0).abs() < 0.01 && without.theta[AT.late] > base.calibrated()[AT.late] + 0.03);
        // The last digits are for the one or for the other.
        let off =
            |bar: f64| HeldOut::plain((0..6_000_usize).map(|k| if k.is_multiple_of(2) { bar } else { -bar }).collect(), blocks(&fitter));
        for (with_bar, without_bar, is_confirmed_so) in [(0.0199, 0.02, true), (0.02, 0.0199, true), (0.022, 0.02, false)] {
            let predicted = (&off(with_bar), &off(without_bar));
            assert_eq!(is_confirmed(&fitter, (&with, 0), &without, predicted), is_confirmed_so, "{with_bar} {without_bar}");
        }
    }
}
