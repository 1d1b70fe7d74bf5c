//! What a model leaves of the readings: where the start is not known, where readings are masked, and beside scatter that was found.

use super::base::Base;
use super::conclude::Findings;
use super::evidence::rms;
use super::fit::Fit;
use super::heldout::HeldOut;
use super::simulator::Simulator;

impl Findings<'_, '_> {
    /// Readings minus `simulated`; NaN before the valve has settled from where it stood [bar].
    pub fn residual_settled(&self, readings: &[f64], simulated: &[f64]) -> Vec<f64> {
        let mut out: Vec<f64> = readings.iter().zip(simulated).map(|(y, p)| y - p).collect();
        self.unsettled.iter().for_each(|k| out[*k] = f64::NAN);
        out
    }

    /// Readings minus `simulated`, the pressure of the chosen model; before the valve has settled what lies beyond all that it would show
    /// from a start anywhere in its loop, and NaN as long as that model remembers the current before the first sample [bar].
    pub fn off_from_any_start(&self, readings: &[f64], simulated: &[f64]) -> Vec<f64> {
        let mut out = self.residual_settled(readings, simulated);
        if self.unsettled.is_empty() {
            return out;
        }
        let (chosen, evidence) = (&self.search.chosen, self.fitter.evidence);
        let [ascending, descending] = [0.0, 1.0].map(|share| {
            let mut pressure = Vec::new();
            Simulator::starting_at(evidence, share).pressure(&chosen.model, &chosen.theta, &mut pressure);
            pressure
        });
        let memory_s = remembers_s(chosen);
        let since_start_s: Vec<f64> = evidence.grids.iter().flat_map(|g| (0..g.current_a.len()).map(|k| g.dt_s * k as f64)).collect();
        for k in self.unsettled.iter().copied().filter(|k| since_start_s[*k] > memory_s) {
            let (low, high) = (ascending[k].min(descending[k]), ascending[k].max(descending[k]));
            out[k] = readings[k] - readings[k].max(low).min(high);
        }
        out
    }

    /// RMSE of a held-out residual with the masked readings counted against the model again.
    pub fn with_masked(&self, held: &HeldOut, measured: &[f64], simulated: &[f64]) -> f64 {
        let full: Vec<f64> =
            held.residual.iter().zip(measured).zip(simulated).map(|((e, y), p)| if e.is_finite() { *e } else { y - p }).collect();
        rms(&full)
    }

    /// The residual with the scatter that was found taken out: each sample over its own standard deviation, times
    /// that of the noise.
    pub fn standardised(&self, residual: &[f64]) -> Vec<f64> {
        let noise = self.fitter.evidence.noise_bar;
        let mut variance = vec![noise * noise; residual.len()];
        for s in self.scattered {
            for (v, spread) in variance.iter_mut().zip(&s.finding.spread_bar) {
                *v += spread * spread;
            }
        }
        residual.iter().zip(variance).map(|(e, v)| e * noise / v.sqrt()).collect()
    }
}

/// How long a model remembers a current that went before [s]: its base, and the effects that it was given with or that were found.
fn remembers_s(fit: &Fit<'_>) -> f64 {
    let mut base = Base::of(&fit.theta);
    for (effect, values) in fit.model.valued(&fit.theta) {
        let moves_by_itself_s = Some(effect.shortest_s(&values)).filter(|time_s| time_s.is_finite());
        let (delay_s, lag_s) =
            effect.linear(&values).map_or((0.0, moves_by_itself_s.unwrap_or(0.0)), |linear| (linear.delay_s, linear.lag_s));
        base.late += delay_s + lag_s;
        base.lag += lag_s;
    }
    base.memory_s()
}
