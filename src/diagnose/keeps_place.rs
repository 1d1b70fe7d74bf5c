//! Whether a cause gives its place to a free form.
//!
//! Once more than one effect was found, each is held against its rivals in its place. A free form bends wherever the curve has moved, so
//! that it nearly always gains more than the reason for it.

use super::fit::{Fit, Fitter};
use crate::physics::Kind;

/// Whether effect number `k` of a fit is a cause that keeps its place where a free form, as `next` has it, would take it and gain no more
/// than twice as much over `less`, the model without either.
pub fn stays_before_form(fitter: &Fitter<'_>, less: &Fit<'_>, (fit, k): (&Fit<'_>, usize), next: &Fit<'_>) -> bool {
    let (effective, effect) = (fitter.effective(), fit.model.effects[k]);
    let gain = |fit: &Fit<'_>| less.bic(effective) - fit.bic(effective);
    let is_form = next.model.effects.last().is_some_and(|e| e.kind() == Kind::Form);
    is_form && effect.is_cause() && gain(fit) > fitter.criteria.cause_first * gain(next)
}

#[cfg(test)]
mod tests {
    use super::super::model::Model;
    use super::super::simulator::Simulator;
    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::physics::effect;

    #[test]
    fn a_cause_keeps_its_place_before_a_form_that_gains_less_than_twice_as_much() {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(3000), |k, _| if k % 2 == 0 { 0.3 } else { -0.3 })]);
        let fitter = Fitter::new(&evidence);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let less = fitter.score(&mut Simulator::new(&evidence), &base, &base.calibrated(), &mut Vec::new());
        let gaining = |id: &str, bic: f64| {
            let model = base.with(effect(id).unwrap(), 0.0);
            let fit = Fit { model, ..less.clone() };
            // BIC counts the nats twice, and half of them are the mean loss.
            let off = fit.bic(fitter.effective()) - less.bic(fitter.effective()) + bic;
            Fit { mean_nats: fit.mean_nats - off / fitter.effective(), ..fit }
        };
        let form = gaining("reference_shape", 100.0);
        let keeps = |id: &str, bic: f64, next: &Fit<'_>| stays_before_form(&fitter, &less, (&gaining(id, bic), 0), next);
        assert!(keeps("reference_shift", 60.0, &form));
        assert!(!keeps("reference_shift", 40.0, &form), "the form gains more than twice as much");
        assert!(!keeps("nonlocal_memory", 60.0, &form), "a form of the loop is no cause");
        assert!(!keeps("reference_shift", 60.0, &gaining("leakage", 100.0)), "another cause may take its place");
    }
}
