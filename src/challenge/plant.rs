//! The whole way from a command to a sample, put together for one specimen and what is concealed in it.

use rand_pcg::Pcg64;

use super::anatomy::{Anatomy, STEP_S};
use super::case::Concealed;
use super::chamber::Volume;
use super::chance::{stream, uniform};
use super::driver::{Coil, DeadTime, Heating, Jitter};
use super::hydraulics::Hydraulics;
use super::memory::Memory;
use super::sensor::{Sensor, SensorFault};
use super::specimen::Specimen;
use super::spool::Friction;
use super::supply::{Ripple, Supply};
use super::unknown::Unknown;

/// How the static curve has changed since it was calibrated.
#[derive(Debug, Clone)]
enum Change {
    /// Gain and zero, at once and for good.
    Scale { gain: f64, offset_bar: f64 },
    /// The spring's seat has set: more or less current for the same pressure.
    Preload { offset_a: f64 },
    /// At constant speed over the run.
    Linear { gain_s: f64, offset_bar_s: f64 },
    /// Towards an end value.
    Saturating { gain: f64, offset_bar: f64, tau_s: f64 },
}

/// A running plant.
pub(super) struct Plant {
    specimen: Specimen,
    jitter: Option<Jitter>,
    line: DeadTime,
    extra_s: f64,
    coil: Coil,
    frictions: Vec<Friction>,
    memory: Memory,
    changes: Vec<Change>,
    supply: Option<Supply>,
    volumes: Vec<Volume>,
    hydraulics: Option<Hydraulics>,
    chamber_bar: f64,
    settled_bar: f64,
    ripple: Option<Ripple>,
    unknown: Option<Unknown>,
    late: Option<(DeadTime, f64)>,
    sensor: Sensor,
    time_s: f64,
    period_s: f64,
    /// Parameters that mean the same in a library of effects: id, name, value.
    planted: Vec<(&'static str, &'static str, f64)>,
}

impl Plant {
    /// At rest at `start_a`, reached from below. `run` tells the recordings of one valve apart: noise and chance
    /// differ, the valve does not.
    pub(super) fn new(specimen: &Specimen, concealed: &[Concealed], seed: u64, run: u64, start_a: f64, period_s: f64) -> Self {
        let from = 0.1_f64.min(start_a);
        let chance = |purpose| stream(seed, 1000 * (run + 1) + purpose);
        let mut plant = Self {
            specimen: specimen.clone(),
            jitter: None,
            line: DeadTime::new(from),
            extra_s: 0.0,
            coil: Coil::new(specimen.coil_lag_s, from),
            frictions: Vec::new(),
            memory: Memory::new(specimen, from),
            changes: Vec::new(),
            supply: None,
            volumes: Vec::new(),
            hydraulics: (specimen.anatomy == Anatomy::Equations).then(|| Hydraulics::draw(&mut stream(seed, 4))),
            chamber_bar: 0.0,
            settled_bar: 0.0,
            ripple: None,
            unknown: None,
            late: None,
            sensor: Sensor::new(specimen, period_s, chance(1), chance(2)),
            time_s: 0.0,
            period_s,
            planted: Vec::new(),
        };
        // the same sizes in every recording of this valve
        for (k, what) in concealed.iter().enumerate() {
            let rng = &mut stream(seed, 100 + k as u64);
            if !plant.conceal_in_equations(what, rng) {
                plant.conceal(what, rng, &mut chance(3), from);
            }
        }
        plant.settle(from, start_a);
        plant
    }

    /// One second up to the start, half a second at rest; then slow states take the level for granted, clocks start.
    fn settle(&mut self, from: f64, start_a: f64) {
        let heating = self.coil.heating.take();
        for k in 0..3000 {
            self.step(from + (start_a - from) * (f64::from(k) / 2000.0).min(1.0), k % 20 == 0);
        }
        self.coil.heating = heating;
        for volume in &mut self.volumes {
            if let Volume::Creep { parts } = volume {
                for part in parts {
                    part.2 = self.settled_bar;
                }
            }
        }
        self.time_s = 0.0;
    }

