//! A term that no effect of the library holds, looked for where an error remains that no effect explains.
//!
//! States of the model's own free run are tried, alone and in pairs, by smooth functions under blocked cross-validation; the
//! best one must beat chance over everything that was tried, be worth half of the noise, and predict, as a short formula,
//! data that the search has not seen. A formula says what the error follows, never why.

mod atoms;
mod confirm;
mod distil;
mod rows;
mod screen;
mod spline;
mod states;

pub use confirm::Unseen;

use super::diagnosis::{Diagnosed, Discovery, Followed, OnUnseen};
use super::fit::{Fit, Fitter, shifted};
use super::simulator::Simulator;
use crate::physics::{Discovered, Term, numbers, specification, state_text};
use crate::valve::EffectSpec;
use confirm::confirmed;
use distil::{Formula, Known, distil, shortened, with_coefficients};
use rows::Rows;

/// Most formulas that are looked for one after the other.
const MOST_ROUNDS: usize = 3;
/// Chance of the best of all candidates up to which it is looked at (one in twenty).
const BY_CHANCE: f64 = 0.05;
/// What a term must take off the error, in units of the noise.
const MATERIAL: f64 = 0.5;
/// Steps in which the base makes room for the terms.
const POLISH: usize = 8;

/// What was found.
pub struct Found<'a> {
    /// The terms.
    pub terms: Vec<Term>,
    /// The model with them, and its base fitted anew.
    pub fit: Fit<'a>,
    /// Root mean square of what they add [bar].
    pub adds_bar: f64,
    /// The first formula on data that its search has not seen, then the others.
    pub unseen: Vec<Unseen>,
    /// How many functions of states were tried.
    pub tried: usize,
    /// Chance that the best of them is as good, of the first formula.
    pub p_value: f64,
    /// Pressure of the model with the terms [bar].
    pub pressure_bar: Vec<f64>,
}

impl Found<'_> {
    /// Whether recordings or runs confirm it that its search has not seen. The end of the only one repeats what its begin shows, and a term
    /// that follows that may be wrong on any other drive: such a term is told, and stays out of the model.
    fn enters_model(&self) -> bool {
        self.unseen.iter().all(|u| u.own_run)
    }

    /// Enters it into a diagnosis whose model was `without` it, and, where another recording confirms it, into its augmented model, `beside`
    /// what was found of the scatter.
    pub fn enter(&self, found: &mut Diagnosed, without: &Fit<'_>, beside: Vec<EffectSpec>) {
        let formula: Vec<String> = self.terms.iter().map(Term::text).collect();
        let mut follows: Vec<Followed> = Vec::new();
        for f in self.terms.iter().flat_map(|t| &t.factors) {
            let state = state_text(&f.state);
            if !follows.iter().any(|known| known.state == state) {
                follows.push(Followed { state, from: f.seen.0, to: f.seen.1, unit: f.state.kind.unit().symbol.into() });
            }
        }
        let on = |u: &Unseen| OnUnseen {
            on: if u.own_run { "run" } else { "end" }.into(),
            lasts_s: u.lasts_s,
            rmse_without_bar: u.rmse_bar.0,
            rmse_with_bar: u.rmse_bar.1,
            gain_ci_bar: u.gain_ci_bar,
            p_value: u.p_value,
        };
        let unseen: Vec<OnUnseen> = self.unseen.iter().map(on).collect();
        let ends = unseen.first().zip(unseen.last());
        let shown = ends.map_or(String::new(), |(first, last)| {
            let what = if first.on == "run" {
                "a run that its search has not seen"
            } else {
                "the end of the recording, which its search has not seen,"
            };
            format!("; on {what} the error falls from {:.3} bar to {:.3} bar", first.rmse_without_bar, last.rmse_with_bar)
        });
        let in_model = self.enters_model();
        let stays_out = if in_model { "" } else { ". It is not in the augmented model: a second recording has to confirm it" };
        let text = format!("A term was found that no effect of the library holds: {}{shown}{stays_out}.", formula.join(" + "));
        found.diagnosis.summary = format!("{} {text}", found.diagnosis.summary);
        found.diagnosis.discovered = Some(Discovery {
            text,
            in_model,
            formula,
            follows,
            adds_bar: self.adds_bar,
            rmse_without_bar: without.rmse_bar,
            rmse_with_bar: self.fit.rmse_bar,
            unseen,
            tried: self.tried,
            p_value: self.p_value,
        });
        // What is drawn has the term; of what is left, no effect of the library is asked about any more.
        found.curves.augmented_bar = self.pressure_bar.clone();
        found.open = found.open.take().filter(|open| open.named.is_some());
        if !in_model {
            return;
        }
        let noise_bar = found.augmented.noise_bar;
        let mut valve = self.fit.model.valve_file(&self.fit.theta);
        // The simulation had it ahead of what was found by name.
        valve.effects.insert(self.fit.model.valve.effects.len(), specification(&Discovered, &numbers(&self.terms)));
        valve.effects.extend(beside);
        valve.noise_bar = noise_bar;
        found.augmented = valve;
        found.diagnosis.rmse_bar.augmented_heldout = self.unseen.last().map_or(self.fit.rmse_bar, |u| u.rmse_bar.1);
    }
}

