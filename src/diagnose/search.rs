//! Which effects: added one by one, each swapped for its rivals and dropped again when the others make it needless.

use rayon::prelude::*;

use super::base::{AT, BASE};
use super::confirm::confirmed;
use super::criteria::MOST_EFFECTS;
use super::excerpt::{excerpt, throughout};
use super::fit::{Fit, Fitter};
use super::keeps_place::stays_before_form;
use super::loss;
use super::model::Model;
use super::proposals::{Left, placed_anew};
use super::round::{Ranked, Round};
use super::simulator::Simulator;
use super::watch;
use crate::physics::{EFFECTS, Effect, Kind, Stage};

/// Bounds on how many samples count as one.
const TAU_SAMPLES: (f64, f64) = (6.0, 60.0);
/// Share of the best candidate's gain from which on a candidate is fitted to the end.
const PROMISING: f64 = 0.5;
/// Most rivals that an effect is swapped for.
const MOST_SWAPPED: usize = 6;
/// Share of the evidence for a name below which the best of a round is not looked at more closely.
const STUCK: f64 = 0.25;
/// Candidates within this difference of BIC of the best one get its base,
const HANDED_NATS: f64 = 60.0;
/// and so many steps from there.
const HANDED_STEPS: usize = 5;
/// of which the later ones are taken only where the first two have come this near [nats].
const HANDED_SHORT_NATS: f64 = 10.0;

/// The outcome of a search.
pub struct Search<'a> {
    /// "Recalibrate only".
    pub null: Fit<'a>,
    /// The model chosen; its effects in the order in which they were found.
    pub chosen: Fit<'a>,
    /// All rounds.
    pub rounds: Vec<Round<'a>>,
}

/// "Recalibrate only", of the base and of one whose lag is not believed where the recording does not confirm it.
pub fn recalibrated<'a>(fitter: &Fitter<'_>, base: Model<'a>) -> (Fit<'a>, Model<'a>) {
    let short = excerpt(fitter, &base, None);
    let find = |base: &Model<'a>| match &short {
        Some(short) => fitter.refit(base, &fitter.looking_at(short).recalibrate(base, &[]).theta),
        None => fitter.recalibrate(base, &[]),
    };
    let null = find(&base);
    if base.confirms_lag(null.theta[AT.lag]) {
        return (null, base);
    }
    let base = base.distrusting_lag();
    (find(&base), base)
}

/// Searches the library on what `looking` sees, and fits and judges what was found on all; without it on all.
pub fn search_in<'a>(fitter: &mut Fitter<'_>, looking: Option<&mut Fitter<'_>>, base: &Model<'a>) -> Search<'a> {
    let Some(looking) = looking else {
        let found = search(fitter, base);
        let chosen = confirmed(fitter, found.chosen, false, &incumbents(&found.rounds));
        return Search { chosen, ..found };
    };
    let found = search(looking, base);
    let starts = [&found.null.theta[..], &found.chosen.theta[..BASE]];
    // Whether an effect is confirmed is no matter of finer steps; the values are.
    let all = throughout(fitter);
    let (null, confirmed) = rayon::join(
        || fitter.best(starts.par_iter().map(|start| fitter.refit(base, start)).collect::<Vec<_>>()),
        || {
            let mut fitter = fitter.looking_at(&all);
            let chosen = placed_anew(&fitter, fitter.refit(&found.chosen.model, &found.chosen.theta));
            fitter.tau_samples = correlation(&fitter, &chosen);
            confirmed(&fitter, chosen, true, &incumbents(&found.rounds))
        },
    );
    let chosen = fitter.refit(&confirmed.model, &confirmed.theta);
    fitter.tau_samples = correlation(fitter, &chosen);
    Search { null: null.unwrap_or(found.null), chosen, rounds: found.rounds }
}

/// The models that a search has gone through.
fn incumbents<'r, 'a>(rounds: &'r [Round<'a>]) -> Vec<&'r Fit<'a>> {
    rounds.iter().map(|round| &round.incumbent).collect()
}

