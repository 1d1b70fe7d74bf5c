//! When a command reaches the valve: held from message to message or on straight lines, a dead time later that need not be
//! a whole number of samples.

use crate::valve::Input;

/// A part of a step that is rounding: a delay so near to whole steps is whole.
const ROUNDING: f64 = 1e-9;

/// A dead time on a grid of even steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Arrival {
    /// Whole steps.
    shift: usize,
    /// Share of the sample one step older, for a command on straight lines.
    older: f64,
    /// Share of a step that is left between the arrival of a held command and the next sample; `None` on straight lines.
    left: Option<f64>,
}

impl Arrival {
    /// A dead time of `steps` samples.
    pub fn new(steps: f64, input: Input) -> Self {
        let steps = steps.max(0.0);
        match input {
            Input::Held => {
                let whole = (steps - ROUNDING).ceil().max(0.0);
                Self { shift: whole as usize, older: 0.0, left: Some((whole - steps).max(0.0)) }
            }
            Input::Ramp => Self { shift: steps.floor() as usize, older: steps - steps.floor(), left: None },
        }
    }

    /// The command later by the whole steps; before its begin it stood at its first value. The corners of straight lines arrive so at the
    /// curves, which remember them; see [`Arrival::read_between`].
    pub fn apply(self, current_a: &[f64], out: &mut [f64]) {
        let n = current_a.len().min(out.len());
        let Some(first) = current_a.first() else { return };
        out[..(self.shift + 1).min(n)].fill(*first);
        if self.shift + 1 < n {
            out[self.shift + 1..n].copy_from_slice(&current_a[1..n - self.shift]);
        }
    }

    /// Later by what the whole steps leave, in place; a held command leaves nothing.
    pub fn read_between(self, values: &mut [f64]) {
        if self.older > 0.0 {
            let mut before = values.first().copied().unwrap_or_default();
            for value in values {
                let now = std::mem::replace(&mut before, *value);
                *value += self.older * (now - *value);
            }
        }
    }

    /// A first-order lag over the pressure of the arrived command, in place, exact between the samples: `ratio` is the step
    /// over the time constant, and the lag stands `before_bar` above the pressure that belongs to the first sample.
    pub fn lag(self, ratio: f64, before_bar: f64, values: &mut [f64]) {
        let Some((first, rest)) = values.split_first_mut() else { return };
        let (decay, old, new) = self.weights(ratio);
        let mut from = *first;
        let mut y = from + before_bar;
        *first = y;
        for value in rest {
            let to = *value;
            y = decay * y + (old * from + new * to);
            from = to;
            *value = y;
        }
    }

    /// What a lag keeps of its value over a step, and the weights of the pressure at the begin and the end of the step.
    fn weights(self, ratio: f64) -> (f64, f64, f64) {
        let decay = (-ratio).exp();
        match self.left {
            Some(left) => {
                let since = (-left * ratio).exp();
                (decay, since - decay, -(-left * ratio).exp_m1())
            }
            None if ratio > 0.0 => {
                let mean = -(-ratio).exp_m1() / ratio;
                (decay, mean - decay, 1.0 - mean)
            }
            None => (1.0, 0.0, 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same by a thousand small steps per sample.
    fn fine(input: Input, steps: f64, ratio: f64, current: &[f64], k: usize) -> f64 {
        const FINE: usize = 1000;
        let at = |t: f64| {
            let t = t.clamp(0.0, (current.len() - 1) as f64);
            let j = (t + 1e-9).floor();
            match input {
                Input::Held => current[j as usize],
                Input::Ramp => current[j as usize] + (t - j) * (current[(j as usize + 1).min(current.len() - 1)] - current[j as usize]),
            }
        };
        let h = 1.0 / FINE as f64;
        (0..k * FINE).fold(current[0], |y, n| {
            let u = at((n as f64 + 0.5) * h - steps);
            u + (y - u) * (-ratio * h).exp()
        })
    }

    #[test]
    fn delay_and_lag_are_those_of_a_fine_solution_for_both_inputs() {
        for input in [Input::Held, Input::Ramp] {
            // On lines the way from one read sample to the next is taken as straight, so that what turns at every sample is smoothed.
            let current: Vec<f64> = match input {
                Input::Held => (0..60).map(|k| f64::from((k * 7919) % 13)).collect(),
                Input::Ramp => (0..60).map(|k| 6.0 * (0.157 * f64::from(k)).sin()).collect(),
            };
            for (steps, ratio) in [(2.37, 1.0), (2.0, 0.3), (0.4, 3.0)] {
                let arrival = Arrival::new(steps, input);
                let mut out = vec![0.0; current.len()];
                arrival.apply(&current, &mut out);
                arrival.read_between(&mut out);
                arrival.lag(ratio, 0.0, &mut out);
                for k in [10, 31, 59] {
                    let exact = fine(input, steps, ratio, &current, k);
                    assert!((out[k] - exact).abs() < 0.02, "{input:?} {steps} {ratio} {k}: {} {exact}", out[k]);
                }
            }
        }
    }
}
