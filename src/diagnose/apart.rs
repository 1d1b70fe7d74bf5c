//! A cause in the place of a recalibration that data of the good valve does not allow.
//!
//! A delay that has grown, a zero or a gain that has moved is taken in by a recalibration without a rest, and then there is nothing to
//! name. Where data of the good valve says that the calibration was right, it stays as it is, and the library is searched once more
//! for the one effect that explains the record in its place, as well as the recalibration did.

use super::base::AT;
use super::fit::{Fit, Fitter};
use super::model::{CALIBRATION, Model};
use super::search::{Search, search_in};

/// So many times as far as a good calibration may be off.
const FAR: f64 = 2.0;

/// Whether the recalibration leaves the loop as wide and as round as it was: what moves these on another drive is the form of the
/// hysteresis, which no single cause stands for.
pub fn leaves_the_loop(null: &Fit<'_>) -> bool {
    let free = null.model.free();
    let far = |k: usize, sigma: f64| {
        let start = null.model.calibrated()[k];
        (null.theta[k] - start).abs() > FAR * free[k].prior.map_or(sigma, |p| p.sigma)
    };
    !far(AT.width, CALIBRATION.width) && !far(AT.ln_a, CALIBRATION.ln_a)
}

/// Searches for one effect besides `still`, a model whose calibration stays as it is. No form of the loop: the record would pay for
/// the repair of the model's own.
pub fn search<'a>(fitter: &mut Fitter<'_>, mut looking: Option<&mut Fitter<'_>>, still: &Model<'a>) -> Search<'a> {
    let rounds = std::mem::replace(&mut fitter.criteria.rounds, 1);
    if let Some(looking) = &mut looking {
        looking.criteria.rounds = 1;
    }
    let mut search = search_in(fitter, looking.as_deref_mut(), still);
    fitter.criteria.rounds = rounds;
    if let Some(looking) = looking {
        looking.criteria.rounds = rounds;
    }
    if search.chosen.model.effects.iter().any(|e| e.imitates_form()) {
        search.chosen = search.null.clone();
    }
    search
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::diagnose::model::Simulator;

    #[test]
    fn a_loop_that_had_to_move_stands_for_no_single_cause_and_a_still_calibration_does_not_move() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |_, _| 0.4)]);
        let fitter = Fitter::new(&evidence);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let moved = |k: usize, by: f64| {
            let mut theta = base.calibrated();
            theta[k] += by;
            fitter.score(&mut Simulator::new(&evidence), &base, &theta, &mut Vec::new())
        };
        assert!(leaves_the_loop(&moved(AT.offset, 0.4)) && leaves_the_loop(&moved(AT.late, 0.006)));
        assert!(leaves_the_loop(&moved(AT.width, 0.1)) && !leaves_the_loop(&moved(AT.width, -0.5)));
        assert!(leaves_the_loop(&moved(AT.ln_a, 0.3)) && !leaves_the_loop(&moved(AT.ln_a, -3.0)));

        let free = fitter.recalibrate(&base, &[]);
        assert!(free.theta[AT.offset] > 0.1, "{:?}", free.theta);
        let still = base.standing_still();
        assert_eq!(fitter.recalibrate(&still, &[]).theta, still.calibrated());
    }
}