    /// What the equations hold as a parameter of theirs; `false`: nothing, the block is to be put in.
    fn conceal_in_equations(&mut self, what: &Concealed, rng: &mut Pcg64) -> bool {
        let Some(valve) = &mut self.hydraulics else { return false };
        let (s, first) = (what.severity, what.variant == 0);
        let mut u = |low: f64, high: f64| uniform(rng, low, high);
        match what.id {
            "first_order_lag" if first => valve.resistance += s * u(80.0, 130.0),
            "first_order_lag" => valve.turbulent += s * u(2e3, 4e3),
            "second_order_resonance" => {
                valve.inertia += s * u(1.2, 2.2);
                valve.resistance *= 1.0 - 0.6 * s.min(1.0);
                if !first {
                    valve.turbulent += 600.0;
                }
            }
            "flow_limit" => {
                let left = 1.0 / (1.0 + s * u(5.0, 8.0));
                (valve.feed, valve.drain) = (valve.feed * left, valve.drain * left * if first { 1.0 } else { 1.4 });
            }
            "stiction" => {
                valve.resting_bar += s * u(0.5, 0.8);
                if !first {
                    valve.sliding_bar += s * u(0.1, 0.2);
                }
            }
            "fill_phase" => valve.piston_volume += s * u(0.006, 0.012),
            "leakage" if first => valve.leak_laminar += s * u(2e-3, 3e-3),
            "leakage" => valve.leak_orifice += s * u(0.008, 0.014),
            "rate_dependent_hysteresis" if first => valve.viscous_bar_s += s * u(0.03, 0.05),
            "rate_dependent_hysteresis" => {
                valve.eddy_share = (valve.eddy_share + 0.3).min(0.8);
                valve.eddy_s += s * u(0.03, 0.05);
            }
            "air_entrainment" => valve.air += s * u(0.02, 0.04),
            _ => return false,
        }
        true
    }

