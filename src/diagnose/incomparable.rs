//! The diagnosis of a model and a recording that do not belong together: no cause is looked for.

use super::base::AT;
use super::diagnosis::{Curves, Diagnosed, Diagnosis, Errors, SCHEMA, Verdict};
use super::evidence::{Evidence, rms};
use super::locate::locate;
use super::mistake::Mistake;
use super::model::Model;
use super::simulator::Simulator;
use super::words::figure;
use crate::recording::Recording;

/// What is said of them; `share` is what the model explains of the variance after the freest recalibration.
pub fn incomparable(recording: &Recording, evidence: &Evidence, base: &Model<'_>, mistake: Mistake, share: f64) -> Diagnosed {
    let mut theta = base.calibrated();
    theta[AT.lag] = base.valve.lag_s;
    let mut simulated = Vec::new();
    Simulator::new(evidence).pressure(base, &theta, &mut simulated);
    let measured = evidence.pressure_bar();
    let residual: Vec<f64> = measured.iter().zip(&simulated).map(|(y, p)| y - p).collect();
    let error = rms(&residual);
    let summary = format!(
        "Model and recording do not belong together, so no cause is looked for: {}. A straight line over the simulation, shifted in time as far as a valve can be late, explains {:.0} % of the variance of the pressure; the model as given is off by {} RMSE.",
        mistake.text(),
        100.0 * share,
        figure(error, "bar")
    );
    let diagnosis = Diagnosis {
        schema: SCHEMA.into(),
        recording: recording.source.clone(),
        model: base.valve.name.clone(),
        verdict: Verdict::NotComparable,
        summary,
        mistake: Some(mistake),
        rmse_bar: Errors {
            base: error,
            base_heldout: error,
            refit_heldout: error,
            augmented_heldout: error,
            noise_floor: evidence.noise_bar,
        },
        effects: Vec::new(),
        form: Vec::new(),
        recalibration: Vec::new(),
        place: locate(evidence, &residual, &simulated),
        candidates: Vec::new(),
        unexplained: None,
        discovered: None,
        coil_current: None,
        other_drives: None,
        next_experiment: None,
        notes: evidence.notes.clone(),
    };
    let curves = Curves { base_bar: simulated.clone(), refit_bar: simulated.clone(), augmented_bar: simulated, ..Curves::along(evidence) };
    let recalibration = evidence.base.as_ref().map(|foreign| foreign.recalibration(&theta));
    Diagnosed { diagnosis, augmented: base.valve.clone(), curves, open: None, recalibration, stands_apart: false }
}
