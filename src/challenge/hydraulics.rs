//! A valve of differential equations: spool with friction between spring, magnet and feedback face, two metering
//! edges, chamber, line, piston of the clutch.
//!
//! Forces stand as pressure on the feedback face [bar], the spool's travel in widths of a metering edge, volumes in
//! units of the chamber's. Source of the equations: H. E. Merritt, Hydraulic Control Systems (1967), chapters 3, 5 and
//! 9; friction by bristles after C. Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995) 419.

use rand_pcg::Pcg64;

use super::anatomy::STEP_S;
use super::chance::uniform;

/// Fine steps within a step of the plant: the spool swings at some 100 Hz, the chamber settles in milliseconds.
const FINE: u32 = 5;

/// Parameters and state.
#[derive(Debug, Clone)]
pub(super) struct Hydraulics {
    /// Share of the magnet's force that comes late, by eddy currents, and how late [s].
    pub(super) eddy_share: f64,
    pub(super) eddy_s: f64,
    /// Swing of the spool on its spring [rad/s], and the spring over one travel [bar].
    spool_rad_s: f64,
    spring_bar: f64,
    /// Friction [bar]: sliding, at rest, and per speed [bar s/travel].
    pub(super) sliding_bar: f64,
    pub(super) resting_bar: f64,
    pub(super) viscous_bar_s: f64,
    /// Travel on which nothing opens, of either edge.
    overlap: f64,
    /// Flow gain of the edges [chamber volumes/s per root bar].
    pub(super) feed: f64,
    pub(super) drain: f64,
    pub(super) supply_bar: f64,
    /// Leak from chamber to tank [1/s per bar] and [1/s per root bar].
    pub(super) leak_laminar: f64,
    pub(super) leak_orifice: f64,
    /// Stiffness of the chamber [bar per volume], and the share of air at atmosphere in the oil.
    stiffness_bar: f64,
    pub(super) air: f64,
    /// Line: inertia [bar s], laminar and turbulent resistance [bar s], [bar s^2].
    pub(super) inertia: f64,
    pub(super) resistance: f64,
    pub(super) turbulent: f64,
    /// Piston: pressure at which it begins to travel, spring over the travel [bar], volume of the travel.
    kiss_bar: f64,
    piston_spring_bar: f64,
    pub(super) piston_volume: f64,
    /// Compliance of the clutch behind the piston, relative to the chamber's.
    clutch: f64,
    late_bar: f64,
    at: f64,
    speed: f64,
    bristle: f64,
    face_bar: f64,
    chamber_bar: f64,
    flow: f64,
    clutch_bar: f64,
    travel: f64,
}

impl Hydraulics {
    /// A healthy one.
    pub(super) fn draw(rng: &mut Pcg64) -> Self {
        let sliding_bar = uniform(rng, 0.12, 0.3);
        Self {
            eddy_share: uniform(rng, 0.15, 0.4),
            eddy_s: uniform(rng, 0.006, 0.015),
            spool_rad_s: std::f64::consts::TAU * uniform(rng, 100.0, 150.0),
            spring_bar: uniform(rng, 2.0, 3.0),
            sliding_bar,
            resting_bar: sliding_bar * uniform(rng, 1.0, 1.2),
            viscous_bar_s: uniform(rng, 0.005, 0.008),
            overlap: uniform(rng, 0.0, 0.05),
            feed: uniform(rng, 0.010, 0.018),
            drain: uniform(rng, 0.014, 0.025),
            supply_bar: uniform(rng, 45.0, 60.0),
            leak_laminar: 2e-5,
            leak_orifice: 0.0,
            stiffness_bar: uniform(rng, 9000.0, 13_000.0),
            air: uniform(rng, 0.0005, 0.002),
            inertia: uniform(rng, 1.5e-1, 4e-1),
            resistance: uniform(rng, 40.0, 80.0),
            turbulent: uniform(rng, 100.0, 300.0),
            kiss_bar: uniform(rng, 0.8, 1.2),
            piston_spring_bar: uniform(rng, 0.4, 0.8),
            piston_volume: uniform(rng, 0.0005, 0.0015),
            clutch: uniform(rng, 2.0, 4.0),
            late_bar: 0.0,
            at: 0.0,
            speed: 0.0,
            bristle: 0.0,
            face_bar: 0.0,
            chamber_bar: 0.0,
            flow: 0.0,
            clutch_bar: 0.0,
            travel: 0.0,
        }
    }

    /// Stiffness of oil with its free air at a pressure, relative to oil alone.
    fn modulus(&self, bar: f64) -> f64 {
        let absolute = bar.max(0.0) + 1.013;
        let air = self.air * (1.013 / absolute).powf(1.0 / 1.3);
        1.0 / (1.0 + 14_000.0 * air / (1.3 * absolute))
    }

