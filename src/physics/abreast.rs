//! Dynamic blocks of one kind side by side: each with values and a signal of its own, one step of all of them after the other.
//!
//! A step of a block waits for the step before it, most of the time for the end of a division. Steps of other blocks do not, and
//! fill that time.

use std::any::{Any, TypeId};

use super::block::{Courses, Dynamic, Point, Signals, Step};

/// The signal of one block, of several side by side.
pub struct Lane<'l> {
    /// What the block may look at besides.
    pub at: Signals<'l>,
    /// The input before the first step.
    pub from: f64,
    /// Its input, and then its output.
    pub signal: Courses<'l>,
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
        Dynamic::run(self, &lane.at, lane.from, &mut lane.signal);
    }

    fn run_abreast(&mut self, others: Vec<&mut dyn Following>, lanes: &mut [Lane<'_>]) {
        let others = others.into_iter().filter_map(|other| (other as &mut dyn Any).downcast_mut::<B>());
        let mut blocks: Vec<&mut B> = std::iter::once(self).chain(others).collect();
        debug_assert_eq!(blocks.len(), lanes.len(), "blocks of one kind, each with its signal");
        let length = lanes.iter().map(|lane| lane.signal.to.len()).min().unwrap_or(0);
        let points = lanes.iter().any(|lane| lane.at.oil_temp_c.is_some() || lane.at.supply_bar.is_some());
        for k in 0..length {
            for (block, Lane { at, from, signal }) in blocks.iter_mut().zip(lanes.iter_mut()) {
                let input = Step { to: signal.to[k], mean: signal.mean[k], jump: signal.jump[k] };
                let point = if points { at.at(k) } else { Point::current(at.current_a[k]) };
                let output = block.step(&point, *from, input);
                *from = input.to;
                (signal.to[k], signal.mean[k], signal.jump[k]) = (output.to, output.mean, output.jump);
            }
        }
    }
}