    fn conceal(&mut self, what: &Concealed, rng: &mut Pcg64, chance: &mut Pcg64, start_a: f64) {
        let s = what.severity;
        let first = what.variant == 0;
        let sign = if rand::RngExt::random::<bool>(rng) { 1.0 } else { -1.0 };
        let mut u = |low: f64, high: f64| uniform(rng, low, high);
        let p_bar = 0.0;
        match what.id {
            "transport_delay" => {
                let extra_s = s * u(0.020, 0.030);
                self.planted.push(("transport_delay", "extra", extra_s));
                if first { self.extra_s = extra_s } else { self.late = Some((DeadTime::new(0.0), extra_s)) }
            }
            "delay_jitter" if first => self.jitter = Some(Jitter::message(s * u(0.06, 0.09), chance.clone(), start_a)),
            "delay_jitter" => self.jitter = Some(Jitter::load(s * u(0.06, 0.09), chance.clone(), start_a)),
            "first_order_lag" if first => {
                let tau_s = s * u(0.035, 0.055);
                self.planted.push(("first_order_lag", "tau", tau_s));
                self.volumes.push(Volume::Laminar { tau_s, p_bar });
            }
            "first_order_lag" => self.volumes.push(Volume::Orifice { bar_s: u(22.0, 32.0) / s, small_bar: 0.03, p_bar }),
            "second_order_resonance" => {
                let natural_rad_s = std::f64::consts::TAU * u(4.5, 7.0) / s.powf(0.7);
                let (zeta, quadratic) = if first { (u(0.12, 0.3), 0.0) } else { (u(0.08, 0.15), u(0.25, 0.5)) };
                if first {
                    self.planted.push(("second_order_resonance", "frequency", natural_rad_s / std::f64::consts::TAU));
                    self.planted.push(("second_order_resonance", "damping", zeta));
                }
                self.volumes.push(Volume::Swing { natural_rad_s, zeta, quadratic, p_bar, speed: 0.0 });
            }
            "flow_limit" if first => {
                let up_bar_s = u(24.0, 36.0) / s;
                let down_bar_s = up_bar_s * u(1.2, 1.7);
                self.planted.push(("flow_limit", "rise", up_bar_s));
                self.planted.push(("flow_limit", "fall", down_bar_s));
                self.volumes.push(Volume::FlowLimit { up_bar_s, down_bar_s, p_bar });
            }
            "flow_limit" => {
                self.volumes.push(Volume::FlowOrifice { up: u(5.5, 8.0) / s, down: u(8.0, 11.5) / s, supply_bar: u(38.0, 45.0), p_bar })
            }
            "reversal_dead_band" if first => {
                let half_a = s * u(0.009, 0.012);
                self.planted.push(("reversal_dead_band", "width", 2.0 * half_a));
                self.frictions.push(Friction::clearance(half_a, start_a));
            }
            "reversal_dead_band" => self.frictions.push(Friction::soft_clearance(s * u(0.009, 0.012), start_a)),
            "stiction" if first => {
                let (static_a, sliding_a) = (s * u(0.013, 0.018), s * u(0.002, 0.006));
                self.frictions.push(Friction::StickSlip { static_a, sliding_a, at_a: start_a });
            }
            "stiction" => {
                let (static_a, sliding_a) = (s * u(0.014, 0.019), s * u(0.005, 0.008));
                self.frictions.push(Friction::karnopp(static_a, sliding_a, rng, start_a));
            }
            "fill_phase" if first => self.volumes.push(Volume::Piston {
                flow: u(1.0, 1.5) / s,
                kiss_bar: u(1.7, 2.5),
                spring_bar: u(0.4, 1.0),
                travel: 0.0,
                p_bar,
            }),
            "fill_phase" => self.volumes.push(Volume::EmptyLine {
                flow: u(0.9, 1.4) / s,
                fill_bar: u(1.8, 3.0),
                drain_s: u(0.15, 0.35),
                missing: 1.0,
                p_bar,
            }),
            "supply_saturation" if first => {
                // below what the drives ask for, or nothing would show
                let asked = self.specimen.curve.pressure(0.8);
                self.supply = Some(Supply::low(asked - 2.0 - 5.5 * s + u(-0.6, 0.6)));
            }
            "supply_saturation" => {
                let sagged = 26.0 - 5.5 * s + u(-0.8, 0.8);
                self.supply = Some(Supply::sagging(60.0, 60.0 - sagged, chance));
            }
            "reference_drift" if first => self
                .changes
                .push(Change::Linear { gain_s: sign * s * u(0.055, 0.085) / 120.0, offset_bar_s: sign * s * u(0.1, 0.3) / 120.0 }),
            "reference_drift" => self.changes.push(Change::Saturating {
                gain: sign * s * u(0.055, 0.085),
                offset_bar: sign * s * u(0.1, 0.3),
                tau_s: u(35.0, 60.0),
            }),
            "reference_shift" if first => {
                self.changes.push(Change::Scale { gain: sign * s * u(0.02, 0.03), offset_bar: sign * s * u(0.2, 0.4) });
            }
            "reference_shift" => self.changes.push(Change::Preload { offset_a: sign * s * u(0.010, 0.014) }),
            "leakage" if first => {
                self.volumes.insert(0, Volume::LeakGap { share: s * u(0.06, 0.09), build_s: u(0.15, 0.35), drop_bar: 0.0 });
            }
            "leakage" => self.volumes.insert(0, Volume::LeakEdge { factor: s * u(0.35, 0.5), build_s: u(0.1, 0.25), drop_bar: 0.0 }),
            "rate_dependent_hysteresis" if first => {
                let (radius_a, per_a_s) = (s * u(0.004, 0.005), u(2.5, 4.0));
                self.frictions.push(Friction::RatePlay { radius_a, per_a_s, at_a: start_a, last_a: start_a, rate_a_s: 0.0 });
            }
            "rate_dependent_hysteresis" => self.frictions.push(Friction::RateDahl {
                level_a: s * u(0.004, 0.0055),
                per_root: u(2.5, 3.5),
                length_a: u(0.012, 0.02),
                lost_a: 0.0,
                last_a: start_a,
                rate_a_s: 0.0,
            }),
            "creep" if first => {
                let sum = s * u(0.06, 0.085);
                self.volumes
                    .push(Volume::Creep { parts: [(0.4, 0.8), (0.33, 6.0), (0.27, 40.0)].map(|(w, tau)| (w * sum, tau, 0.0)).to_vec() });
            }
            "creep" => self.volumes.push(Volume::Creep { parts: vec![(s * u(0.05, 0.07), u(3.0, 9.0), 0.0)] }),
            "air_entrainment" => {
                let (tau_s, share) = (u(0.0015, 0.0025), s * u(0.025, 0.04));
                self.volumes.push(Volume::Air { tau_s, share, exponent: if first { 1.3 } else { 1.0 }, orifice: !first, p_bar });
            }
            "coil_heating" => {
                let nodes = if first {
                    vec![(s * u(2.8, 4.2), u(18.0, 35.0))]
                } else {
                    vec![(s * u(2.2, 3.0), u(6.0, 10.0)), (s * u(2.5, 4.0), u(60.0, 100.0))]
                };
                let excess_k = vec![0.0; nodes.len()];
                self.coil.heating = Some(Heating { nodes, compensated: if first { 0.0 } else { 0.3 }, excess_k });
            }
            "nonlocal_memory" if first => {
                let lost = s * u(0.016, 0.022);
                self.frictions.push(Friction::plays(lost, rng, start_a));
            }
            "nonlocal_memory" => {
                let total = s * u(0.19, 0.26);
                self.frictions.push(Friction::relays(total, rng));
            }
            "sensor_lag" => {
                let tau_s = s * u(0.035, 0.055);
                if first {
                    self.planted.push(("sensor_lag", "tau", tau_s));
                }
                let fault = if first {
                    SensorFault::Lag { stages: vec![0.0], tau_s }
                } else {
                    SensorFault::Lag { stages: vec![0.0; 2], tau_s: 0.5 * tau_s }
                };
                self.sensor.faults.insert(0, fault);
            }
            "sensor_quantization" if first => {
                let lsb_bar = s * u(0.45, 0.6);
                self.planted.push(("sensor_quantization", "step", lsb_bar));
                self.sensor.faults.push(SensorFault::Round { lsb_bar });
            }
            "sensor_quantization" => self.sensor.faults.push(SensorFault::Truncate { lsb_bar: s * u(0.4, 0.55), uneven: 0.4 }),
            "sensor_drift" if first => self.sensor.faults.insert(0, SensorFault::Walk { bar_s: sign * s * u(0.9, 1.3) / 120.0 }),
            "sensor_drift" => self.sensor.faults.insert(0, SensorFault::WarmUp { bar: sign * s * u(0.9, 1.3), tau_s: u(25.0, 50.0) }),
            "sensor_outliers" if first => {
                self.sensor.faults.push(SensorFault::Spikes { chance: 0.012 * s, low_bar: 2.5, high_bar: 6.0 });
            }
            "sensor_outliers" => self.sensor.faults.push(SensorFault::Bursts { chance: 0.003 * s, bar: 2.5, left: 0, offset_bar: 0.0 }),
            "periodic_disturbance" => {
                let (hz, amplitude_bar) = (u(3.0, 30.0), s * u(0.22, 0.32));
                if first {
                    self.planted.push(("periodic_disturbance", "frequency", hz));
                }
                self.ripple = Some(Ripple {
                    hz,
                    amplitude_bar,
                    second: if first { 0.0 } else { 0.35 },
                    with_pressure: !first,
                    wander: if first { 0.0 } else { 0.002 },
                    phase: u(0.0, 6.0),
                    speed: 0.0,
                    rng: chance.clone(),
                });
            }
            _ => self.unknown = Some(Unknown::draw(what.variant, s, rng)),
        }
    }

