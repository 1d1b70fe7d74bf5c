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

/// The median of so many readings tells at which pressure a run began: a spoilt one does not,
const FIRST: usize = 3;
/// nor do those that are missing, where others come within this time [s].
const FIRST_S: f64 = 0.1;

/// The pressure at which a run began [bar]; NaN where nothing was read then.
fn begins_bar(run: &Run) -> f64 {
    let soon = FIRST.max((FIRST_S / run.dt_s) as usize);
    let mut first: Vec<f64> = run.pressure_bar.iter().copied().take(soon).filter(|p| p.is_finite()).take(FIRST).collect();
    first.sort_by(f64::total_cmp);
    first.get(first.len() / 2).copied().unwrap_or(f64::NAN)
}

/// What a run brings for a simulation.
pub fn signals(run: &Run) -> Signals<'_> {
    Signals {
        current_a: &run.current_a,
        oil_temp_c: run.oil_temp_c.as_deref(),
        supply_bar: run.supply_bar.as_deref(),
        begins_bar: begins_bar(run),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neither_a_spoilt_nor_a_missing_reading_hides_at_which_pressure_a_run_began() {
        let gap = f64::NAN;
        let begins = |read: &[f64]| signals(&Run::even(None, 0.0, 0.01, vec![0.5; read.len()], read.to_vec())).begins_bar;
        assert_eq!(begins(&[10.0, 10.1, 9.9, 3.0]), 10.0);
        assert_eq!(begins(&[0.1, 10.0, 10.2]), 10.0);
        assert_eq!(begins(&[gap, gap, gap, 10.0, gap, 9.9, 9.8]), 9.9);
        assert_eq!(begins(&[10.0]), 10.0);
        assert!(begins(&[]).is_nan() && begins(&[[gap; 20].as_slice(), &[10.0]].concat()).is_nan());
    }
}
