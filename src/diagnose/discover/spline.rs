//! Smooth functions of one or two states: quadratic B-splines on even knots with a penalty on their second differences
//! (Eilers and Marx, Statistical Science 11 (1996) 89), and their product for two.

use nalgebra::DMatrix;

use super::states::{Candidate, Tried};

/// Functions of one state alone; of two, more of the one that leads.
const ALONE: usize = 16;
const SINCE: usize = 24;
const LEADING: usize = 11;
const SECOND: usize = 7;
/// Time after an event from which on it is long ago [s].
const LONG_AFTER_S: f64 = 4.0;
/// Functions of one state that are not zero at a place.
const ACTIVE: usize = 3;
/// What holds every coefficient back, in parts of the mean weight of a function.
const RIDGE: f64 = 1e-3;

/// The functions at each row.
pub struct Basis {
    /// Number of functions.
    pub size: usize,
    /// For each row the functions that are not zero, with their values.
    pub rows: Vec<Vec<(usize, f64)>>,
    /// Second differences.
    roughness: DMatrix<f64>,
}

impl Basis {
    /// Of a candidate, at the first `searched` rows.
    pub fn of(tried: &[Tried], candidate: Candidate, searched: usize) -> Self {
        let first = &tried[candidate.first];
        if candidate.alone() {
            let size = if first.is_since() { SINCE } else { ALONE };
            let rows = (0..searched).map(|k| active(first, k, size).to_vec()).collect();
            return Self { size, rows, roughness: differences(size) };
        }
        let second = &tried[candidate.second];
        let rows = (0..searched).map(|k| {
            let (a, b) = (active(first, k, LEADING), active(second, k, SECOND));
            a.iter().flat_map(|(i, u)| b.iter().map(move |(j, v)| (i * SECOND + j, u * v))).collect()
        });
        let one = |size| DMatrix::identity(size, size);
        let roughness = differences(LEADING).kronecker(&one(SECOND)) + one(LEADING).kronecker(&differences(SECOND));
        Self { size: LEADING * SECOND, rows: rows.collect(), roughness }
    }

    /// What is added to the normal equations where the roughness counts so much, relative to the data.
    pub fn penalty(&self, smoothing: f64) -> DMatrix<f64> {
        let weight = self.rows.len() as f64 / self.size as f64;
        &self.roughness * (smoothing * weight) + DMatrix::identity(self.size, self.size) * (RIDGE * weight)
    }
}

/// The functions of a state that are not zero at a row. Soon after an event they stand closer together.
fn active(tried: &Tried, row: usize, size: usize) -> [(usize, f64); ACTIVE] {
    let (value, (low, high)) = (tried.values[row], tried.seen);
    let part = if tried.is_since() { (value / LONG_AFTER_S).clamp(0.0, 1.0).sqrt() } else { (value - low) / (high - low) };
    let cells = (size + 1 - ACTIVE) as f64;
    let x = (part * cells).clamp(0.0, cells - 1e-9);
    let (cell, t) = (x as usize, x.fract());
    [(cell, 0.5 * (1.0 - t) * (1.0 - t)), (cell + 1, 0.5 + t * (1.0 - t)), (cell + 2, 0.5 * t * t)]
}

/// D'D of the second differences.
fn differences(size: usize) -> DMatrix<f64> {
    let d = DMatrix::from_fn(size - 2, size, |i, j| match j.wrapping_sub(i) {
        0 | 2 => 1.0,
        1 => -2.0,
        _ => 0.0,
    });
    d.transpose() * d
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::{State, StateKind};

    #[test]
    fn functions_sum_to_one_and_straight_lines_are_not_rough() {
        let values: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k) - 0.3).collect();
        let tried = [Tried { state: State::new(StateKind::Pressure, &[]), values, seen: (0.0, 4.0) }];
        let basis = Basis::of(&tried, Candidate { first: 0, second: 0 }, 50);
        assert!(basis.rows.iter().all(|row| (row.iter().map(|r| r.1).sum::<f64>() - 1.0).abs() < 1e-12));
        assert!(basis.rows.iter().flatten().all(|(k, _)| *k < basis.size));
        let line = nalgebra::DVector::from_fn(ALONE, |k, _| k as f64);
        assert!((&basis.roughness * line).amax() < 1e-9);
    }
}
