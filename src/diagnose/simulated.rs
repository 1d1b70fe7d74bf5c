//! A pressure that the user's own simulation gave for the recorded current, in place of a model.

use super::foreign::Plant;
use crate::course::Run;
use crate::recording::Recording;

/// How far beyond its ends a simulation is believed, in samples of the recording.
const BEYOND: f64 = 1.5;
/// RMS difference of two currents, over their span, above which one was not simulated from the other.
const SAME: f64 = 0.02;

/// The simulated pressure of each recorded run.
#[derive(Debug)]
pub struct Simulated {
    runs: Vec<Series>,
}

#[derive(Debug)]
struct Series {
    name: Option<String>,
    time_s: Vec<f64>,
    pressure_bar: Vec<f64>,
    current_a: Vec<f64>,
}

impl Simulated {
    /// The pressure of this recording, run by run.
    ///
    /// # Errors
    /// In words, where it holds no pressure.
    pub fn of(simulated: Recording) -> Result<Self, String> {
        let source = simulated.source;
        let runs: Vec<Series> = simulated
            .runs
            .into_iter()
            .filter_map(|run| {
                let pressure = run.pressure_bar?;
                let keep: Vec<usize> = (0..run.time_s.len()).filter(|k| pressure[*k].is_finite()).collect();
                let of = |values: &[f64]| keep.iter().filter_map(|k| values.get(*k).copied()).collect::<Vec<f64>>();
                Some(Series { name: run.name, time_s: of(&run.time_s), pressure_bar: of(&pressure), current_a: of(&run.current_a) })
            })
            .filter(|series| series.time_s.len() > 1)
            .collect();
        if runs.is_empty() { Err(format!("{source}: holds no simulated pressure")) } else { Ok(Self { runs }) }
    }

    fn series(&self, run: &Run) -> Result<&Series, String> {
        let named = self.runs.iter().find(|s| s.name.is_some() && s.name == run.name);
        named.or_else(|| self.runs.get(run.origin.run)).ok_or_else(|| {
            let name = run.name.clone().unwrap_or_else(|| format!("number {}", run.origin.run + 1));
            format!("holds no simulated pressure of run {name}")
        })
    }
}

impl Series {
    fn at(&self, values: &[f64], time_s: f64) -> f64 {
        let next = self.time_s.partition_point(|t| *t <= time_s).clamp(1, self.time_s.len() - 1);
        let (from_s, to_s) = (self.time_s[next - 1], self.time_s[next]);
        let part = ((time_s - from_s) / (to_s - from_s).max(1e-300)).clamp(0.0, 1.0);
        values[next - 1] + part * (values[next] - values[next - 1])
    }
}

impl Plant for Simulated {
    fn pressure(&self, run: &Run, _: &[f64]) -> Result<Vec<f64>, String> {
        let series = self.series(run)?;
        let (first, last) = (series.time_s[0], series.time_s[series.time_s.len() - 1]);
        let (begin, end) = (run.time_s(0), run.time_s(run.len().saturating_sub(1)));
        if first > begin + BEYOND * run.dt_s || last < end - BEYOND * run.dt_s {
            return Err(format!("was simulated from {first:.3} s to {last:.3} s, the recording goes from {begin:.3} s to {end:.3} s"));
        }
        let at = |values: &[f64]| (0..run.len()).map(|k| series.at(values, run.time_s(k))).collect::<Vec<f64>>();
        if series.current_a.len() == series.time_s.len() {
            let theirs = at(&series.current_a);
            let (low, high) = run.current_a.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), i| (l.min(*i), h.max(*i)));
            let both = || theirs.iter().zip(&run.current_a).filter(|(a, _)| a.is_finite());
            let apart = (both().map(|(a, b)| (a - b).powi(2)).sum::<f64>() / both().count().max(1) as f64).sqrt();
            if apart > SAME * (high - low) {
                return Err(format!("was simulated for another current, {apart:.3} A RMS apart from the recorded one"));
            }
        }
        Ok(at(&series.pressure_bar))
    }

    fn runs_again(&self) -> bool {
        false
    }
}
