//! A whole recording made ready, and how that is asked for.

use std::ops::Range;

use super::noise::Noise;
use super::run::{Run, between};
use crate::recording::{Recording, Selection};
use crate::valve::{Input, Valve};

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
    pub(super) apart: Option<(String, String)>,
}

impl Course {
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
        self.runs.iter().reduce(|best, run| if run.len() > best.len() { run } else { best }).expect("a course holds at least one run")
    }
}
