//! What the unknown start of a recording hides: until the current has moved far, the pressure depends on what came
//! before the first sample. A wrong start there would look like a slow change.

use super::fit::{Fit, Fitter};
use super::model::Simulator;
use super::search::Search;

/// A model is worse than another one where it is off by this much more.
const WORSE: f64 = 1.02;

/// Takes out the effects with which the model is farther off than without them once the readings count as well that were left out
/// for the start: nobody asks a fit what it does there, and yet whoever simulates the recording sees it.
pub fn drop_denied(fitter: &Fitter<'_>, search: &mut Search<'_>, unsettled: &[usize]) {
    let measured = fitter.evidence.pressure_bar();
    let mean_square = |fit: &Fit<'_>| {
        let mut pressure = Vec::new();
        Simulator::new(fitter.evidence).pressure(&fit.model, &fit.theta, &mut pressure);
        let seen = fitter.measured.iter().zip(&pressure).map(|(y, p)| y - p);
        let left_out = unsettled.iter().map(|k| measured[*k] - pressure[*k]);
        let (sum, n) = seen.chain(left_out).filter(|e| e.is_finite()).fold((0.0, 0.0), |(sum, n), e| (sum + e * e, n + 1.0));
        sum / f64::max(n, 1.0)
    };
    let mut k = if unsettled.is_empty() { 0 } else { search.chosen.model.effects.len() };
    while k > 0 {
        k -= 1;
        let less = fitter.refit_without(&search.chosen, k);
        if mean_square(&search.chosen) > WORSE * WORSE * mean_square(&less) {
            search.chosen = less;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::course::{Input, Run};
    use crate::diagnose::evidence::Evidence;
    use crate::diagnose::model::Model;
    use crate::physics::{effect, simulate};
    use crate::valve::Valve;

    #[test]
    fn what_only_the_readings_left_out_deny_is_taken_out() {
        let valve = Valve::from_toml(include_str!("../../valves/paper.toml"), "paper").unwrap();
        // From tank pressure up, and never down again.
        let current_a: Vec<f64> = (0..2000).map(|k| if k < 20 { 0.0 } else { 0.5 + 0.1 * (0.01 * f64::from(k)).sin() }).collect();
        let time_s: Vec<f64> = (0..2000).map(|k| 0.01 * f64::from(k)).collect();
        let pressure = simulate(&valve, Input::Held, &time_s, &current_a).unwrap();
        let noisy = pressure.iter().enumerate().map(|(k, p)| p + if k % 2 == 0 { 0.02 } else { -0.02 }).collect();
        let evidence = Evidence::new(vec![Run::even(None, 0.0, 0.01, current_a, noisy)], 0.02, Input::Held);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let unsettled: Vec<usize> = (0..300).collect();
        let fitter = Fitter::without(&evidence, &unsettled);
        let filling = base.with(effect("fill_phase").unwrap(), 0.0);
        let theta = [base.calibrated().as_slice(), &[3.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0]].concat();
        let search = || {
            let (null, chosen) =
                (fitter.refit(&base, &base.calibrated()), fitter.score(&mut Simulator::new(&evidence), &filling, &theta, &mut Vec::new()));
            // On the readings that count both are at the noise.
            assert!(null.rmse_bar < 0.025 && chosen.rmse_bar < 0.025, "{} {}", null.rmse_bar, chosen.rmse_bar);
            Search { null, chosen, rounds: Vec::new() }
        };
        let mut kept = search();
        drop_denied(&fitter, &mut kept, &[]);
        assert_eq!(kept.chosen.model.effects.len(), 1);
        let mut denied = search();
        drop_denied(&fitter, &mut denied, &unsettled);
        assert!(denied.chosen.model.effects.is_empty());
    }
}
