//! The stages behind the static curve, one block after the other, for a whole recording or one sample at a time.
//!
//! Blocks that know values only run over the samples. From the first to the last dynamic block signals are followed as
//! steps, on a grid that divides the samples where what stands second or later is too fast for them.

use super::block::{Block, Dynamic, Pointwise};
use super::effect::{Context, Effect, Stage};
use super::follow::{Link, Middle, Track, follow};
use super::linear::FirstOrder;
use super::signal::{Arrival, Point, Signals, Step};

/// Longest inner step of several dynamic blocks: in units of the shortest time of one that is not linear; of linear ones
/// that stand together, of the fastest or of the slowest.
const LONGEST: f64 = 0.7;
const LONGEST_FAST: f64 = 1.3;
const LONGEST_SLOW: f64 = 0.4;
/// A lag that is shorter than this is followed as one of this time [s].
const SHORT_LAG_S: f64 = 0.004;

/// Tank pressure: the outlet cannot fall below it.
struct Floor {
    floor_bar: f64,
    left: f64,
}

impl Dynamic for Floor {
    fn start(&mut self, _: &Point, _: f64) {}
    /// Above and below, before the jump and after it.
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        if from > self.floor_bar && input.to > self.floor_bar {
            return input;
        }
        if input.jump == 0.0 {
            let to = input.to.max(self.floor_bar);
            return Step { to, mean: 0.5 * (from.max(self.floor_bar) + to), jump: 0.0 };
        }
        let (mut mean, mut jump, mut end) = (0.0, 0.0, f64::NAN);
        input.pieces(from, self.left, f64::INFINITY, |share, a, b| {
            let (a, b) = (a.max(self.floor_bar), b.max(self.floor_bar));
            jump += if end.is_nan() { 0.0 } else { a - end };
            mean += share * 0.5 * (a + b);
            end = b;
        });
        let to = input.to.max(self.floor_bar);
        // An arrival at the sample itself, or at the begin of the step, leaves one part only.
        if self.left == 0.0 || self.left >= 1.0 {
            jump = if self.left == 0.0 { to - end } else { (from + input.jump).max(self.floor_bar) - from.max(self.floor_bar) };
        }
        Step { to, mean, jump }
    }
}

impl Pointwise for Floor {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        input.max(self.floor_bar)
    }
}

/// An effect with its values.
type Valued = (&'static dyn Effect, Vec<f64>);

/// The stages behind the static curve.
pub(super) struct Chain {
    front: Vec<Box<dyn Pointwise>>,
    middle: Middle,
    back: Vec<Box<dyn Pointwise>>,
    started: bool,
}

/// A chain with the signal that it is to replace.
pub(super) struct Behind<'b> {
    /// The blocks.
    pub chain: &'b mut Chain,
    /// What they may look at besides.
    pub at: Signals<'b>,
    /// The pressure after the static curve, at the samples [bar].
    pub pressure_bar: &'b mut [f64],
}

impl Chain {
    /// The chain of these effects, a floor and a lag, for a simulation with this context.
    pub fn new(all: &[Valued], floor_bar: Option<f64>, lag_s: f64, context: &Context) -> Self {
        let effects = |stages: &[Stage]| {
            let mut of: Vec<_> = all.iter().filter(|(e, _)| stages.contains(&e.stage())).collect();
            of.sort_by_key(|(e, _)| e.stage());
            of
        };
        let before = effects(&[Stage::Static, Stage::Curve, Stage::Supply]);
        let after = effects(&[Stage::Chamber, Stage::Creep, Stage::Sensor]);
        let inner = inner_steps(context, &groups(&before, lag_s, &after));
        let (arrival, arrives_at) = match context.arrival {
            Arrival::Ramp => (Arrival::Ramp, 0),
            Arrival::Held { left } => {
                let place = inner * (1.0 - left);
                let at = place.floor().min(inner - 1.0);
                (Arrival::Held { left: (at + 1.0 - place).clamp(0.0, 1.0) }, at as usize)
            }
        };
        // The last inner step of a sample ends at it, also at the first.
        let dt_s = context.dt_s / inner;
        let fine = Context { dt_s, start_s: context.start_s - (inner - 1.0) * dt_s, arrival, ..*context };
        let mut links: Vec<(Block, bool)> = Vec::new();
        links.extend(before.iter().map(|(e, theta)| (e.block(theta, &fine), true)));
        let moving = links.iter().any(|(block, _)| matches!(block, Block::Dynamic(_)));
        let floor = floor_bar.map(|floor_bar| Floor { floor_bar, left: arrival.left() });
        links.extend(floor.map(|floor| (if moving { Block::dynamic(floor) } else { Block::pointwise(floor) }, true)));
        // Of linear blocks that stand together the slowest goes first: it smooths what the others then follow.
        let linear = after.iter().take_while(|(e, theta)| e.is_linear(theta)).count();
        let mut smooth: Vec<(f64, Block)> = after[..linear].iter().map(|(e, theta)| (e.shortest_s(theta), e.block(theta, &fine))).collect();
        if lag_s > 0.0 {
            smooth.insert(0, (lag_s, Block::dynamic(FirstOrder::new(lag_s, fine.dt_s, arrival))));
        }
        smooth.sort_by(|a, b| b.0.total_cmp(&a.0));
        links.extend(smooth.into_iter().map(|(_, block)| (block, true)));
        links.extend(after[linear..].iter().map(|(e, theta)| (e.block(theta, &fine), false)));
        let moves = |(block, _): &(Block, bool)| matches!(block, Block::Dynamic(_));
        let first = links.iter().position(moves).unwrap_or(links.len());
        let last = links.iter().rposition(moves).map_or(first, |k| k + 1);
        let plain = |block| if let Block::Pointwise(block) = block { Some(block) } else { None };
        let mut chain =
            Self { front: Vec::new(), middle: Middle::new(inner as usize, arrival, arrives_at), back: Vec::new(), started: false };
        // Behind the last dynamic block there are samples again, and clocks go by them.
        let (ahead, behind) = (before.len() + usize::from(floor_bar.is_some()) + usize::from(lag_s > 0.0), last);
        for (k, (block, jumps)) in links.into_iter().enumerate() {
            let at_samples = |fine: Block| {
                let effect = if k < before.len() { before.get(k) } else { after.get(k.wrapping_sub(ahead)) };
                effect.map_or(fine, |(e, theta)| e.block(theta, context))
            };
            if k < first {
                chain.front.extend(plain(if inner > 1.0 { at_samples(block) } else { block }));
            } else if k < behind {
                chain.middle.push(Link::new(block, jumps));
            } else {
                chain.back.extend(plain(if inner > 1.0 { at_samples(block) } else { block }));
            }
        }
        chain
    }

