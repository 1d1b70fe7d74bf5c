//! From the first to the last dynamic block of a chain, on a grid that divides the samples; of one chain, or of several side by side.

use super::block::{Block, Following, Lane};
use super::signal::{Arrival, Courses, Signals, Step};

/// Inner steps handled together; small enough for the level-1 cache.
const CHUNK: usize = 256;

/// A block between dynamic ones.
pub(super) struct Link {
    block: Block,
    /// Its input at the last sample.
    input: f64,
    /// What a block that knows values only has added there.
    added: f64,
    /// Whether its input jumps with the command.
    jumps: bool,
}

impl Link {
    /// This block, whose input `jumps` with the command or does not.
    pub fn new(block: Block, jumps: bool) -> Self {
        Self { block, input: 0.0, added: 0.0, jumps }
    }

    fn is_like(&self, other: &Self) -> bool {
        match (&self.block, &other.block) {
            (Block::Pointwise(_), Block::Pointwise(_)) => true,
            (Block::Dynamic(block), Block::Dynamic(other)) => block.as_ref().kind() == other.as_ref().kind(),
            _ => false,
        }
    }

    /// Takes note of the signal that it is about to replace, after a rest at its first value where it starts.
    fn enter(&mut self, lane: &mut Lane<'_>, settle: bool) {
        if settle {
            let start = lane.at.at(0);
            self.input = lane.signal.to[0];
            match &mut self.block {
                Block::Pointwise(block) => block.start(&start, self.input),
                Block::Dynamic(block) => block.start(&start, self.input),
            }
        }
        lane.from = self.input;
        self.input = lane.signal.to.last().copied().unwrap_or(self.input);
    }

    /// The block where it is dynamic; otherwise the signal has been replaced.
    fn dynamic(&mut self, lane: &mut Lane<'_>, settle: bool, arrival: Arrival) -> Option<&mut dyn Following> {
        let block = match &mut self.block {
            Block::Dynamic(block) => return Some(block.as_mut()),
            Block::Pointwise(block) => block,
        };
        // Ahead of the chamber what changes does so with the command, behind it all along the step.
        let held = self.jumps && matches!(arrival, Arrival::Held { .. });
        let left = if held { arrival.left() } else { 0.5 };
        let signal = &mut lane.signal;
        for k in 0..signal.to.len() {
            let input = signal.to[k];
            let output = block.step(&lane.at.at(k), input);
            if settle && k == 0 {
                self.added = output - input;
            }
            let change = output - input - self.added;
            signal.to[k] = output;
            signal.mean[k] += self.added + left * change;
            signal.jump[k] += if held { change } else { 0.0 };
            self.added += change;
        }
        None
    }
}

/// A signal in inner steps, and what is known besides.
#[derive(Default)]
struct Buffers {
    to: Vec<f64>,
    mean: Vec<f64>,
    jump: Vec<f64>,
    current_a: Vec<f64>,
    /// Oil temperature [degC] and supply pressure [bar], where recorded.
    channels: [Option<Vec<f64>>; 2],
    /// The pressure that was read at first [bar].
    begins_bar: f64,
}

impl Buffers {
    fn lane(&mut self) -> Lane<'_> {
        let [oil_temp_c, supply_bar] = &self.channels;
        Lane {
            at: Signals {
                current_a: &self.current_a,
                oil_temp_c: oil_temp_c.as_deref(),
                supply_bar: supply_bar.as_deref(),
                begins_bar: self.begins_bar,
            },
            from: 0.0,
            signal: Courses { to: &mut self.to, mean: &mut self.mean, jump: &mut self.jump },
        }
    }
}

/// The blocks from the first to the last dynamic one.
pub(super) struct Middle {
    links: Vec<Link>,
    /// Inner steps per sample, and when within an inner step the command changes.
    inner: usize,
    arrival: Arrival,
    /// The inner step in which a held command arrives.
    arrives_at: usize,
    /// Pressure and current at the last sample.
    last: (f64, f64),
    buffers: Buffers,
}

/// A chain's middle with the signal that it is to replace.
pub(super) struct Track<'t> {
    /// The blocks.
    pub middle: &'t mut Middle,
    /// What they may look at besides.
    pub at: Signals<'t>,
    /// The pressure, at the samples [bar].
    pub pressure_bar: &'t mut [f64],
    /// Whether what came before was rest at the first value.
    pub settle: bool,
}

impl Middle {
    /// Without a block yet, on a grid of so many inner steps, the command changing in the one numbered `arrives_at`.
    pub fn new(inner: usize, arrival: Arrival, arrives_at: usize) -> Self {
        Self { links: Vec::new(), inner, arrival, arrives_at, last: (0.0, 0.0), buffers: Buffers::default() }
    }

    /// A block more, behind the others.
    pub fn push(&mut self, link: Link) {
        self.links.push(link);
    }

