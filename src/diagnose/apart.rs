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
