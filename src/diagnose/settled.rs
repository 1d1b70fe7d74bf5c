//! Where a valve stands in its loop before the first sample of a run: until the current has moved far, the pressure depends on it.

use super::evidence::{Evidence, MIDDLE};
use super::model::Model;
use super::simulator::Simulator;

/// Two starts count as forgotten once they differ by less than this share of the sensor noise.
const FORGOTTEN: f64 = 0.5;
/// A run that forgets its start only after this share of its samples keeps them: its start is estimated instead.
const LONGEST: f64 = 0.2;
/// Starts that are tried lie so far apart, from the ascending curve to the descending one.
const TRIED: usize = 20;

/// The samples before which a start on the ascending and one on the descending curve still differ. Where these are too many to
/// be left out, the evidence takes the start at which they fit the model best.
pub fn unsettled(evidence: &mut Evidence, base: &Model<'_>) -> Vec<usize> {
    let theta = base.calibrated();
    let from = |evidence: &Evidence, share: f64| {
        let mut pressure = Vec::new();
        Simulator::starting_at(evidence, share).pressure(base, &theta, &mut pressure);
        pressure
    };
    let (low, high) = (from(evidence, 0.0), from(evidence, 1.0));
    let (mut out, mut remembering) = (Vec::new(), Vec::new());
    let mut begin = 0;
    for (number, grid) in evidence.grids.iter().enumerate() {
        let run = begin..begin + grid.current_a.len();
        let apart = |k: &usize| (high[*k] - low[*k]).abs() > FORGOTTEN * evidence.noise_bar;
        let settled = run.clone().rev().find(apart).map_or(begin, |k| k + 1);
        if ((settled - begin) as f64) < LONGEST * run.len() as f64 {
            out.extend(begin..settled);
        } else {
            remembering.push((number, begin..settled));
        }
        begin = run.end;
    }
    if remembering.is_empty() {
        return out;
    }
    let tried: Vec<(f64, Vec<f64>)> = (0..=TRIED).map(|k| k as f64 / TRIED as f64).map(|share| (share, from(evidence, share))).collect();
    let measured: Vec<f64> = evidence.grids.iter().flat_map(|grid| grid.pressure_bar.iter().copied()).collect();
    for (number, part) in remembering {
        let squares =
            |pressure: &[f64]| part.clone().map(|k| measured[k] - pressure[k]).filter(|e| e.is_finite()).map(|e| e * e).sum::<f64>();
        let best = tried.iter().min_by(|a, b| squares(&a.1).total_cmp(&squares(&b.1)));
        evidence.start_shares[number] = best.map_or(MIDDLE, |(share, _)| *share);
    }
    out
}
