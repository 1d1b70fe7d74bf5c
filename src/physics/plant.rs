//! The same pipeline one sample at a time: the valve behind `--sim` and behind the emulator.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

use super::effect::{Block, PhysicsError, Stage};
use super::linear::{DelayLine, FirstOrder};
use super::pipeline::Pipeline;
use crate::valve::{HyperbolaState, Hysteresis, ReferenceCurves, Valve};

/// A simulated valve: a command in, a measured pressure out, one period later.
pub struct Plant {
    curves: ReferenceCurves,
    hysteresis: Hysteresis,
    state: Option<HyperbolaState>,
    delay: DelayLine,
    before: Vec<(Stage, Box<dyn Block>)>,
    after: Vec<(Stage, Box<dyn Block>)>,
    floor_bar: f64,
    lag: FirstOrder,
    noise: Option<(Pcg64, Normal<f64>)>,
    /// Blocks settle at their first input, as they do in a whole simulation.
    started: bool,
}

impl Plant {
    /// A valve settled at `start_current_a`, stepped every `period_s`. Without a seed nothing is random.
    ///
    /// # Errors
    /// [`PhysicsError`] where an effect of the valve is not known or out of range.
    pub fn new(valve: &Valve, period_s: f64, start_current_a: f64, seed: Option<u64>) -> Result<Self, PhysicsError> {
        let pipeline = Pipeline::of(valve)?;
        let context = pipeline.context(0.0, period_s, seed);
        let extra: f64 = pipeline.effects.iter().filter(|(e, _)| e.id() == "transport_delay").map(|(_, theta)| theta[0]).sum();
        let mut delay = DelayLine::new((valve.delay_s + extra).max(0.0), period_s);
        delay.start(start_current_a);
        let (mut before, mut after) = (Vec::new(), Vec::new());
        let mut ordered: Vec<_> = pipeline.effects.iter().collect();
        ordered.sort_by_key(|(e, _)| e.stage());
        for (effect, theta) in ordered {
            match effect.stage() {
                stage @ (Stage::Delay | Stage::Coil | Stage::Spool) => before.push((stage, effect.block(theta, &context))),
                stage => after.push((stage, effect.block(theta, &context))),
            }
        }
        let noise = seed.filter(|_| valve.noise_bar > 0.0).and_then(|seed| {
            let normal = Normal::new(0.0, valve.noise_bar).ok()?;
            Some((Pcg64::seed_from_u64(seed), normal))
        });
        Ok(Self {
            curves: valve.curves.clone(),
            hysteresis: valve.hysteresis,
            state: None,
            delay,
            before,
            after,
            floor_bar: valve.floor_bar.unwrap_or(f64::NEG_INFINITY),
            lag: FirstOrder::new(valve.lag_s, period_s),
            noise,
            started: false,
        })
    }

    /// The measured pressure one period after `command_a` was applied [bar].
    pub fn step(&mut self, command_a: f64) -> f64 {
        let settle = !std::mem::replace(&mut self.started, true);
        let mut current = self.delay.step(command_a);
        for (_, block) in &mut self.before {
            if settle {
                block.start(current, current);
            }
            current = block.step(current, current);
        }
        if let (true, Hysteresis::Hyperbolic { a_bar2 }) = (settle, self.hysteresis) {
            self.state = Some(HyperbolaState::start(a_bar2, current, self.curves.average_at(current)));
        }
        let pressure = match &mut self.state {
            Some(state) => state.advance(&self.curves, current),
            None => self.curves.average_at(current),
        };
        let chamber = self.after.partition_point(|(stage, _)| *stage < Stage::Chamber);
        let (changes, dynamics) = self.after.split_at_mut(chamber);
        let pass = |blocks: &mut [(Stage, Box<dyn Block>)], mut pressure: f64| {
            for (_, block) in blocks {
                if settle {
                    block.start(current, pressure);
                }
                pressure = block.step(current, pressure);
            }
            pressure
        };
        let pressure = pass(changes, pressure).max(self.floor_bar);
        if settle {
            self.lag.start(pressure);
        }
        let pressure = pass(dynamics, self.lag.step(pressure));
        match &mut self.noise {
            Some((random, normal)) => pressure + normal.sample(random),
            None => pressure,
        }
    }
}
