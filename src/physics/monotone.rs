//! Where a current goes one way.

use std::ops::Range;

/// A current rests that has not gone on for so long [s], and for so many readings.
const REST: (f64, usize) = (0.3, 10);
/// Fewest readings of a stretch.
const SHORTEST: usize = 20;

/// Stretches over which the current moves in one direction, but for turns of less than `dead_a`, and does not rest.
pub(super) fn monotone(current_a: &[f64], dead_a: f64, dt_s: f64) -> Vec<Range<usize>> {
    let rest = ((REST.0 / dt_s).round() as usize).max(REST.1);
    let mut out = Vec::new();
    let (mut begin, mut extreme, mut direction) = (0, 0, 0.0);
    for k in 1..current_a.len() {
        let beyond = current_a[k] - current_a[extreme];
        if direction == 0.0 {
            if beyond.abs() > dead_a {
                direction = beyond.signum();
                extreme = k;
            }
        } else if beyond * direction > 0.0 {
            extreme = k;
        } else if -beyond * direction > dead_a {
            out.push(begin..extreme + 1);
            (begin, extreme, direction) = (extreme, k, -direction);
        } else if k - extreme > rest {
            out.push(begin..extreme + 1);
            (begin, extreme, direction) = (k, k, 0.0);
        }
    }
    out.push(begin..extreme + 1);
    out.retain(|s| s.len() > SHORTEST);
    out
}
