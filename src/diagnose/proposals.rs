//! Where fits begin: what effects propose on looking at what the present model leaves.

use std::ops::Range;

use super::base::AT;
use super::fit::{Fit, Fitter, clamped};
use super::simulator::Simulator;
use crate::course::Run;
use crate::physics::{Effect, Hint};

/// What a fit leaves of the evidence.
pub struct Left<'l> {
    fitter: &'l Fitter<'l>,
    theta: &'l [f64],
    scale_bar: f64,
    residual: &'l [f64],
    pressure: &'l [f64],
    parts: Vec<(f64, &'l [f64])>,
}

impl<'l> Left<'l> {
    /// Of this fit; `residual` and `pressure`: what it leaves and gives [bar].
    pub fn of(fitter: &'l Fitter<'_>, fit: &'l Fit<'_>, (residual, pressure): (&'l [f64], &'l [f64])) -> Self {
        let parts = fitter.evidence.parts(residual);
        Self { fitter, theta: &fit.theta, scale_bar: fit.scale_bar, residual, pressure, parts }
    }

    /// How much what is left bears the signature of an effect [nats].
    pub fn signature_nats(&self, effect: &dyn Effect) -> f64 {
        effect.signature_nats(&self.hint(self.fitter.evidence.longest()))
    }

    /// What an effect proposes on looking at the longest run, and at the one with the largest squared error: an effect that shows now and
    /// then, as a filling, may be in none but one of them. A fit then sees them all.
    pub fn proposals(&self, effect: &dyn Effect) -> Vec<Vec<f64>> {
        let longest = self.fitter.evidence.longest();
        let worst = self.worst().filter(|worst| worst.0 != longest.0);
        std::iter::once(longest).chain(worst).flat_map(|run| effect.propose(&self.hint(run))).collect()
    }

    /// The run with the largest squared error, and where it stands among the samples of all runs; none where nothing is left.
    fn worst(&self) -> Option<(Range<usize>, &'l Run)> {
        let squares = |samples: &Range<usize>| self.residual[samples.clone()].iter().filter(|e| e.is_finite()).map(|e| e * e).sum::<f64>();
        let runs = self.fitter.evidence.runs().into_iter().zip(&self.fitter.evidence.grids);
        runs.filter(|run| squares(&run.0) > 0.0).max_by(|a, b| squares(&a.0).total_cmp(&squares(&b.0)))
    }

    fn hint(&self, (samples, run): (Range<usize>, &'l Run)) -> Hint<'_> {
        Hint {
            start_s: run.elapsed_s,
            dt_s: run.dt_s,
            current_a: &run.current_a,
            delay_s: self.theta[AT.late],
            residual_bar: &self.residual[samples.clone()],
            parts: &self.parts,
            pressure_bar: &self.pressure[samples],
            scale_bar: self.scale_bar,
            recalibrated: (self.theta[AT.gain], self.theta[AT.offset]),
        }
    }
}

/// A fit whose effects were found on a part of the evidence, each where all of the evidence shows it, if that is a better place to begin:
/// an instant between two stretches that were looked at lies somewhere in the gap, and no step of a fit would find it there.
pub fn placed_anew<'a>(fitter: &Fitter<'_>, fit: Fit<'a>) -> Fit<'a> {
    let mut simulator = Simulator::new(fitter.evidence);
    let (mut pressure, mut residual) = (Vec::new(), Vec::new());
    (0..fit.model.effects.len()).fold(fit, |fit, k| {
        let less = fit.without(k);
        simulator.pressure(&less.model, &less.theta, &mut pressure);
        let without: Vec<f64> = fitter.measured.iter().zip(&pressure).map(|(y, p)| y - p).collect();
        // What it leaves is larger than what the fit does.
        let less = fitter.judged(&less.model, &less.theta, fitter.guessed_scale_bar(), &without);
        let proposals = Left::of(fitter, &less, (&without, &pressure)).proposals(fit.model.effects[k]);
        let free = fit.model.free();
        let mut begin = |values: &Vec<f64>| {
            let mut theta = fit.theta.clone();
            theta[fit.model.place(k)].copy_from_slice(values);
            // What is held stays where it is: its range is nothing but that.
            fitter.score_near(&mut simulator, &fit.model, &clamped(&free, &theta), fit.scale_bar, &mut residual)
        };
        let begins: Vec<Fit<'a>> = proposals.iter().map(&mut begin).collect();
        match fitter.best(begins).filter(|begin| fitter.objective(begin) < fitter.objective(&fit)) {
            Some(begin) => fitter.better(fit, fitter.refit(&begin.model, &begin.theta)),
            None => fit,
        }
    })
}
