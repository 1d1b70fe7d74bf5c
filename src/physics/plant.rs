//! The same pipeline one sample at a time: the valve behind `--sim` and behind the emulator.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

use super::block::Pointwise;
use super::chain::Chain;
use super::delay::{Delay, DelayLine};
use super::error::PhysicsError;
use super::pipeline::Pipeline;
use super::signal::{Point, Signals};
use crate::valve::{Hysteresis, HysteresisState, Input, ReferenceCurves, Valve};

/// A simulated valve: a command in, which it holds until the next one, and the pressure measured at the instant of the
/// message.
pub struct Plant {
    curves: ReferenceCurves,
    hysteresis: Hysteresis,
    state: Option<HysteresisState>,
    messages: Vec<Box<dyn Pointwise>>,
    delay: DelayLine,
    coil: Vec<Box<dyn Pointwise>>,
    chain: Chain,
    noise: Option<(Pcg64, Normal<f64>)>,
    oil_temp_c: Option<f64>,
    supply_bar: Option<f64>,
    /// The command that the driver holds [A].
    command_a: f64,
    /// Pressure in place of that of the curves [bar].
    elsewhere_bar: Option<f64>,
    /// Current at the curves [A].
    at_curve_a: f64,
    /// Pressure on the curves [bar].
    on_curve_bar: f64,
    /// Simulated steps per period.
    parts: usize,
    /// Blocks settle at their first input, as they do in a whole simulation.
    started: bool,
}

impl Plant {
    /// A valve settled at `start_current_a`, stepped every `period_s`. Without a seed nothing is random.
    ///
    /// # Errors
    /// [`PhysicsError`] where an effect of the valve is not known or out of range.
    pub fn new(valve: &Valve, period_s: f64, start_current_a: f64, seed: Option<u64>) -> Result<Self, PhysicsError> {
        Self::with_input(valve, Input::Held, period_s, start_current_a, seed)
    }

    /// The effects of `valve` behind a pressure that comes from elsewhere, by [`Plant::take`], and goes on straight lines from step to step.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub fn behind(valve: &Valve, period_s: f64, start_current_a: f64, seed: Option<u64>) -> Result<Self, PhysicsError> {
        Self::with_input(valve, Input::Ramp, period_s, start_current_a, seed)
    }

    fn with_input(valve: &Valve, input: Input, period_s: f64, start_current_a: f64, seed: Option<u64>) -> Result<Self, PhysicsError> {
        let pipeline = Pipeline { input, ..Pipeline::of(valve)? };
        let parts = pipeline.parts(period_s);
        let period_s = period_s / parts as f64;
        let context = pipeline.context(0.0, period_s, seed);
        let delay = DelayLine::new(Delay::new(pipeline.dead_time_s(), period_s, pipeline.input), start_current_a);
        let [messages, coil] = pipeline.current_blocks(&context);
        let noise = seed.filter(|_| valve.noise_bar > 0.0).and_then(|seed| {
            let normal = Normal::new(0.0, valve.noise_bar).ok()?;
            Some((Pcg64::seed_from_u64(seed), normal))
        });
        Ok(Self {
            curves: valve.curves.clone(),
            hysteresis: valve.hysteresis,
            state: None,
            messages,
            delay,
            coil,
            chain: pipeline.chain(&context),
            noise,
            oil_temp_c: None,
            supply_bar: None,
            elsewhere_bar: None,
            at_curve_a: start_current_a,
            on_curve_bar: f64::NAN,
            parts,
            command_a: start_current_a,
            started: false,
        })
    }

    /// From now on the oil has this temperature [degC] and the supply this pressure [bar], for the effects that use them.
    pub fn surround(&mut self, oil_temp_c: Option<f64>, supply_bar: Option<f64>) {
        (self.oil_temp_c, self.supply_bar) = (oil_temp_c, supply_bar);
    }

    /// From now on the pressure behind the curves is this one [bar], from a model that stands in their place.
    pub fn take(&mut self, pressure_bar: f64) {
        self.elsewhere_bar = Some(pressure_bar);
    }

    /// The current at the curves after the last step [A].
    pub fn at_curve_a(&self) -> f64 {
        self.at_curve_a
    }

    /// The pressure on the curves, with their hysteresis and ahead of all dynamics, after the last step [bar]; not a number before it.
    pub fn on_curve_bar(&self) -> f64 {
        self.on_curve_bar
    }

    /// The pressure measured as `command_a` arrives at the driver, one period after the last call [bar].
    pub fn step(&mut self, command_a: f64) -> f64 {
        // The last command has stood for all of the period but its end.
        let held_a = std::mem::replace(&mut self.command_a, command_a);
        for _ in 1..if self.started { self.parts } else { 1 } {
            self.advance(held_a);
        }
        let pressure_bar = self.advance(command_a);
        match &mut self.noise {
            Some((random, normal)) => pressure_bar + normal.sample(random),
            None => pressure_bar,
        }
    }

    /// One simulated step.
    fn advance(&mut self, command_a: f64) -> f64 {
        let settle = !std::mem::replace(&mut self.started, true);
        let (oil_temp_c, supply_bar) = (self.oil_temp_c, self.supply_bar);
        let pass = |blocks: &mut [Box<dyn Pointwise>], mut current_a: f64| {
            for block in blocks {
                let channel = |value: Option<f64>| value.unwrap_or(f64::NAN);
                let at = Point { oil_temp_c: channel(oil_temp_c), supply_bar: channel(supply_bar), ..Point::current(current_a) };
                if settle {
                    block.start(&at, current_a);
                }
                current_a = block.step(&at, current_a);
            }
            current_a
        };
        let sent = pass(&mut self.messages, command_a);
        let arrived = self.delay.step(sent);
        let current_a = pass(&mut self.coil, arrived);
        let state = match &mut self.state {
            Some(state) => state,
            state => state.insert(self.hysteresis.start(&self.curves, current_a)),
        };
        let own_bar = state.advance(&self.curves, current_a);
        (self.at_curve_a, self.on_curve_bar) = (current_a, own_bar);
        let mut pressure = [self.elsewhere_bar.unwrap_or(own_bar)];
        let channel = |value: &Option<f64>| value.map(|v| [v]);
        let (oil, supply) = (channel(&self.oil_temp_c), channel(&self.supply_bar));
        let (oil_temp_c, supply_bar) = (oil.as_ref().map(|o| &o[..]), supply.as_ref().map(|s| &s[..]));
        let current_a = [current_a];
        let at = Signals { oil_temp_c, supply_bar, ..Signals::current(&current_a) };
        self.chain.run(&at, &mut pressure);
        pressure[0]
    }
}
