//! A fit is told from every other one, so that one that is remembered is taken for it and for no other.

use std::hash::{DefaultHasher, Hash, Hasher};

use super::fit::{Fit, Fitter};
use super::model::Model;
use super::remembered::End;

/// All that a fit depends on, told from all else.
#[derive(Default)]
struct Identity(DefaultHasher);

impl Identity {
    fn numbers(&mut self, values: &[f64]) {
        values.len().hash(&mut self.0);
        values.iter().for_each(|v| v.to_bits().hash(&mut self.0));
    }

    fn fitter(&mut self, fitter: &Fitter<'_>) {
        let evidence = fitter.evidence;
        for run in &evidence.grids {
            self.numbers(&[run.elapsed_s, run.dt_s]);
            (run.origin.run, &run.origin.samples).hash(&mut self.0);
            for values in [Some(&run.current_a), Some(&run.pressure_bar), run.oil_temp_c.as_ref(), run.supply_bar.as_ref()] {
                self.numbers(values.map_or(&[], |v| v));
            }
        }
        self.numbers(&evidence.start_shares);
        self.numbers(&[evidence.noise_bar, fitter.tau_samples]);
        (evidence.most_inner, format!("{:?}", evidence.input), fitter.squared).hash(&mut self.0);
        self.numbers(&fitter.measured);
        self.numbers(&fitter.weights);
    }
}

impl Fitter<'_> {
    /// What `fitted` gives for `model` from these vectors, as it was where the same was fitted before and is remembered. `how` tells
    /// one way of fitting from another.
    pub(super) fn remembering<'a>(
        &self,
        (model, from): (&Model<'a>, &[&[f64]]),
        how: impl Hash,
        fitted: impl FnOnce() -> Vec<Fit<'a>>,
    ) -> Vec<Fit<'a>> {
        // What a foreign model answers is its own affair.
        let Some(remembered) = self.evidence.remembered.as_ref().filter(|_| self.evidence.base.is_none()) else { return fitted() };
        let mut identity = Identity::default();
        identity.fitter(self);
        told_apart(model).hash(&mut identity.0);
        from.iter().for_each(|vector| identity.numbers(vector));
        how.hash(&mut identity.0);
        let of = identity.0.finish();
        if let Some(ends) = remembered.ends(of) {
            return ends.iter().map(|end| of_end(end, model)).collect();
        }
        let fits = fitted();
        remembered.keep(of, fits.iter().map(end_of).collect());
        fits
    }
}

/// All by which a fit of this model differs from a fit of another one, in words that nobody reads.
fn told_apart(model: &Model<'_>) -> String {
    let Model { valve, fixed, effects, held, lag_limit_s, slowness, foreign_step_s, form_error_bar, is_still, sampling, .. } = model;
    let fixed: Vec<_> = fixed.iter().map(|(effect, values)| (effect.id(), values)).collect();
    let effects: Vec<_> = effects.iter().map(|effect| effect.id()).collect();
    let about = (lag_limit_s, slowness, foreign_step_s, form_error_bar, is_still, sampling);
    format!("{valve:?} {fixed:?} {effects:?} {held:?} {about:?}")
}

fn end_of(fit: &Fit<'_>) -> End {
    let Fit { theta, mean_nats, prior_nats, scale_bar, rmse_bar, .. } = fit;
    End { theta: theta.clone(), mean_nats: *mean_nats, prior_nats: *prior_nats, scale_bar: *scale_bar, rmse_bar: *rmse_bar }
}

fn of_end<'a>(end: &End, model: &Model<'a>) -> Fit<'a> {
    let End { theta, mean_nats, prior_nats, scale_bar, rmse_bar } = end;
    let (theta, model) = (theta.clone(), model.clone());
    Fit { model, theta, mean_nats: *mean_nats, prior_nats: *prior_nats, scale_bar: *scale_bar, rmse_bar: *rmse_bar }
}