/// Searches the library.
fn search<'a>(fitter: &mut Fitter<'_>, base: &Model<'a>) -> Search<'a> {
    let mut null = fitter.recalibrate(base, &[]);
    let mut chosen = null.clone();
    let mut rounds: Vec<Round<'a>> = Vec::new();
    for _ in 0..fitter.criteria.rounds {
        // Where the good valve itself is off by as much, there is nothing left for a second cause but what the calibration was bent for.
        let known = fitter.floor_bar > fitter.evidence.noise_bar;
        let follows = known && !chosen.model.effects.is_empty() && chosen.rmse_bar < fitter.criteria.structure_known * fitter.floor_bar;
        if follows && !fitter.criteria.denies(chosen.prior_nats) {
            break;
        }
        let mut ranked = candidates(fitter, &chosen, rounds.last());
        if ranked.is_empty() {
            break;
        }
        let best_nats = ranked.iter().min_by(|a, b| a.fit.mean_nats.total_cmp(&b.fit.mean_nats)).map(|r| r.fit.clone());
        if let Some(best) = best_nats {
            fitter.tau_samples = correlation(fitter, &best);
        }
        let effective = fitter.effective();
        if ranked.iter().any(|r| fitter.gain(&chosen, &r.fit) > stuck_nats(fitter)) {
            hand_back(fitter, &chosen, &mut ranked);
            simplify(fitter, &chosen, &mut ranked);
        }
        ranked.sort_by(|a, b| a.fit.bic(effective).total_cmp(&b.fit.bic(effective)));
        chosen = same_effort(fitter, chosen, &ranked);
        if chosen.model.effects.is_empty() {
            null = chosen.clone();
        }
        let open: Vec<&Ranked<'a>> = ranked.iter().filter(|r| !follows || !fitter.criteria.denies(r.fit.prior_nats)).collect();
        let next = simplest(fitter, &chosen, &open);
        rounds.push(Round { incumbent: chosen.clone(), ranked, effective });
        match next {
            Some(fit) => chosen = with_lag(fitter, settle(fitter, fit, &rounds)),
            None => break,
        }
    }
    Search { null, chosen, rounds }
}

/// The fit with the lag that was calibrated, where the recording confirms it beside what was found: alone, a recalibration may
/// have had no use for it.
fn with_lag<'a>(fitter: &Fitter<'_>, fit: Fit<'a>) -> Fit<'a> {
    let Some(model) = fit.model.believing_lag() else { return fit };
    let starts = [fit.theta[AT.late], model.calibrated()[AT.late]].map(|late_s| {
        let mut theta = fit.theta.clone();
        (theta[AT.late], theta[AT.lag]) = (late_s, model.valve.lag_s);
        theta
    });
    let effective = fitter.effective();
    let with: Vec<Fit<'a>> = starts.into_par_iter().map(|start| fitter.refit(&model, &start)).collect();
    fitter.best(with).filter(|with| model.confirms_lag(with.theta[AT.lag]) && with.bic(effective) < fit.bic(effective)).unwrap_or(fit)
}

/// The candidates once more, each from the best base that anyone has found or from the incumbent's, whichever suits it: otherwise one
/// loses by a base that it did not reach, and one that holds the incumbent within it may even stand behind it.
fn hand_back<'a>(fitter: &Fitter<'_>, incumbent: &Fit<'a>, ranked: &mut [Ranked<'a>]) {
    let effective = fitter.effective();
    let Some(best) = ranked.iter().min_by(|a, b| a.fit.bic(effective).total_cmp(&b.fit.bic(effective))) else { return };
    let (best_bic, base) = (best.fit.bic(effective), best.fit.theta[..BASE].to_vec());
    let own = incumbent.theta.len();
    let near = |fit: &Fit<'_>| fit.bic(effective) < best_bic + HANDED_NATS || fitter.gain(incumbent, fit) < 0.0;
    ranked.par_iter_mut().filter(|r| near(&r.fit) && r.fit.theta[..BASE] != base[..]).for_each(|r| {
        let mut simulator = Simulator::new(fitter.evidence);
        let [of_best, own_base] = [&base[..], &incumbent.theta[..BASE]].map(|from| {
            let theta = [from, &incumbent.theta[BASE..own], &r.fit.theta[own..]].concat();
            fitter.score_near(&mut simulator, &r.fit.model, &theta, r.fit.scale_bar, &mut Vec::new())
        });
        let start = fitter.better(of_best, own_base);
        let mut next = fitter.polish(&r.fit.model, &start.theta, 2);
        if fitter.gain(&r.fit, &next) > -HANDED_SHORT_NATS {
            next = fitter.polish(&r.fit.model, &next.theta, HANDED_STEPS - 2);
        }
        if fitter.objective(&next) < fitter.objective(&r.fit) {
            r.fit = next;
        }
    });
}

