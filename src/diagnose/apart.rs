//! A cause in the place of a recalibration that data of the good valve does not allow.
//!
//! A delay that has grown, a zero or a gain that has moved is taken in by a recalibration without a rest, and then there is nothing to
//! name. Where data of the good valve says that the calibration was right, it stays as it is, and the library is searched once more
//! for the one effect that explains the record in its place, as well as the recalibration did or as the good valve's data is explained.

use rayon::prelude::*;

use super::confirm::confirmed;
use super::fit::{Fit, Fitter};
use super::hollow::explains;
use super::model::Model;
use super::search::{Search, search_in};

/// Searches for one effect besides `still`, a model whose calibration stays as it is. No form of the loop: the record would pay for
/// the repair of the model's own.
pub fn search<'a>(fitter: &mut Fitter<'_>, mut looking: Option<&mut Fitter<'_>>, still: &Model<'a>) -> Search<'a> {
    let in_part = looking.is_some();
    let rounds = std::mem::replace(&mut fitter.criteria.rounds, 1);
    if let Some(looking) = &mut looking {
        looking.criteria.rounds = 1;
    }
    let mut search = search_in(fitter, looking.as_deref_mut(), still);
    fitter.criteria.rounds = rounds;
    if let Some(looking) = looking {
        looking.criteria.rounds = rounds;
    }
    search.chosen = best_of_all(fitter, &search, in_part).unwrap_or_else(|| search.null.clone());
    search
}

/// Of the effects that come near the best one where was searched, the one that follows all of the record best and takes most of what is
/// wrong there. `in_part`: a part of the record was searched, and the best there need not be the best on all of it.
fn best_of_all<'a>(fitter: &Fitter<'_>, search: &Search<'a>, in_part: bool) -> Option<Fit<'a>> {
    let round = search.rounds.first()?;
    let most = round.causes().map(|r| round.gain(&r.fit)).fold(fitter.criteria.very_strong, f64::max);
    let near: Vec<&Fit<'a>> = round.causes().map(|r| &r.fit).filter(|fit| round.gain(fit) > fitter.criteria.cause_first * most).collect();
    let effective = fitter.effective();
    near.into_par_iter()
        .map(|fit| confirmed(fitter, fitter.refit(&fit.model, &fit.theta), in_part, &[]))
        .filter(|fit| !fit.model.effects.is_empty() && explains(fitter, &search.null, fit))
        .min_by(|a, b| a.bic(effective).total_cmp(&b.bic(effective)))
}

/// Whether the model `with` one effect and a calibration that stayed as it was follows the record: as well as the recalibrated one, or as
/// well as the good valve's own data is followed. A recalibration moves six parameters for what one effect does.
pub fn follows(fitter: &Fitter<'_>, recalibrated: &Fit<'_>, with: &Fit<'_>) -> bool {
    with.rmse_bar <= fitter.criteria.structure_known * recalibrated.rmse_bar.max(fitter.floor_bar)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::base::AT;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::diagnose::round::{Ranked, Round};
    use crate::physics::effect;

    #[test]
    fn a_still_calibration_does_not_move() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |_, _| 0.4)]);
        let fitter = Fitter::new(&evidence);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let free = fitter.recalibrate(&base, &[]);
        assert!(free.theta[AT.offset] > 0.1, "{:?}", free.theta);
        let still = base.standing_still();
        assert_eq!(fitter.recalibrate(&still, &[]).theta, still.calibrated());
    }

    #[test]
    fn what_is_best_on_a_part_gives_way_to_what_follows_all_of_the_record() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |k, _| if k.is_multiple_of(2) { 0.42 } else { 0.38 })]);
        let fitter = Fitter::new(&evidence);
        let still = Model::base(&valve).unwrap().on(&evidence).standing_still();
        let null = fitter.recalibrate(&still, &[]);
        let gaining = |id: &str, nats: f64| {
            let effect = effect(id).unwrap();
            let model = still.with(effect, 0.0);
            let theta = [null.theta.clone(), model.starts(effect).swap_remove(0)].concat();
            Ranked { effect, fit: Fit { model, theta, mean_nats: null.mean_nats - nats / fitter.effective(), ..null.clone() } }
        };
        let found = |ranked| {
            let round = Round { incumbent: null.clone(), ranked, effective: fitter.effective() };
            let search = Search { null: null.clone(), chosen: null.clone(), rounds: vec![round] };
            best_of_all(&fitter, &search, true).map(|fit| fit.ids())
        };
        assert_eq!(found(vec![gaining("transport_delay", 900.0), gaining("sensor_zero", 600.0)]), Some(vec!["sensor_zero"]));
        assert_eq!(found(vec![gaining("transport_delay", 900.0)]), None, "a delay follows no zero that is off");
        assert_eq!(found(vec![gaining("transport_delay", 900.0), gaining("sensor_zero", 300.0)]), None, "it came nowhere near");
    }

    #[test]
    fn one_effect_follows_as_well_as_six_parameters_or_as_the_good_valve_is_followed() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |_, _| 0.0)]);
        let fitter = Fitter { floor_bar: 0.14, ..Fitter::new(&evidence) };
        let base = Model::base(&valve).unwrap().on(&evidence);
        let fit = fitter.recalibrate(&base, &[]);
        let leaving = |rmse_bar: f64| Fit { rmse_bar, ..fit.clone() };
        assert!(follows(&fitter, &leaving(0.128), &leaving(0.169)), "good data is followed no better");
        assert!(!follows(&fitter, &leaving(0.128), &leaving(0.19)));
        assert!(follows(&fitter, &leaving(0.2), &leaving(0.25)) && !follows(&fitter, &leaving(0.2), &leaving(0.27)));
    }
}
