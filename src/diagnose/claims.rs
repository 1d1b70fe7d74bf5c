//! What is claimed of what was found: cause or form, lacking or changed, and how much may be left.

use super::base::BASE;
use super::conclude::Findings;
use super::criteria::Criteria;
use super::descent::Descent;
use super::diagnosis::{Claim, Finding};
use super::evidence::rms;
use super::fit::Fit;
use super::good::Good;
use super::seen;
use super::simulator::Simulator;
use super::trust::Trust;
use crate::physics::{Effect, Kind, effect};

/// A recording that is this much quieter was simulated or smoothed, and says nothing of noise: a sensor whose noise has grown so much
/// would not follow its pressure any more.
const SMOOTHED: f64 = 30.0;

impl Findings<'_, '_> {
    /// What may be excused as noise [bar]: that of the record, or of the good valve where the record seems to be much noisier. A tone
    /// between the samples, a loose contact or a worse sensor is what has changed, though a search had better not look into it.
    pub fn noise_bar(&self) -> f64 {
        let (criteria, noise_bar) = (&self.fitter.criteria, self.fitter.evidence.noise_bar);
        let Some(known_bar) = self.good.map(|good| good.evidence.noise_bar) else { return noise_bar };
        // A tone whose pace wanders drives neighbouring readings farther apart than anything is off, and is no noise.
        let rings = || self.scattered.iter().any(|s| s.effect.is_apart_from_form());
        let is_apart = || noise_bar > criteria.structure_named * self.fitter.plain_rmse_bar(&self.search.chosen);
        let is_noisier = noise_bar >= criteria.noisier * known_bar && (noise_bar < SMOOTHED * known_bar || rings() && is_apart());
        if is_noisier { known_bar } else { noise_bar }
    }

