//! The pipeline: a whole recorded current through a valve model, free-running from its own start.

use super::Effect;
use super::block::{Block, Pointwise};
use super::chain::{Behind, Chain};
use super::delay::Delay;
use super::effect::{Context, Stage};
use super::error::PhysicsError;
use super::resolve::resolve;
use super::signal::Signals;
use crate::valve::{Hysteresis, Input, ReferenceCurves, Valve};

/// Inner steps of a sample at most: with these every effect gives the same pressure however often is sampled, to a hundredth of its swing
/// (with half as many a flow limit does not).
pub const MOST_INNER: usize = 16;
/// Most parts of a sample.
const MOST_PARTS: f64 = 1000.0;

/// A valve model made ready to simulate signals of one time step, again and again.
pub struct Pipeline<'a> {
    /// Reference curves.
    pub curves: &'a ReferenceCurves,
    /// Path between the curves.
    pub hysteresis: Hysteresis,
    /// Dead time [s].
    pub delay_s: f64,
    /// First-order lag of the chamber [s].
    pub lag_s: f64,
    /// Tank pressure [bar].
    pub floor_bar: Option<f64>,
    /// What the command does between two samples.
    pub input: Input,
    /// Most inner steps of a sample behind the curve: fewer are faster, and less exact where dynamics follow dynamics.
    pub most_inner: usize,
    /// Further effects with their values.
    pub effects: Vec<(&'static dyn Effect, Vec<f64>)>,
}

impl<'a> Pipeline<'a> {
    /// The pipeline of a valve file.
    ///
    /// # Errors
    /// [`PhysicsError`] where an effect or a parameter is not known or out of range.
    pub fn of(valve: &'a Valve) -> Result<Self, PhysicsError> {
        let effects = valve.effects.iter().map(resolve).collect::<Result<_, _>>()?;
        let Valve { curves, hysteresis, delay_s, lag_s, floor_bar, .. } = valve;
        Ok(Self {
            curves,
            hysteresis: *hysteresis,
            delay_s: *delay_s,
            lag_s: *lag_s,
            floor_bar: *floor_bar,
            input: Input::Held,
            most_inner: MOST_INNER,
            effects,
        })
    }

    /// Whether nothing but the static model remains, so that the time step does not matter.
    pub(super) fn is_static(&self) -> bool {
        self.delay_s == 0.0 && self.lag_s == 0.0 && self.effects.is_empty()
    }

    /// Dead time of the valve and of the effects together [s].
    pub fn dead_time_s(&self) -> f64 {
        (self.delay_s + self.effects.iter().map(|(e, theta)| e.dead_time_s(theta)).sum::<f64>()).max(0.0)
    }

