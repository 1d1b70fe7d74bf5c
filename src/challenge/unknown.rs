//! What no library of effects holds: these must be admitted as unknown, not named.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::specimen::{STEP_S, uniform};

/// A disturbance from outside the valve's own physics, added to the pressure behind the spool.
#[derive(Debug, Clone)]
pub(super) enum Unknown {
    /// A neighbour on the same block answers each larger shift with a pull of its own, some time later.
    Neighbour { bar: f64, after_s: f64, long_s: f64, since_s: f64, reference_bar: f64, ring_hz: f64, clock_s: f64, quiet_s: f64 },
    /// A map over pressure and over the pressure of some seconds ago: hills and valleys.
    Map { bar: f64, across_bar: f64, memory_s: f64, past_bar: f64 },
    /// Two seats between which the spool's sleeve flips, when it will.
    Seats { bar: f64, now: f64, goal: f64, until_s: f64, clock_s: f64, rng: Pcg64 },
}

impl Unknown {
    pub(super) fn draw(variant: u8, severity: f64, rng: &mut Pcg64) -> Self {
        match variant {
            0 => Self::Neighbour {
                bar: 3.2 * severity,
                after_s: uniform(rng, 0.25, 0.6),
                long_s: uniform(rng, 0.7, 1.3),
                since_s: f64::INFINITY,
                reference_bar: 0.0,
                ring_hz: uniform(rng, 1.2, 2.5),
                clock_s: 0.0,
                quiet_s: 0.0,
            },
            1 => Self::Map { bar: 0.9 * severity, across_bar: uniform(rng, 5.0, 8.0), memory_s: uniform(rng, 2.0, 4.0), past_bar: 5.0 },
            _ => {
                let seed = rng.random::<u64>();
                Self::Seats { bar: 1.1 * severity, now: 0.0, goal: 0.0, until_s: 2.0, clock_s: 0.0, rng: super::specimen::stream(seed, 77) }
            }
        }
    }

    pub(super) fn step(&mut self, pressure_bar: f64) -> f64 {
        let tau = std::f64::consts::TAU;
        let push = match self {
            Self::Neighbour { bar, after_s, long_s, since_s, reference_bar, ring_hz, clock_s, quiet_s } => {
                *clock_s += STEP_S;
                *since_s += STEP_S;
                *quiet_s += STEP_S;
                // a shift: 5 bar away from the level of the last half second
                *reference_bar += (pressure_bar - *reference_bar) * STEP_S / 0.5;
                if (pressure_bar - *reference_bar).abs() > 5.0 && *quiet_s > 2.5 {
                    (*since_s, *quiet_s) = (0.0, 0.0);
                }
                let t = *since_s - *after_s;
                if t > 0.0 && t < *long_s { -*bar * (tau * *ring_hz * t).sin() * (1.0 - t / *long_s).sqrt() } else { 0.0 }
            }
            Self::Map { bar, across_bar, memory_s, past_bar } => {
                *past_bar += (pressure_bar - *past_bar) * STEP_S / *memory_s;
                *bar * (tau * pressure_bar / *across_bar).sin() * (tau * *past_bar / (1.6 * *across_bar)).cos()
            }
            Self::Seats { bar, now, goal, until_s, clock_s, rng } => {
                *clock_s += STEP_S;
                if *clock_s > *until_s {
                    *goal = if rng.random::<bool>() { *bar } else { -*bar } * (0.6 + 0.8 * rng.random::<f64>());
                    *until_s = *clock_s + 0.4 - 1.8 * (1.0 - rng.random::<f64>()).ln();
                }
                *now += (*goal - *now) * STEP_S / 0.03;
                *now
            }
        };
        // nothing can be pushed where there is no pressure
        push * (pressure_bar / 2.0).clamp(0.0, 1.0)
    }
}
