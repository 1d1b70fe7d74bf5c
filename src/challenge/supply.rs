//! The pump's side: what pressure there is to regulate down from, and the ripple that comes with it.

use rand_pcg::Pcg64;

use super::anatomy::STEP_S;
use super::chance::{normal, uniform};

/// Supply pressure over time, where it limits.
#[derive(Debug, Clone)]
pub(super) enum Supply {
    /// A relief valve set too low: constant, with the droop of its spring as flow is taken.
    Low { bar: f64, droop_s: f64, last_bar: f64 },
    /// A pump that is shared: at times the pressure sags, and comes back.
    Sagging { bar: f64, sag_bar: f64, windows_s: Vec<(f64, f64)>, clock_s: f64, now_bar: f64 },
}

impl Supply {
    pub(super) fn low(bar: f64) -> Self {
        Self::Low { bar, droop_s: 0.004, last_bar: 0.0 }
    }

    /// Sags of 3 to 7 s, about one in 14 s.
    pub(super) fn sagging(bar: f64, sag_bar: f64, rng: &mut Pcg64) -> Self {
        let mut windows_s = Vec::new();
        let mut at = uniform(rng, 3.0, 10.0);
        while at < 400.0 {
            let long = uniform(rng, 3.0, 7.0);
            windows_s.push((at, at + long));
            at += long + uniform(rng, 5.0, 14.0);
        }
        Self::Sagging { bar, sag_bar, windows_s, clock_s: 0.0, now_bar: bar }
    }

    /// What of the wanted pressure the supply can give [bar].
    pub(super) fn step(&mut self, wanted_bar: f64) -> f64 {
        let most = match self {
            Self::Low { bar, droop_s, last_bar } => {
                let filling = ((wanted_bar - *last_bar) / STEP_S).clamp(0.0, 200.0);
                *last_bar = wanted_bar;
                *bar - *droop_s * filling
            }
            Self::Sagging { bar, sag_bar, windows_s, clock_s, now_bar } => {
                *clock_s += STEP_S;
                let sags = windows_s.iter().any(|w| (w.0..w.1).contains(clock_s));
                let goal = if sags { *bar - *sag_bar } else { *bar };
                *now_bar += (goal - *now_bar) * STEP_S / 0.08;
                *now_bar
            }
        };
        // the metering edge opens fully over the last 0.15 bar
        let soft = 0.15;
        let d = wanted_bar - most;
        wanted_bar - 0.5 * (d + (d * d + soft * soft).sqrt())
    }
}

/// Ripple of the pump or an engine order, on top of the regulated pressure.
#[derive(Debug, Clone)]
pub(super) struct Ripple {
    pub(super) hz: f64,
    pub(super) amplitude_bar: f64,
    /// Share of the second harmonic.
    pub(super) second: f64,
    /// Whether it grows with pressure.
    pub(super) with_pressure: bool,
    /// Relative wander of the speed.
    pub(super) wander: f64,
    pub(super) phase: f64,
    pub(super) speed: f64,
    pub(super) rng: Pcg64,
}

impl Ripple {
    pub(super) fn step(&mut self, pressure_bar: f64) -> f64 {
        if self.wander > 0.0 {
            self.speed += -self.speed * STEP_S / 3.0 + self.wander * (2.0 * STEP_S / 3.0).sqrt() * normal(&mut self.rng);
        }
        self.phase += std::f64::consts::TAU * self.hz * (1.0 + self.speed) * STEP_S;
        let size = if self.with_pressure { self.amplitude_bar * (pressure_bar / 18.0).clamp(0.0, 2.0) } else { self.amplitude_bar };
        size * (self.phase.sin() + self.second * (2.0 * self.phase + 0.7).sin())
    }
}
