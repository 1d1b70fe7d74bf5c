//! Effects that show in the scatter about a course, or in stretches of their own.

use super::base::AT;
use super::fit::{Fit, Fitter};
use super::model::Model;
use super::search::recalibrated;
use super::simulator::Simulator;
use crate::physics::{EFFECTS, Effect, Scatter, ScatterFinding, specification};
use crate::valve::EffectSpec;

/// An effect of the scatter with what it found.
pub struct Scattered {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// What it found.
    pub finding: ScatterFinding,
}

impl Scattered {
    /// What the augmented model holds of it; nothing of what came at times of its own.
    pub fn specification(&self) -> Option<EffectSpec> {
        (!self.finding.is_event).then(|| specification(self.effect, &self.finding.theta))
    }
}

/// Readings as the pressure was, where what changed them can be undone.
pub fn give_back(scattered: &[Scattered], measured_bar: &mut [f64]) {
    for finding in scattered.iter().map(|s| &s.finding).filter(|f| !f.restored.is_empty()) {
        measured_bar.copy_from_slice(&finding.restored);
    }
}

/// Leaves out readings that measure nothing.
pub fn mask(scattered: &[Scattered], measured_bar: &mut [f64]) {
    for k in scattered.iter().flat_map(|s| &s.finding.masked) {
        measured_bar[*k] = f64::NAN;
    }
}

/// The recalibrated model, on readings that are given back first where that can be told, and by which effects they were changed.
pub fn restored<'a>(fitter: &mut Fitter<'_>, base: Model<'a>) -> (Fit<'a>, Model<'a>, Vec<Scattered>) {
    // About the model as given: a recalibration takes half of what is read away for a zero that is off.
    let as_given = fitter.score(&mut Simulator::new(fitter.evidence), &base, &base.calibrated(), &mut Vec::new());
    let changed = scatter(fitter, &as_given, |e| e.restores());
    give_back(&changed, &mut fitter.measured);
    let (null, base) = recalibrated(fitter, base);
    (null, base, changed)
}

/// Those of the effects asked for whose signature shows in the scatter about this fit, or in stretches of their own.
pub fn scatter(fitter: &Fitter<'_>, fit: &Fit<'_>, asked: impl Fn(&dyn Effect) -> bool) -> Vec<Scattered> {
    let mut simulated = Vec::new();
    Simulator::new(fitter.evidence).pressure(&fit.model, &fit.theta, &mut simulated);
    let (current_a, runs) = (fitter.evidence.current_a(), fitter.evidence.runs());
    let look = Scatter {
        dt_s: fitter.evidence.step_s(),
        noise_bar: fitter.evidence.noise_bar,
        measured_bar: &fitter.measured,
        simulated_bar: &simulated,
        current_a: &current_a,
        runs: &runs,
        delay_s: fit.theta[AT.late],
        lag_s: fit.theta[AT.lag],
    };
    EFFECTS
        .iter()
        .copied()
        .filter(|e| asked(*e))
        .filter_map(|effect| effect.scatter(&look).map(|finding| Scattered { effect, finding }))
        .collect()
}
