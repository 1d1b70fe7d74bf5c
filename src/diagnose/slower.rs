//! Data of the good valve as a logger that is as slow as that of the record would have written it.
//!
//! What the current does between two readings nobody sees, and a simulation from it is off by that: the slower the logger, the more. An
//! effect that takes in a part of it has changed nothing.

use super::evidence::FEWEST_SAMPLES;
use crate::recording::{Channel, Recording, Run};

/// The recording, each run that is read more often than once in `step_s` with as few of its rows; nothing where that is none.
pub fn read_every(recording: &Recording, step_s: f64) -> Option<Recording> {
    let among: Vec<usize> = recording.runs.iter().map(|run| rows(run, step_s)).collect();
    let runs = recording.runs.iter().zip(&among).map(|(run, rows)| run.every(*rows)).collect();
    among.iter().any(|rows| *rows > 1).then(|| Recording { runs, ..recording.clone() })
}

/// One of how many rows of a run is read at such steps, and leaves as many as a diagnosis takes; all where the pressure stands in few
/// rows, which a slower logger need not hit.
fn rows(run: &Run, step_s: f64) -> usize {
    let readings = run.channel(Channel::Pressure).map_or(0, |p| p.iter().filter(|p| p.is_finite()).count());
    let own_s = run.step_s();
    if own_s > 0.0 && 2 * readings > run.len() { ((step_s / own_s).round() as usize).min(run.len() / FEWEST_SAMPLES).max(1) } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(rows: u32, pressure: impl Fn(u32) -> f64) -> Recording {
        let time_s: Vec<f64> = (0..rows).map(|k| f64::from(k) * 0.01).collect();
        let current_a = (0..rows).map(f64::from).collect();
        let pressure_bar = Some((0..rows).map(pressure).collect());
        Recording { runs: vec![Run { time_s, current_a, pressure_bar, ..Run::default() }], ..Recording::default() }
    }

    #[test]
    fn a_slower_logger_leaves_rows_out_and_a_faster_one_adds_none() {
        let all = run(1000, |k| 2.0 * f64::from(k));
        let slow = read_every(&all, 0.05).unwrap().runs.swap_remove(0);
        assert_eq!((slow.len(), slow.time_s[3], slow.current_a[3]), (200, 0.15, 15.0));
        assert_eq!(slow.pressure_bar.unwrap()[3], 30.0);
        assert_eq!(read_every(&all, 0.5).unwrap().runs[0].len(), 200);
        for as_it_is in [0.001, 0.01, 0.014] {
            assert_eq!(read_every(&all, as_it_is), None);
        }
    }

    #[test]
    fn readings_that_stand_in_few_rows_stay() {
        let few = run(1000, |k| if k % 5 == 3 { 1.0 } else { f64::NAN });
        assert_eq!(read_every(&few, 0.05), None);
    }
}