    /// What was planted with a parameter that means the same in a library of effects: id, name, value in the unit of
    /// the name (s, Hz, bar, bar/s, A).
    pub(super) fn planted(&self) -> &[(&'static str, &'static str, f64)] {
        &self.planted
    }

    /// The pressure of a healthy valve, without the sensor [bar].
    pub(super) fn true_bar(&self) -> f64 {
        self.settled_bar.max(0.0)
    }

    /// Holds a command for one period and returns the sample at its end [bar].
    pub(super) fn period(&mut self, command_a: f64) -> f64 {
        let mut seen = 0.0;
        for k in 0..(self.period_s / STEP_S).round() as usize {
            seen = self.step(command_a, k == 0);
        }
        self.sensor.sample(seen, self.time_s)
    }

    fn step(&mut self, command_a: f64, fresh: bool) -> f64 {
        self.time_s += STEP_S;
        let heard = self.jitter.as_mut().map_or(command_a, |j| j.step(command_a, fresh));
        let arrived = self.line.step(heard, self.specimen.delay_s + self.extra_s);
        let mut felt = self.coil.step(arrived);
        for friction in &mut self.frictions {
            felt = friction.step(felt);
        }
        for change in &self.changes {
            if let Change::Preload { offset_a } = change {
                felt += offset_a;
            }
        }
        let mut p = self.memory.step(&self.specimen.curve, felt);
        for change in &self.changes {
            p = match change {
                Change::Scale { gain, offset_bar } => lifted(p, *gain, *offset_bar),
                Change::Linear { gain_s, offset_bar_s } => lifted(p, gain_s * self.time_s, offset_bar_s * self.time_s),
                Change::Saturating { gain, offset_bar, tau_s } => {
                    let part = 1.0 - (-self.time_s / tau_s).exp();
                    lifted(p, gain * part, offset_bar * part)
                }
                Change::Preload { .. } => p,
            };
        }
        if let Some(hydraulics) = &mut self.hydraulics {
            if let Some(supply) = &mut self.supply {
                hydraulics.supply_bar = supply.step(1e3);
            }
            p = hydraulics.step(p);
        } else {
            if let Some(supply) = &mut self.supply {
                p = supply.step(p);
            }
            self.chamber_bar += (p - self.chamber_bar) * STEP_S / self.specimen.chamber_lag_s;
            p = self.chamber_bar;
        }
        self.settled_bar = p;
        for volume in &mut self.volumes {
            p = volume.step(p);
        }
        if let Some(unknown) = &mut self.unknown {
            p += unknown.step(p);
        }
        if let Some(ripple) = &mut self.ripple {
            p += ripple.step(p);
        }
        // the tank is the lowest pressure there is
        p = p.max(0.0);
        if let Some((line, delay_s)) = &mut self.late {
            p = line.step(p, *delay_s);
        }
        self.sensor.track(p)
    }

