//! What a recording leaves open: the models that explain it about as well as the one that was chosen, or that come nearest to
//! what is left.

use super::conclude::Findings;
use super::diagnosis::{Diagnosis, Open, Rival};
use super::fit::Fit;

/// Of the candidates for what is left, so many are asked about.
const NEAREST: usize = 3;

impl Findings<'_, '_> {
    /// The credible set of the most important name that is not certain; where all are, or there is none, and something is left: the
    /// candidates that come nearest to it, with strong evidence on this record and yet without proof.
    pub fn open(&self, diagnosis: &Diagnosis) -> Option<Open> {
        let chosen = &self.search.chosen;
        let number = |id: &str| chosen.model.effects.iter().position(|e| e.id() == id);
        let in_doubt = diagnosis.effects.iter().filter_map(|f| Some((f, &self.weighed[number(&f.id)?]))).find(|(_, w)| !w.rest.is_empty());
        if let Some((finding, weighed)) = in_doubt {
            let rivals = weighed.rest.iter().map(|member| rival(member.id, member.share, &member.fit)).collect();
            return Some(Open { named: Some(finding.id.clone()), share: weighed.share, rivals });
        }
        diagnosis.unexplained.as_ref()?;
        // The round that went on from what stands in the answer, and found nothing worth adding.
        let kept = |id: &str| diagnosis.effects.iter().chain(&diagnosis.form).any(|f| f.id == id);
        let is_answer = |fit: &Fit<'_>| {
            let effects = &fit.model.effects;
            effects.iter().all(|e| kept(e.id())) && chosen.model.effects.iter().filter(|e| kept(e.id())).count() == effects.len()
        };
        let round = self.search.rounds.iter().rev().find(|round| is_answer(&round.incumbent))?;
        let (before, criteria) = (round.incumbent.bic(round.effective), &self.fitter.criteria);
        let nearest: Vec<_> =
            round.ranked.iter().filter(|c| c.fit.bic(round.effective) < before - criteria.very_strong).take(NEAREST).collect();
        let share = 1.0 / (nearest.len() + 1) as f64;
        let rivals: Vec<Rival> = nearest.into_iter().map(|c| rival(c.effect.id(), share, &c.fit)).collect();
        (!rivals.is_empty()).then_some(Open { named: None, share, rivals })
    }
}

fn rival(id: &str, share: f64, fit: &Fit<'_>) -> Rival {
    Rival { id: id.into(), share, valve: fit.model.valve_file(&fit.theta) }
}
