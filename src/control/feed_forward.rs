//! Feed-forward: the current that the valve model needs for the wanted pressure.

use serde::{Deserialize, Serialize};

use crate::valve::{HysteresisInverse, ReferenceCurves, Valve};

/// Which model the feed-forward inverts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FeedForwardModel {
    /// The model with its hysteresis: the hyperbola, Eq. (11), or the free loop of the valve file.
    #[default]
    Hyperbolic,
    /// The mean of the two curves, Eq. (10): what production controllers use.
    Average,
    /// The hyperbolic model, and everything else that the valve file knows and a feed-forward can undo: lag, gain and zero, heating,
    /// leakage, creep, drift. What is left out: dead time, chance, the sensor.
    Model,
}

/// The inverse model with its memory.
#[derive(Debug, Clone)]
pub struct FeedForward {
    curves: ReferenceCurves,
    /// `None` for the average model, which has no memory.
    inverse: Option<HysteresisInverse>,
    limits_a: (f64, f64),
}

impl FeedForward {
    /// The inverse of `model`, its memory at `current_a` and the pressure that the average curve gives there.
    pub fn new(model: FeedForwardModel, valve: &Valve, current_a: f64) -> Self {
        let inverse = match model {
            FeedForwardModel::Hyperbolic | FeedForwardModel::Model => valve.hysteresis.inverse(&valve.curves, current_a),
            FeedForwardModel::Average => None,
        };
        Self { curves: valve.curves.clone(), inverse, limits_a: valve.current_limits_a }
    }

    /// Moves the memory along with a current that somebody else commands.
    pub fn follow(&mut self, current_a: f64) {
        if let Some(inverse) = &mut self.inverse {
            inverse.follow(&self.curves, current_a);
        }
    }

    /// The current for `target_bar`, within `range_a` [A]. The memory moves along with the current that is given, whether that reaches
    /// the pressure or not.
    pub fn current_for(&mut self, target_bar: f64, range_a: (f64, f64)) -> f64 {
        let (low, high) = range_a;
        let Some(inverse) = &mut self.inverse else {
            return self.curves.average_current(target_bar).clamp(low, high);
        };
        let before = inverse.clone();
        let wanted = inverse.current_for(&self.curves, target_bar);
        let given = wanted.clamp(low, high);
        if given != wanted {
            // The pressure was not reached: the memory follows the current that the valve really gets.
            *inverse = before;
            inverse.follow(&self.curves, given);
        }
        given
    }

    /// The static pressure at which the memory stands; `current_a` is the current that was given last [bar].
    pub fn pressure_bar(&self, current_a: f64) -> f64 {
        self.inverse.as_ref().map_or_else(|| self.curves.average_at(current_a), HysteresisInverse::pressure_bar)
    }

    /// Slope of the average curve where it has `pressure_bar` [bar/A].
    pub fn slope_bar_per_a(&self, pressure_bar: f64) -> f64 {
        let current_a = self.curves.average_current(pressure_bar).clamp(self.limits_a.0, self.limits_a.1);
        (0.5 * (self.curves.ascending.slope(current_a) + self.curves.descending.slope(current_a))).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::controller::tests::valve;
    use crate::valve::{HyperbolaState, Hysteresis};

    #[test]
    fn the_inverse_reaches_the_wanted_pressure() {
        let valve = valve();
        let Hysteresis::Hyperbolic { a_bar2 } = valve.hysteresis else { unreachable!() };
        let mut forward = HyperbolaState::start(a_bar2, 0.3, valve.curves.average_at(0.3));
        let mut feed_forward = FeedForward::new(FeedForwardModel::Hyperbolic, &valve, 0.3);
        for k in 0..500 {
            let target = 15.0 + 10.0 * (k as f64 * 0.05).sin();
            let pressure = forward.advance(&valve.curves, feed_forward.current_for(target, valve.current_limits_a));
            assert!((pressure - target).abs() < 1e-7, "{k}: {pressure} against {target}");
        }
    }

    #[test]
    fn the_current_stays_within_its_limits() {
        let valve = valve();
        for model in [FeedForwardModel::Hyperbolic, FeedForwardModel::Average] {
            let mut feed_forward = FeedForward::new(model, &valve, 0.3);
            assert_eq!(feed_forward.current_for(1000.0, valve.current_limits_a), valve.current_limits_a.1);
            assert_eq!(feed_forward.current_for(-1000.0, valve.current_limits_a), valve.current_limits_a.0);
            // And it recovers from there.
            let current = feed_forward.current_for(15.0, valve.current_limits_a);
            assert!((valve.curves.average_current(15.0) - current).abs() < 0.05, "{current}");
        }
    }
}
