//! Friction between coil and spool: what the spool does with the current's force.
//!
//! Everything here is in current-equivalents [A]: force divided by the coil's force per ampere.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::anatomy::STEP_S;
use super::chance::uniform;
use super::memory::Play;

/// One fault of the spool.
#[derive(Debug, Clone)]
pub(super) enum Friction {
    /// Clearance in the armature's pin: the spool stands until the clearance is crossed.
    Clearance { play: Play },
    /// Clearance with a soft seat: two plays and an elastic part.
    SoftClearance { first: Play, second: Play, elastic: f64 },
    /// Stands while the force misses by less than `static_a`, then slips to within `sliding_a`.
    StickSlip { static_a: f64, sliding_a: f64, at_a: f64 },
    /// Mass on a spring with Coulomb friction, Karnopp's zero-velocity interval.
    Karnopp { static_a: f64, sliding_a: f64, natural_rad_s: f64, zeta: f64, at_a: f64, speed_a_s: f64 },
    /// Play whose radius grows with the current's rate.
    RatePlay { radius_a: f64, per_a_s: f64, at_a: f64, last_a: f64, rate_a_s: f64 },
    /// Dahl friction whose level grows with the root of the rate, and which forgets only while moving.
    RateDahl { level_a: f64, per_root: f64, length_a: f64, lost_a: f64, last_a: f64, rate_a_s: f64 },
    /// More plays than the valve was born with.
    Plays { plays: Vec<(f64, Play)> },
    /// Preisach relays over the plane of switching currents.
    Relays { relays: Vec<(f64, f64, bool)>, total_a: f64, last_a: f64, sum: f64 },
}

impl Friction {
    pub(super) fn clearance(half_width_a: f64, start_a: f64) -> Self {
        Self::Clearance { play: Play::new(half_width_a, start_a) }
    }

    pub(super) fn soft_clearance(half_width_a: f64, start_a: f64) -> Self {
        Self::SoftClearance {
            first: Play::new(0.85 * half_width_a, start_a),
            second: Play::new(1.25 * half_width_a, start_a),
            elastic: 0.06,
        }
    }

    pub(super) fn karnopp(static_a: f64, sliding_a: f64, rng: &mut Pcg64, start_a: f64) -> Self {
        let natural_rad_s = std::f64::consts::TAU * uniform(rng, 45.0, 75.0);
        Self::Karnopp { static_a, sliding_a, natural_rad_s, zeta: uniform(rng, 0.6, 0.9), at_a: start_a, speed_a_s: 0.0 }
    }

    /// Plays of seven radii from 6 to 250 mA; together they lose `lost_a` on the major loop.
    pub(super) fn plays(lost_a: f64, rng: &mut Pcg64, start_a: f64) -> Self {
        let ratio = uniform(rng, 1.75, 1.95);
        let radii: Vec<f64> = (0..7).map(|k| 0.006 * ratio.powi(k)).collect();
        let weights: Vec<f64> = radii.iter().map(|r| r.powf(-0.6)).collect();
        let sum: f64 = radii.iter().zip(&weights).map(|(r, w)| r * w).sum();
        Self::Plays { plays: radii.iter().zip(&weights).map(|(r, w)| (w * lost_a / sum, Play::new(*r, start_a))).collect() }
    }

    /// Relays drawn with switching widths of up to 0.35 A, mostly narrow, starting all down.
    pub(super) fn relays(total_a: f64, rng: &mut Pcg64) -> Self {
        let relays: Vec<(f64, f64, bool)> = (0..400)
            .map(|_| {
                let centre = uniform(rng, 0.15, 0.95);
                let half = 0.5 * 0.35 * rng.random::<f64>().powf(1.6);
                (centre + half, centre - half, false)
            })
            .collect();
        Self::Relays { relays, total_a, last_a: f64::NAN, sum: 0.0 }
    }

    /// The current that passes on to the static curve.
    pub(super) fn step(&mut self, input_a: f64) -> f64 {
        match self {
            Self::Clearance { play } => play.step(input_a),
            Self::SoftClearance { first, second, elastic } => {
                *elastic * input_a + (1.0 - *elastic) * 0.5 * (first.step(input_a) + second.step(input_a))
            }
            Self::StickSlip { static_a, sliding_a, at_a } => {
                let miss = input_a - *at_a;
                if miss.abs() > *static_a {
                    *at_a = input_a - sliding_a.copysign(miss);
                }
                *at_a
            }
            Self::Karnopp { static_a, sliding_a, natural_rad_s, zeta, at_a, speed_a_s } => {
                let stiffness = *natural_rad_s * *natural_rad_s;
                // two half steps: the spool's own period is some 15 ms
                for _ in 0..2 {
                    let force = input_a - *at_a;
                    if speed_a_s.abs() < 1e-4 {
                        if force.abs() <= *static_a {
                            *speed_a_s = 0.0;
                            continue;
                        }
                        *speed_a_s = 2e-4_f64.copysign(force);
                    }
                    let before = *speed_a_s;
                    let acceleration = stiffness * (force - sliding_a.copysign(before)) - 2.0 * *zeta * *natural_rad_s * before;
                    *speed_a_s += acceleration * 0.5 * STEP_S;
                    if *speed_a_s * before < 0.0 {
                        *speed_a_s = 0.0;
                    }
                    *at_a += *speed_a_s * 0.5 * STEP_S;
                }
                *at_a
            }
            Self::RatePlay { radius_a, per_a_s, at_a, last_a, rate_a_s } => {
                follow_rate(rate_a_s, last_a, input_a);
                // the clearance is what it is where the spool moves; at rest nothing moves back
                let radius = *radius_a * (1.0 + *per_a_s * rate_a_s.abs());
                if *rate_a_s > 0.0 && input_a - radius > *at_a {
                    *at_a = input_a - radius;
                } else if *rate_a_s < 0.0 && input_a + radius < *at_a {
                    *at_a = input_a + radius;
                }
                *at_a = at_a.clamp(input_a - radius.max(0.05), input_a + radius.max(0.05));
                *at_a
            }
            Self::RateDahl { level_a, per_root, length_a, lost_a, last_a, rate_a_s } => {
                let travel = input_a - *last_a;
                follow_rate(rate_a_s, last_a, input_a);
                let goal = (*level_a * (1.0 + *per_root * rate_a_s.abs().powf(0.7))).copysign(travel);
                *lost_a = goal + (*lost_a - goal) * (-travel.abs() / *length_a).exp();
                input_a - *lost_a
            }
            Self::Plays { plays } => plays.iter_mut().fold(input_a, |sum, (w, play)| sum + *w * (play.step(input_a) - input_a)),
            Self::Relays { relays, total_a, last_a, sum } => {
                if input_a != *last_a {
                    *last_a = input_a;
                    let mut up_count = 0.0;
                    for (on, off, up) in relays.iter_mut() {
                        if input_a >= *on {
                            *up = true;
                        } else if input_a <= *off {
                            *up = false;
                        }
                        up_count += f64::from(u8::from(*up));
                    }
                    // without the part that has no memory, which a calibration takes for the curve
                    *sum = up_count / relays.len() as f64 - ((input_a - 0.15) / 0.8).clamp(0.0, 1.0);
                }
                input_a + *total_a * *sum
            }
        }
    }
}

/// Rate of a current that is commanded in steps: low-passed over two periods.
fn follow_rate(rate_a_s: &mut f64, last_a: &mut f64, input_a: f64) {
    let now = (input_a - *last_a) / STEP_S;
    *last_a = input_a;
    *rate_a_s += (now - *rate_a_s) * STEP_S / 0.015;
}
