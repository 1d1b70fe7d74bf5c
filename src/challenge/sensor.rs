//! The pressure transmitter and its converter: noise, lag, wander, steps and spikes.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::anatomy::STEP_S;
use super::chance::normal;
use super::specimen::Specimen;

/// One fault of the sensor.
#[derive(Debug, Clone)]
pub(super) enum SensorFault {
    /// Damping set in the transmitter: RC stages in series.
    Lag { stages: Vec<f64>, tau_s: f64 },
    /// Zero point that walks off at constant speed [bar/s].
    Walk { bar_s: f64 },
    /// Zero point that follows the warming of the electronics.
    WarmUp { bar: f64, tau_s: f64 },
    /// Single wrong samples.
    Spikes { chance: f64, low_bar: f64, high_bar: f64 },
    /// Disturbed telegrams: a few samples on end, some of them zero.
    Bursts { chance: f64, bar: f64, left: u32, offset_bar: f64 },
    /// A converter with few bits that rounds.
    Round { lsb_bar: f64 },
    /// A converter that truncates, with steps of unequal width.
    Truncate { lsb_bar: f64, uneven: f64 },
}

/// The sensor with its healthy noise.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    pub(super) faults: Vec<SensorFault>,
    noise_bar: f64,
    coloured: f64,
    /// What of the coloured part is left after a sampling period.
    keep: f64,
    slow: f64,
    rng: Pcg64,
    fault_rng: Pcg64,
}

impl Sensor {
    pub(super) fn new(valve: &Specimen, period_s: f64, rng: Pcg64, fault_rng: Pcg64) -> Self {
        let keep = (-period_s / valve.colour_s).exp();
        Self { faults: Vec::new(), noise_bar: valve.noise_bar, coloured: valve.coloured, keep, slow: 0.0, rng, fault_rng }
    }

    /// What happens between samples.
    pub(super) fn track(&mut self, pressure_bar: f64) -> f64 {
        let mut p = pressure_bar;
        for fault in &mut self.faults {
            if let SensorFault::Lag { stages, tau_s } = fault {
                for state in stages.iter_mut() {
                    *state += (p - *state) * STEP_S / *tau_s;
                    p = *state;
                }
            }
        }
        p
    }

    /// One sample at `time_s`, with 10 mbar resolution.
    pub(super) fn sample(&mut self, tracked_bar: f64, time_s: f64) -> f64 {
        let keep = self.keep;
        self.slow = keep * self.slow + (1.0 - keep * keep).sqrt() * normal(&mut self.rng);
        let noise = self.noise_bar * ((1.0 - self.coloured).sqrt() * normal(&mut self.rng) + self.coloured.sqrt() * self.slow);
        let mut y = tracked_bar + noise;
        let rng = &mut self.fault_rng;
        for fault in &mut self.faults {
            match fault {
                SensorFault::Lag { .. } => {}
                SensorFault::Walk { bar_s } => y += *bar_s * time_s,
                SensorFault::WarmUp { bar, tau_s } => y += *bar * (1.0 - (-time_s / *tau_s).exp()),
                SensorFault::Spikes { chance, low_bar, high_bar } => {
                    if rng.random::<f64>() < *chance {
                        let size = *low_bar + (*high_bar - *low_bar) * rng.random::<f64>();
                        y += if rng.random::<bool>() { size } else { -size };
                    }
                }
                SensorFault::Bursts { chance, bar, left, offset_bar } => {
                    if *left == 0 && rng.random::<f64>() < *chance {
                        *left = rng.random_range(2..7);
                        *offset_bar = if rng.random::<f64>() < 0.12 { f64::NAN } else { *bar * normal(rng) };
                    }
                    if *left > 0 {
                        *left -= 1;
                        y = if offset_bar.is_nan() { 0.0 } else { y + *offset_bar + 0.4 * *bar * normal(rng) };
                    }
                }
                SensorFault::Round { lsb_bar } => y = (y / *lsb_bar).round() * *lsb_bar,
                SensorFault::Truncate { lsb_bar, uneven } => {
                    let code = (y / *lsb_bar + 0.5 * *uneven * (y / *lsb_bar * 0.5 * std::f64::consts::TAU).sin()).floor();
                    y = (code + 0.5) * *lsb_bar;
                }
            }
        }
        (y * 100.0).round() / 100.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::anatomy::Anatomy;
    use super::super::chance::stream;
    use super::super::formulation::Formulations;
    use super::*;

    #[test]
    fn noise_has_the_standard_deviation_that_was_drawn() {
        let valve = Specimen { noise_bar: 0.04, coloured: 0.1, ..Specimen::draw(1, Anatomy::Blocks, Formulations::All) };
        let mut sensor = Sensor::new(&valve, 0.01, stream(1, 1), stream(1, 2));
        let y: Vec<f64> = (0..20_000).map(|k| sensor.sample(10.0, f64::from(k) * 0.01) - 10.0).collect();
        let sd = (y.iter().map(|v| v * v).sum::<f64>() / 20_000.0).sqrt();
        assert!((sd - 0.04).abs() < 0.004, "{sd}");
    }

    #[test]
    fn few_bits_leave_few_values() {
        let valve = Specimen { noise_bar: 0.04, coloured: 0.1, ..Specimen::draw(1, Anatomy::Blocks, Formulations::All) };
        let mut sensor = Sensor::new(&valve, 0.01, stream(1, 1), stream(1, 2));
        sensor.faults.push(SensorFault::Round { lsb_bar: 0.5 });
        for k in 0..1000 {
            let y = sensor.sample(f64::from(k) * 0.01, 0.0) / 0.5;
            assert!((y - y.round()).abs() < 1e-9);
        }
    }
}
