//! One valve on the bench: a sweep, a commissioning drive and two drives, and the same of its healthy twin.

use rayon::prelude::*;

use super::case::{Case, Concealed};
use super::chance::{stream, uniform};
use super::controller::Controller;
use super::excitation::{self, Drive};
use super::plant::Plant;
use super::specimen::Specimen;
use crate::recording::Run;

/// The recordings of one valve.
#[derive(Debug, Clone)]
pub struct Session {
    /// Slow sweep in open loop, to identify the valve from.
    pub sweep: Run,
    /// A lively drive of the healthy valve, 120 s; none where the effects were there when the valve was calibrated.
    pub commission: Option<Run>,
    /// The drive to diagnose.
    pub record: Run,
    /// A second drive of the same valve, 100 s of everything, to score on.
    pub holdout: Run,
}

/// A session of the valve of a case, and of the healthy twin: same valve, same drives, same noise, nothing concealed.
pub fn record_session(case: &Case) -> (Session, Session) {
    let specimen = case.specimen();
    let while_calibrated: &[Concealed] = if case.absorbed { &case.effects } else { &[] };
    let none: &[Concealed] = &[];
    let jobs = [(while_calibrated, 0), (none, 3), (&case.effects, 1), (&case.effects, 2), (none, 0), (none, 1), (none, 2)];
    let runs: Vec<Run> = jobs.into_par_iter().map(|(effects, run)| one_run(case, &specimen, effects, run)).collect();
    let mut runs = runs.into_iter();
    let mut next = || runs.next().unwrap_or_default();
    let (sweep, commission, record, holdout) = (next(), next(), next(), next());
    let twin = Session { sweep: next(), commission: Some(commission.clone()), record: next(), holdout: next() };
    (Session { sweep, commission: (!case.absorbed).then_some(commission), record, holdout }, twin)
}

/// Number of the run that is diagnosed.
const RECORD: u64 = 1;

/// What is commanded in a run of the case, before any controller: 0 the sweep, 1 the record, 2 the second drive, 3 the
/// commissioning drive.
fn wanted(case: &Case, run: u64) -> Vec<f64> {
    let (period_s, rng) = (1.0 / case.rate_hz, &mut stream(case.seed, 10 + run));
    match run {
        0 => excitation::sweep(period_s),
        RECORD => excitation::drive(case.drive, rng, case.length_s, period_s),
        2 => excitation::drive(Drive::Mixed, rng, 100.0, period_s),
        _ => excitation::drive(Drive::Mixed, rng, 120.0, period_s),
    }
}

fn one_run(case: &Case, specimen: &Specimen, effects: &[Concealed], run: u64) -> Run {
    let (wanted, period_s) = (wanted(case, run), 1.0 / case.rate_hz);
    let mut plant = Plant::new(specimen, effects, case.seed, run, wanted[0], period_s);
    let Some(controller) = case.controller.filter(|_| run != 0) else {
        return open_loop(&wanted, &mut plant, case.rate_hz);
    };
    let time_s = (0..wanted.len()).map(|k| digits(k as f64 / case.rate_hz, 4)).collect();
    let target: Vec<f64> = wanted.iter().map(|i| digits(specimen.curve.pressure(*i), 3)).collect();
    let (current_a, pressure) = closed_loop(case, controller, &target, &mut plant, wanted[0]);
    Run { time_s, current_a, pressure_bar: Some(pressure), target_bar: Some(target), ..Run::default() }
}

/// The pressure [bar] of the record of a case with given effects under the currents of the open loop, with those
/// currents; the noise is that of the case whatever is concealed.
pub(super) fn in_open_loop(case: &Case, effects: &[Concealed]) -> (Vec<f64>, Vec<f64>) {
    let currents = wanted(case, RECORD);
    let pressure = sampled(&currents, &mut Plant::new(&case.specimen(), effects, case.seed, RECORD, currents[0], 1.0 / case.rate_hz));
    (currents, pressure)
}

/// What was planted in a case with a parameter that means the same in a library of effects: id, name, value.
pub(super) fn planted(case: &Case) -> Vec<(&'static str, &'static str, f64)> {
    Plant::new(&case.specimen(), &case.effects, case.seed, RECORD, 0.3, 1.0 / case.rate_hz).planted().to_vec()
}

/// Number of the run in which an experiment is driven.
const EXPERIMENT: u64 = 4;
/// Before an experiment the valve rests at its first current for so long [s].
const SETTLES_S: f64 = 5.0;

/// The valve of a case along the points (time [s], current [A]) of an experiment that was asked for, in open loop.
pub(super) fn record_experiment(case: &Case, points: &[(f64, f64)]) -> Run {
    let (period_s, end_s) = (1.0 / case.rate_hz, points.last().map_or(0.0, |p| p.0));
    let count = ((SETTLES_S + end_s) * case.rate_hz) as usize;
    let current_a: Vec<f64> = (0..count).map(|k| along(points, k as f64 * period_s - SETTLES_S).clamp(0.05, 1.05)).collect();
    let start_a = current_a.first().copied().unwrap_or_default();
    open_loop(&current_a, &mut Plant::new(&case.specimen(), &case.effects, case.seed, EXPERIMENT, start_a, period_s), case.rate_hz)
}