    /// One step of the plant: the magnet asks for `asked_bar`, the answer is the pressure at the clutch, where the transmitter sits.
    pub(super) fn step(&mut self, asked_bar: f64) -> f64 {
        let h = STEP_S / f64::from(FINE);
        for _ in 0..FINE {
            self.late_bar += (asked_bar - self.late_bar) * h / self.eddy_s;
            let magnet = (1.0 - self.eddy_share) * asked_bar + self.eddy_share * self.late_bar;
            self.move_spool(magnet, h);
            self.fill(h);
        }
        self.clutch_bar
    }

    fn move_spool(&mut self, magnet_bar: f64, h: f64) {
        // behind its damping orifice, the feedback face follows the chamber
        self.face_bar += (self.chamber_bar - self.face_bar) * h / 0.001;
        // bristles of a hundredth of a travel, whose level falls with the speed (Stribeck)
        let level = self.sliding_bar + (self.resting_bar - self.sliding_bar) * (-(self.speed / 0.5).powi(2)).exp();
        let stiffness = self.sliding_bar / 0.01;
        self.bristle += self.speed * h;
        self.bristle = self.bristle.clamp(-level / stiffness, level / stiffness);
        let friction = stiffness * self.bristle;
        let w2 = self.spool_rad_s * self.spool_rad_s;
        let force = magnet_bar - self.face_bar - self.spring_bar * self.at - friction;
        // the damper implicitly: it is what would limit the step
        let mass = self.spring_bar / w2;
        self.speed = (self.speed + h * force / mass) / (1.0 + h * self.viscous_bar_s / mass);
        self.at += self.speed * h;
        if self.at.abs() > 1.0 {
            self.at = self.at.clamp(-1.0, 1.0);
            self.speed = 0.0;
        }
    }

    fn fill(&mut self, h: f64) {
        let opened = |d: f64| 0.5 * (d + (d * d + 1e-4).sqrt());
        let root = |d: f64| d / (d * d + 0.05).sqrt().sqrt();
        let (feed, drain) = (self.feed * opened(self.at - self.overlap), self.drain * opened(-self.at - self.overlap));
        let p = self.chamber_bar;
        let inflow = feed * root(self.supply_bar - p) - drain * root(p) - self.leak_laminar * p - self.leak_orifice * root(p);
        // how the flow falls with the pressure, for a step that cannot overshoot
        let falls = feed / (self.supply_bar - p).abs().max(0.2).sqrt() + drain / p.abs().max(0.2).sqrt() + self.leak_laminar;
        let stiff = self.stiffness_bar * self.modulus(p);
        self.chamber_bar += h * stiff * (inflow - self.flow) / (1.0 + h * stiff * falls);
        let loss = self.resistance + self.turbulent * self.flow.abs();
        self.flow = (self.flow + h * (self.chamber_bar - self.clutch_bar) / self.inertia) / (1.0 + h * loss / self.inertia);
        self.bear(h);
    }

    /// The piston travels between the first touch and the full spring; then the pack bears.
    fn bear(&mut self, h: f64) {
        let volume = self.flow * h;
        let (empty, full) = (self.kiss_bar, self.kiss_bar + self.piston_spring_bar);
        let stiff = self.stiffness_bar * self.modulus(self.clutch_bar) / self.clutch;
        let soft = self.piston_spring_bar / self.piston_volume;
        let moves = self.clutch_bar > empty && self.clutch_bar < full;
        let k = if moves { stiff * soft / (stiff + soft) } else { stiff };
        let next = self.clutch_bar + k * volume;
        self.travel = ((next - empty) / (full - empty)).clamp(0.0, 1.0);
        self.clutch_bar = next.max(-0.9);
    }
}

#[cfg(test)]
mod tests {
    use super::super::chance::stream;
    use super::*;

    #[test]
    fn the_pressure_settles_where_the_magnet_asks_for_it_within_friction_and_spring() {
        for seed in 0..30 {
            let mut valve = Hydraulics::draw(&mut stream(seed, 5));
            for asked in [5.0, 20.0, 30.0, 12.0, 2.5, 0.0] {
                let p = (0..2000).map(|_| valve.step(asked)).last().unwrap_or_default();
                let last: Vec<f64> = (0..400).map(|_| valve.step(asked)).collect();
                let swing = last.iter().fold(0.0_f64, |m, q| m.max((q - p).abs()));
                assert!((p - asked).abs() < 1.2 && swing < 0.15, "seed {seed}: asked {asked}, got {p}, swings {swing}");
            }
        }
    }
}
