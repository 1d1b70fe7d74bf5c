//! A recording made ready to be compared with a model, once for every command.
//!
//! A [`Course`] holds runs on even time grids of their own, the noise of the readings, and what was noticed on the way.
//! Identification, simulation, diagnosis and their pages look at a recording through it alone, so that all of them speak
//! of the same samples. The rules, each in one place: what a gap is (`split`), which grid (`grid`), how large the noise is
//! (`noise`), what carries nothing (`refuse`). docs/recordings.md tells them to users.

mod error;
mod grid;
mod noise;
mod prepare;
mod refuse;
mod split;

use std::ops::Range;

pub use crate::recording::Selection;
pub use error::CourseError;
pub use noise::Noise;

use crate::recording::Recording;
pub use crate::valve::Input;
use crate::valve::Valve;

/// How a recording is made ready.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Preparation {
    /// What the command does between its samples, where that is known.
    pub input: Option<Input>,
    /// What of the recording counts.
    pub selection: Selection,
}

impl Preparation {
    /// For a comparison with a model: a recording that does not state its input has that of the recordings which the model was
    /// identified from, as its delay counts from there.
    pub fn for_model(recording: &Recording, valve: &Valve) -> Self {
        let input = recording.input.or(valve.identification.as_ref().and_then(|i| i.input));
        Self { input, ..Self::default() }
    }
}

/// A recording made ready: runs on even grids, noise, notes.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// Name of the recording, for messages.
    pub source: String,
    /// The runs in the order of the recording; one that a long gap splits is several.
    pub runs: Vec<Run>,
    /// The noise of the readings.
    pub noise: Noise,
    /// What the command does between its samples.
    pub input: Input,
    /// Whether the input was stated; otherwise it is the convention, and what the data show goes before it.
    pub input_stated: bool,
    /// What was handled on the way, those of the recording first.
    pub notes: Vec<String>,
    /// When the current and when the pressure was recorded, where they have no time in common.
    apart: Option<(String, String)>,
}

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
    offset_steps: Option<Vec<f32>>,
}

/// The samples of a recording that a run is made of.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Origin {
    /// Number of the recorded run.
    pub run: usize,
    /// Its samples.
    pub samples: Range<usize>,
}

impl Course {
    /// Makes a recording ready.
    ///
    /// Nothing is refused here that a simulation can use; what a comparison needs is asked for by [`Course::carries`].
    ///
    /// # Errors
    /// [`CourseError`] where the command is never recorded, or the selection leaves nothing.
    pub fn of(recording: &Recording, preparation: &Preparation) -> Result<Self, CourseError> {
        prepare::course(recording.clone(), preparation)
    }

    /// As [`Course::of`], for a recording that nobody needs any more: its samples are moved, not copied.
    ///
    /// # Errors
    /// As [`Course::of`].
    pub fn take(recording: Recording, preparation: &Preparation) -> Result<Self, CourseError> {
        prepare::course(recording, preparation)
    }

    /// Refuses what no model can be compared with: no pressure, nothing in common, a current or a pressure that stands
    /// still, fewer than `fewest` readings.
    ///
    /// # Errors
    /// [`CourseError`] with the first of these that holds.
    pub fn carries(&self, fewest: usize) -> Result<(), CourseError> {
        refuse::carries(self, fewest)
    }

    /// Samples of all grids.
    pub fn samples(&self) -> usize {
        self.runs.iter().map(Run::len).sum()
    }

    /// Readings of the pressure in all.
    pub fn readings(&self) -> usize {
        self.runs.iter().map(Run::readings).sum()
    }

    /// Where the samples of each run stand in columns of all runs one after the other.
    pub fn ranges(&self) -> Vec<Range<usize>> {
        let mut end = 0;
        self.runs
            .iter()
            .map(|run| {
                let begin = end;
                end += run.len();
                begin..end
            })
            .collect()
    }

    /// The readings of all runs, one after the other [bar]; NaN where there is none.
    pub fn pressure_bar(&self) -> Vec<f64> {
        self.runs.iter().flat_map(|run| run.pressure_bar.iter().copied()).collect()
    }

    /// Smallest and largest command [A].
    pub fn current_range_a(&self) -> (f64, f64) {
        let all = self.runs.iter().flat_map(|run| run.current_a.iter().copied());
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), i| (low.min(i), high.max(i)))
    }

    /// What was simulated on the grids of all runs, at the times of recorded run number `number`. Where the command is not
    /// known, before the first and in long gaps, the simulation stands still.
    pub fn on_recorded(&self, number: usize, time_s: &[f64], simulated: &[Vec<f64>]) -> Vec<f64> {
        let mut parts = self.runs.iter().zip(simulated).filter(|(run, _)| run.origin.run == number).peekable();
        let mut out = Vec::with_capacity(time_s.len());
        while let Some((run, values)) = parts.next() {
            let end = parts.peek().map_or(time_s.len(), |(next, _)| next.origin.samples.start);
            let from = out.len();
            if (from..end) == run.origin.samples {
                out.extend(run.at_times(values, &time_s[from..end]));
            } else {
                out.extend(time_s[from..end].iter().map(|t| between(values, (t - run.start_s) / run.dt_s)));
            }
        }
        out
    }

    /// The longest run, which a judgement on one run's worth of samples looks at.
    pub fn longest(&self) -> &Run {
        self.runs.iter().reduce(|best, run| if run.len() > best.len() { run } else { best }).unwrap_or(&self.runs[0])
    }
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
fn between(values: &[f64], place: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    let place = place.clamp(0.0, last as f64);
    let before = (place as usize).min(last.saturating_sub(1));
    let (from, to) = (values[before], values[(before + 1).min(last)]);
    let share = place - before as f64;
    if share == 0.0 { from } else { from + share * (to - from) }
}

#[cfg(test)]
mod tests;