    /// Steps of one block that a sample takes.
    pub fn steps_per_sample(&self) -> usize {
        self.inner * self.links.len()
    }

    fn is_like(&self, other: &Self) -> bool {
        let links = || self.links.iter().zip(&other.links);
        self.inner == other.inner && self.links.len() == other.links.len() && links().all(|(link, other)| link.is_like(other))
    }

    /// Samples as inner steps: held until the command arrives, or on straight lines.
    fn spread(&mut self, at: &Signals<'_>, pressure_bar: &[f64], out: &mut Buffers) {
        let inner = self.inner;
        for buffer in [&mut out.to, &mut out.mean, &mut out.jump, &mut out.current_a] {
            buffer.resize(pressure_bar.len() * inner, 0.0);
        }
        for (channel, out) in [at.oil_temp_c, at.supply_bar].into_iter().zip(&mut out.channels) {
            *out = channel.map(|values| values.iter().flat_map(|v| std::iter::repeat_n(*v, inner)).collect());
        }
        out.begins_bar = at.begins_bar;
        let (mut last, mut last_a) = self.last;
        if inner == 1 {
            out.current_a.copy_from_slice(at.current_a);
            for (k, p) in pressure_bar.iter().enumerate() {
                let step = Step::arriving(last, *p, self.arrival);
                (out.to[k], out.mean[k], out.jump[k]) = (step.to, step.mean, step.jump);
                last = *p;
            }
            self.last = (last, at.current_a.last().copied().unwrap_or(last_a));
            return;
        }
        for (k, (p, i)) in pressure_bar.iter().zip(at.current_a).enumerate() {
            let mut before = last;
            for j in 0..inner {
                let (now, now_a) = match self.arrival {
                    Arrival::Held { .. } if j < self.arrives_at => (last, last_a),
                    Arrival::Held { .. } => (*p, *i),
                    Arrival::Ramp => {
                        let share = (j + 1) as f64 / inner as f64;
                        (last + share * (p - last), last_a + share * (i - last_a))
                    }
                };
                let (place, step) = (k * inner + j, Step::arriving(before, now, self.arrival));
                (out.to[place], out.mean[place], out.jump[place], out.current_a[place]) = (step.to, step.mean, step.jump, now_a);
                before = now;
            }
            (last, last_a) = (*p, *i);
        }
        self.last = (last, last_a);
    }
}

/// Replaces the pressure of every track, chunk by chunk: side by side where their blocks are of the same kinds.
pub(super) fn follow(tracks: &mut [Track<'_>]) {
    let Some((first, others)) = tracks.split_first() else { return };
    let (length, inner, links, settle) = (first.pressure_bar.len(), first.middle.inner, first.middle.links.len(), first.settle);
    let is_alike = |track: &Track<'_>| track.pressure_bar.len() == length && track.settle == settle && track.middle.is_like(first.middle);
    if !others.iter().all(is_alike) {
        for track in tracks {
            follow(std::slice::from_mut(track));
        }
        return;
    }
    let mut buffers: Vec<Buffers> = tracks.iter_mut().map(|track| std::mem::take(&mut track.middle.buffers)).collect();
    let samples = (CHUNK / inner).max(1);
    for begin in (0..length).step_by(samples) {
        let (here, settle) = (begin..(begin + samples).min(length), settle && begin == 0);
        for (track, buffer) in tracks.iter_mut().zip(&mut buffers) {
            let (at, pressure_bar) = (track.at.part(here.clone()), &track.pressure_bar[here.clone()]);
            if settle {
                track.middle.last = (pressure_bar[0], at.current_a[0]);
            }
            track.middle.spread(&at, pressure_bar, buffer);
        }
        for k in 0..links {
            let mut lanes: Vec<Lane<'_>> = buffers.iter_mut().map(Buffers::lane).collect();
            let mut dynamic = Vec::with_capacity(lanes.len());
            for (track, lane) in tracks.iter_mut().zip(&mut lanes) {
                let arrival = track.middle.arrival;
                let link = &mut track.middle.links[k];
                link.enter(lane, settle);
                dynamic.extend(link.dynamic(lane, settle, arrival));
            }
            match (dynamic.pop(), lanes.as_mut_slice()) {
                (None, _) => {}
                (Some(block), [lane]) => block.run(lane),
                (Some(block), lanes) => {
                    // The last one has been taken out: it goes first with its own signal.
                    lanes.rotate_right(1);
                    block.run_abreast(dynamic, lanes);
                }
            }
        }
        for (track, buffer) in tracks.iter_mut().zip(&buffers) {
            let ends = buffer.to.iter().skip(inner - 1).step_by(inner);
            track.pressure_bar[here.clone()].iter_mut().zip(ends).for_each(|(pressure, end)| *pressure = *end);
        }
    }
    for (track, buffer) in tracks.iter_mut().zip(buffers) {
        track.middle.buffers = buffer;
    }
}
