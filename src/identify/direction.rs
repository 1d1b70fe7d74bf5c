//! Whether the pressure rises with the current at all.

use super::segment::Segment;
use crate::course::Course;

/// A characteristic falls where pressure and current are correlated at most as much as this, at every delay that counts.
const FALLS: f64 = -0.5;
/// Delays at which the correlation is looked at, in samples.
const DELAYS: [usize; 8] = [0, 1, 2, 4, 8, 16, 32, 50];

/// Whether the pressure falls while the current rises: the strongest correlation of the two, over a row of delays, is negative.
pub(super) fn falls(segments: &[Segment]) -> bool {
    let strongest = DELAYS.iter().map(|d| correlation(segments, *d)).fold(0.0, |best: f64, r| if r.abs() > best.abs() { r } else { best });
    strongest <= FALLS
}

/// The same recordings with the sign of the current turned.
pub(super) fn turned(courses: &[Course]) -> Vec<Course> {
    let mut out = courses.to_vec();
    out.iter_mut().flat_map(|c| &mut c.runs).flat_map(|run| &mut run.current_a).for_each(|i| *i = -*i);
    out
}

/// Correlation of the pressure and the current `delay` samples before.
fn correlation(segments: &[Segment], delay: usize) -> f64 {
    let mut sums = [0.0f64; 6];
    for s in segments {
        for k in (delay..s.len()).filter(|k| s.weight[*k] > 0.0) {
            let (i, p) = (s.current_a[k - delay], s.pressure_bar[k]);
            for (sum, value) in sums.iter_mut().zip([1.0, i, p, i * i, p * p, i * p]) {
                *sum += value;
            }
        }
    }
    let [n, i, p, ii, pp, ip] = sums;
    let (vi, vp) = (ii - i * i / n, pp - p * p / n);
    if n > 2.0 && vi > 0.0 && vp > 0.0 { (ip - i * p / n) / (vi * vp).sqrt() } else { 0.0 }
}
