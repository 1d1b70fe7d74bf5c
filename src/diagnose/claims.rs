//! What is claimed of what was found: cause or form, lacking or changed, and how much may be left.

use super::conclude::Findings;
use super::diagnosis::{Claim, Finding};
use super::good::Good;
use crate::physics::{Effect, Kind, effect};

impl Findings<'_, '_> {
    /// What may be left beyond the noise without anything being wrong [bar]. Where a cause is named, the model with it
    /// claims to be right, and only the noise excuses it.
    pub fn accuracy_bar(&self, named: bool) -> f64 {
        let (criteria, noise) = (&self.fitter.criteria, self.fitter.evidence.noise_bar);
        if let Some(good) = self.good {
            let most = if named { criteria.structure_named } else { criteria.structure_known };
            return ((most * self.fitter.floor_bar).powi(2) - noise * noise).max(0.0).sqrt().max(good.form_error_bar());
        }
        let identified = self.base.valve.identification.as_ref().and_then(|i| i.rmse).map_or(0.0, crate::units::Pressure::value);
        // A poor fit at the identification is a reason for a diagnosis, not an excuse.
        let accuracy = noise.max(identified.min(1.5 * noise));
        if named {
            criteria.structure_named.powi(2).mul_add(accuracy * accuracy, -noise * noise).max(0.0).sqrt()
        } else {
            criteria.structure * accuracy
        }
    }

    /// The findings parted into what says nothing of a fault and what does.
    ///
    /// Without data of the good valve, what acts as another form of the loop would is form; not about a foreign model, whose
    /// loop nobody fitted to this valve. With it, so is all that this data does not exclude: the model lacks it, and always did.
    pub fn sorted(&self, findings: Vec<(f64, Finding)>) -> (Vec<Finding>, Vec<Finding>) {
        findings.into_iter().map(|f| f.1).partition(|f| {
            let of = |is: fn(&dyn Effect) -> bool| effect(&f.id).is_some_and(is);
            match self.good {
                None if self.fitter.evidence.base.is_some() => of(|e| e.kind() == Kind::Form),
                None => of(|e| e.imitates_form()),
                Some(_) => f.claim == Claim::Lacks || of(|e| e.kind() == Kind::Form),
            }
        })
    }

    /// Whether data of the good valve excludes an effect of these values.
    pub fn claim(&self, effect: &'static dyn Effect, theta: &[f64]) -> Claim {
        // A loop whose form had to be corrected by the same effect already has changed its form only on paper.
        let had = |g: &Good| effect.imitates_form() && g.corrections.iter().any(|c| c.effect.id() == effect.id());
        let excluded = |g: &Good| !had(g) && g.excludes(effect, theta) > self.fitter.criteria.excluded_nats;
        if self.good.is_some_and(excluded) { Claim::Changed } else { Claim::Lacks }
    }
}