/// The value at a time of straight lines between points.
fn along(points: &[(f64, f64)], at_s: f64) -> f64 {
    let next = points.partition_point(|p| p.0 <= at_s);
    match (next.checked_sub(1).map(|k| points[k]), points.get(next)) {
        (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (at_s - a.0) / (b.0 - a.0),
        (before, after) => before.or(after.copied()).map_or(0.0, |end| end.1),
    }
}

/// The sweep of the healthy valve.
pub(super) fn healthy_sweep(case: &Case) -> Run {
    one_run(case, &case.specimen(), &[], 0)
}

/// A plant along currents in open loop, as a recording.
pub(super) fn open_loop(currents: &[f64], plant: &mut Plant, rate_hz: f64) -> Run {
    let time_s = (0..currents.len()).map(|k| digits(k as f64 / rate_hz, 4)).collect();
    let current_a: Vec<f64> = currents.iter().map(|i| digits(*i, 5)).collect();
    let pressure = sampled(&current_a, plant);
    Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() }
}

/// The sample of a row is taken when its command is sent, so before the command can act.
fn sampled(current_a: &[f64], plant: &mut Plant) -> Vec<f64> {
    let mut measured = plant.period(current_a[0]);
    current_a
        .iter()
        .map(|i| {
            let now = measured;
            measured = plant.period(*i);
            now
        })
        .collect()
}

/// The currents that a controller sends along a target, and the samples that it sees.
fn closed_loop(case: &Case, controller: Controller, target: &[f64], plant: &mut Plant, start_a: f64) -> (Vec<f64>, Vec<f64>) {
    let (specimen, period_s, rng) = (case.specimen(), 1.0 / case.rate_hz, &mut stream(case.seed, 20));
    // a slow loop cannot be as quick as one of 100 Hz
    let slower = (0.03 / (0.02 + period_s)).min(1.0);
    let (kp, ki) = (slower * uniform(rng, 0.001, 0.003), slower * uniform(rng, 0.008, 0.025));
    let (gain, offset) = (uniform(rng, 0.985, 1.015), uniform(rng, -0.006, 0.006));
    let behind = ((specimen.delay_s / period_s).round() as usize) + 1;
    let (mut integral, mut rising) = (0.0_f64, true);
    let mut measured = plant.period(start_a);
    let (mut currents, mut pressures) = (Vec::with_capacity(target.len()), Vec::with_capacity(target.len()));
    for (k, goal) in target.iter().enumerate() {
        let before = target[k.saturating_sub(1)];
        if *goal != before {
            rising = *goal > before;
        }
        let error = target[k.saturating_sub(behind)] - measured;
        let command = match controller {
            Controller::FeedForwardPi => {
                let ahead = gain * Plant::feed_forward(&specimen, *goal, rising) + offset;
                if *goal > 6.0 {
                    integral = (integral + ki * error * period_s).clamp(-0.15, 0.15);
                    ahead + kp * error + integral
                } else {
                    integral = 0.0;
                    ahead
                }
            }
            Controller::Pi => {
                integral = (integral + 6.0 * ki * error * period_s).clamp(-0.5, 0.5);
                specimen.curve.current(12.0) + (goal - 12.0) / specimen.curve.steepest() + 1.5 * kp * error + integral
            }
            Controller::ThreeStep => {
                if error.abs() > 0.4 {
                    integral = (integral + (0.02 * slower * period_s).copysign(error)).clamp(-0.15, 0.15);
                }
                gain * specimen.curve.current(*goal) + offset + integral
            }
        };
        let current = digits(command.clamp(0.05, 1.05), 5);
        currents.push(current);
        pressures.push(measured);
        measured = plant.period(current);
    }
    (currents, pressures)
}

/// What the file holds is what the valve was given.
fn digits(value: f64, places: i32) -> f64 {
    let scale = 10.0_f64.powi(places);
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::super::draw::placed;
    use super::*;

    #[test]
    fn twin_and_valve_differ_only_by_what_is_concealed() {
        let case = Case { controller: Some(Controller::FeedForwardPi), ..placed(8, Vec::new()) };
        let (valve, twin) = record_session(&case);
        assert_eq!(valve.record, twin.record);
        assert_eq!(valve.holdout, twin.holdout);
        assert_eq!((valve.sweep.len(), valve.record.len(), valve.holdout.len()), (20_000, 12_000, 10_000));
    }

    #[test]
    fn an_experiment_is_driven_on_the_concealed_valve_along_its_points() {
        let points = [(0.0, 0.3), (2.0, 0.7), (2.01, 0.4), (4.0, 0.4)];
        for (t, current) in [(-1.0, 0.3), (1.0, 0.5), (2.005, 0.55), (3.0, 0.4), (9.0, 0.4)] {
            assert!((along(&points, t) - current).abs() < 1e-9, "{t}");
        }
        let leak = vec![Concealed { id: "leakage", variant: 0, severity: 1.0 }];
        let (faulty, healthy) = (record_experiment(&placed(8, leak), &points), record_experiment(&placed(8, Vec::new()), &points));
        assert_eq!((faulty.len(), &faulty.current_a), (900, &healthy.current_a));
        assert_ne!(faulty.pressure_bar, healthy.pressure_bar);
    }

    #[test]
    fn a_closed_loop_follows_its_target() {
        for controller in [Controller::FeedForwardPi, Controller::Pi, Controller::ThreeStep] {
            let case = Case { controller: Some(controller), ..placed(21, Vec::new()) };
            let (valve, _) = record_session(&case);
            let (p, goal) = (valve.record.pressure_bar.unwrap_or_default(), valve.record.target_bar.unwrap_or_default());
            let mean = p.iter().zip(&goal).map(|(a, b)| (a - b).abs()).sum::<f64>() / p.len() as f64;
            assert!(mean < 1.2, "{controller:?} {mean}");
        }
    }
}
