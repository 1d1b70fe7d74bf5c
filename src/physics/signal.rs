//! What a signal is between two samples.
//!
//! A simulation has the samples of its recording and no finer grid, yet its answer must not depend on how often was
//! sampled. So a signal is more than its values: for each step it is known whether it jumped and when (a command that is
//! held jumps as its message arrives), and what its mean was. A dynamic block that respects the three gives at each sample
//! what a fine-step solution gives.

/// One step of a signal: what happened since the sample before, from whose value it started.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Value at the sample.
    pub to: f64,
    /// Mean over the step.
    pub mean: f64,
    /// By how much it jumped at the instant at which a held command arrives; 0 for a smooth signal.
    pub jump: f64,
}

impl Step {
    /// A signal at rest.
    pub fn rest(value: f64) -> Self {
        Self { to: value, mean: value, jump: 0.0 }
    }

    /// So many times this.
    #[inline]
    pub fn times(self, factor: f64) -> Self {
        Self { to: factor * self.to, mean: factor * self.mean, jump: factor * self.jump }
    }

    /// The sum of two signals.
    #[inline]
    pub fn plus(self, other: Self) -> Self {
        Self { to: self.to + other.to, mean: self.mean + other.mean, jump: self.jump + other.jump }
    }

    /// This less another signal.
    #[inline]
    pub fn minus(self, other: Self) -> Self {
        Self { to: self.to - other.to, mean: self.mean - other.mean, jump: self.jump - other.jump }
    }

    /// From the value at the sample before: held until the command arrives, or on a straight line.
    #[inline]
    pub fn arriving(from: f64, to: f64, arrival: Arrival) -> Self {
        match arrival {
            Arrival::Held { left } => Self { to, mean: from + left * (to - from), jump: to - from },
            Arrival::Ramp => Self { to, mean: 0.5 * (from + to), jump: 0.0 },
        }
    }
}

impl Step {
    /// The step in parts over which the signal is nearly a straight line, each handed on with its share of the step
    /// and its values at both ends: two where it jumps, more where it changes by more than `resolution`. `left` is
    /// the share of the step after a jump, `from` the value at its begin.
    #[inline]
    pub fn pieces(self, from: f64, left: f64, resolution: f64, mut part: impl FnMut(f64, f64, f64)) {
        let to = self.to - self.jump;
        let bow = 6.0 * (self.mean - left * self.jump - 0.5 * (from + to));
        let change = (to - from).abs() + 0.5 * bow.abs();
        if change <= resolution {
            if self.jump == 0.0 {
                part(1.0, from, self.to);
                return;
            }
            let at = from + (1.0 - left) * (to - from + left * bow);
            if left < 1.0 {
                part(1.0 - left, from, at);
            }
            if left > 0.0 {
                part(left, at + self.jump, self.to);
            }
            return;
        }
        let count = (change / resolution).ceil().min(MOST_PIECES);
        let value = |x: f64| from + x * (to - from + (1.0 - x) * bow);
        let jump_at = 1.0 - left;
        let (mut x, mut before) = (0.0, from);
        while x < 1.0 - 1e-12 {
            let mut end = ((x * count + 1e-9).floor() + 1.0) / count;
            let crosses = self.jump != 0.0 && x < jump_at && end >= jump_at;
            if crosses {
                end = jump_at;
            }
            let jumped = if self.jump != 0.0 && end > jump_at { self.jump } else { 0.0 };
            let now = value(end) + jumped;
            part(end - x, before, now);
            (x, before) = (end, if crosses { now + self.jump } else { now });
        }
    }
}

/// Most parts of a step.
const MOST_PIECES: f64 = 16.0;

/// When within a step the command changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Arrival {
    /// At once, with this share of the step left until the sample, from 0 to below 1.
    Held {
        /// Share of the step between arrival and sample.
        left: f64,
    },
    /// All through the step.
    Ramp,
}

impl Arrival {
    /// Share of the step that a jump lasts.
    #[inline]
    pub fn left(self) -> f64 {
        match self {
            Self::Held { left } => left,
            Self::Ramp => 0.0,
        }
    }
}

/// What a block may look at besides its own signal, at one sample.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Current at the static curve [A]; in the stages before it, the block's own input.
    pub current_a: f64,
    /// Oil temperature [degC]; NaN where it is not recorded.
    pub oil_temp_c: f64,
    /// Supply pressure [bar]; NaN where it is not recorded.
    pub supply_bar: f64,
    /// The pressure that was read at the first sample of the run [bar]; NaN where none was. Only where a block starts does it count.
    pub begins_bar: f64,
}

impl Point {
    /// With nothing recorded besides the current.
    #[inline]
    pub fn current(current_a: f64) -> Self {
        Self { current_a, oil_temp_c: f64::NAN, supply_bar: f64::NAN, begins_bar: f64::NAN }
    }
}

/// What blocks may look at besides their own signal, over a whole recording.
#[derive(Debug, Clone, Copy)]
pub struct Signals<'a> {
    /// The command; behind the stages of the current, the current at the static curve [A].
    pub current_a: &'a [f64],
    /// Oil temperature [degC], where recorded.
    pub oil_temp_c: Option<&'a [f64]>,
    /// Supply pressure [bar], where recorded.
    pub supply_bar: Option<&'a [f64]>,
    /// The pressure that was read at the first sample [bar]; NaN where none was.
    pub begins_bar: f64,
}

impl<'a> Signals<'a> {
    /// With nothing recorded besides the current.
    pub fn current(current_a: &'a [f64]) -> Self {
        Self { current_a, oil_temp_c: None, supply_bar: None, begins_bar: f64::NAN }
    }

    /// What is known at sample `k`.
    #[inline]
    pub fn at(&self, k: usize) -> Point {
        let of = |channel: Option<&[f64]>| channel.map_or(f64::NAN, |c| c[k]);
        Point {
            current_a: self.current_a[k],
            oil_temp_c: of(self.oil_temp_c),
            supply_bar: of(self.supply_bar),
            begins_bar: self.begins_bar,
        }
    }

    /// What is known at some of the samples.
    pub fn part(&self, samples: std::ops::Range<usize>) -> Self {
        let of = |channel: &'a [f64]| &channel[samples.clone()];
        let begins_bar = if samples.start == 0 { self.begins_bar } else { f64::NAN };
        Self { current_a: of(self.current_a), oil_temp_c: self.oil_temp_c.map(of), supply_bar: self.supply_bar.map(of), begins_bar }
    }

    /// The same with another current.
    pub fn with_current<'b>(&self, current_a: &'b [f64]) -> Signals<'b>
    where
        'a: 'b,
    {
        Signals { current_a, ..*self }
    }
}

/// Steps of a signal, one after the other.
#[derive(Debug)]
pub struct Courses<'a> {
    /// Values at the samples.
    pub to: &'a mut [f64],
    /// Means over the steps.
    pub mean: &'a mut [f64],
    /// Jumps within the steps.
    pub jump: &'a mut [f64],
}
