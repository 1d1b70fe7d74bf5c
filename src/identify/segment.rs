//! What the fit works on: stretches of a course with outliers marked and a start of their own.

use crate::course::Run;

/// A stretch that is simulated from its own start.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    /// Name of the run.
    pub run: Option<String>,
    /// Time of each reading [s].
    pub time_s: Vec<f64>,
    /// Current [A].
    pub current_a: Vec<f64>,
    /// Measured pressure [bar]; NaN where it was not recorded.
    pub pressure_bar: Vec<f64>,
    /// Weight of each sample in the fit, 0 where it is left out.
    pub weight: Vec<f64>,
    /// Pressure measured at the start [bar].
    pub start_bar: f64,
    /// Time step [s].
    pub step_s: f64,
    /// Where the readings stand beside the grid.
    laid: Option<Run>,
}

impl Segment {
    /// A segment from a part of a run, from its first reading on; `None` where it holds none.
    pub fn from_run(run: &Run, part: std::ops::Range<usize>) -> Option<Self> {
        let first = part.start + run.pressure_bar[part.clone()].iter().position(|p| p.is_finite())?;
        let part = first..part.end;
        let pressure_bar = run.pressure_bar[part.clone()].to_vec();
        let weight = pressure_bar.iter().map(|p| if p.is_finite() { 1.0 } else { 0.0 }).collect();
        let mut begin: Vec<f64> = pressure_bar.iter().copied().filter(|p| p.is_finite()).take(5).collect();
        begin.sort_by(f64::total_cmp);
        Some(Self {
            run: run.name.clone(),
            time_s: part.clone().map(|k| run.reading_s(k)).collect(),
            current_a: run.current_a[part.clone()].to_vec(),
            pressure_bar,
            weight,
            start_bar: begin[begin.len() / 2],
            step_s: run.dt_s,
            laid: (!run.is_on_grid()).then(|| run.part(part)),
        })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// The current `delay_s` earlier, on a line between the samples, held over gaps and before the start.
    pub fn delayed(&self, delay_s: f64, out: &mut [f64]) {
        let n = self.len();
        let current = &self.current_a;
        let steps = (delay_s / self.step_s).max(0.0);
        let whole = (steps.floor() as usize).min(n);
        let part = steps - steps.floor();
        out[..(whole + 1).min(n)].fill(current[0]);
        for (k, o) in out.iter_mut().enumerate().take(n).skip(whole + 1) {
            let later = current[k - whole];
            *o = later + part * (current[k - whole - 1] - later);
        }
    }

    /// Takes a simulated pressure to the times of the readings, in place.
    pub fn at_readings(&self, simulated: &mut [f64]) {
        if let Some(run) = &self.laid {
            run.at_readings(simulated);
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
        let ratio = self.step_s / lag_s;
        let (decay, mean) = ((-ratio).exp(), -(-ratio).exp_m1() / ratio);
        for value in rest {
            let now = *value;
            y = decay * y + ((mean - decay) * before + (1.0 - mean) * now);
            before = now;
            *value = y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(step_s: f64, current_a: Vec<f64>) -> Segment {
        let n = current_a.len();
        Segment::from_run(&Run::even(None, 0.0, step_s, current_a, vec![1.0; n]), 0..n).unwrap()
    }

    #[test]
    fn a_ramp_is_delayed_by_a_fraction_of_a_step() {
        let s = segment(0.01, (0..20).map(|k| k as f64).collect());
        let mut out = vec![0.0; 20];
        s.delayed(0.0125, &mut out);
        assert_eq!((out[0], out[1]), (0.0, 0.0));
        assert!((out[2] - 0.75).abs() < 1e-9 && (out[10] - 8.75).abs() < 1e-9, "{out:?}");
    }

    #[test]
    fn a_lag_reaches_the_known_share_of_a_step_after_its_time_constant() {
        let s = segment(0.001, vec![0.5; 200]);
        let mut values = vec![1.0; 200];
        values[0] = 0.0;
        s.lagged(0.05, &mut values);
        // The input rises over the first step, so the answer is that of a step at its middle but for second order.
        let expected = |at_s: f64| 1.0 - (-at_s / 0.05f64).exp();
        assert!((values[50] - expected(0.0495)).abs() < 1e-5, "{}", values[50]);
    }
}