/// The candidates that may still win, each with no more free parameters than it needs.
fn simplify(fitter: &Fitter<'_>, incumbent: &Fit<'_>, ranked: &mut [Ranked<'_>]) {
    let effective = fitter.effective();
    let best = ranked.iter().map(|r| r.fit.bic(effective)).fold(f64::INFINITY, f64::min);
    let cost = |count: usize| count as f64 * effective.ln();
    let is_near = |r: &Ranked<'_>| r.fit.bic(effective) < best + cost(r.effect.parameters().len()) + fitter.criteria.very_strong;
    // Who is no better than the incumbent even without what it can do without is no cause, however simple.
    let optional = |r: &Ranked<'_>| r.effect.parameters().iter().filter(|p| p.default.is_some()).count();
    let may_count = |r: &Ranked<'_>| r.fit.bic(effective) - cost(optional(r)) < incumbent.bic(effective);
    ranked
        .par_iter_mut()
        .filter(|r| r.effect.kind() == Kind::Course && is_near(r) && may_count(r))
        .for_each(|r| r.fit = fitter.simplified(r.fit.clone()));
}

/// The best candidate of worth; among those that are as good as it, the one with the fewest free parameters, then the
/// one whose physics has the fewest, then one that holds no other of them within it.
pub(super) fn simplest<'a>(fitter: &Fitter<'_>, incumbent: &Fit<'a>, ranked: &[&Ranked<'a>]) -> Option<Fit<'a>> {
    let (effective, criteria) = (fitter.effective(), &fitter.criteria);
    let gain = |r: &Ranked<'_>| incumbent.bic(effective) - r.fit.bic(effective);
    let mut worthy = ranked.iter().filter(|r| worth(fitter, incumbent, &r.fit));
    let mut best = worthy.next()?;
    // A free form imitates whatever changes the curve; a cause that explains half as much goes first.
    if best.effect.kind() == Kind::Form {
        best = worthy.find(|r| r.effect.kind() == Kind::Course && gain(r) > criteria.cause_first * gain(best)).unwrap_or(best);
    }
    // What follows the record as well as the good valve's own data is followed needs no more: the rest repairs the form.
    let known = criteria.structure_known;
    let follows = |r: &Ranked<'_>| {
        let plainly = || fitter.plain_rmse_bar(&r.fit) < known * fitter.plain_floor_bar();
        fitter.against_good && r.fit.rmse_bar < known * fitter.floor_bar && plainly()
    };
    let is_as_good = |r: &Ranked<'_>| gain(r) > criteria.as_good * gain(best) || gain(r) > criteria.cause_first * gain(best) && follows(r);
    let may_be_it = |r: &&Ranked<'a>| r.effect.kind() == best.effect.kind() && is_as_good(r) && worth(fitter, incumbent, &r.fit);
    let as_good: Vec<&Ranked<'a>> = ranked.iter().copied().filter(may_be_it).collect();
    let fewest = as_good.iter().map(|r| r.fit.model.extra_parameters()).min()?;
    let lean = || as_good.iter().filter(|r| r.fit.model.extra_parameters() == fewest);
    let most = lean().map(|r| gain(r)).fold(f64::NEG_INFINITY, f64::max);
    let tied = || lean().filter(|r| gain(r) > most - criteria.tie);
    // An effect at the edge of its range explains by what it does not mean to be; and of two that do the same, to the last digits in which
    // they differ, the one that holds the other within it does no more than that.
    let holds_another = |r: &Ranked<'_>| r.effect.nested().is_some_and(|nested| tied().any(|other| other.effect.id() == nested.id));
    tied().min_by_key(|r| (r.fit.at_edge(), r.effect.parameters().len(), holds_another(r))).map(|r| r.fit.clone())
}

/// The incumbent, refitted from where its best challengers ended: otherwise it loses by its own missed optimum.
fn same_effort<'a>(fitter: &Fitter<'_>, incumbent: Fit<'a>, ranked: &[Ranked<'a>]) -> Fit<'a> {
    let length = incumbent.theta.len();
    let effective = fitter.effective();
    let tries: Vec<Fit<'a>> = ranked.par_iter().take(4).map(|r| fitter.polish(&incumbent.model, &r.fit.theta[..length], 10)).collect();
    tries.into_iter().fold(incumbent, |best, next| if next.bic(effective) < best.bic(effective) { next } else { best })
}

