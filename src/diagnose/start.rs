//! What the unknown start of a recording hides: until the current has moved far, the pressure depends on what came
//! before the first sample. A wrong start there would look like a slow change.

use super::evidence::Evidence;
use super::model::{Model, Simulator};

/// Two starts count as forgotten once they differ by less than this share of the sensor noise.
const FORGOTTEN: f64 = 0.5;
/// A run that forgets its start only after this share of its samples is used as it is.
const LONGEST: f64 = 0.2;

/// The samples before which a start on the ascending and one on the descending curve still differ.
pub fn unsettled(evidence: &Evidence, base: &Model<'_>) -> Vec<usize> {
    let theta = base.calibrated();
    let (mut low, mut high) = (Vec::new(), Vec::new());
    Simulator::starting_at(evidence, 0.0).pressure(base, &theta, &mut low);
    Simulator::starting_at(evidence, 1.0).pressure(base, &theta, &mut high);
    let mut begin = 0;
    let mut out = Vec::new();
    for grid in &evidence.grids {
        let run = begin..begin + grid.current_a.len();
        let apart = |k: &usize| (high[*k] - low[*k]).abs() > FORGOTTEN * evidence.noise_bar;
        let settled = run.clone().rev().find(apart).map_or(begin, |k| k + 1);
        if ((settled - begin) as f64) < LONGEST * run.len() as f64 {
            out.extend(begin..settled);
        }
        begin = run.end;
    }
    out
}
