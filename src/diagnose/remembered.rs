//! Fits that were made before. Diagnoses of one recording by other thresholds go the same way until a threshold parts them; what
//! they fit up to there is the same to the last digit and need not be fitted again.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex};

use super::descent::Descent;
use super::fit::{Fit, Fitter};
use super::model::Model;

/// Where fits from one start have ended, best first.
type Ends = Arc<Vec<End>>;

/// The fits of all diagnoses that share it; a copy shares them, too.
#[derive(Debug, Clone, Default)]
pub struct Remembered(Arc<Mutex<HashMap<u64, Ends>>>);

/// Where a fit has ended, without its model.
#[derive(Debug)]
struct End {
    theta: Vec<f64>,
    mean_nats: f64,
    prior_nats: f64,
    scale_bar: f64,
    rmse_bar: f64,
}

impl Remembered {
    /// What `fitted` gives for `model`, once for each of what stands under `of`, and from then on as it was.
    fn or_fit<'a>(&self, of: u64, model: &Model<'a>, fitted: impl FnOnce() -> Vec<Fit<'a>>) -> Vec<Fit<'a>> {
        let kept = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get(&of).cloned();
        if let Some(ends) = kept {
            let fit = |end: &End| Fit {
                model: model.clone(),
                theta: end.theta.clone(),
                mean_nats: end.mean_nats,
                prior_nats: end.prior_nats,
                scale_bar: end.scale_bar,
                rmse_bar: end.rmse_bar,
            };
            return ends.iter().map(fit).collect();
        }
        let fits = fitted();
        let end = |fit: &Fit<'a>| End {
            theta: fit.theta.clone(),
            mean_nats: fit.mean_nats,
            prior_nats: fit.prior_nats,
            scale_bar: fit.scale_bar,
            rmse_bar: fit.rmse_bar,
        };
        let ends = Arc::new(fits.iter().map(end).collect());
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).insert(of, ends);
        fits
    }
}

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
        model.told_apart().hash(&mut identity.0);
        from.iter().for_each(|vector| identity.numbers(vector));
        how.hash(&mut identity.0);
        remembered.or_fit(identity.0.finish(), model, fitted)
    }
}

impl Hash for Descent {
    fn hash<H: Hasher>(&self, state: &mut H) {
        (self.iterations, self.held, self.rough).hash(state);
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::diagnose::model::Simulator;

    #[test]
    fn what_was_fitted_is_fitted_once_and_what_differs_in_anything_is_another_fit() {
        let valve = straight();
        let mut evidence = held(vec![straight_run(waves(600), |k, _| if k % 2 == 0 { 0.02 } else { -0.02 })]);
        evidence.remembered = Some(Remembered::default());
        let without = crate::diagnose::evidence::Evidence { remembered: None, ..evidence.clone() };
        let base = Model::base(&valve).unwrap().on(&evidence);
        let start = base.calibrated();
        let made = Cell::new(0);
        let ask = |fitter: &Fitter<'_>, model: &Model<'_>, start: &[f64], descent: Descent| {
            let ends = fitter.remembering((model, &[start]), descent, || {
                made.set(made.get() + 1);
                vec![fitter.score(&mut Simulator::new(fitter.evidence), model, start, &mut Vec::new())]
            });
            (made.get(), ends[0].theta.clone(), ends[0].mean_nats)
        };
        let fitter = Fitter::new(&evidence);
        let first = ask(&fitter, &base, &start, Descent::of(4));
        assert_eq!(ask(&fitter, &base, &start, Descent::of(4)), first, "the same is not fitted again");
        let mut moved = start.clone();
        moved[0] += 1e-9;
        let mut masked = Fitter::new(&evidence);
        masked.measured[7] = f64::NAN;
        let mut weighed = Fitter::new(&evidence);
        weighed.weights = vec![0.5; 600];
        let squared = Fitter { squared: !fitter.squared, ..Fitter::new(&evidence) };
        let thinner = Fitter { tau_samples: 7.0, ..Fitter::new(&evidence) };
        let lag = base.with(crate::physics::effect("first_order_lag").unwrap(), 0.0);
        let longer = [start.as_slice(), &[0.05, 1.0]].concat();
        let still = base.standing_still();
        let others: [(&Fitter<'_>, &Model<'_>, &[f64], Descent); 9] = [
            (&fitter, &base, &moved, Descent::of(4)),
            (&fitter, &base, &start, Descent::of(5)),
            (&fitter, &base, &start, Descent { held: 1, ..Descent::of(4) }),
            (&fitter, &still, &start, Descent::of(4)),
            (&fitter, &lag, &longer[..start.len() + lag.extra_parameters()], Descent::of(4)),
            (&masked, &base, &start, Descent::of(4)),
            (&weighed, &base, &start, Descent::of(4)),
            (&squared, &base, &start, Descent::of(4)),
            (&thinner, &base, &start, Descent::of(4)),
        ];
        for (k, (fitter, model, start, descent)) in others.into_iter().enumerate() {
            assert_eq!(ask(fitter, model, start, descent).0, 2 + k, "number {k} is another fit");
        }
        let forgetful = Fitter::new(&without);
        assert_eq!([0, 1].map(|_| ask(&forgetful, &base, &start, Descent::of(4)).0), [11, 12], "nothing is remembered unasked");
    }
}
