//! One run on an even grid, and what was simulated on it at the times of its readings.

use std::ops::Range;

use crate::valve::Input;

/// One run on an even grid, simulated from its own start.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Run {
    /// Its name, that of the recorded run also where a gap has split it; `None` where the file holds one nameless run.
    pub name: Option<String>,
    /// Where it comes from.
    pub origin: Origin,
    /// Time of the first sample by the recording's clock [s]: for words and drawings, never for a simulation.
    pub start_s: f64,
    /// Time from the begin of the recorded run to the first sample [s]: 0 but behind a gap. A simulation counts from here.
    pub elapsed_s: f64,
    /// Time step [s].
    pub dt_s: f64,
    /// Command at each sample [A]; always finite. For [`Input::Held`] its mean until the next sample.
    pub current_a: Vec<f64>,
    /// Measured pressure [bar], each reading at the sample of the grid that is next to it; NaN where there is none.
    pub pressure_bar: Vec<f64>,
    /// Oil temperature [degC] at each sample, on lines between its readings, where recorded.
    pub oil_temp_c: Option<Vec<f64>>,
    /// Supply pressure [bar] at each sample, on lines between its readings, where recorded.
    pub supply_bar: Option<Vec<f64>>,
    /// How far each reading lies behind its sample [steps]; `None` where all lie on the grid.
    pub(super) offset_steps: Option<Vec<f32>>,
}

/// The samples of a recording that a run is made of.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Origin {
    /// Number of the recorded run.
    pub run: usize,
    /// Its samples.
    pub samples: Range<usize>,
}

impl Run {
    /// A run on an even grid, every reading on it.
    pub fn even(name: Option<String>, start_s: f64, dt_s: f64, current_a: Vec<f64>, pressure_bar: Vec<f64>) -> Self {
        let origin = Origin { run: 0, samples: 0..current_a.len() };
        Self { name, origin, start_s, dt_s, current_a, pressure_bar, ..Self::default() }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.current_a.len()
    }

    /// Whether it holds no sample.
    pub fn is_empty(&self) -> bool {
        self.current_a.is_empty()
    }

    /// Number of readings.
    pub fn readings(&self) -> usize {
        self.pressure_bar.iter().filter(|p| p.is_finite()).count()
    }

    /// Time of sample `k` by the recording's clock [s].
    pub fn time_s(&self, k: usize) -> f64 {
        self.start_s + k as f64 * self.dt_s
    }

    /// Time of the reading at sample `k` by the recording's clock [s].
    pub fn reading_s(&self, k: usize) -> f64 {
        self.time_s(k) + self.offset_steps.as_ref().map_or(0.0, |o| f64::from(o[k])) * self.dt_s
    }

    /// Whether every reading stands on the grid.
    pub fn is_on_grid(&self) -> bool {
        self.offset_steps.is_none()
    }

    /// Takes what was simulated on the grid to the times of the readings, in place: a reading is compared with the
    /// simulation where it was taken, and nothing measured is ever interpolated.
    pub fn at_readings(&self, simulated: &mut [f64]) {
        let Some(offsets) = &self.offset_steps else { return };
        let on_grid = simulated.to_vec();
        for (k, (value, offset)) in simulated.iter_mut().zip(offsets).enumerate() {
            if *offset != 0.0 {
                *value = between(&on_grid, k as f64 + f64::from(*offset));
            }
        }
    }

    /// What was simulated on the grid at the times of the recorded samples that the run is made of; these are given by
    /// the recording's clock [s].
    pub fn at_times(&self, simulated: &[f64], time_s: &[f64]) -> Vec<f64> {
        if self.offset_steps.is_none() && time_s.len() == simulated.len() {
            return simulated.to_vec();
        }
        time_s.iter().map(|t| between(simulated, (t - self.start_s) / self.dt_s)).collect()
    }

    /// The run on a grid that is `every` times as coarse: one reading of each new step, where it was taken, and the command
    /// by its convention.
    pub fn thinned(&self, every: usize, input: Input) -> Self {
        let every = every.max(1);
        let mut offsets = Vec::new();
        let mut pressure_bar = Vec::new();
        for step in self.pressure_bar.chunks(every) {
            let place = step.iter().position(|p| p.is_finite()).unwrap_or(0);
            let at = offsets.len() * every + place;
            let behind = place as f32 + self.offset_steps.as_ref().map_or(0.0, |o| o[at]);
            pressure_bar.push(step[place]);
            offsets.push(behind / every as f32);
        }
        let first = |values: &Vec<f64>| values.iter().copied().step_by(every).collect::<Vec<f64>>();
        let current_a = match input {
            Input::Held => self.current_a.chunks(every).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect(),
            Input::Ramp => first(&self.current_a),
        };
        Self {
            name: self.name.clone(),
            origin: self.origin.clone(),
            dt_s: self.dt_s * every as f64,
            current_a,
            pressure_bar,
            oil_temp_c: self.oil_temp_c.as_ref().map(first),
            supply_bar: self.supply_bar.as_ref().map(first),
            offset_steps: offsets.iter().any(|o| *o != 0.0).then_some(offsets),
            ..*self
        }
    }

    /// A part of the run, as a run of its own.
    pub fn part(&self, samples: Range<usize>) -> Self {
        let cut = |values: &Option<Vec<f64>>| values.as_ref().map(|v| v[samples.clone()].to_vec());
        Self {
            name: self.name.clone(),
            origin: self.origin.clone(),
            start_s: self.time_s(samples.start),
            elapsed_s: self.elapsed_s + samples.start as f64 * self.dt_s,
            dt_s: self.dt_s,
            current_a: self.current_a[samples.clone()].to_vec(),
            pressure_bar: self.pressure_bar[samples.clone()].to_vec(),
            oil_temp_c: cut(&self.oil_temp_c),
            supply_bar: cut(&self.supply_bar),
            offset_steps: self.offset_steps.as_ref().map(|o| o[samples.clone()].to_vec()),
        }
    }
}

/// The value at a place between samples, on a straight line; beyond the ends the end values.
pub(super) fn between(values: &[f64], place: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    let place = place.clamp(0.0, last as f64);
    let before = (place as usize).min(last.saturating_sub(1));
    let (from, to) = (values[before], values[(before + 1).min(last)]);
    let share = place - before as f64;
    if share == 0.0 { from } else { from + share * (to - from) }
}
