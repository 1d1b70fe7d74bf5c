//! What the controller expects to measure: the believed valve, simulated without noise beside the real one.

use crate::physics::{Plant, Stage, resolve};
use crate::valve::{EffectSpec, Valve};

/// The believed valve, driven by the feed-forward alone.
pub struct Expectation {
    /// The whole model.
    valve: Option<Plant>,
    /// What the last call gave: the pressure at the instant whose measurement comes next [bar].
    pressure_bar: Option<f64>,
}

impl Expectation {
    /// The model of `valve`, settled at `current_a`. A model that cannot be simulated expects nothing.
    pub fn new(valve: &Valve, period_s: f64, current_a: f64) -> Self {
        Self { valve: Plant::new(valve, period_s, current_a, None).ok(), pressure_bar: None }
    }

    /// The pressure that the measurement of the last slot should show, if the feed-forward alone had acted; then `current_a` is sent.
    pub fn step(&mut self, current_a: f64) -> Option<f64> {
        let before = self.pressure_bar;
        self.pressure_bar = self.valve.as_mut().map(|v| v.step(current_a));
        before
    }
}

/// The part of a model that a feed-forward can undo: its lag, and how far its pressure is from its curve. Dead time cannot be
/// undone, and what a sensor shows is no pressure.
pub struct Undone {
    plant: Option<Plant>,
    /// Share of the way to a new value that the model's lags leave after one period.
    left: f64,
    /// By how many changes of the target the command must lead it.
    lead: f64,
    /// The static pressures that were asked for, behind the lags.
    lagged_bar: Option<f64>,
    /// How far the model's pressure is from what its curve and its lags alone give [bar].
    off_bar: f64,
    last_target_bar: Option<f64>,
    /// Share of a new difference that is taken over in one period.
    taken: f64,
}

/// Time over which a difference between the model and its curve is taken over [s]: slower than what a lag of the model leaves
/// open, faster than anything that drifts, creeps or warms up.
const TAKEN_S: f64 = 0.05;

impl Undone {
    /// The model of `valve` without its dead time and its sensor, settled at `current_a`; `lag_s` is the sum of its lags.
    ///
    /// The lead makes the pressure of a lag behind held commands meet a ramp of the target at the instants of the samples.
    /// With x = T/tau and phi the share of a period between the arrival of a command and the next sample, a ramp of commands
    /// that changes by D each period gives s - D e^(-phi x) / (1 - e^-x) at the sample, where the target is p + phi D.
    pub fn new(valve: &Valve, lag_s: f64, period_s: f64, current_a: f64) -> Self {
        let felt = |spec: &&EffectSpec| resolve(spec).is_ok_and(|(effect, _)| !matches!(effect.stage(), Stage::Delay | Stage::Sensor));
        let effects = valve.effects.iter().filter(felt).cloned().collect();
        let without = Valve { delay_s: 0.0, delay_range_s: (0.0, 0.0), noise_bar: 0.0, effects, ..valve.clone() };
        let periods = valve.delay_s / period_s;
        // A delay of whole periods up to rounding counts as whole.
        let phi = ((periods - 1e-9).ceil() - periods).max(0.0);
        let (left, lead) = match lag_s > 0.0 {
            true => {
                let left = (-period_s / lag_s).exp();
                (left, phi + (-phi * period_s / lag_s).exp() / (1.0 - left))
            }
            false => (0.0, phi),
        };
        Self {
            plant: Plant::new(&without, period_s, current_a, None).ok(),
            left,
            lead,
            lagged_bar: None,
            off_bar: 0.0,
            last_target_bar: None,
            taken: period_s / (TAKEN_S + period_s),
        }
    }

    /// The static pressure to ask the curve for, so that the model's pressure follows `target_bar`.
    pub fn ask(&mut self, target_bar: f64) -> f64 {
        let before = self.last_target_bar.replace(target_bar).unwrap_or(target_bar);
        target_bar + self.lead * (target_bar - before) - self.off_bar
    }

    /// Notes the current that was sent, and the static pressure `reached_bar` that it stands for.
    pub fn sent(&mut self, current_a: f64, reached_bar: f64) {
        let Some(plant) = &mut self.plant else { return };
        let shown = plant.step(current_a);
        let lagged = self.lagged_bar.get_or_insert(reached_bar);
        // The plant shows the pressure as the command arrives: what the lags had made of all commands before it.
        let expected = if self.left > 0.0 { *lagged } else { reached_bar };
        *lagged = self.left * *lagged + (1.0 - self.left) * reached_bar;
        self.off_bar += self.taken * (shown - expected - self.off_bar);
    }
}
