//! Causes in name only: what was found, fitted as well as it can be, and still leaves half of the error.
//!
//! Where the physics is none of the library, the effect that imitates it best takes a part of the error, on this record
//! alone. Such a name is worse than none, and the model with it is no better on another drive.

use super::fit::{Fit, Fitter};
use super::heldout::{carried_forward, held_out};
use super::scatter::Scattered;
use super::search::Search;
use super::simulator::Simulator;
use crate::physics::Kind;

/// Takes causes in name only out of what was chosen; their ids. Where all together do not explain enough, as many of the first
/// ones stay as explain that share of the held-out error, and go on to do so beyond the data of their fit: physics that is there
/// beside more that nothing in the library holds.
///
/// `of_form`: whether a form of the loop may be called a cause, as data of the good valve makes it.
pub fn drop_hollow(fitter: &Fitter<'_>, search: &mut Search<'_>, of_form: bool) -> Vec<&'static str> {
    if explains(fitter, &search.null, &search.chosen) {
        return Vec::new();
    }
    let held = |fit: &Fit<'_>| held_out(fitter, fit, HELD_STEPS).weighed_bar();
    let enough = (1.0 - fitter.criteria.explains).sqrt() * held(&search.null);
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
/// named for them. Readings that neither neighbour bears out need no model to be wrong.
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
    let (alone, spoilt): (Vec<Scattered>, Vec<Scattered>) =
        spoilt.into_iter().partition(|s| stand_alone(&all, &s.finding.masked) > fitter.criteria.explains);
    scattered.extend(alone);
    if after <= (1.0 - fitter.criteria.explains) * before {
        scattered.extend(spoilt);
        return Vec::new();
    }
    spoilt.iter().map(|s| s.effect.id()).collect()
}

/// Share of the squared jumps of these readings beyond both neighbours, over those from reading to reading where they are: near 1 where
/// each stands alone, a quarter and less on the course of a pressure.
fn stand_alone(measured_bar: &[f64], readings: &[usize]) -> f64 {
    let (mut off, mut way) = (0.0, 0.0);
    for k in readings.iter().copied().filter(|k| *k > 0 && k + 1 < measured_bar.len()) {
        let (before, here, after) = (measured_bar[k - 1], measured_bar[k], measured_bar[k + 1]);
        let jumps = (here - before).powi(2) + (here - after).powi(2);
        if jumps.is_finite() {
            off += 2.0 * (here - 0.5 * (before + after)).powi(2);
            way += jumps;
        }
    }
    if way > 0.0 { off / way } else { 0.0 }
}

/// Steps of the fits that are held out.
const HELD_STEPS: usize = 4;

/// Whether the effects take enough of what is beyond the floor, by the squared error or by the scale of the residual. Where a parameter of
/// the base had to stand in for them, the recalibrated model does not say how much there was to be explained: the one as calibrated does.
/// Where a signature speaks, the error need not.
pub fn explains(fitter: &Fitter<'_>, null: &Fit<'_>, chosen: &Fit<'_>) -> bool {
    let criteria = &fitter.criteria;
    let floor2 = fitter.floor_bar.powi(2);
    let part = |before: f64, after: f64| (before * before - after * after) / (before * before - floor2).max(0.1 * floor2);
    let signed = chosen.model.signature_nats() > criteria.very_strong;
    let takes_enough = |before: &Fit<'_>| {
        let weighed = part(before.rmse_bar, chosen.rmse_bar).max(part(before.scale_bar, chosen.scale_bar));
        weighed > criteria.explains || plainly(fitter, before, chosen) > criteria.explains
    };
    let stood_in = criteria.denies(null.prior_nats - chosen.prior_nats);
    let as_calibrated = || fitter.score(&mut Simulator::new(fitter.evidence), &null.model, &null.model.calibrated(), &mut Vec::new());
    signed || takes_enough(null) || stood_in && takes_enough(&as_calibrated())
}

/// The share that effects take of the plain squared error beyond what data of the good valve excuses: most of what is wrong may show
/// where the model is to be trusted less, and be far more than it is off there.
fn plainly(fitter: &Fitter<'_>, null: &Fit<'_>, chosen: &Fit<'_>) -> f64 {
    let excused = fitter.plain_floor_bar();
    let beyond = |fit: &Fit<'_>| fitter.plain_rmse_bar(fit).powi(2) - excused.powi(2);
    let before = beyond(null);
    if before > 0.1 * excused.powi(2) { (before - beyond(chosen)) / before } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::base::AT;
    use super::super::model::Model;
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};

    #[test]
    fn readings_that_stand_alone_are_told_from_a_steep_course() {
        let course: Vec<f64> = (0..400).map(|k| 10.0 + 4.0 * (0.3 * f64::from(k)).sin()).collect();
        let mut spoilt = course.clone();
        let readings: Vec<usize> = (5..395).step_by(13).collect();
        readings.iter().for_each(|k| spoilt[*k] += 6.0);
        assert!(stand_alone(&spoilt, &readings) > 0.9, "{}", stand_alone(&spoilt, &readings));
        assert!(stand_alone(&course, &readings) < 0.3, "{}", stand_alone(&course, &readings));
    }

    #[test]
    fn where_the_base_stood_in_for_a_cause_it_has_to_explain_what_the_model_as_calibrated_leaves() {
        let valve = straight();
        let explained = |rest_bar: f64| {
            let rest = |k: usize| if k.is_multiple_of(2) { rest_bar } else { -rest_bar };
            let evidence = held(vec![straight_run(waves(3000), |k, _| 0.4 + rest(k))]);
            let fitter = Fitter::new(&evidence);
            let base = Model::base(&valve).unwrap().on(&evidence);
            let mut theta = base.calibrated();
            theta[AT.offset] += 0.4;
            let mut simulator = Simulator::new(&evidence);
            let null = fitter.score(&mut simulator, &base, &theta, &mut Vec::new());
            // The effect leaves what the recalibration leaves, and the calibration where it was.
            let chosen = Fit { prior_nats: 0.0, ..null.clone() };
            assert!(null.prior_nats > fitter.criteria.very_strong, "{}", null.prior_nats);
            explains(&fitter, &null, &chosen)
        };
        assert!(explained(0.05), "an offset of 0.4 bar beside 0.05 bar");
        assert!(!explained(0.3), "an offset of 0.4 bar beside 0.3 bar that nobody explains");
    }

    #[test]
    fn what_shows_where_the_model_is_trusted_less_is_explained_where_it_is_far_more_than_that() {
        let valve = straight();
        let is_still = |k: usize| k.is_multiple_of(10);
        let evidence = held(vec![straight_run(waves(3000), |k, _| if is_still(k) { 0.0 } else { 0.4 })]);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let fits = |trusted_less: f64| {
            let mut fitter = Fitter::new(&evidence);
            fitter.weights = (0..3000).map(|k| if is_still(k) { 1.0 } else { trusted_less }).collect();
            let mut simulator = Simulator::new(&evidence);
            let mut theta = base.calibrated();
            let null = fitter.score(&mut simulator, &base, &theta, &mut Vec::new());
            theta[AT.offset] += 0.4;
            let chosen = fitter.score(&mut simulator, &base, &theta, &mut Vec::new());
            plainly(&fitter, &null, &chosen)
        };
        assert!(fits(0.1) > 0.8, "off by twice what is excused: {}", fits(0.1));
        assert!(fits(0.04) < 0.1, "off by less than is excused: {}", fits(0.04));
    }
}
