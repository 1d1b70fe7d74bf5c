//! What the fits of a diagnosis look at: the runs of a course and its noise.

use super::criteria::Criteria;
use super::error::DiagnoseError;
use super::foreign::{Base, Foreign};
use super::remembered::Remembered;
use crate::course::{Course, CourseError, Input, Preparation, Run};
use crate::physics::{Channel, MOST_INNER, Sampling};
use crate::process_loop::SLOW_STEP_S;
use crate::recording::Recording;
use crate::valve::Valve;

/// Fewest usable samples in all.
pub const FEWEST_SAMPLES: usize = 200;

/// Noise of a recording without any [bar].
const LEAST_NOISE_BAR: f64 = 1e-6;
/// A current that moves for less than this share of the time rests mostly,
const RESTS: f64 = 0.05;
/// where it moves by this share of its range in a second, seen over a time step no shorter than that [s].
const MOVES: f64 = 0.1;
const STEP_S: f64 = 0.01;

/// Start between the two curves where nothing is known of it.
pub const MIDDLE: f64 = 0.5;

/// All that a fit looks at.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The runs, each simulated from its own start.
    pub grids: Vec<Run>,
    /// Standard deviation of a reading about the pressure [bar].
    pub noise_bar: f64,
    /// What the command does between its samples.
    pub input: Input,
    /// Most inner steps of a sample in a simulation.
    pub most_inner: usize,
    /// Whether a slow recording shows a controller at work: what its valve does is then told by the loop as a whole.
    pub controlled: bool,
    /// What was noticed.
    pub notes: Vec<String>,
    /// Where between its curves the valve stands at first, for each run: 0 ascending, 1 descending; the middle where it is soon
    /// forgotten.
    pub start_shares: Vec<f64>,
    /// The foreign model that is the base, where there is one.
    pub base: Option<Base>,
    /// The thresholds of all that is decided by it.
    pub criteria: Criteria,
    /// Fits that are remembered beyond this diagnosis; none for most.
    pub remembered: Option<Remembered>,
}

impl Evidence {
    /// Runs as they are, each from a start of which nothing is known, simulated as finely as their physics asks for.
    pub fn new(grids: Vec<Run>, noise_bar: f64, input: Input) -> Self {
        let start_shares = vec![MIDDLE; grids.len()];
        Self {
            grids,
            noise_bar,
            input,
            most_inner: MOST_INNER,
            controlled: false,
            notes: Vec::new(),
            start_shares,
            base: None,
            criteria: Criteria::default(),
            remembered: None,
        }
    }

    /// Takes a recording that is made ready.
    ///
    /// # Errors
    /// [`CourseError`] where it cannot carry a diagnosis: no pressure, a constant current, too short.
    pub fn of(course: Course) -> Result<Self, CourseError> {
        match course.carries(FEWEST_SAMPLES) {
            // A pressure that stands still or shows noise alone is an answer of a diagnosis: they do not belong together.
            Err(CourseError::ConstantPressure { .. }) => {}
            carries => carries?,
        }
        // What nothing at all disturbs would make every trifle evidence without end.
        let noise_bar = course.noise.bar.max(LEAST_NOISE_BAR);
        Ok(Self { notes: course.notes, ..Self::new(course.runs, noise_bar, course.input) })
    }

    /// Takes a recording as it is made ready for this model.
    ///
    /// # Errors
    /// As [`Evidence::of`]; also where the recording cannot be made ready.
    pub fn read(recording: &Recording, valve: &Valve) -> Result<Self, CourseError> {
        Self::of(Course::of(recording, &Preparation::for_model(recording, valve))?)
    }

    /// From now on a foreign model is the base; the valve that stands for it.
    ///
    /// # Errors
    /// [`DiagnoseError::Foreign`] where the model refuses.
    pub fn about(&mut self, foreign: &Foreign) -> Result<Valve, DiagnoseError> {
        let (base, valve, notes) = Base::on(&self.grids, foreign)?;
        self.notes.extend(notes);
        self.base = Some(base);
        Ok(valve)
    }

