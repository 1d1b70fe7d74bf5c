//! One valve on the bench: a sweep and two drives, and the same of its healthy twin.

use rayon::prelude::*;

use super::draw::{Case, Concealed};
use super::excitation;
use super::plant::Plant;
use super::specimen::{PERIOD_S, Specimen, stream, uniform};
use crate::recording::Run;

/// The recordings of one valve.
#[derive(Debug, Clone)]
pub struct Session {
    /// Slow sweep in open loop, to identify the valve from.
    pub sweep: Run,
    /// The drive to diagnose, 120 s.
    pub record: Run,
    /// A second drive of the same valve, 100 s, to score on.
    pub holdout: Run,
}

/// A session of the valve of a case, and of the healthy twin: same valve, same drives, same noise, nothing concealed.
pub fn record_session(case: &Case) -> (Session, Session) {
    let specimen = Specimen::draw(case.seed);
    let while_calibrated: &[Concealed] = if case.absorbed { &case.effects } else { &[] };
    let jobs: [(&[Concealed], u64); 6] = [(while_calibrated, 0), (&case.effects, 1), (&case.effects, 2), (&[], 0), (&[], 1), (&[], 2)];
    let mut runs: Vec<Run> = jobs.into_par_iter().map(|(effects, run)| one_run(case, &specimen, effects, run)).collect();
    let twin = runs.split_off(3);
    let session = |runs: Vec<Run>| {
        let mut runs = runs.into_iter();
        let mut next = || runs.next().unwrap_or_default();
        Session { sweep: next(), record: next(), holdout: next() }
    };
    (session(runs), session(twin))
}

fn one_run(case: &Case, specimen: &Specimen, effects: &[Concealed], run: u64) -> Run {
    let wanted = match run {
        0 => excitation::sweep(),
        _ => excitation::drive(&mut stream(case.seed, 10 + run), if run == 1 { 120.0 } else { 100.0 }),
    };
    let mut plant = Plant::new(specimen, effects, case.seed, run, wanted[0]);
    let time_s = (0..wanted.len()).map(|k| k as f64 / 100.0).collect();
    if run == 0 || !case.closed {
        let current_a: Vec<f64> = wanted.iter().map(|i| digits(*i, 5)).collect();
        let pressure = sampled(&current_a, &mut plant);
        return Run { time_s, current_a, pressure_bar: Some(pressure), ..Run::default() };
    }
    let target: Vec<f64> = wanted.iter().map(|i| digits(specimen.curve.pressure(*i), 3)).collect();
    let (current_a, pressure) = closed_loop(case, specimen, &target, &mut plant, wanted[0]);
    Run { time_s, current_a, pressure_bar: Some(pressure), target_bar: Some(target), ..Run::default() }
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

/// Feed-forward by a calibration that is a little off, and PI above 6 bar against the target of a delay ago.
fn closed_loop(case: &Case, specimen: &Specimen, target: &[f64], plant: &mut Plant, start_a: f64) -> (Vec<f64>, Vec<f64>) {
    let rng = &mut stream(case.seed, 20);
    let (kp, ki) = (uniform(rng, 0.001, 0.003), uniform(rng, 0.008, 0.025));
    let (gain, offset) = (uniform(rng, 0.985, 1.015), uniform(rng, -0.006, 0.006));
    let behind = ((specimen.delay_s / PERIOD_S).round() as usize) + 1;
    let (mut integral, mut rising) = (0.0_f64, true);
    let mut measured = plant.period(start_a);
    let (mut currents, mut pressures) = (Vec::with_capacity(target.len()), Vec::with_capacity(target.len()));
    for (k, goal) in target.iter().enumerate() {
        let before = target[k.saturating_sub(1)];
        if *goal != before {
            rising = *goal > before;
        }
        let ahead = gain * Plant::feed_forward(specimen, *goal, rising) + offset;
        let error = target[k.saturating_sub(behind)] - measured;
        let trim = if *goal > 6.0 {
            integral = (integral + ki * error * PERIOD_S).clamp(-0.15, 0.15);
            kp * error + integral
        } else {
            integral = 0.0;
            0.0
        };
        let current = digits((ahead + trim).clamp(0.05, 1.05), 5);
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
        let case = Case { closed: true, ..placed(8, Vec::new()) };
        let (valve, twin) = record_session(&case);
        assert_eq!(valve.record, twin.record);
        assert_eq!(valve.holdout, twin.holdout);
        assert_eq!((valve.sweep.len(), valve.record.len(), valve.holdout.len()), (20_000, 12_000, 10_000));
    }

    #[test]
    fn a_closed_loop_follows_its_target() {
        let case = Case { closed: true, ..placed(21, Vec::new()) };
        let (valve, _) = record_session(&case);
        let (p, goal) = (valve.record.pressure_bar.unwrap_or_default(), valve.record.target_bar.unwrap_or_default());
        let mean = p.iter().zip(&goal).map(|(a, b)| (a - b).abs()).sum::<f64>() / p.len() as f64;
        assert!(mean < 0.8, "{mean}");
    }
}
