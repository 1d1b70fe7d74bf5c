//! What no library of effects holds: these must be admitted as unknown, not named.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::anatomy::STEP_S;
use super::chance::{normal, uniform};

/// A disturbance from outside the valve's own physics, added to the pressure behind the spool.
#[derive(Debug, Clone)]
pub(super) enum Unknown {
    /// A neighbour on the same block answers each larger shift with a pull of its own, some time later.
    Neighbour { bar: f64, after_s: f64, long_s: f64, since_s: f64, reference_bar: f64, ring_hz: f64, clock_s: f64, quiet_s: f64 },
    /// A map over pressure and over the pressure of some seconds ago: hills and valleys.
    Map { bar: f64, across_bar: f64, memory_s: f64, past_bar: f64 },
    /// Two seats between which the spool's sleeve flips, when it will.
    Seats { bar: f64, now: f64, goal: f64, until_s: f64, clock_s: f64, rng: Pcg64 },
    /// Knocks from outside that ring out, at times of their own.
    Knocks { bar: f64, hz: f64, since_s: f64, until_s: f64, sign: f64, rng: Pcg64 },
    /// A seat that changes sides at every second turn of the pressure's course.
    Toggle { bar: f64, side: f64, now: f64, turns: u32, turned_bar: f64, rising: bool },
    /// A mean that moves with how lively the pressure has been.
    Rectifier { bar: f64, slow_bar: f64, lively: f64 },
    /// A bypass that opens late above a pressure and closes late below another.
    Bypass { bar: f64, opens_bar: f64, closes_bar: f64, late_s: f64, waited_s: f64, open: bool, now: f64 },
    /// An echo of the pressure from the end of a long line.
    Echo { share: f64, past: std::collections::VecDeque<f64>, slow_bar: f64 },
    /// A gain that wanders by chance within seconds.
    Wander { share: f64, now: f64, slow: f64, rng: Pcg64 },
    /// A squeal within one band of pressure only.
    Squeal { bar: f64, from_bar: f64, to_bar: f64, hz: f64, phase: f64, size: f64 },
    /// A rebound after every quick fall.
    Rebound { bar: f64, slow_bar: f64, state: f64, speed: f64, hz: f64 },
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
            3 => Self::Knocks {
                bar: 2.2 * severity,
                hz: uniform(rng, 2.0, 6.0),
                since_s: f64::INFINITY,
                until_s: 1.0,
                sign: 1.0,
                rng: super::chance::stream(rng.random::<u64>(), 78),
            },
            4 => Self::Toggle { bar: 0.8 * severity, side: 1.0, now: 0.0, turns: 0, turned_bar: 0.0, rising: true },
            5 => Self::Rectifier { bar: 0.45 * severity, slow_bar: 5.0, lively: 0.0 },
            6 => Self::Bypass {
                bar: 1.6 * severity,
                opens_bar: uniform(rng, 14.0, 20.0),
                closes_bar: uniform(rng, 6.0, 10.0),
                late_s: uniform(rng, 0.4, 1.2),
                waited_s: 0.0,
                open: false,
                now: 0.0,
            },
            7 => {
                let steps = (uniform(rng, 0.35, 0.9) / STEP_S) as usize;
                Self::Echo { share: 0.3 * severity, past: std::iter::repeat_n(0.0, steps).collect(), slow_bar: 5.0 }
            }
            8 => Self::Wander { share: 0.05 * severity, now: 0.0, slow: 0.0, rng: super::chance::stream(rng.random::<u64>(), 79) },
            9 => {
                let from_bar = uniform(rng, 8.0, 16.0);
                let to_bar = from_bar + uniform(rng, 4.0, 8.0);
                Self::Squeal { bar: 0.9 * severity, from_bar, to_bar, hz: uniform(rng, 3.0, 8.0), phase: 0.0, size: 0.0 }
            }
            10 => Self::Rebound { bar: 1.5 * severity, slow_bar: 5.0, state: 0.0, speed: 0.0, hz: uniform(rng, 0.5, 1.2) },
            _ => {
                let seed = rng.random::<u64>();
                Self::Seats { bar: 1.1 * severity, now: 0.0, goal: 0.0, until_s: 2.0, clock_s: 0.0, rng: super::chance::stream(seed, 77) }
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
            Self::Knocks { bar, hz, since_s, until_s, sign, rng } => {
                *since_s += STEP_S;
                *until_s -= STEP_S;
                if *until_s < 0.0 {
                    *until_s = 0.8 - 2.5 * (1.0 - rng.random::<f64>()).ln();
                    *since_s = 0.0;
                    *sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
                }
                if *since_s < 3.0 { *sign * *bar * (-*since_s / 0.25).exp() * (tau * *hz * *since_s).sin() } else { 0.0 }
            }
            Self::Toggle { bar, side, now, turns, turned_bar, rising } => {
                // a turn: 1.5 bar back from the last extreme
                let ahead = if *rising { pressure_bar > *turned_bar } else { pressure_bar < *turned_bar };
                if ahead {
                    *turned_bar = pressure_bar;
                } else if (pressure_bar - *turned_bar).abs() > 1.5 {
                    (*rising, *turned_bar, *turns) = (!*rising, pressure_bar, *turns + 1);
                    if *turns % 2 == 0 {
                        *side = -*side;
                    }
                }
                *now += (*side * *bar - *now) * STEP_S / 0.05;
                *now
            }
            Self::Rectifier { bar, slow_bar, lively } => {
                *slow_bar += (pressure_bar - *slow_bar) * STEP_S / 0.4;
                *lively += ((pressure_bar - *slow_bar).abs() - *lively) * STEP_S / 2.5;
                *bar * *lively
            }
            Self::Bypass { bar, opens_bar, closes_bar, late_s, waited_s, open, now } => {
                let asks = if *open { pressure_bar < *closes_bar } else { pressure_bar > *opens_bar };
                *waited_s = if asks { *waited_s + STEP_S } else { 0.0 };
                if *waited_s > *late_s {
                    (*open, *waited_s) = (!*open, 0.0);
                }
                let goal = if *open { -*bar } else { 0.0 };
                *now += (goal - *now) * STEP_S / 0.1;
                *now
            }
            Self::Echo { share, past, slow_bar } => {
                *slow_bar += (pressure_bar - *slow_bar) * STEP_S / 1.5;
                past.push_front(pressure_bar - *slow_bar);
                -*share * past.pop_back().unwrap_or_default()
            }
            Self::Wander { share, now, slow, rng } => {
                *slow += -*slow * STEP_S / 1.2 + (2.0 * STEP_S / 1.2_f64).sqrt() * normal(rng);
                *now += (*slow - *now) * STEP_S / 0.2;
                *share * *now * pressure_bar
            }
            Self::Squeal { bar, from_bar, to_bar, hz, phase, size } => {
                let inside = pressure_bar > *from_bar && pressure_bar < *to_bar;
                *size += (if inside { *bar } else { 0.0 } - *size) * STEP_S / 0.15;
                *phase += tau * *hz * STEP_S * (1.0 + 0.02 * (pressure_bar - *from_bar));
                *size * phase.sin()
            }
            Self::Rebound { bar, slow_bar, state, speed, hz } => {
                *slow_bar += (pressure_bar - *slow_bar) * STEP_S / 0.1;
                let kick = if *slow_bar - pressure_bar > 0.8 { *bar } else { 0.0 };
                let w = tau * *hz;
                *speed += (w * w * (kick - *state) - 1.2 * w * *speed) * STEP_S;
                *state += *speed * STEP_S;
                *state
            }
        };
        // nothing can be pushed where there is no pressure
        push * (pressure_bar / 2.0).clamp(0.0, 1.0)
    }
}
