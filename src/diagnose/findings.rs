//! What is told of each effect: its size, what speaks for it, and whose it is; and of the candidates that were tried.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::conclude::{Findings, Weighed};
use super::diagnosis::{Candidate, Claim, Estimate, Finding};
use super::errors::Curvature;
use super::evidence::rms;
use super::heldout::{HeldOut, held_out};
use super::profile::Profiles;
use super::scatter::Scattered;
use super::spread::between_models;
use crate::physics::{EFFECTS, Kind};

impl Findings<'_, '_> {
    /// The effects of the course with their importance.
    pub fn course_findings(&self, chosen_held: &HeldOut, curvature: Option<&Curvature<'_, '_>>) -> Vec<(f64, Finding)> {
        let (fitter, chosen) = (self.fitter, &self.search.chosen);
        let between = between_models(fitter, chosen, &self.search.rounds);
        let profiles = curvature.filter(|_| !chosen.model.effects.is_empty()).map(|curvature| Profiles::new(fitter, curvature));
        let effective = fitter.effective();
        let good = self.good_of_another_state();
        let plain_bar = fitter.plain_rmse_bar(chosen);
        (0..chosen.model.effects.len())
            .into_par_iter()
            .map(|k| {
                let effect = chosen.model.effects[k];
                let Weighed { without, share, rest, .. } = &self.weighed[k];
                // What a recalibration does as well is held against the model with nothing moved in its place.
                let as_calibrated = effect.recalibrates().then(|| fitter.as_it_stands(&chosen.without(k)));
                let (without, steps) = as_calibrated.as_ref().map_or((without, 4), |fit| (fit, 0));
                let (gain, interval, p_value) = chosen_held.gain_over(&held_out(fitter, without, steps));
                let parameters: BTreeMap<String, Estimate> = effect
                    .parameters()
                    .iter()
                    .zip(chosen.model.place(k))
                    .map(|(p, j)| {
                        let known = profiles.as_ref().map(|profiles| profiles.interval(j, between[j]));
                        let (std_error, interval) = known.unwrap_or_default();
                        (p.name.to_string(), Estimate { value: chosen.theta[j], std_error, interval, unit: p.unit.symbol.into() })
                    })
                    .collect();
                let importance = without.bic(effective) - chosen.bic(effective);
                let speaks = effect.is_apart_from_form() || effect.is_cause() && self.is_in_place_of_recalibration();
                let claim = self.claim(k, if speaks { self.good } else { good }, without, interval);
                let evidence = super::words::evidence(effect, fitter.plain_rmse_bar(without), plain_bar, importance, p_value);
                let id = effect.id().to_string();
                (
                    importance,
                    Finding {
                        id,
                        claim,
                        share: *share,
                        is_class: *share < fitter.criteria.name_share || chosen.at_bound(k),
                        parameters,
                        heldout_gain_bar: gain,
                        heldout_gain_ci_bar: interval,
                        p_value,
                        indistinguishable: rest.iter().map(|member| member.id.to_string()).collect(),
                        evidence,
                    },
                )
            })
            .collect()
    }

    /// A cause without a simulation, with its importance.
    pub fn scatter_finding(&self, s: &Scattered) -> (f64, Finding) {
        let (fitter, f) = (self.fitter, &s.finding);
        let estimate =
            |(k, p): (usize, &crate::physics::Parameter)| (p.name.to_string(), Estimate::normal(p, f.theta[k], Some(f.std_errors[k])));
        let parameters = s.effect.parameters().iter().enumerate().map(estimate).collect();
        let off_bar = if f.restored.is_empty() {
            rms(&f.spread_bar)
        } else {
            rms(&f.restored.iter().zip(fitter.evidence.pressure_bar()).map(|(was, read)| was - read).collect::<Vec<f64>>())
        };
        let finding = Finding {
            id: s.effect.id().into(),
            claim: if self.good.is_some_and(|g| !g.scatters(s.effect, f)) { Claim::Changed } else { Claim::Lacks },
            share: 1.0,
            is_class: false,
            parameters,
            heldout_gain_bar: off_bar,
            heldout_gain_ci_bar: None,
            // Chance of such a likelihood by Wilks' theorem, bounded by what a test of this size can say.
            p_value: (-f.gain_nats).exp().max(1e-6),
            indistinguishable: Vec::new(),
            evidence: f.evidence.clone(),
        };
        (2.0 * f.gain_nats / fitter.tau_samples, finding)
    }

    /// All effects that were tried alone, and the verdict on each beside these, which were found.
    pub fn candidates(&self, effects: &[Finding]) -> Vec<Candidate> {
        let mut out: Vec<Candidate> = Vec::new();
        if let Some(first) = self.search.rounds.first() {
            let null = first.incumbent.bic(first.effective);
            out = first
                .ranked
                .par_iter()
                .enumerate()
                .map(|(rank, c)| {
                    let bic = c.fit.bic(first.effective) - null;
                    let rejected_because = (!effects.iter().any(|f| f.id == c.effect.id()))
                        .then(|| super::words::rejected(c.effect.id(), bic, effects, self.fitter.criteria.overwhelming));
                    let heldout_rmse_bar = (rank < 8).then(|| held_out(self.where_searched(), &c.fit, 2).rmse_bar());
                    Candidate { id: c.effect.id().into(), heldout_rmse_bar, bic, rejected_because }
                })
                .collect();
        }
        for effect in EFFECTS.iter().filter(|e| e.kind() == Kind::Scatter || self.fitter.found.contains(&e.id())) {
            let found = self.scattered.iter().find(|s| s.effect.id() == effect.id());
            let bic = found.map_or(0.0, |s| -2.0 * s.finding.gain_nats);
            let rejected_because = found.is_none().then(|| "its signature is not in the recording".to_string());
            out.push(Candidate { id: effect.id().into(), heldout_rmse_bar: None, bic, rejected_because });
        }
        out
    }
}
