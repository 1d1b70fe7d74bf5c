//! Effects at work, which the stages are made of: by their values alone, or with a course of their own between samples.
//!
//! Dynamic blocks of one kind go side by side: each with values and a signal of its own, one step of all of them after the other. A step
//! of a block waits for the step before it, most of the time for the end of a division; steps of other blocks do not, and fill that time.

use std::any::{Any, TypeId};

use super::signal::{Courses, Point, Signals, Step};

/// An effect at work whose output depends on the values of its input alone, in their order, and on the clock; not on
/// what the input does between them.
pub trait Pointwise: Send {
    /// Settles the block at its first input.
    fn start(&mut self, at: &Point, input: f64);
    /// The output at a sample.
    fn step(&mut self, at: &Point, input: f64) -> f64;
    /// Replaces a whole signal, once started.
    fn run(&mut self, at: &Signals<'_>, signal: &mut [f64]) {
        if at.oil_temp_c.is_none() && at.supply_bar.is_none() {
            for (current, value) in at.current_a.iter().zip(signal) {
                *value = self.step(&Point::current(*current), *value);
            }
            return;
        }
        for (k, value) in signal.iter_mut().enumerate() {
            *value = self.step(&at.at(k), *value);
        }
    }
}

/// An effect at work that has a course of its own between samples.
pub trait Dynamic: Send {
    /// Settles the block at its first input.
    fn start(&mut self, at: &Point, input: f64);
    /// The output over a step of its input, which began at the value `from`.
    fn step(&mut self, at: &Point, from: f64, input: Step) -> Step;
}

/// The signal of one block, of several side by side.
pub struct Lane<'l> {
    /// What the block may look at besides.
    pub at: Signals<'l>,
    /// The input before the first step.
    pub from: f64,
    /// Its input, and then its output.
    pub signal: Courses<'l>,
}

impl Lane<'_> {
    /// Whether more than the current was recorded.
    fn has_points(&self) -> bool {
        self.at.oil_temp_c.is_some() || self.at.supply_bar.is_some()
    }

    /// Replaces step `k` by what the block makes of it.
    #[inline]
    fn step<B: Dynamic>(&mut self, block: &mut B, k: usize, has_points: bool) {
        let Self { at, from, signal } = self;
        let input = Step { to: signal.to[k], mean: signal.mean[k], jump: signal.jump[k] };
        let point = if has_points { at.at(k) } else { Point::current(at.current_a[k]) };
        let output = block.step(&point, *from, input);
        *from = input.to;
        (signal.to[k], signal.mean[k], signal.jump[k]) = (output.to, output.mean, output.jump);
    }
}

/// A dynamic block of whatever kind.
pub trait Following: Any + Send {
    /// Which kind it is.
    fn kind(&self) -> TypeId;
    /// Settles the block at its first input.
    fn start(&mut self, at: &Point, input: f64);
    /// Replaces a whole signal, once started.
    fn run(&mut self, lane: &mut Lane<'_>);
    /// Replaces the signals of this block and of others of its kind, this one's first: what each gives by itself.
    fn run_abreast(&mut self, others: Vec<&mut dyn Following>, lanes: &mut [Lane<'_>]);
}

impl<B: Dynamic + 'static> Following for B {
    fn kind(&self) -> TypeId {
        TypeId::of::<B>()
    }

    fn start(&mut self, at: &Point, input: f64) {
        Dynamic::start(self, at, input);
    }

    fn run(&mut self, lane: &mut Lane<'_>) {
        let has_points = lane.has_points();
        for k in 0..lane.signal.to.len() {
            lane.step(self, k, has_points);
        }
    }

    fn run_abreast(&mut self, others: Vec<&mut dyn Following>, lanes: &mut [Lane<'_>]) {
        let others = others.into_iter().filter_map(|other| (other as &mut dyn Any).downcast_mut::<B>());
        let mut blocks: Vec<&mut B> = std::iter::once(self).chain(others).collect();
        debug_assert_eq!(blocks.len(), lanes.len(), "blocks of one kind, each with its signal");
        let length = lanes.iter().map(|lane| lane.signal.to.len()).min().unwrap_or(0);
        let has_points = lanes.iter().any(Lane::has_points);
        for k in 0..length {
            for (block, lane) in blocks.iter_mut().zip(lanes.iter_mut()) {
                lane.step(*block, k, has_points);
            }
        }
    }
}

/// An effect at work.
pub enum Block {
    /// It knows values only.
    Pointwise(Box<dyn Pointwise>),
    /// It has a course of its own.
    Dynamic(Box<dyn Following>),
}

impl Block {
    /// An effect that knows values only.
    pub fn pointwise(block: impl Pointwise + 'static) -> Self {
        Self::Pointwise(Box::new(block))
    }
    /// An effect with a course of its own.
    pub fn dynamic(block: impl Dynamic + 'static) -> Self {
        Self::Dynamic(Box::new(block))
    }
}

/// Passes its input.
pub(super) struct Through;

impl Pointwise for Through {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        input
    }
    fn run(&mut self, _: &Signals<'_>, _: &mut [f64]) {}
}
