//! A model over a recording that is made ready: what every command that compares the two sees.

use super::error::PhysicsError;
use super::finite::blame;
use super::pipeline::Pipeline;
use super::signal::Signals;
use crate::course::{Course, Run};
use crate::valve::Valve;

/// Simulates every run of a course from its own start: the pressure [bar] at each sample of its grid.
///
/// # Errors
/// [`PhysicsError`] where an effect of the valve is not known, or the simulation leaves the numbers: it names the sample
/// and the effect.
pub fn simulate_course(valve: &Valve, course: &Course) -> Result<Vec<Vec<f64>>, PhysicsError> {
    let pipeline = Pipeline { input: course.input, ..Pipeline::of(valve)? };
    let mut work = Vec::new();
    let mut out = Vec::with_capacity(course.runs.len());
    for run in &course.runs {
        let signals = signals(run);
        let mut pressure = Vec::new();
        pipeline.run(run.elapsed_s, run.dt_s, &signals, &mut work, &mut pressure);
        if let Some(sample) = pressure.iter().position(|p| !p.is_finite()) {
            return Err(blame(&pipeline, (run.elapsed_s, run.dt_s), &signals, sample).at_clock(run.time_s(sample), run.name.as_deref()));
        }
        out.push(pressure);
    }
    Ok(out)
}

/// One of so many readings at the begin of a run tells at which pressure it began.
const FIRST: usize = 3;

/// What a run brings for a simulation.
pub fn signals(run: &Run) -> Signals<'_> {
    Signals {
        current_a: &run.current_a,
        oil_temp_c: run.oil_temp_c.as_deref(),
        supply_bar: run.supply_bar.as_deref(),
        begins_bar: run.pressure_bar.iter().copied().take(FIRST).find(|p| p.is_finite()).unwrap_or(f64::NAN),
    }
}

/// How far a simulation is from the readings, over all of them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Misfit {
    /// Sum of squares [bar^2].
    pub squares_bar2: f64,
    /// Readings that were compared.
    pub readings: usize,
}

impl Misfit {
    /// Of what was simulated on the grid of a run: each reading is compared where it was taken.
    pub fn of(run: &Run, simulated_bar: &[f64]) -> Self {
        let mut at_readings = simulated_bar.to_vec();
        run.at_readings(&mut at_readings);
        let errors = at_readings.iter().zip(&run.pressure_bar).filter(|(_, p)| p.is_finite()).map(|(s, p)| s - p);
        errors.fold(Self::default(), |sum, e| Self { squares_bar2: sum.squares_bar2 + e * e, readings: sum.readings + 1 })
    }

    /// Of two stretches together.
    pub fn and(self, other: Self) -> Self {
        Self { squares_bar2: self.squares_bar2 + other.squares_bar2, readings: self.readings + other.readings }
    }

    /// Root mean square [bar]; `None` without readings.
    pub fn rmse_bar(self) -> Option<f64> {
        (self.readings > 0).then(|| (self.squares_bar2 / self.readings as f64).sqrt())
    }
}
