//! Behind the spool: volume, orifice, piston, oil with air, and the spool's own swing.
//!
//! Input is the pressure that the spool asks for, output the pressure in the chamber where the sensor sits.

use super::anatomy::STEP_S;

/// One dynamic fault behind the spool.
#[derive(Debug, Clone)]
pub(super) enum Volume {
    /// Compliance behind a laminar restrictor: `tau p' = u - p`.
    Laminar { tau_s: f64, p_bar: f64 },
    /// Compliance behind a sharp orifice: `p' = c sign(d) sqrt|d|`, linear below `small_bar`.
    Orifice { bar_s: f64, small_bar: f64, p_bar: f64 },
    /// Spool and oil column swing: a mass on a spring.
    Swing { natural_rad_s: f64, zeta: f64, quadratic: f64, p_bar: f64, speed: f64 },
    /// Flow that is bounded: pump on the way up, drain on the way down.
    FlowLimit { up_bar_s: f64, down_bar_s: f64, p_bar: f64 },
    /// Bounded by orifices against supply and tank: the more counter-pressure, the slower.
    FlowOrifice { up: f64, down: f64, supply_bar: f64, p_bar: f64 },
    /// Oil with free air: compliance from the bulk modulus of the mixture.
    Air { tau_s: f64, share: f64, exponent: f64, orifice: bool, p_bar: f64 },
    /// Piston that travels against its return spring before the clutch bears.
    Piston { flow: f64, kiss_bar: f64, spring_bar: f64, travel: f64, p_bar: f64 },
    /// Lines and housing that run empty and have to be filled first.
    EmptyLine { flow: f64, fill_bar: f64, drain_s: f64, missing: f64, p_bar: f64 },
    /// Leak past a seal, fed through the spool's resistance: laminar gap.
    LeakGap { share: f64, build_s: f64, drop_bar: f64 },
    /// The same past a sharp edge.
    LeakEdge { factor: f64, build_s: f64, drop_bar: f64 },
    /// Slow after-effect: strain of seals and magnetic after-effect, as shares that follow late.
    Creep { parts: Vec<(f64, f64, f64)> },
}

/// Atmosphere [bar], bulk modulus of the oil without air [bar].
const ATMOSPHERE: f64 = 1.013;
const OIL_BAR: f64 = 14_000.0;

/// Modulus of oil with `share` of free air at atmosphere [bar]: volumes in series, the air by a polytropic law.
fn modulus(share: f64, exponent: f64, gauge_bar: f64) -> f64 {
    let absolute = gauge_bar.max(0.0) + ATMOSPHERE;
    let air = share * (ATMOSPHERE / absolute).powf(1.0 / exponent);
    (1.0 - share + air) / ((1.0 - share) / OIL_BAR + air / (exponent * absolute))
}

impl Volume {
    pub(super) fn step(&mut self, u: f64) -> f64 {
        match self {
            Self::Laminar { tau_s, p_bar } => {
                *p_bar += (u - *p_bar) * STEP_S / *tau_s;
                *p_bar
            }
            Self::Orifice { bar_s, small_bar, p_bar } => {
                *p_bar = fill(*p_bar, u, *bar_s, *small_bar);
                *p_bar
            }
            Self::Swing { natural_rad_s, zeta, quadratic, p_bar, speed } => {
                let w = *natural_rad_s;
                let acceleration = w * w * (u - *p_bar) - (2.0 * *zeta * w + *quadratic * speed.abs()) * *speed;
                *speed += acceleration * STEP_S;
                *p_bar += *speed * STEP_S;
                *p_bar
            }
            Self::FlowLimit { up_bar_s, down_bar_s, p_bar } => {
                let free = (u - *p_bar) / 0.003;
                *p_bar += free.clamp(-*down_bar_s, *up_bar_s) * STEP_S;
                *p_bar
            }
            Self::FlowOrifice { up, down, supply_bar, p_bar } => {
                let most = *up * (*supply_bar - *p_bar).max(0.5).sqrt();
                let least = *down * p_bar.max(0.3).sqrt();
                *p_bar += ((u - *p_bar) / 0.003).clamp(-least, most) * STEP_S;
                *p_bar
            }
            Self::Air { tau_s, share, exponent, orifice, p_bar } => {
                // tau_s belongs to airless oil; the mixture is softer by the ratio of the moduli
                let softer = OIL_BAR / modulus(*share, *exponent, *p_bar);
                let tau = *tau_s * softer;
                *p_bar = if *orifice { fill(*p_bar, u, 1.0 / tau, 0.05) } else { *p_bar + (u - *p_bar) * (1.0 - (-STEP_S / tau).exp()) };
                *p_bar
            }
            Self::Piston { flow, kiss_bar, spring_bar, travel, p_bar } => {
                let inside = *kiss_bar + *spring_bar * *travel;
                let d = u - inside;
                let moves = if d > 0.0 { *travel < 1.0 } else { *travel > 0.0 };
                if moves {
                    // return springs push the oil out somewhat faster than the valve lets it in
                    let rate = if d > 0.0 { *flow } else { 1.3 * *flow };
                    *travel = (*travel + rate * d.signum() * d.abs().sqrt() * STEP_S).clamp(0.0, 1.0);
                    *p_bar += (inside - *p_bar) * STEP_S / 0.006;
                } else {
                    *p_bar += (u - *p_bar) * STEP_S / 0.006;
                }
                *p_bar
            }
            Self::EmptyLine { flow, fill_bar, drain_s, missing, p_bar } => {
                if u < 0.55 * *fill_bar {
                    *missing += (1.0 - *missing) * STEP_S / *drain_s;
                } else if *missing > 0.0 {
                    *missing = (*missing - *flow * (u - *fill_bar * 0.9).max(0.02).sqrt() * STEP_S).max(0.0);
                }
                let goal = if *missing > 1e-3 { u.min(*fill_bar) } else { u };
                *p_bar += (goal - *p_bar) * STEP_S / 0.010;
                *p_bar
            }
            Self::LeakGap { share, build_s, drop_bar } => {
                *drop_bar += (*share * u.max(0.0) - *drop_bar) * STEP_S / *build_s;
                (u - *drop_bar).max(0.0)
            }
            Self::LeakEdge { factor, build_s, drop_bar } => {
                *drop_bar += (*factor * (u - *drop_bar).max(0.0).sqrt() - *drop_bar) * STEP_S / *build_s;
                (u - *drop_bar).max(0.0)
            }
            Self::Creep { parts } => {
                let mut p = u;
                for (share, tau_s, state) in parts.iter_mut() {
                    *state += (u - *state) * STEP_S / *tau_s;
                    p += *share * (*state - u);
                }
                p
            }
        }
    }
}

