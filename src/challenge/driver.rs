//! From the command to the coil current: message line, output stage, coil.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::anatomy::STEP_S;
use super::chance::uniform;

/// A first-in-first-out line of the plant's time steps: dead time that may change while signals are under way.
#[derive(Debug, Clone)]
pub(super) struct DeadTime {
    past: std::collections::VecDeque<f64>,
}

impl DeadTime {
    /// A line that can hold a quarter of a second, filled with `start`.
    pub(super) fn new(start: f64) -> Self {
        Self { past: std::iter::repeat_n(start, (0.25 / STEP_S) as usize).collect() }
    }
    /// Takes a value in and gives the one of `delay_s` ago.
    pub(super) fn step(&mut self, value: f64, delay_s: f64) -> f64 {
        self.past.pop_back();
        self.past.push_front(value);
        let steps = ((delay_s / STEP_S).round() as usize).min(self.past.len() - 1);
        self.past[steps]
    }
}

/// What makes a message late by chance.
#[derive(Debug, Clone)]
pub(super) enum Jitter {
    /// Each message by its own amount, uniform up to `most_s`; a late one is overtaken by the next and then void.
    Message { most_s: f64, rng: Pcg64, pending: Vec<(f64, u64, f64)>, sent: u64, newest: u64, output_a: f64, last_a: f64, clock_s: f64 },
    /// A bus that is loaded at times: every fraction of a second another extra delay.
    Load { most_s: f64, rng: Pcg64, extra_s: f64, until_s: f64, clock_s: f64, line: DeadTime },
}

impl Jitter {
    pub(super) fn message(most_s: f64, rng: Pcg64, start_a: f64) -> Self {
        Self::Message { most_s, rng, pending: Vec::new(), sent: 0, newest: 0, output_a: start_a, last_a: start_a, clock_s: 0.0 }
    }
    pub(super) fn load(most_s: f64, rng: Pcg64, start_a: f64) -> Self {
        Self::Load { most_s, rng, extra_s: 0.0, until_s: 0.0, clock_s: 0.0, line: DeadTime::new(start_a) }
    }

    /// `fresh`: a message leaves in this step.
    pub(super) fn step(&mut self, command_a: f64, fresh: bool) -> f64 {
        match self {
            Self::Message { most_s, rng, pending, sent, newest, output_a, last_a, clock_s } => {
                *clock_s += STEP_S;
                if fresh {
                    *sent += 1;
                    *last_a = command_a;
                    pending.push((*clock_s + uniform(rng, 0.0, *most_s), *sent, command_a));
                }
                for &(at_s, number, value) in pending.iter() {
                    if at_s <= *clock_s && number > *newest {
                        *newest = number;
                        *output_a = value;
                    }
                }
                pending.retain(|m| m.0 > *clock_s && m.1 > *newest);
                *output_a
            }
            Self::Load { most_s, rng, extra_s, until_s, clock_s, line } => {
                *clock_s += STEP_S;
                if *clock_s >= *until_s {
                    *extra_s = *most_s * rng.random::<f64>().powf(1.3);
                    *until_s = *clock_s + uniform(rng, 0.06, 0.5);
                }
                line.step(command_a, *extra_s)
            }
        }
    }
}

/// A winding that warms up, behind an output stage that does not quite hold the current.
#[derive(Debug, Clone)]
pub(super) struct Heating {
    /// Warming of copper and of housing per watt at rest [K/W], with their time constants [s].
    pub(super) nodes: Vec<(f64, f64)>,
    /// Share of a change of resistance that the stage's feedback takes back.
    pub(super) compensated: f64,
    /// Excess temperature of each node [K].
    pub(super) excess_k: Vec<f64>,
}

/// Cold resistance of the winding [ohm] and temperature coefficient of copper [1/K].
const COLD_OHM: f64 = 5.3;
const COPPER_PER_K: f64 = 0.0039;

impl Heating {
    /// The output stage is set for the cold winding; each run starts cold.
    fn step(&mut self, wanted_a: f64) -> f64 {
        let rise = COPPER_PER_K * self.excess_k.iter().sum::<f64>();
        let current = wanted_a / (1.0 + (1.0 - self.compensated) * rise);
        let watt = current * current * COLD_OHM * (1.0 + rise);
        for (excess, (k_per_w, tau_s)) in self.excess_k.iter_mut().zip(&self.nodes) {
            *excess += (watt * k_per_w - *excess) * STEP_S / tau_s;
        }
        current
    }
}

/// Output stage and coil: the loop of the current, with voltage that drives through the inductance.
#[derive(Debug, Clone)]
pub(super) struct Coil {
    lag_s: f64,
    current_a: f64,
    pub(super) heating: Option<Heating>,
}

impl Coil {
    pub(super) fn new(lag_s: f64, start_a: f64) -> Self {
        Self { lag_s, current_a: start_a, heating: None }
    }
    /// Coil current [A] one step later.
    pub(super) fn step(&mut self, wanted_a: f64) -> f64 {
        let wanted = self.heating.as_mut().map_or(wanted_a, |h| h.step(wanted_a));
        // what 24 V leaves over the winding's 5 ohm drives some 0.1 H: 150 A/s at most
        let rate = ((wanted - self.current_a) / self.lag_s).clamp(-150.0, 150.0);
        self.current_a += rate * STEP_S;
        self.current_a
    }
}

#[cfg(test)]
mod tests {
    use super::super::chance::stream;
    use super::*;

    #[test]
    fn dead_time_is_what_it_says() {
        let mut line = DeadTime::new(0.0);
        let out: Vec<f64> = (0..100).map(|k| line.step(if k >= 10 { 1.0 } else { 0.0 }, 0.02)).collect();
        assert_eq!(out.iter().position(|v| *v == 1.0), Some(10 + 40));
    }

    #[test]
    fn a_warm_coil_draws_less_and_the_loss_grows_with_time() {
        let mut coil = Coil::new(0.003, 0.7);
        coil.heating = Some(Heating { nodes: vec![(5.0, 10.0)], compensated: 0.0, excess_k: vec![0.0] });
        let after = |coil: &mut Coil, s: f64| (0..(s / STEP_S) as usize).fold(0.0, |_, _| coil.step(0.7));
        let early = after(&mut coil, 1.0);
        let late = after(&mut coil, 60.0);
        assert!(early < 0.7 && late < early - 0.01, "{early} {late}");
        // balance: rise = k_per_w R i^2 (1 + alpha rise) with i = 0.7/(1 + alpha rise), here 12.4 K
        assert!((0.7 / late - 1.0 - COPPER_PER_K * 12.4).abs() < 0.002, "{late}");
    }

    #[test]
    fn a_late_message_never_undoes_a_newer_one() {
        let mut jitter = Jitter::message(0.06, stream(3, 3), 0.0);
        let mut last = 0.0;
        for k in 0..4000 {
            let out = jitter.step(f64::from(k / 20), k % 20 == 0);
            assert!(out >= last);
            last = out;
        }
        assert!(last >= 190.0);
    }
}
