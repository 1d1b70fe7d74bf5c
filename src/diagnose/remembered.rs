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