    /// This evidence with other runs, each with where the valve stands at first, simulated in at most so many inner steps.
    pub fn of_runs(&self, (grids, start_shares): (Vec<Run>, Vec<f64>), most_inner: usize) -> Self {
        Self { grids, start_shares, most_inner, notes: Vec::new(), base: None, remembered: self.remembered.clone(), ..*self }
    }

    /// Whether this channel was recorded and moved, so that an effect that follows it can be told from a constant.
    pub fn moves(&self, channel: Channel) -> bool {
        let (values, least): (Vec<f64>, f64) = match channel {
            Channel::OilTemperature => (self.grids.iter().filter_map(|g| g.oil_temp_c.as_ref()).flatten().copied().collect(), 3.0),
            Channel::SupplyPressure => (self.grids.iter().filter_map(|g| g.supply_bar.as_ref()).flatten().copied().collect(), 0.5),
        };
        let finite = values.iter().filter(|v| v.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        high - low > least
    }

    /// Whether the current hardly moves most of the time: steps, and slow sweeps.
    pub fn rests_mostly(&self) -> bool {
        let all = || self.grids.iter().flat_map(|g| g.current_a.iter());
        let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), i| (l.min(*i), h.max(*i)));
        let (mut moves, mut of) = (0, 0);
        for run in &self.grids {
            // However finely it is sampled: from one reading to the next, a thousandth of a second later, nothing moves much.
            let every = ((STEP_S / run.dt_s).round() as usize).max(1);
            let least_a = MOVES * (high - low) * every as f64 * run.dt_s;
            let thinned: Vec<f64> = run.current_a.iter().copied().step_by(every).collect();
            moves += thinned.windows(2).filter(|w| (w[1] - w[0]).abs() > least_a).count();
            of += thinned.len();
        }
        (moves as f64) < RESTS * of as f64
    }

    /// Whether the samples are too far apart for a valve's dynamics, so that a process behind the valve is what they show.
    pub fn is_slow(&self) -> bool {
        self.step_s() >= SLOW_STEP_S
    }

    /// Time step of the longest run [s].
    pub fn step_s(&self) -> f64 {
        self.longest().1.dt_s
    }

    /// The longest run, and where it stands among the samples of all runs.
    pub fn longest(&self) -> (std::ops::Range<usize>, &Run) {
        self.runs()
            .into_iter()
            .zip(&self.grids)
            .reduce(|best, next| if next.0.len() > best.0.len() { next } else { best })
            .expect("a course holds at least one run")
    }

    /// What stands for each sample of all runs, parted into those runs that have the step of the longest; each with its time on the
    /// clock of the recording [s].
    pub fn parts<'v>(&self, values: &'v [f64]) -> Vec<(f64, &'v [f64])> {
        let step_s = self.step_s();
        let mut rest = values;
        let mut parts = Vec::with_capacity(self.grids.len());
        for grid in &self.grids {
            let (own, others) = rest.split_at(grid.len());
            if (grid.dt_s - step_s).abs() < 1e-9 {
                parts.push((grid.elapsed_s, own));
            }
            rest = others;
        }
        parts
    }

    /// How it is sampled, all runs together.
    pub fn sampling(&self) -> Sampling {
        let ends = self.grids.iter().map(|g| (g.elapsed_s, g.elapsed_s + g.len() as f64 * g.dt_s));
        let (from, to) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (from, to)| (a.min(from), b.max(to)));
        Sampling { length_s: to - from, step_s: self.step_s() }
    }

    /// Samples in all, used or not.
    pub fn samples(&self) -> usize {
        self.grids.iter().map(|g| g.current_a.len()).sum()
    }

    /// Share of the readings that are the same as the one before.
    pub fn repeats(&self) -> f64 {
        let pairs = || self.grids.iter().flat_map(|g| g.pressure_bar.windows(2)).filter(|w| w[0].is_finite() && w[1].is_finite());
        pairs().filter(|w| w[0] == w[1]).count() as f64 / pairs().count().max(1) as f64
    }

    /// The currents of all runs, one after the other.
    pub fn current_a(&self) -> Vec<f64> {
        self.grids.iter().flat_map(|g| g.current_a.iter().copied()).collect()
    }

    /// Where each run stands among the samples of all.
    pub fn runs(&self) -> Vec<std::ops::Range<usize>> {
        let mut end = 0;
        let placed = self.grids.iter().map(|run| {
            let begin = end;
            end += run.len();
            begin..end
        });
        placed.collect()
    }

    /// The measured pressures of all runs, one after the other.
    pub fn pressure_bar(&self) -> Vec<f64> {
        self.grids.iter().flat_map(|g| g.pressure_bar.iter().copied()).collect()
    }
}

