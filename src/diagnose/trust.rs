//! Where a model is to be trusted less: behind movements, as data of the good valve shows.
//!
//! What a model of few lines lacks of a good valve shows where the pressure moves: the valve overshoots, fills, lags in another
//! way. At rest the same model may be right to the noise. So the error that data of the good valve leaves is not one number
//! but one for each liveliness, and a record's error weighs by it: a fault that shows at rest is not excused by what the model lacks in
//! movement, and what it lacks in movement is not taken for a fault.

use std::ops::Range;

use super::evidence::{Evidence, rms};
use crate::course::Run;
use crate::valve::Valve;

/// Time over which the current has to have moved the pressure to count as a movement [s],
const OVER_S: f64 = 0.1;
/// and by which the memory of it fades: twenty to one within three times as long.
const FADES_S: f64 = 0.25;
/// A class of liveliness needs this many readings, over so long a time [s]: a single movement, sampled however often, tells little. One
/// that has fewer goes with the next livelier one.
const FEWEST: usize = 50;
const FEWEST_S: f64 = 1.0;
/// Classes are apart by this factor of the movement.
const APART: f64 = 2.0;
/// Most classes.
const MOST: i32 = 8;
/// Between the quietest class and the liveliest the error must grow by this factor: less is no reason to weigh.
const GROWS: f64 = 2.0;

/// How far a model is off where nothing is wrong, by how much it has moved.
#[derive(Debug, Clone)]
pub struct Trust {
    valve: Valve,
    /// From which movement on [bar], and the error there [bar]; both rising, the first from zero.
    classes: Vec<(f64, f64)>,
}

impl Trust {
    /// What the residual of the good valve's model says; nothing where it is about the same everywhere.
    pub fn of(valve: &Valve, evidence: &Evidence, residual: &[f64]) -> Option<Self> {
        let moved = movements(valve, evidence);
        let liveliest = moved.iter().copied().fold(0.0, f64::max);
        let mut classes: Vec<(f64, f64)> = Vec::new();
        let mut begin = 0.0;
        for octave in (0..MOST).rev() {
            // The quietest class begins at rest, and the liveliest has no end.
            let to = if octave == 0 { f64::INFINITY } else { liveliest * APART.powi(-octave) };
            if let Some(error) = of_class(evidence, &moved, residual, begin..to) {
                let floor = classes.last().map_or(0.0, |c| c.1);
                classes.push((begin, error.max(floor)));
                begin = to;
            }
        }
        let grows = classes.first().zip(classes.last()).is_some_and(|(quiet, lively)| quiet.1 > 0.0 && lively.1 > GROWS * quiet.1);
        grows.then(|| Self { valve: valve.clone(), classes })
    }

    /// What a reading of each sample weighs: 1 where the model is as good as at rest.
    pub fn weights(&self, evidence: &Evidence) -> Vec<f64> {
        let at_rest = self.classes[0].1;
        let error = |m: &f64| self.classes.iter().rev().find(|c| c.0 <= *m).map_or(at_rest, |c| c.1);
        movements(&self.valve, evidence).iter().map(|m| at_rest / error(m)).collect()
    }

    /// How many times as far as it was off where nothing is wrong a model is off in the class where that is most: all readings
    /// together hide what shows behind a few movements.
    pub fn beyond(&self, evidence: &Evidence, residual: &[f64]) -> f64 {
        let moved = movements(&self.valve, evidence);
        let ends = self.classes.iter().skip(1).map(|c| c.0).chain([f64::INFINITY]);
        let ratio = |((from, error), to): (&(f64, f64), f64)| of_class(evidence, &moved, residual, *from..to).map(|off| off / error);
        self.classes.iter().zip(ends).filter_map(ratio).fold(0.0, f64::max)
    }
}

