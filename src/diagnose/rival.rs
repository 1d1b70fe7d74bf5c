//! The model that comes closest to the one that was chosen: with another effect in place of one that was found.

use super::conclude::Findings;
use super::diagnosis::{Finding, Rival};
use crate::physics::effect;

impl Findings<'_, '_> {
    /// The rival of the most important finding that cannot be told from another; where all can, the runner-up of the
    /// first.
    pub fn rival(&self, findings: &[Finding]) -> Option<Rival> {
        let chosen = &self.search.chosen;
        let number = |id: &str| chosen.model.effects.iter().position(|e| e.id() == id);
        let close = findings.iter().find_map(|f| Some((number(&f.id)?, effect(f.indistinguishable.first()?)?, true)));
        let next = || {
            let of = findings.iter().find_map(|f| number(&f.id))?;
            let first = self.search.rounds.first()?;
            let taken = |id: &str| number(id).is_some();
            Some((of, first.ranked.iter().map(|c| c.effect).find(|e| !taken(e.id()))?, false))
        };
        let (of, other, indistinguishable) = close.or_else(next)?;
        let mut theta = chosen.theta.clone();
        theta.drain(chosen.model.place(of));
        let without = self.where_searched().refit(&chosen.model.without(of), &theta);
        let fit = self.where_searched().fit_new(&without.model.with(other, 0.0), &without, &[]);
        Some(Rival {
            of: chosen.model.effects[of].id().into(),
            id: other.id().into(),
            valve: fit.model.valve_file(&fit.theta),
            indistinguishable,
        })
    }
}