    /// Steps of one block that a sample takes; at least 1.
    pub fn steps_per_sample(&self) -> usize {
        self.middle.steps_per_sample().max(1)
    }

    /// Replaces the pressure after the static curve by that at the sensor, in place; goes on where it has ended before.
    pub fn run(&mut self, at: &Signals<'_>, pressure_bar: &mut [f64]) {
        Self::run_abreast(&mut [Behind { chain: self, at: *at, pressure_bar }]);
    }

    /// The same of several chains, side by side.
    pub fn run_abreast(all: &mut [Behind<'_>]) {
        let plain = |blocks: &mut [Box<dyn Pointwise>], at: &Signals<'_>, settle: bool, pressure_bar: &mut [f64]| {
            for block in blocks {
                if settle {
                    block.start(&at.at(0), pressure_bar[0]);
                }
                block.run(at, pressure_bar);
            }
        };
        let settle: Vec<bool> = all.iter().map(|of| !of.chain.started && !of.pressure_bar.is_empty()).collect();
        let mut tracks = Vec::with_capacity(all.len());
        for (Behind { chain, at, pressure_bar }, settle) in all.iter_mut().zip(&settle) {
            chain.started |= *settle;
            plain(&mut chain.front, at, *settle, pressure_bar);
            tracks.push(Track { middle: &mut chain.middle, at: *at, pressure_bar, settle: *settle });
        }
        follow(&mut tracks);
        for (Behind { chain, at, pressure_bar }, settle) in all.iter_mut().zip(&settle) {
            plain(&mut chain.back, at, *settle, pressure_bar);
        }
    }
}

/// Dynamic blocks that stand together: one that is not linear, or several that are.
struct Group {
    linear: bool,
    /// Shortest and longest time of its members [s].
    shortest_s: f64,
    longest_s: f64,
    members: usize,
}

/// The dynamic blocks of a chain.
fn groups(before: &[&Valued], lag_s: f64, after: &[&Valued]) -> Vec<Group> {
    let of = |(e, theta): &&Valued| (e.is_linear(theta), e.shortest_s(theta));
    let all = before.iter().map(of).chain((lag_s > 0.0).then_some((true, lag_s))).chain(after.iter().map(of));
    let mut groups: Vec<Group> = Vec::new();
    for (linear, time_s) in all.filter(|(_, t)| t.is_finite()) {
        match groups.last_mut() {
            Some(group) if linear && group.linear => {
                (group.shortest_s, group.longest_s) = (group.shortest_s.min(time_s), group.longest_s.max(time_s));
                group.members += 1;
            }
            _ => groups.push(Group { linear, shortest_s: time_s, longest_s: time_s, members: 1 }),
        }
    }
    groups
}

/// Into how many parts a sample is divided: one where a single block is exact by itself.
fn inner_steps(context: &Context, groups: &[Group]) -> f64 {
    let alone = groups.len() == 1;
    let longest = |group: &Group| match (group.linear, alone) {
        (true, true) if group.members == 1 => f64::INFINITY,
        // The slow one smooths, or the fast one does.
        (true, _) => (LONGEST_FAST * group.shortest_s.max(SHORT_LAG_S)).max(LONGEST_SLOW * group.longest_s),
        (false, true) => f64::INFINITY,
        (false, false) => LONGEST * group.shortest_s,
    };
    let step_s = groups.iter().map(longest).fold(f64::INFINITY, f64::min);
    let parts = (context.dt_s / step_s).clamp(1.0, context.most_inner as f64);
    // Powers of two, so that a fit that moves a time constant seldom moves the grid.
    parts.log2().ceil().exp2()
}