/// RMS of the residual where the pressure has moved so far [bar]; nothing where there are too few readings.
fn of_class(evidence: &Evidence, moved: &[f64], residual: &[f64], class: Range<f64>) -> Option<f64> {
    let readings: Vec<f64> = moved.iter().zip(residual).filter(|(m, e)| e.is_finite() && class.contains(m)).map(|r| *r.1).collect();
    let fewest = FEWEST.max((FEWEST_S / evidence.step_s()) as usize);
    (readings.len() >= fewest).then(|| rms(&readings))
}

/// By how much the current has lately moved the pressure, at each sample of all runs [bar].
fn movements(valve: &Valve, evidence: &Evidence) -> Vec<f64> {
    evidence.grids.iter().flat_map(|run| of_run(valve, run)).collect()
}

fn of_run(valve: &Valve, run: &Run) -> Vec<f64> {
    let goal: Vec<f64> = run.current_a.iter().map(|i| valve.curves.average_at(*i)).collect();
    let every = ((OVER_S / run.dt_s).round() as usize).max(1);
    let late = (valve.delay_s / run.dt_s).round() as usize;
    let keeps = (-run.dt_s / FADES_S).exp();
    let mut recent = 0.0;
    let lately: Vec<f64> = (0..goal.len())
        .map(|k| {
            let moved = (goal[k] - goal[k.saturating_sub(every)]).abs();
            recent = f64::max(recent * keeps, moved);
            recent
        })
        .collect();
    // From where the current moves until its effect, a delay later, has faded.
    (0..lately.len()).map(|k| f64::max(lately[k], lately[k.saturating_sub(late)])).collect()
}

#[cfg(test)]
mod tests {
    use super::super::evidence::tests::{held, straight, straight_run};
    use super::*;

    /// A step of 0.2 A every five seconds.
    fn steps(samples: usize) -> Vec<f64> {
        (0..samples).map(|k| if (k / 500) % 2 == 0 { 0.3 } else { 0.5 }).collect()
    }

    #[test]
    fn a_model_that_is_off_behind_steps_alone_is_trusted_at_rest() {
        let error = |k: usize, _: f64| if k % 500 < 30 { 1.0 } else { 0.02 * if k.is_multiple_of(2) { 1.0 } else { -1.0 } };
        let evidence = held(vec![straight_run(steps(6000), error)]);
        let residual: Vec<f64> = (0..6000).map(|k| error(k, 0.0)).collect();
        let weights = Trust::of(&straight(), &evidence, &residual).unwrap().weights(&evidence);
        assert!(weights[505] < 0.1, "{}", weights[505]);
        assert!((weights[900] - 1.0).abs() < 1e-9, "{}", weights[900]);
        assert!(weights.iter().all(|w| *w > 0.0 && *w <= 1.0));
    }

    #[test]
    fn what_is_off_behind_a_few_movements_shows_though_all_readings_hide_it() {
        let error =
            |size: f64| move |k: usize, _: f64| if k % 500 < 30 { size } else { 0.05 * if k.is_multiple_of(2) { 1.0 } else { -1.0 } };
        let evidence = held(vec![straight_run(steps(6000), error(0.3))]);
        let residual = |size: f64| -> Vec<f64> { (0..6000).map(|k| error(size)(k, 0.0)).collect() };
        let trust = Trust::of(&straight(), &evidence, &residual(0.3)).unwrap();
        assert!((trust.beyond(&evidence, &residual(0.3)) - 1.0).abs() < 0.2, "{}", trust.beyond(&evidence, &residual(0.3)));
        assert!(trust.beyond(&evidence, &residual(0.9)) > 2.0, "{}", trust.beyond(&evidence, &residual(0.9)));
    }

    #[test]
    fn a_model_that_is_off_everywhere_alike_is_weighed_nowhere() {
        let evidence = held(vec![straight_run(steps(6000), |_, _| 0.0)]);
        let residual: Vec<f64> = (0..6000).map(|k| if k % 2 == 0 { 0.3 } else { -0.3 }).collect();
        assert!(Trust::of(&straight(), &evidence, &residual).is_none());
    }
}