/// How many of these effects count against [`MOST_EFFECTS`].
fn counted(effects: &[&'static dyn Effect]) -> usize {
    effects.iter().filter(|e| !e.imitates_form()).count()
}

/// Every effect of the course that the incumbent does not have, fitted jointly with it. A recording that is slower than a
/// valve shows the process behind it, which no effect after the spool can be told from.
fn candidates<'a>(fitter: &Fitter<'_>, incumbent: &Fit<'a>, before: Option<&Round<'a>>) -> Vec<Ranked<'a>> {
    let mut simulator = Simulator::new(fitter.evidence);
    let mut pressure = Vec::new();
    simulator.pressure(&incumbent.model, &incumbent.theta, &mut pressure);
    let residual: Vec<f64> = fitter.measured.iter().zip(&pressure).map(|(y, p)| y - p).collect();
    let open: Vec<&'static dyn Effect> = EFFECTS
        .iter()
        .copied()
        .filter(|e| match e.kind() {
            Kind::Course => counted(&incumbent.model.effects) < MOST_EFFECTS,
            // Steps show the curve at their levels only, and a free form would bend it where they pass.
            Kind::Form => !fitter.squared,
            Kind::Scatter => false,
        })
        .filter(|e| !incumbent.model.effects.iter().any(|have| have.id() == e.id()) && !fitter.found.contains(&e.id()))
        .filter(|e| !fitter.evidence.is_slow() || !fitter.evidence.controlled && e.stage() == Stage::Spool)
        .filter(|e| e.searched() && (fitter.against_good || !e.recalibrates()))
        .filter(|e| fitter.evidence.base.as_ref().is_none_or(|base| base.carries(*e)))
        .filter(|e| e.needs().is_none_or(|channel| fitter.evidence.moves(channel)))
        .collect();
    let screened: Vec<(&'static dyn Effect, Vec<Fit<'a>>)> =
        open.into_par_iter().map(|effect| (effect, screened(fitter, incumbent, effect, (&residual, &pressure), before))).collect();
    let most = |of: &[(&'static dyn Effect, Vec<Fit<'a>>)]| {
        of.iter().map(|(_, fits)| fitter.gain(incumbent, &fits[0])).fold(f64::NEG_INFINITY, f64::max)
    };
    let wanted = PROMISING * most(&screened);
    let begin = |(effect, fits): (&'static dyn Effect, Vec<Fit<'a>>)| (effect, fitter.begin(fits, incumbent, wanted));
    let begun: Vec<(&'static dyn Effect, Vec<Fit<'a>>)> = screened.into_par_iter().map(begin).collect();
    let needed = (PROMISING * most(&begun)).max(stuck_nats(fitter));
    let of = begun.len();
    begun
        .into_par_iter()
        .map(|(effect, mut fits)| {
            let hopeless = fitter.gain(incumbent, &fits[0]) < needed;
            let fit = if hopeless { fits.swap_remove(0) } else { fitter.finish(fits, false) };
            watch::tried(effect, &incumbent.model.effects, of, (incumbent.rmse_bar, fit.rmse_bar));
            Ranked { effect, fit }
        })
        .collect()
}

/// The first steps of the fits of the incumbent with one more effect, best first; `residual` and `pressure`: what the incumbent
/// leaves and gives [bar].
pub fn screened<'a>(
    fitter: &Fitter<'_>,
    incumbent: &Fit<'a>,
    effect: &'static dyn Effect,
    (residual, pressure): (&[f64], &[f64]),
    before: Option<&Round<'a>>,
) -> Vec<Fit<'a>> {
    let left = Left::of(fitter, incumbent, (residual, pressure));
    let model = incumbent.model.with(effect, left.signature_nats(effect));
    let mut starts = model.starts(effect);
    starts.extend(left.proposals(effect));
    starts.extend(before.and_then(|round| round.end_of(effect)));
    fitter.screen(&model, incumbent, &starts)
}

/// A gain below this [nats] is far from evidence for a name.
fn stuck_nats(fitter: &Fitter<'_>) -> f64 {
    STUCK * fitter.criteria.very_strong
}