/// One step of `p' = c sign(u - p) sqrt|u - p|`, laminar within `small`, and never past `u`.
fn fill(p: f64, u: f64, c: f64, small: f64) -> f64 {
    let d = u - p;
    let rate = if d.abs() < small { c * d / small.sqrt() } else { c * d.signum() * d.abs().sqrt() };
    let next = p + rate * STEP_S;
    if (next - u) * d > 0.0 { u } else { next }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_modulus_of_the_mixture_is_that_of_the_tables() {
        // 1 % air, n = 1, 14 000 bar: about 390 bar at 1 bar gauge and 10 600 bar at 20 bar gauge
        assert!((modulus(0.01, 1.0, 1.0) - 390.0).abs() < 40.0, "{}", modulus(0.01, 1.0, 1.0));
        assert!((modulus(0.0, 1.0, 5.0) - OIL_BAR).abs() < 1e-6);
        assert!(modulus(0.01, 1.0, 20.0) > 8_000.0);
    }

    #[test]
    fn a_piston_holds_the_pressure_down_until_it_has_travelled() {
        let mut clutch = Volume::Piston { flow: 0.6, kiss_bar: 2.0, spring_bar: 0.5, travel: 0.0, p_bar: 0.0 };
        let p: Vec<f64> = (0..4000).map(|_| clutch.step(12.0)).collect();
        let bears = p.iter().position(|v| *v > 6.0).map(|k| k as f64 * STEP_S);
        // 1 = 0.6 sqrt(12 - 2.25) t
        assert!((bears.unwrap_or(9.0) - 1.0 / (0.6 * 9.75_f64.sqrt())).abs() < 0.03, "{bears:?}");
        assert!((1.8..2.7).contains(&p[400]));
        assert!((p[3999] - 12.0).abs() < 1e-3);
    }

    #[test]
    fn a_swing_rings_at_its_frequency() {
        let w = std::f64::consts::TAU * 8.0;
        let mut spool = Volume::Swing { natural_rad_s: w, zeta: 0.15, quadratic: 0.0, p_bar: 0.0, speed: 0.0 };
        let p: Vec<f64> = (0..2000).map(|_| spool.step(1.0)).collect();
        let top = p.iter().copied().fold(0.0, f64::max);
        let overshoot = (-std::f64::consts::PI * 0.15 / (1.0_f64 - 0.0225).sqrt()).exp();
        assert!((top - 1.0 - overshoot).abs() < 0.02, "{top}");
    }

    #[test]
    fn an_orifice_fills_in_finite_time_without_overshoot() {
        let mut p = 0.0;
        let mut last = 0.0;
        for _ in 0..2000 {
            p = fill(p, 4.0, 20.0, 0.02);
            assert!(p >= last && p <= 4.0);
            last = p;
        }
        assert!((p - 4.0).abs() < 1e-3);
    }
}