/// The terms that this fit lacks; nothing where none is confirmed.
pub fn discover<'a>(fitter: &Fitter<'_>, fit: &Fit<'a>) -> Option<Found<'a>> {
    // A state that the error follows in movement is looked for there, too.
    let fitter = &fitter.seeing(fitter.measured.clone()).trusting(None);
    let fit = &fitter.as_it_stands(fit);
    let first = Rows::of(fitter, fit, false);
    let own_run = first.own_run;
    // Of two recordings either may show it.
    look(fitter, fit, first).or_else(|| if own_run { look(fitter, fit, Rows::of(fitter, fit, true)) } else { None })
}

fn look<'a>(fitter: &Fitter<'_>, fit: &Fit<'a>, mut rows: Rows<'_>) -> Option<Found<'a>> {
    if rows.searched < 10 * rows::FOLDS || rows.len() < rows.searched + rows.searched / 10 {
        return None;
    }
    let material_bar = MATERIAL * fitter.evidence.noise_bar;
    let tried = states::tried(&rows);
    let candidates = states::candidates(&tried);
    let parameters = rows.besides.len();
    let mut formulas: Formula = Vec::new();
    let (mut unseen, mut p_value) = (Vec::new(), 1.0);
    for round in 0..MOST_ROUNDS {
        let Some(best) = screen::best(&rows, &tried, &candidates) else { break };
        let gain_bar = rows.of_samples(best.mean_square.1) - rows.of_samples(best.mean_square.0);
        if gain_bar < material_bar {
            break;
        }
        let chance = screen::by_chance(&rows, &tried, &candidates, &best, BY_CHANCE);
        if chance > BY_CHANCE {
            break;
        }
        let of_two = [&tried[best.candidate.first], &tried[best.candidate.second]];
        let states = if best.candidate.alone() { &of_two[..1] } else { &of_two[..] };
        let formula = shortened(&distil(&rows, states));
        let columns: Vec<Vec<f64>> = {
            let mut known = Known::new(&rows, states);
            formula.iter().map(|f| known.column(f)).collect()
        };
        let Some(found) = confirmed(&rows, &columns, material_bar) else { break };
        if round == 0 {
            p_value = chance;
        }
        unseen.push(found);
        formulas.extend(formula);
        rows.besides.extend(columns);
        rows.stiffness.resize(rows.besides.len(), 0.0);
    }
    if formulas.is_empty() {
        return None;
    }
    let (moves, _) = rows.regress(&[], 0..rows.len())?;
    let terms = with_coefficients(&formulas, &moves[parameters..]);
    let free = fit.model.free();
    let theta: Vec<f64> = (0..parameters).map(|k| shifted(&free[k], fit.theta[k], moves[k] * rows.units[k])).collect();
    let model = fit.model.beside(&Discovered, numbers(&terms));
    let with = fitter.polish(&model, &theta, POLISH);
    let worth = fit.rmse_bar - with.rmse_bar;
    if worth < material_bar || worth < confirm::WORTH * fit.rmse_bar {
        return None;
    }
    let of = |model: &_| {
        let mut pressure = Vec::new();
        Simulator::new(fitter.evidence).pressure(model, &with.theta, &mut pressure);
        pressure
    };
    let (without, all) = (of(&fit.model), of(&with.model));
    let adds_bar = (all.iter().zip(&without).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / all.len().max(1) as f64).sqrt();
    Some(Found { terms, adds_bar, fit: with, unseen, tried: candidates.len(), p_value, pressure_bar: all })
}

#[cfg(test)]
mod tests;