/// Root mean square of what is finite.
pub fn rms(values: &[f64]) -> f64 {
    let (sum, n) = values.iter().filter(|e| e.is_finite()).fold((0.0, 0usize), |(s, n), e| (s + e * e, n + 1));
    (sum / n.max(1) as f64).sqrt()
}

/// What the tests of several files look at: a valve of one straight line, and runs of it.
#[cfg(test)]
pub mod tests {
    use super::*;

    /// A valve of 20 bar/A without hysteresis, delay or lag.
    pub fn straight() -> Valve {
        let text = "schema = \"hil.valve/1\"\nname = \"test\"\ncurrent_limits = [\"0 A\", \"1 A\"]\nhysteresis = \"none\"\n\
                    [curve]\nascending = [20.0, 0.0]\ndescending = [20.0, 0.0]\n";
        Valve::from_toml(text, "test").unwrap()
    }

    /// A run of it in steps of 10 ms whose readings are off by `error_bar`, at a sample and its current.
    pub fn straight_run(current_a: Vec<f64>, error_bar: impl Fn(usize, f64) -> f64) -> Run {
        let pressure = current_a.iter().enumerate().map(|(k, i)| 20.0 * i + error_bar(k, *i)).collect();
        Run::even(None, 0.0, 0.01, current_a, pressure)
    }

    /// A slow current between 0.2 A and 0.8 A.
    pub fn waves(samples: usize) -> Vec<f64> {
        (0..samples).map(|k| 0.5 + 0.3 * (0.02 * k as f64).sin()).collect()
    }

    /// Runs of held commands with a noise of 20 mbar.
    pub fn held(grids: Vec<Run>) -> Evidence {
        Evidence::new(grids, 0.02, Input::Held)
    }

    #[test]
    fn a_current_rests_mostly_or_does_not_however_often_it_is_sampled() {
        let rests = |rate_hz: f64, current_a: &dyn Fn(f64) -> f64| {
            let current_a: Vec<f64> = (0..(60.0 * rate_hz) as usize).map(|k| current_a(k as f64 / rate_hz)).collect();
            held(vec![Run::even(None, 0.0, 1.0 / rate_hz, current_a.clone(), current_a)]).rests_mostly()
        };
        let ramps = |half_s: f64| move |t_s: f64| 0.2 + 0.6 * (1.0 - ((t_s / half_s) % 2.0 - 1.0).abs());
        for rate_hz in [50.0, 100.0, 1000.0, 5000.0] {
            assert!(rests(rate_hz, &|t_s| if ((t_s / 5.0) as usize).is_multiple_of(2) { 0.3 } else { 0.6 }), "steps at {rate_hz} Hz");
            assert!(rests(rate_hz, &ramps(30.0)), "a slow sweep at {rate_hz} Hz");
            assert!(!rests(rate_hz, &ramps(3.0)), "a lively one at {rate_hz} Hz");
        }
    }
}
