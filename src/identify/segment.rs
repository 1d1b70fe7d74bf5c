//! What the fit works on: stretches of a recording with gaps held, outliers marked and a start of their own.

use crate::recording::Run;

/// A gap longer than this many steps holds the current instead of drawing a line through it.
const GAP_STEPS: f64 = 3.0;

/// A stretch that is simulated from its own start.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    /// Name of the run.
    pub run: Option<String>,
    /// Time [s].
    pub time_s: Vec<f64>,
    /// Current, held where it was not recorded [A].
    pub current_a: Vec<f64>,
    /// Measured pressure [bar]; NaN where it was not recorded.
    pub pressure_bar: Vec<f64>,
    /// Weight of each sample in the fit, 0 where it is left out.
    pub weight: Vec<f64>,
    /// Pressure measured at the start [bar].
    pub start_bar: f64,
    /// Median step [s].
    pub step_s: f64,
    /// Whether all steps are equal.
    uniform: bool,
}

impl Segment {
    /// A segment from a part of a run; `None` where current and pressure never stand side by side in it.
    pub fn from_run(run: &Run, part: std::ops::Range<usize>) -> Option<Self> {
        let (current, pressure) = (&run.current_a[part.clone()], &run.pressure_bar.as_ref()?[part.clone()]);
        let first = current.iter().zip(pressure).position(|(i, p)| i.is_finite() && p.is_finite())?;
        let time_s = run.time_s[part][first..].to_vec();
        let mut current_a = current[first..].to_vec();
        let mut held = current_a[0];
        for i in &mut current_a {
            if i.is_finite() {
                held = *i;
            } else {
                *i = held;
            }
        }
        let step_s = median_step(&time_s);
        Some(Self::new(run.name.clone(), time_s, current_a, pressure[first..].to_vec(), step_s))
    }

    fn new(run: Option<String>, time_s: Vec<f64>, current_a: Vec<f64>, pressure_bar: Vec<f64>, step_s: f64) -> Self {
        let uniform = time_s.windows(2).all(|w| ((w[1] - w[0]) - step_s).abs() <= 1e-4 * step_s);
        let weight = pressure_bar.iter().map(|p| if p.is_finite() { 1.0 } else { 0.0 }).collect();
        let mut first: Vec<f64> = pressure_bar.iter().copied().filter(|p| p.is_finite()).take(5).collect();
        first.sort_by(f64::total_cmp);
        let start_bar = first.get(first.len() / 2).copied().unwrap_or(0.0);
        Self { run, time_s, current_a, pressure_bar, weight, start_bar, step_s, uniform }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// The current `delay_s` earlier, on a line between the samples, held over gaps and before the start.
    pub fn delayed(&self, delay_s: f64, out: &mut [f64]) {
        let n = self.len();
        let current = &self.current_a;
        if self.uniform && self.step_s > 0.0 {
            let steps = (delay_s / self.step_s).max(0.0);
            let whole = (steps.floor() as usize).min(n);
            let part = steps - steps.floor();
            out[..(whole + 1).min(n)].fill(current[0]);
            if whole < n {
                out[whole] = current[0];
                for (k, o) in out.iter_mut().enumerate().skip(whole + 1) {
                    let later = current[k - whole];
                    *o = later + part * (current[k - whole - 1] - later);
                }
            }
            return;
        }
        let mut j = 0;
        for (k, o) in out.iter_mut().enumerate().take(n) {
            let t = self.time_s[k] - delay_s;
            while j + 1 < n && self.time_s[j + 1] <= t {
                j += 1;
            }
            *o = if j + 1 >= n || t <= self.time_s[0] {
                current[j]
            } else {
                let to = self.time_s[j + 1];
                let from = if to - self.time_s[j] > GAP_STEPS * self.step_s { to - self.step_s } else { self.time_s[j] };
                let share = ((t - from) / (to - from)).clamp(0.0, 1.0);
                current[j] + share * (current[j + 1] - current[j])
            };
        }
    }

    /// A first-order lag of time constant `lag_s` over `values`, in place, settled at the first: exact for an input
    /// that is linear over each step, as the current is.
    pub fn lagged(&self, lag_s: f64, values: &mut [f64]) {
        if lag_s <= 0.0 {
            return;
        }
        let Some((first, rest)) = values.split_first_mut() else { return };
        let (mut before, mut y) = (*first, *first);
        let (mut step, mut decay, mut mean) = (f64::NAN, 0.0, 0.0);
        for (value, t) in rest.iter_mut().zip(self.time_s.windows(2)) {
            let h = if self.uniform { self.step_s } else { t[1] - t[0] };
            if h != step {
                let ratio = h / lag_s;
                (step, decay, mean) = (h, (-ratio).exp(), -(-ratio).exp_m1() / ratio);
            }
            let now = *value;
            y = decay * y + ((mean - decay) * before + (1.0 - mean) * now);
            before = now;
            *value = y;
        }
    }
}

/// Median step [s]; 0 for fewer than two times.
fn median_step(time_s: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(time_s: Vec<f64>, current_a: Vec<f64>) -> Segment {
        let n = time_s.len();
        let run = Run { time_s, current_a, pressure_bar: Some(vec![1.0; n]), ..Run::default() };
        Segment::from_run(&run, 0..n).unwrap()
    }

    #[test]
    fn a_ramp_is_delayed_by_a_fraction_of_a_step() {
        let s = segment((0..20).map(|k| k as f64 * 0.01).collect(), (0..20).map(|k| k as f64).collect());
        let mut out = vec![0.0; 20];
        s.delayed(0.0125, &mut out);
        assert_eq!(out[0], 0.0);
        assert!((out[10] - 8.75).abs() < 1e-9, "{out:?}");
        // The same run with one step that differs takes the general way.
        let mut uneven = s.clone();
        uneven.uniform = false;
        let mut general = vec![0.0; 20];
        uneven.delayed(0.0125, &mut general);
        for (a, b) in out.iter().zip(&general).skip(2) {
            assert!((a - b).abs() < 1e-9, "{out:?} {general:?}");
        }
        assert!((general[1] - 0.0).abs() < 1e-12 && (general[2] - 0.75).abs() < 1e-9);
    }

    #[test]
    fn the_current_is_held_over_a_gap() {
        let s = segment(vec![0.0, 0.01, 0.02, 0.03, 5.0, 5.01], vec![1.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
        let mut out = vec![0.0; 6];
        s.delayed(0.02, &mut out);
        assert_eq!(out[4], 1.0);
        s.delayed(0.005, &mut out);
        assert!((out[4] - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_lag_reaches_the_known_share_of_a_step_after_its_time_constant() {
        let s = segment((0..200).map(|k| k as f64 * 0.001).collect(), vec![0.5; 200]);
        let mut values = vec![1.0; 200];
        values[0] = 0.0;
        s.lagged(0.05, &mut values);
        // The input rises over the first step, so the answer is that of a step at its middle but for second order.
        let expected = |at_s: f64| 1.0 - (-at_s / 0.05f64).exp();
        assert!((values[50] - expected(0.0495)).abs() < 1e-5, "{}", values[50]);
    }
}