    /// What may be left beyond the noise without anything being wrong [bar]. Where a cause is named, the model with it
    /// claims to be right, and only the noise excuses it.
    pub fn accuracy_bar(&self, named: bool) -> f64 {
        let (criteria, noise) = (&self.fitter.criteria, self.noise_bar());
        if let Some(good) = self.good.filter(|good| !good.is_denied()) {
            let most = if named { criteria.structure_named } else { self.farther(good).0 };
            return ((most * noise.hypot(good.form_error_bar())).powi(2) - noise * noise).max(0.0).sqrt().max(good.form_error_bar());
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
    /// loop nobody fitted to this valve. With it, so is all that this data does not exclude: the model lacks it, and always did. But
    /// where nobody has driven the good valve besides the one recording of the identification, what a dynamic lacks is told as a lack
    /// if the model with it follows the record down to the noise: a sweep shows next to nothing of it, and the model is off all the same.
    pub fn sorted(&self, findings: Vec<(f64, Finding)>) -> (Vec<Finding>, Vec<Finding>) {
        let (fitter, chosen) = (self.fitter, &self.search.chosen);
        let follows = fitter.plain_rmse_bar(chosen) <= fitter.criteria.structure_named * fitter.evidence.noise_bar;
        findings.into_iter().map(|f| f.1).partition(|f| {
            let of = |is: fn(&dyn Effect) -> bool| effect(&f.id).is_some_and(is);
            match self.good {
                None if self.fitter.evidence.base.is_some() => of(|e| e.kind() == Kind::Form),
                None => f.claim == Claim::Lacks && of(|e| e.imitates_form()),
                Some(_) if of(|e| e.kind() == Kind::Form) => true,
                Some(good) => f.claim == Claim::Lacks && (of(|e| e.imitates_form()) || !good.is_identification || !follows),
            }
        })
    }

    /// What a residual amounts to, each reading as much as it weighs, in RMS [bar].
    fn off_bar(&self, mut residual: Vec<f64>) -> f64 {
        self.fitter.weigh(&mut residual);
        rms(&residual)
    }

    /// How many times as far as data of the good valve excuses the record is off the model, as that data has it and without any refit:
    /// over all readings as they weigh, and in the class of movements where that is most. What lies behind movements faster than any
    /// in that data does not count: how far a good valve is off there, it does not tell.
    fn beyond(&self, good: &Good) -> (f64, f64) {
        let fitter = self.fitter;
        let mut simulated_bar = Vec::new();
        Simulator::new(fitter.evidence).pressure(self.base, &self.base.calibrated(), &mut simulated_bar);
        let mut residual = self.residual(&simulated_bar);
        let faster = seen::faster(&good.evidence, fitter.evidence, fitter.criteria.speaks);
        residual.iter_mut().zip(faster).filter(|r| r.1).for_each(|(residual, _)| *residual = f64::NAN);
        let in_class = good.trust.as_ref().map_or(0.0, |trust: &Trust| trust.beyond(fitter.evidence, &residual));
        (self.off_bar(residual) / fitter.floor_bar, in_class)
    }

    /// How many times as far as on its own data a good valve may be off on the drive of the record, over all and in one class of movements:
    /// less where both are steps and nothing else.
    fn farther(&self, good: &Good) -> (f64, f64) {
        let criteria = &self.fitter.criteria;
        if seen::are_of_steps(&good.evidence, self.fitter.evidence) {
            (criteria.structure_known, criteria.of_class_alike)
        } else {
            (criteria.another_drive, criteria.of_class)
        }
    }

    /// Whether that is more than a good valve is off from one drive to the next.
    fn is_another_state(&self, good: &Good, (over_all, in_class): (f64, f64)) -> bool {
        let (most, most_in_class) = self.farther(good);
        over_all >= most || in_class > most_in_class
    }

    /// The data of the good valve, unless the record is no farther off the model, as that data has it and without any refit, than that
    /// data is: nothing has changed then.
    pub fn good_of_another_state(&self) -> Option<&Good> {
        self.good.filter(|good| self.is_another_state(good, self.beyond(good)))
    }

    /// Whether the effects stand in the place of a recalibration that data of the good valve denies, and leave the calibration where that
    /// data has it. A valve that is no farther off than a good one may be has changed then all the same: a good one's own error is no
    /// single effect, and recalibrates beside whatever is found. But one that is no farther off than on its own data shows just that.
    pub fn is_in_place_of_recalibration(&self) -> bool {
        let (null, chosen) = (self.search.null.prior_nats, self.search.chosen.prior_nats);
        let Some(good) = self.good.filter(|good| !good.is_denied()) else { return false };
        stands_in(&self.fitter.criteria, (null, chosen), self.beyond(good).0)
    }

    /// Whether the record is off the model, as data of the good valve has it, by more than that data allows, and a recalibration hides
    /// it, or another form of the loop where a recalibration is denied as well, or that there are few such readings: the valve does not
    /// stand then as it did. Data that does not vouch for the model says so only of what is far off. `known_bar`, `other_bar`: the pressure
    /// of the model as given or corrected by data of the good valve, and of the model recalibrated and as chosen.
    pub fn stands_apart(&self, known_bar: &[f64], other_bar: [&[f64]; 2]) -> bool {
        let Some(good) = self.good else { return false };
        let criteria = &self.fitter.criteria;
        let (over_all, in_class) = self.beyond(good);
        // The calibration of a day is no other state.
        let is_denied = criteria.denies(self.search.null.prior_nats);
        let off_bar = |simulated_bar: &[f64]| self.off_bar(self.residual(simulated_bar));
        let hides = || is_hidden(criteria, off_bar(known_bar), other_bar.map(off_bar));
        self.is_another_state(good, (over_all, in_class))
            && (!good.is_denied() || over_all > criteria.structure)
            && (in_class > self.farther(good).1 || is_denied && hides())
    }

    /// Whether most of what the chosen model gains over `without`, by an effect on the form of the loop or another one, lies behind
    /// movements of which data of the good valve shows none: what that valve would do there, nobody knows.
    fn shows_where_unseen(&self, good: &Good, without: &Fit<'_>, of_form: bool) -> bool {
        let fitter = self.fitter;
        let residual = |fit: &Fit<'_>| {
            let mut residual = Vec::new();
            fitter.residual(&mut Simulator::new(fitter.evidence), &fit.model, &fit.theta, &mut residual);
            residual
        };
        let gains = residual(without).into_iter().zip(residual(&self.search.chosen)).map(|(a, b)| a * a - b * b);
        let (mut unseen, mut all) = (0.0, 0.0);
        let faster = seen::faster(&good.evidence, fitter.evidence, fitter.criteria.reaches);
        let new = if of_form {
            let smaller = seen::smaller(&good.evidence, fitter.evidence);
            faster.into_iter().zip(smaller).map(|(faster, smaller)| faster || smaller).collect()
        } else {
            faster
        };
        for (gain, new) in gains.zip(new).filter(|(g, _)| g.is_finite()) {
            all += gain;
            unseen += if new { gain } else { 0.0 };
        }
        unseen > 0.0 && unseen > 0.5 * all
    }

    /// Whether data of a good valve excludes effect number `k` of the chosen model; `good`: that data, where it may speak of this effect
    /// as one of another state; `without`: the model without the effect; `gain_bar`: the interval of its gain on held-out data.
    pub fn claim(&self, k: usize, good: Option<&Good>, without: &Fit<'_>, gain_bar: Option<(f64, f64)>) -> Claim {
        let chosen = &self.search.chosen;
        let (effect, theta) = (chosen.model.effects[k], &chosen.theta[chosen.model.place(k)]);
        let is_shown = |good: &&Good| !self.shows_where_unseen(good, without, effect.imitates_form());
        let confirmed = || !chosen.at_bound(k) && gain_bar.is_some_and(|i| i.0 > 0.0);
        let is_sole = self.weighed[k].share >= self.fitter.criteria.credible && self.weighed[k].rest.is_empty();
        let Some(good) = good.filter(is_shown) else {
            // A form that another effect might be as well says nothing of which of them has changed.
            let witness = self.witness.filter(|_| effect.imitates_form() && is_sole && confirmed());
            let is_denied = witness.is_some_and(|witness| witness.denies(effect, theta, self.fitter, without.rmse_bar));
            return if is_denied { Claim::Changed } else { Claim::Lacks };
        };
        let criteria = &self.fitter.criteria;
        let is_denied = criteria.denies(without.prior_nats - chosen.prior_nats);
        // A loop whose form had to be corrected by the same effect already has changed its form only on paper, unless the record would need
        // a calibration besides that the same data denies.
        if effect.imitates_form() && !is_denied && good.corrections.iter().any(|c| c.effect.id() == effect.id()) {
            return Claim::Lacks;
        }
        // Nor has one whose form is no farther off on the record than a good valve's may be.
        let may_be_off = form_may_be_off(criteria, self.farther(good).0, is_denied, is_sole);
        if effect.imitates_form() && without.rmse_bar < may_be_off * self.fitter.floor_bar {
            return Claim::Lacks;
        }
        // Nor one that held-out data does not confirm, or that had to go to the end of its range.
        if effect.imitates_form() && !confirmed() {
            return Claim::Lacks;
        }
        let fitter = self.where_searched();
        let nats = |fit: &Fit<'_>| fitter.objective(fit) * fitter.effective();
        let held = |theta: &[f64]| {
            let descent = Descent { held: chosen.model.effects.len(), ..Descent::of(4) };
            nats(&fitter.polish_in(&mut Simulator::new(fitter.evidence), &chosen.model, theta, descent))
        };
        let as_chosen = held(&chosen.theta);
        let with = |values: &[f64]| {
            let mut theta = chosen.theta.clone();
            theta[chosen.model.place(k)].copy_from_slice(values);
            held(&theta) - as_chosen
        };
        // A form that explains both has always been so, also where another size of it would suit the record better.
        let recalibrated = effect.imitates_form().then_some(&chosen.theta[..BASE]);
        let excluded = good.excludes(effect, theta, &with, recalibrated) > self.fitter.criteria.excluded_nats;
        if excluded { Claim::Changed } else { Claim::Lacks }
    }
}

/// How many times as far as on the good valve's own drive the form of its loop may be off on the record without an effect on it: as
/// `farther` as from one drive to the next. Where the record, without the effect, wants a calibration that data of the good valve denies,
/// the form is fitted to the record at that price: then no farther than on its own drive, and if the effect is alone in its credible
/// set, not at all.
fn form_may_be_off(criteria: &Criteria, farther: f64, is_denied: bool, is_sole: bool) -> f64 {
    match is_denied {
        true if is_sole => 0.0,
        true => criteria.structure_known,
        false => farther,
    }
}

/// Whether what was found stands in the place of a calibration that is denied, and needs none itself, by what the two cost [nats], on a
/// record that is `beyond` times as far off as data of the good valve excuses.
fn stands_in(criteria: &Criteria, (null, chosen): (f64, f64), beyond: f64) -> bool {
    criteria.denies(null - chosen) && !criteria.denies(chosen) && beyond >= criteria.structure_known
}

/// Whether an error of the model as given is one no more once it is recalibrated, or has another form [bar].
fn is_hidden(criteria: &Criteria, given_bar: f64, other_bar: [f64; 2]) -> bool {
    given_bar > criteria.structure_named * other_bar[0].min(other_bar[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_hidden_by_a_recalibration_or_by_another_form() {
        let hides = |other_bar: [f64; 2]| is_hidden(&Criteria::default(), 1.8, other_bar);
        assert!(hides([0.3, 0.3]) && hides([1.8, 0.8]) && !hides([1.8, 1.7]));
    }

    #[test]
    fn only_a_denied_calibration_lets_a_form_that_is_off_as_from_drive_to_drive_have_changed() {
        let criteria = Criteria::default();
        let may_be_off = |is_denied, is_sole| form_may_be_off(&criteria, criteria.another_drive, is_denied, is_sole);
        assert_eq!([may_be_off(false, false), may_be_off(false, true)], [criteria.another_drive; 2]);
        assert_eq!([may_be_off(true, false), may_be_off(true, true)], [criteria.structure_known, 0.0]);
    }

    #[test]
    fn what_stands_in_for_a_denied_calibration_needs_none_and_is_farther_off_than_the_good_valve_was() {
        let stands = |null: f64, chosen: f64, beyond: f64| stands_in(&Criteria::default(), (null, chosen), beyond);
        assert!(stands(20.0, 1.0, 1.7));
        assert!(!stands(20.0, 1.0, 0.6), "no farther off than on its own data");
        assert!(!stands(20.0, 14.0, 1.7) && !stands(4.0, 1.0, 1.7), "denied all the same, or never");
    }
}
