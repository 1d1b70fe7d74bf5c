//! A dead time that need not be a whole number of samples.

use super::signal::Arrival;
use crate::valve::Input;

/// A part of a step that is rounding: a delay so near to whole steps is whole.
const ROUNDING: f64 = 1e-9;

/// A dead time on a grid: which sample of the command has arrived, and when within the step.
///
/// A held command arrives at once, one delay after its message, and is seen by the first sample that is not before
/// that. A command on straight lines is read between its samples; ahead of what remembers where it turned it goes on by whole
/// steps, so that its corners arrive, and what stands behind is read between the samples ([`Delay::read_between`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delay {
    /// Whole steps.
    shift: usize,
    /// Share of the sample one step older; 0 for a held command.
    older: f64,
    /// When within a step the command changes.
    pub arrival: Arrival,
}

impl Delay {
    /// A dead time of `delay_s` at steps of `dt_s`.
    pub fn new(delay_s: f64, dt_s: f64, input: Input) -> Self {
        let steps = (delay_s / dt_s).max(0.0);
        match input {
            Input::Held => {
                let whole = (steps - ROUNDING).ceil().max(0.0);
                Self { shift: whole as usize, older: 0.0, arrival: Arrival::Held { left: (whole - steps).max(0.0) } }
            }
            Input::Ramp => {
                let whole = steps.floor();
                Self { shift: whole as usize, older: steps - whole, arrival: Arrival::Ramp }
            }
        }
    }

    /// The whole signal `input`, later by the whole steps, into `output`; before its begin it stood at its first value.
    pub fn shift(&self, input: &[f64], output: &mut Vec<f64>) {
        output.clear();
        let Some(first) = input.first().copied() else { return };
        let n = input.len();
        output.resize((self.shift + 1).min(n), first);
        if self.shift + 1 < n {
            output.extend_from_slice(&input[1..n - self.shift]);
        }
    }

    /// Later by what the whole steps leave, in place; a held command leaves nothing.
    pub fn read_between(&self, values: &mut [f64]) {
        if self.older > 0.0 {
            let mut before = values.first().copied().unwrap_or_default();
            for value in values {
                let now = std::mem::replace(&mut before, *value);
                *value += self.older * (now - *value);
            }
        }
    }
}

/// The same one sample at a time.
#[derive(Debug, Clone)]
pub struct DelayLine {
    delay: Delay,
    past: Vec<f64>,
    next: usize,
}

impl DelayLine {
    /// A line that has stood at `value`.
    pub fn new(delay: Delay, value: f64) -> Self {
        Self { delay, past: vec![value; delay.shift + 2], next: 0 }
    }

    /// Output at the next sample of the input.
    #[inline]
    pub fn step(&mut self, input: f64) -> f64 {
        let n = self.past.len();
        self.past[self.next] = input;
        let late = self.past[(self.next + n - self.delay.shift) % n];
        let later = self.past[(self.next + n - self.delay.shift - 1) % n];
        self.next = (self.next + 1) % n;
        late + self.delay.older * (later - late)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_whole_and_the_stepwise_delay_agree_and_a_ramp_is_late_by_the_delay() {
        let ramp: Vec<f64> = (0..50).map(f64::from).collect();
        for seconds in [0.0, 0.004, 0.01, 0.0237, 0.2, 0.49, 0.5, 3.0] {
            for input in [Input::Ramp, Input::Held] {
                let delay = Delay::new(seconds, 0.01, input);
                let mut out = Vec::new();
                delay.shift(&ramp, &mut out);
                delay.read_between(&mut out);
                assert_eq!(out.len(), ramp.len());
                let mut line = DelayLine::new(delay, ramp[0]);
                for (k, value) in out.iter().enumerate() {
                    assert!((line.step(ramp[k]) - value).abs() < 1e-12);
                    let late = match input {
                        Input::Ramp => k as f64 - seconds / 0.01,
                        Input::Held => (k as f64 - seconds / 0.01 + 1e-9).floor(),
                    };
                    assert!((value - late.max(0.0)).abs() < 1e-9, "{seconds} {k} {value}");
                }
            }
        }
    }

    #[test]
    fn a_held_command_arrives_within_the_step_when_its_delay_is_over() {
        let left = |seconds| Delay::new(seconds, 0.01, Input::Held).arrival.left();
        assert!((left(0.0237) - 0.63).abs() < 1e-9);
        assert!((left(0.02) - 0.0).abs() < 1e-6 && (left(0.03) - 0.0).abs() < 1e-6);
    }
}