    /// Calibration of a controller for this valve: the current for a pressure, by direction of the change.
    pub(super) fn feed_forward(specimen: &Specimen, target_bar: f64, rising: bool) -> f64 {
        let lost = 0.85 * specimen.half_width_a;
        specimen.curve.current(target_bar) + if rising { lost } else { -lost }
    }
}

/// A changed gain and zero, where there is pressure at all.
fn lifted(p: f64, gain: f64, offset_bar: f64) -> f64 {
    p * (1.0 + gain) + offset_bar * p.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::super::formulation::{EFFECTS, Formulations};
    use super::*;

    const PERIOD_S: f64 = 0.01;

    fn drive(anatomy: Anatomy, seed: u64, concealed: &[Concealed]) -> Vec<f64> {
        let specimen = Specimen::draw(seed, anatomy, Formulations::Open);
        let mut plant = Plant::new(&specimen, concealed, seed, 1, 0.3, PERIOD_S);
        // dips below the fill, shifts, holds and a small oscillation
        (0..3000)
            .map(|k| {
                let t = f64::from(k) * PERIOD_S;
                let i = match (t % 6.0).floor() as u32 {
                    0 => 0.22,
                    1 => 0.22 + 0.55 * (t % 1.0) * 4.0_f64.min(1.0 / (t % 1.0).max(0.25)),
                    2 => 0.77,
                    3 => 0.77 + 0.02 * (12.0 * t).sin(),
                    _ => 0.5,
                };
                plant.period(i)
            })
            .collect()
    }

    #[test]
    fn every_effect_changes_what_is_measured_and_nothing_ever_runs_away() {
        for anatomy in [Anatomy::Blocks, Anatomy::Equations] {
            let healthy = drive(anatomy, 11, &[]);
            for id in EFFECTS {
                for variant in 0..2 {
                    let faulty = drive(anatomy, 11, &[Concealed { id, variant, severity: 1.0 }]);
                    assert!(faulty.iter().all(|p| p.is_finite() && (-10.0..60.0).contains(p)), "{anatomy:?} {id} {variant}");
                    let rms = (faulty.iter().zip(&healthy).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 3000.0).sqrt();
                    assert!(rms > 0.1, "{anatomy:?} {id} variant {variant} shows only {rms:.3} bar");
                }
            }
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_samples() {
        let what = [Concealed { id: "stiction", variant: 1, severity: 1.0 }];
        assert_eq!(drive(Anatomy::Equations, 4, &what), drive(Anatomy::Equations, 4, &what));
    }
}
