//! What the fit works on: stretches of a course with outliers marked and a start of their own.

use super::arrival::Arrival;
use crate::course::Run;
use crate::valve::Input;

/// A stretch that is simulated from its own start.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    /// Number of the recording that it comes from.
    pub source: usize,
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

/// The shortest time step of some segments [s]: recordings of one valve may have rates of their own, and the delay shows
/// within the shortest step.
pub(super) fn shortest_step_s<'s>(segments: impl IntoIterator<Item = &'s Segment>) -> f64 {
    segments.into_iter().map(|s| s.step_s).fold(f64::INFINITY, f64::min)
}

impl Segment {
    /// A segment from a part of a run, from its first reading on; `None` where it holds none.
    pub fn from_run(source: usize, run: &Run, part: std::ops::Range<usize>) -> Option<Self> {
        let first = part.start + run.pressure_bar[part.clone()].iter().position(|p| p.is_finite())?;
        let part = first..part.end;
        let pressure_bar = run.pressure_bar[part.clone()].to_vec();
        let weight = pressure_bar.iter().map(|p| if p.is_finite() { 1.0 } else { 0.0 }).collect();
        let mut begin: Vec<f64> = pressure_bar.iter().copied().filter(|p| p.is_finite()).take(5).collect();
        begin.sort_by(f64::total_cmp);
        Some(Self {
            source,
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

    /// When a command reaches the valve after a dead time.
    pub fn arrival(&self, delay_s: f64, input: Input) -> Arrival {
        Arrival::new(delay_s / self.step_s, input)
    }

    /// The current `delay_s` earlier, held before the start.
    pub fn delayed(&self, delay_s: f64, input: Input, out: &mut [f64]) {
        self.arrival(delay_s, input).apply(&self.current_a, out);
    }

    /// Takes a simulated pressure to the times of the readings, in place.
    pub fn at_readings(&self, simulated: &mut [f64]) {
        if let Some(run) = &self.laid {
            run.at_readings(simulated);
        }
    }

    /// A first-order lag of time constant `lag_s` over the pressures of the arrived command, in place; it stands
    /// `before_bar` above the first at the start.
    pub fn lagged(&self, lag_s: f64, before_bar: f64, arrival: Arrival, values: &mut [f64]) {
        if lag_s > 0.0 {
            arrival.lag(self.step_s / lag_s, before_bar, values);
        }
    }
}
