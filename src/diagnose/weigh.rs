//! Each effect that was found against what could stand in its place: its share, the rest of the credible set, and a likelier one
//! where there is one.
//!
//! The posterior is over sets of effects: the one that was chosen, and each that has another effect in the place of one of its own. The
//! share of a name is that of all sets that hold it (Hoeting, Madigan, Raftery and Volinsky, Bayesian model averaging, Statistical
//! Science 14 (1999) 382, eq. 1). Whether there is anything to be named was decided before.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::conclude::{Findings, Member, Weighed};
use super::confirm::confirmed;
use super::evidence::Evidence;
use super::excerpt::throughout;
use super::fit::{Fit, Fitter};
use super::heldout::held_out;
use super::posterior;
use super::round::Ranked;
use super::search::correlation;
use crate::physics::{Effect, Kind};

/// Part of the gain of an effect that a rival may miss after the search and still be fitted again in its place.
const NEAR: f64 = 0.35;
/// Most rivals that are fitted again.
const MOST_FITTED: usize = 6;

impl<'a> Findings<'_, 'a> {
    /// The chosen model without its effect number `k`: refitted, or as it stood in the search if that is better.
    fn without(&self, k: usize) -> Fit<'a> {
        let effective = self.fitter.effective();
        let refitted = self.fitter.refit_without(&self.search.chosen, k);
        let names = |fit: &Fit<'_>| BTreeSet::from_iter(fit.ids());
        let wanted = names(&refitted);
        let rounds = if self.looking.is_some() { &[] } else { self.search.rounds.as_slice() };
        let stood = rounds.iter().map(|r| &r.incumbent).filter(|fit| names(fit) == wanted);
        stood.cloned().fold(refitted, |best, next| if next.bic(effective) < best.bic(effective) { next } else { best })
    }

    /// The fitter with which rivals are compared: that of the search.
    pub fn where_searched(&self) -> &Fitter<'_> {
        self.looking.unwrap_or(self.fitter)
    }

    /// With each effect weighed, and a likelier one in the place of one that has any.
    pub fn weighed(mut self) -> Self {
        self.weighed = self.weigh(self.looking);
        if self.weighed.iter().all(|weighed| weighed.likelier.is_none()) {
            return self;
        }
        let all = self.looking.map(|_| throughout(self.fitter));
        let all = all.as_ref().map(|all| self.looking_through(all));
        let mut likelier = self.likelier(all.as_ref());
        if likelier.is_none() && self.looks_at_a_part() {
            // The whole record denies what the part of it prefers: so all of it has to say the shares.
            self.weighed = self.weigh(all.as_ref());
            likelier = self.likelier(all.as_ref());
        }
        if let Some(likelier) = likelier {
            self.search.chosen = self.fitter.refit(&likelier.model, &likelier.theta);
            self.weighed = self.weigh(self.looking);
        }
        self
    }

    /// Whether the search has left out readings.
    fn looks_at_a_part(&self) -> bool {
        self.where_searched().evidence.samples() < self.fitter.evidence.samples()
    }

    /// The fitter of the whole record, in the inner steps of a search.
    fn looking_through<'e>(&self, all: &'e Evidence) -> Fitter<'e> {
        let mut fitter = self.fitter.looking_at(all);
        fitter.tau_samples = correlation(&fitter, &self.search.chosen);
        fitter
    }

    /// Each effect of the chosen model against what could stand in its place, on the part of the record that is looked at or on all.
    fn weigh(&self, looking: Option<&Fitter<'_>>) -> Vec<Weighed<'a>> {
        let chosen = &self.search.chosen;
        if chosen.model.effects.is_empty() {
            return Vec::new();
        }
        // Its rivals are fitted to what is looked at, and so is it.
        let refitted = looking.map(|looking| looking.refit(&chosen.model, &chosen.theta));
        let there = refitted.as_ref().unwrap_or(chosen);
        let fitter = looking.unwrap_or(self.fitter);
        let of = |k: usize| self.rivals(fitter, k, there, self.without(k));
        let rivals: Vec<Rivals<'a>> = (0..chosen.model.effects.len()).into_par_iter().map(of).collect();
        let sets: Vec<&Fit<'_>> = std::iter::once(there).chain(rivals.iter().flat_map(|r| &r.fits)).collect();
        let shares = posterior::shares(fitter, &sets);
        let counts: Vec<usize> = rivals.iter().map(|r| r.fits.len()).collect();
        let names = names(&shares, &counts).into_iter().zip(rivals).enumerate();
        let weighed = names.map(|(k, (shares_of, rivals))| self.against(rivals, shares_of, shares[0], there.at_bound(k)));
        weighed.collect()
    }

    /// The chosen model with a likelier effect in the place of one, where the whole record does not speak against it; `all`: that record
    /// in the inner steps of a search.
    fn likelier(&self, all: Option<&Fitter<'_>>) -> Option<Fit<'a>> {
        let best = self.weighed.iter().filter_map(|w| w.likelier.as_ref()).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let fitter = all.unwrap_or(self.fitter);
        let seen = all.map(|all| all.refit(&self.search.chosen.model, &self.search.chosen.theta));
        let chosen = seen.as_ref().unwrap_or(&self.search.chosen);
        let next = confirmed(fitter, fitter.refit(&best.1.model, &best.1.theta), false, &[]);
        let whole = next.model.effects.len() == chosen.model.effects.len();
        // On held-out data it is as good, which for two that do the same is a matter of the last digits.
        let carried = || fitter.criteria.as_good * held_out(fitter, &next, 4).weighed_bar() <= held_out(fitter, chosen, 4).weighed_bar();
        (whole && posterior::shares(fitter, &[chosen, &next])[1] > 0.5 && carried()).then_some(next)
    }

    /// What could stand in the place of effect number `k` of the chosen model; `chosen` on what `fitter` looks at, and `without`
    /// that effect.
    fn rivals(&self, fitter: &Fitter<'_>, k: usize, chosen: &Fit<'a>, without: Fit<'a>) -> Rivals<'a> {
        let there = &fitter.as_it_stands(&without);
        let own = chosen.model.effects[k].id();
        // Those that came close in the round in which it was found; a class mate comes close in every round.
        let near: Vec<&'static dyn Effect> = self
            .search
            .rounds
            .iter()
            .filter(|r| r.tried(own))
            .flat_map(|r| {
                let mine = r.ranked.iter().find(|c| c.effect.id() == own).map_or(f64::INFINITY, |c| c.fit.bic(r.effective));
                let gain = r.incumbent.bic(r.effective) - mine;
                let close = NEAR * gain;
                // Of those that are off no farther than the good valve is, none is better than another.
                let known = self.good.map_or(0.0, |_| fitter.criteria.structure_known * fitter.floor_bar);
                let near =
                    move |c: &&Ranked<'a>| c.fit.bic(r.effective) < mine + close.max(fitter.criteria.very_strong) || c.fit.rmse_bar < known;
                r.ranked.iter().filter(near).map(|c| c.effect)
            })
            .collect();
        let mut others: Vec<&'static dyn Effect> = Vec::new();
        for e in near {
            let new = !others.iter().any(|n| n.id() == e.id()) && !chosen.model.effects.iter().any(|have| have.id() == e.id());
            if e.kind() == Kind::Course && new {
                others.push(e);
            }
        }
        others.truncate(MOST_FITTED);
        let fits: Vec<Fit<'a>> = others
            .par_iter()
            .map(|e| {
                let ends: Vec<Vec<f64>> = self.search.rounds.iter().filter_map(|round| round.end_of(*e)).collect();
                let screened = fitter.screen(&there.model.with(*e, 0.0), there, &ends);
                fitter.simplified(fitter.finish(screened, false))
            })
            .collect();
        Rivals { without, effects: others, fits }
    }

    /// An effect against its rivals, with their shares; the set that was chosen has `chosen_share`.
    fn against(&self, rivals: Rivals<'a>, (own, of_rivals): (f64, &[f64]), chosen_share: f64, at_bound: bool) -> Weighed<'a> {
        let criteria = &self.where_searched().criteria;
        let Rivals { without, effects, fits } = rivals;
        let mut rest: Vec<(f64, usize)> = of_rivals.iter().copied().zip(0..).collect();
        rest.sort_by(|a, b| b.0.total_cmp(&a.0));
        // Where no name reaches its share, the class goes by its likeliest member, unless it is likelier by what says nothing.
        let times = if own < criteria.name_share { (0.5 * criteria.power * criteria.tie).exp() } else { criteria.likelier };
        let likelier = rest.first().filter(|(share, _)| *share > times * chosen_share).map(|(share, k)| (*share, fits[*k].clone()));
        let mut held = own;
        let mut members = Vec::new();
        for (share, k) in rest {
            // Nothing that is likelier than the name itself may be missing; nor may a name stand alone that had to go to the end of its
            // range: it is a class then, and the next best belongs to it.
            let alone = at_bound && members.is_empty();
            let enough = held >= criteria.credible && share <= own && !alone;
            if enough || members.len() + 1 >= criteria.members {
                break;
            }
            held += share;
            members.push(Member { id: effects[k].id(), share, fit: fits[k].clone() });
        }
        Weighed { without, share: own, rest: members, likelier }
    }
}

/// What could stand in the place of one effect.
struct Rivals<'a> {
    /// The chosen model without the effect.
    without: Fit<'a>,
    /// The rivals.
    effects: Vec<&'static dyn Effect>,
    /// The chosen model with each of them in its place.
    fits: Vec<Fit<'a>>,
}

/// The share of each name and those of its rivals, from the `shares` of the sets: the one that was chosen, then for each of its effects as
/// many as `counts` says with another one in its place. All sets hold a name but those.
fn names<'s>(shares: &'s [f64], counts: &[usize]) -> Vec<(f64, &'s [f64])> {
    let mut rest = shares.get(1..).unwrap_or_default();
    let of = counts.iter().map(|count| {
        let (of_rivals, others) = rest.split_at(*count);
        rest = others;
        ((1.0 - of_rivals.iter().sum::<f64>()).max(0.0), of_rivals)
    });
    of.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_has_the_share_of_all_sets_that_hold_it() {
        let shares = [0.5, 0.25, 0.125, 0.125];
        assert_eq!(names(&shares, &[1, 2]), [(0.75, &shares[1..2]), (0.75, &shares[2..])]);
        assert_eq!(names(&shares[..1], &[0]), [(1.0, &[] as &[f64])]);
    }
}