/// How many samples of this fit's residual count as one.
pub fn correlation(fitter: &Fitter<'_>, fit: &Fit<'_>) -> f64 {
    let mut residual = Vec::new();
    fitter.residual(&mut Simulator::new(fitter.evidence), &fit.model, &fit.theta, &mut residual);
    let most = (fitter.used() as f64 / 300.0).clamp(1.0, TAU_SAMPLES.1);
    loss::correlation_samples(&residual, fit.scale_bar).clamp(TAU_SAMPLES.0.min(most), most)
}

/// Whether `next` is so much better than `incumbent` that it counts: very strong evidence, and more than a trifle.
fn worth(fitter: &Fitter<'_>, incumbent: &Fit<'_>, next: &Fit<'_>) -> bool {
    let effective = fitter.effective();
    let gain = incumbent.bic(effective) - next.bic(effective);
    if gain < fitter.criteria.very_strong {
        return false;
    }
    let faint = gain > fitter.criteria.overwhelming && next.model.effects.last().is_some_and(|e| !e.imitates_form());
    let closer = next.scale_bar < (1.0 - fitter.criteria.worth) * incumbent.scale_bar
        || next.rmse_bar < (1.0 - fitter.criteria.worth) * incumbent.rmse_bar;
    // A parameter of the calibration had to stand in for it, far from where the calibration found it.
    let stood_in = fitter.criteria.denies(incumbent.prior_nats - next.prior_nats);
    let noise = fitter.floor_bar;
    (stood_in || closer && (faint || explained_rms(fitter, incumbent, next) > fitter.criteria.net * noise))
        && own_rms(fitter, next, next.model.effects.len() - 1) > fitter.criteria.trifle * noise
}

/// RMS of what effect number `k` of a fit does to the pressure, all else equal [bar].
pub fn own_rms(fitter: &Fitter<'_>, fit: &Fit<'_>, k: usize) -> f64 {
    explained_rms(fitter, &fit.without(k), fit)
}

/// RMS of what the two models differ by, where there is data [bar].
pub fn explained_rms(fitter: &Fitter<'_>, a: &Fit<'_>, b: &Fit<'_>) -> f64 {
    let mut simulator = Simulator::new(fitter.evidence);
    let (mut first, mut second) = (Vec::new(), Vec::new());
    simulator.pressure(&a.model, &a.theta, &mut first);
    simulator.pressure(&b.model, &b.theta, &mut second);
    let mut apart: Vec<f64> = first.iter().zip(&second).map(|(p, q)| p - q).collect();
    fitter.weigh(&mut apart);
    let squares: Vec<f64> = apart.iter().zip(&fitter.measured).filter(|(_, y)| y.is_finite()).map(|(e, _)| e.powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// After an effect was added: swap each earlier one for its rivals, drop what has become needless.
fn settle<'a>(fitter: &Fitter<'_>, mut fit: Fit<'a>, rounds: &[Round<'a>]) -> Fit<'a> {
    let effective = fitter.effective();
    let mut k = 0;
    while fit.model.effects.len() > 1 && k < fit.model.effects.len() - 1 {
        // Without it.
        let less = fitter.refit_without(&fit, k);
        if less.bic(effective) < fit.bic(effective) + fitter.criteria.very_strong * 0.5 {
            fit = less;
            continue;
        }
        // The rivals of the round in which it was found, in its place.
        let rivals: Vec<&'static dyn Effect> = rounds
            .iter()
            .find(|r| r.tried(fit.model.effects[k].id()))
            .map(|round| round.promising(PROMISING).take(MOST_SWAPPED).collect())
            .unwrap_or_default();
        let swapped: Vec<Fit<'a>> = rivals
            .into_par_iter()
            .filter(|e| !fit.model.effects.iter().any(|have| have.id() == e.id()))
            .map(|e| fitter.fit_new(&less.model.with(e, 0.0), &less, &[]))
            .filter(|next| !stays_before_form(fitter, &less, (&fit, k), next))
            .collect();
        if let Some(better) = swapped.into_iter().min_by(|a, b| a.bic(effective).total_cmp(&b.bic(effective)))
            && better.bic(effective) < fit.bic(effective) - fitter.criteria.very_strong
        {
            fit = better;
            // The newcomer stands last now; the one that moved to this place is looked at next.
            continue;
        }
        k += 1;
    }
    fit
}
