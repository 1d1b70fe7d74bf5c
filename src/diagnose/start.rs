//! What the unknown start of a recording hides: until the current has moved far, the pressure depends on what came
//! before the first sample. A wrong start there would look like a slow change.

use rayon::prelude::*;

use super::confirm::confirmed;
use super::fit::{Fit, Fitter};
use super::round::Ranked;
use super::search::Search;
use super::simulator::Simulator;
use crate::physics::Kind;

/// A model is worse than another one where it is off by this much more.
const WORSE: f64 = 1.02;
/// Most rivals that are tried in the place of an effect.
const MOST: usize = 3;

/// Takes out the effects with which the model is farther off than without them once the readings count as well that were left out
/// for the start: nobody asks a fit what it does there, and yet whoever simulates the recording sees it. A rival that came near takes
/// the place, where the start does not deny that as well.
pub fn drop_denied<'a>(fitter: &Fitter<'_>, search: &mut Search<'a>, unsettled: &[usize]) {
    let measured = fitter.evidence.pressure_bar();
    let mean_square = |fit: &Fit<'_>| {
        let mut pressure = Vec::new();
        Simulator::new(fitter.evidence).pressure(&fit.model, &fit.theta, &mut pressure);
        let seen = fitter.measured.iter().zip(&pressure).map(|(y, p)| y - p);
        let left_out = unsettled.iter().map(|k| measured[*k] - pressure[*k]);
        let (sum, n) = seen.chain(left_out).filter(|e| e.is_finite()).fold((0.0, 0.0), |(sum, n), e| (sum + e * e, n + 1.0));
        sum / f64::max(n, 1.0)
    };
    let is_denied = |fit: &Fit<'_>, less: &Fit<'_>| mean_square(fit) > WORSE * WORSE * mean_square(less);
    let mut k = if unsettled.is_empty() { 0 } else { search.chosen.model.effects.len() };
    while k > 0 {
        k -= 1;
        let less = fitter.refit_without(&search.chosen, k);
        if is_denied(&search.chosen, &less) {
            let rivals = rivals(fitter, search, k, &less);
            search.chosen = rivals.into_iter().find(|rival| !is_denied(rival, &less)).unwrap_or(less);
        }
    }
}

/// `less` with each cause in the place of effect number `k` that came near in the round in which that was found, best first.
fn rivals<'a>(fitter: &Fitter<'_>, search: &Search<'a>, k: usize, less: &Fit<'a>) -> Vec<Fit<'a>> {
    let (effects, effective) = (&search.chosen.model.effects, fitter.effective());
    let Some(round) = search.rounds.iter().find(|round| round.tried(effects[k].id())) else { return Vec::new() };
    let is_new = |r: &&Ranked<'a>| r.effect.kind() == Kind::Course && effects.iter().all(|have| have.id() != r.effect.id());
    let near: Vec<_> = round.ranked.iter().filter(is_new).take(MOST).collect();
    let fits: Vec<Fit<'a>> = near.into_par_iter().map(|r| round.beside(fitter, r.effect, less)).collect();
    let strong = fits.into_iter().filter(|fit| less.bic(effective) - fit.bic(effective) > fitter.criteria.very_strong);
    let mut held: Vec<Fit<'a>> = strong.map(|fit| confirmed(fitter, fit, false, &[])).collect();
    held.retain(|fit| fit.model.effects.len() == less.model.effects.len() + 1);
    held.sort_by(|a, b| a.bic(effective).total_cmp(&b.bic(effective)));
    held
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::course::{Input, Run};
    use crate::diagnose::evidence::Evidence;
    use crate::diagnose::model::Model;
    use crate::diagnose::round::Round;
    use crate::physics::{effect, simulate, specification};
    use crate::valve::Valve;

    /// A record that goes from tank pressure up and never down again, of a valve with these effects, and its first readings that count
    /// not: what is kept of a fill that only these deny, where `rivals` came near in the round in which it was found.
    fn kept(of: &[crate::valve::EffectSpec], rivals: &[&'static str], are_left_out: bool) -> Vec<&'static str> {
        let valve = Valve::from_toml(include_str!("../../valves/paper.toml"), "paper").unwrap();
        let current_a: Vec<f64> = (0..2000).map(|k| if k < 20 { 0.0 } else { 0.5 + 0.1 * (0.01 * f64::from(k)).sin() }).collect();
        let time_s: Vec<f64> = (0..2000).map(|k| 0.01 * f64::from(k)).collect();
        let pressure = simulate(&Valve { effects: of.to_vec(), ..valve.clone() }, Input::Held, &time_s, &current_a).unwrap();
        let noisy = pressure.iter().enumerate().map(|(k, p)| p + if k % 2 == 0 { 0.02 } else { -0.02 }).collect();
        let evidence = Evidence::new(vec![Run::even(None, 0.0, 0.01, current_a, noisy)], 0.02, Input::Held);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let unsettled: Vec<usize> = (0..300).collect();
        let fitter = Fitter::without(&evidence, &unsettled);
        let filling = base.with(effect("fill_phase").unwrap(), 0.0);
        let theta = [base.calibrated().as_slice(), &[3.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0]].concat();
        let null = fitter.refit(&base, &base.calibrated());
        let chosen = fitter.score(&mut Simulator::new(&evidence), &filling, &theta, &mut Vec::new());
        // On the readings that count it makes no difference.
        assert!(!of.is_empty() || null.rmse_bar < 0.025 && chosen.rmse_bar < 0.025, "{} {}", null.rmse_bar, chosen.rmse_bar);
        let near = rivals.iter().map(|id| fitter.fit_new(&base.with(effect(id).unwrap(), 0.0), &null, &[]));
        let ranked = std::iter::once(chosen.clone()).chain(near);
        let ranked = ranked.map(|fit| Ranked { effect: fit.model.effects[0], fit }).collect();
        let rounds = vec![Round { incumbent: null.clone(), ranked, effective: fitter.effective() }];
        let mut search = Search { null, chosen, rounds };
        drop_denied(&fitter, &mut search, if are_left_out { &unsettled } else { &[] });
        search.chosen.ids()
    }

    #[test]
    fn what_only_the_readings_left_out_deny_is_taken_out() {
        assert_eq!(kept(&[], &[], false), ["fill_phase"]);
        assert!(kept(&[], &[], true).is_empty());
        assert!(kept(&[], &["reversal_dead_band"], true).is_empty(), "nothing is there to take its place");
    }

    #[test]
    fn a_rival_that_the_start_does_not_deny_takes_the_place() {
        let dead = [specification(effect("reversal_dead_band").unwrap(), &[0.05])];
        assert_eq!(kept(&dead, &["leakage", "reversal_dead_band"], true), ["reversal_dead_band"]);
    }
}