    /// What a block needs to know of this simulation.
    pub fn context(&self, start_s: f64, dt_s: f64, seed: Option<u64>) -> Context<'_> {
        let arrival = Delay::new(self.dead_time_s(), dt_s, self.input).arrival;
        Context { dt_s, start_s, arrival, most_inner: self.most_inner, curves: self.curves, seed }
    }

    /// Into how many parts each sample must be divided ahead of the curve.
    pub fn parts(&self, dt_s: f64) -> usize {
        let longest_s = self.effects.iter().map(|(e, theta)| e.longest_step_s(theta)).fold(f64::INFINITY, f64::min);
        (dt_s / longest_s - 1e-9).ceil().clamp(1.0, MOST_PARTS) as usize
    }

    /// Pressure [bar] at each sample of an even grid, free-running. `work` holds the current at the static curve.
    pub fn run(&self, start_s: f64, dt_s: f64, signals: &Signals<'_>, work: &mut Vec<f64>, pressure_bar: &mut Vec<f64>) {
        self.run_from(0.5, (start_s, dt_s), signals, work, pressure_bar);
    }

    /// As [`Pipeline::run`], from between the curves as in [`Pipeline::static_curve`].
    pub fn run_from(
        &self,
        start_share: f64,
        (start_s, dt_s): (f64, f64),
        signals: &Signals<'_>,
        work: &mut Vec<f64>,
        pressure_bar: &mut Vec<f64>,
    ) {
        let parts = self.parts(dt_s);
        if parts > 1 {
            let fine = |values: &[f64], input: Input| spread(values, parts, input);
            let current_a = fine(signals.current_a, self.input);
            let [oil, supply] = [signals.oil_temp_c, signals.supply_bar].map(|c| c.map(|c| fine(c, Input::Ramp)));
            let signals = Signals { current_a: &current_a, oil_temp_c: oil.as_deref(), supply_bar: supply.as_deref(), ..*signals };
            let dt_s = dt_s / parts as f64;
            let mut all = Vec::new();
            self.run_stages(start_share, self.context(start_s, dt_s, None), &signals, work, &mut all);
            pressure_bar.clear();
            pressure_bar.extend(all.into_iter().step_by(parts));
            return;
        }
        self.run_stages(start_share, self.context(start_s, dt_s, None), signals, work, pressure_bar);
    }

    fn run_stages(&self, start_share: f64, context: Context<'_>, signals: &Signals<'_>, work: &mut Vec<f64>, pressure_bar: &mut Vec<f64>) {
        self.current_stages(&context, signals, work);
        pressure_bar.resize(signals.current_a.len(), 0.0);
        self.static_curve(start_share, work, pressure_bar);
        self.read_between(&context, work);
        self.read_between(&context, pressure_bar);
        self.pressure_stages(&context, &signals.with_current(work), pressure_bar);
    }

    /// The blocks of the stages before the static curve: those of the messages, and those of coil and spool.
    pub(super) fn current_blocks(&self, context: &Context) -> [Vec<Box<dyn Pointwise>>; 2] {
        [&[Stage::Delay] as &[Stage], &[Stage::Coil, Stage::Spool]].map(|stages| {
            let of = stages.iter().flat_map(|stage| self.effects.iter().filter(move |(e, _)| e.stage() == *stage));
            // A current that is held, or known at its samples only, has no course of its own between them.
            of.filter_map(|(e, theta)| if let Block::Pointwise(block) = e.block(theta, context) { Some(block) } else { None }).collect()
        })
    }

    /// The stages before the static curve: command in, current at the curve out, at the samples of a command on straight lines,
    /// whose corners the hysteresis remembers; see [`Pipeline::read_between`].
    pub fn current_stages(&self, context: &Context, signals: &Signals<'_>, work: &mut Vec<f64>) {
        let [messages, coil] = self.current_blocks(context);
        let pass = |blocks: Vec<Box<dyn Pointwise>>, current: &mut Vec<f64>| {
            for mut block in blocks {
                let input = current.clone();
                let Some(first) = input.first() else { return };
                let at = signals.with_current(&input);
                block.start(&at.at(0), *first);
                block.run(&at, current);
            }
        };
        let delay = Delay::new(self.dead_time_s(), context.dt_s, self.input);
        if messages.is_empty() {
            delay.shift(signals.current_a, work);
        } else {
            let mut sent = signals.current_a.to_vec();
            pass(messages, &mut sent);
            delay.shift(&sent, work);
        }
        pass(coil, work);
    }

    /// The static curve with its hysteresis. `start_share` is where the valve stands at first: 0 on the ascending curve,
    /// 1/2 on the average, 1 on the descending.
    pub fn static_curve(&self, start_share: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
        self.hysteresis.run(self.curves, start_share, current_a, pressure_bar);
    }

    /// Reads what the static curve has gone through, current or pressure, at the samples: a dead time is no whole number of them.
    pub fn read_between(&self, context: &Context, values: &mut [f64]) {
        Delay::new(self.dead_time_s(), context.dt_s, self.input).read_between(values);
    }

    /// Steps of one block that the stages after the static curve take for a sample.
    pub fn steps_per_sample(&self, context: &Context) -> usize {
        self.chain(context).steps_per_sample()
    }

    /// The stages after the static curve.
    pub(super) fn chain(&self, context: &Context) -> Chain {
        Chain::new(&self.effects, self.floor_bar, self.lag_s, context)
    }

    /// The stages after the static curve, in place; `at` holds the current at the curve.
    pub fn pressure_stages(&self, context: &Context, at: &Signals<'_>, pressure_bar: &mut [f64]) {
        self.chain(context).run(at, pressure_bar);
    }
}

/// A pressure after the static curve, and what is to become of it.
pub struct Stages<'s> {
    /// The valve.
    pub pipeline: &'s Pipeline<'s>,
    /// What its blocks need to know.
    pub context: Context<'s>,
    /// The current at the curve, and what was recorded besides.
    pub at: Signals<'s>,
    /// The pressure, replaced by that at the sensor [bar].
    pub pressure_bar: &'s mut [f64],
}

/// As [`Pipeline::pressure_stages`] for several valves, side by side: the same pressures in less time where their effects are the same.
pub fn pressure_stages_abreast(all: Vec<Stages<'_>>) {
    let mut chains: Vec<Chain> = all.iter().map(|of| of.pipeline.chain(&of.context)).collect();
    let behind = chains.iter_mut().zip(all).map(|(chain, Stages { at, pressure_bar, .. })| Behind { chain, at, pressure_bar });
    Chain::run_abreast(&mut behind.collect::<Vec<_>>());
}

/// Each sample followed by the parts of the step after it; the last sample stands alone.
pub(super) fn spread(values: &[f64], parts: usize, input: Input) -> Vec<f64> {
    let next = values.iter().skip(1).map(Some).chain([None]);
    let steps = values.iter().zip(next).flat_map(|(from, to)| {
        let slope = match (input, to) {
            (Input::Ramp, Some(to)) => (to - from) / parts as f64,
            _ => 0.0,
        };
        (0..if to.is_some() { parts } else { 1 }).map(move |j| from + j as f64 * slope)
    });
    steps.collect()
}
