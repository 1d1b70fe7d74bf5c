//! Which states a smooth function of which predicts the residual, and how good the best of so many would be by chance.
//!
//! Each candidate is judged by what a penalised spline, fitted on the other parts of the record together with what moves
//! besides, leaves of each part. The same is done with the residual turned by circular shifts, which keep its correlation and
//! break its bond to the states; the best of all candidates counts each time, so that having tried many is part of the test
//! (maximum statistic: Westfall and Young, Resampling-Based Multiple Testing, Wiley 1993).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::rows::{FOLDS, Rows};
use super::spline::Basis;
use super::states::{Candidate, Tried};

/// Circular shifts.
const SHIFTS: usize = 39;
/// So many at a time, so that what chance does as well is soon given up.
const BATCH: usize = 13;
/// How much the roughness counts: the best of these.
const SMOOTHING: [f64; 2] = [0.003, 0.3];
/// A function of two states must predict this much better than the best of one.
const OF_TWO: f64 = 0.95;

/// The best candidate.
pub struct Best {
    /// What it is a function of.
    pub candidate: Candidate,
    /// Its mean square on the parts in turn, and that of what moves besides alone [bar^2].
    pub mean_square: (f64, f64),
}

/// The best of all candidates.
pub fn best(rows: &Rows<'_>, tried: &[Tried], candidates: &[Candidate]) -> Option<Best> {
    let alone = left(rows, None, &[0])?[0];
    let of = |c: &Candidate| Some((*c, left(rows, Some(&Basis::of(tried, *c, rows.searched)), &[0])?[0]));
    let scored: Vec<(Candidate, f64)> = candidates.par_iter().filter_map(of).collect();
    let lowest = |alone: bool| scored.iter().filter(|(c, _)| c.alone() == alone).min_by(|a, b| a.1.total_cmp(&b.1));
    let (one, two) = (lowest(true)?, lowest(false));
    let (candidate, square) = two.filter(|two| two.1 < OF_TWO * one.1).unwrap_or(one);
    let n = rows.searched as f64;
    Some(Best { candidate: *candidate, mean_square: (square / n, alone / n) })
}

/// Chance that the best of all candidates is as good as this one; no longer looked at closely once it is beyond `most`.
pub fn by_chance(rows: &Rows<'_>, tried: &[Tried], candidates: &[Candidate], best: &Best, most: f64) -> f64 {
    let n = rows.searched;
    let mut random = rand_pcg::Pcg64::seed_from_u64(0x7465_726d);
    let shifts: Vec<usize> = (0..SHIFTS).map(|_| random.random_range(n / 10..n - n / 10)).collect();
    let found = best.mean_square.0 / best.mean_square.1;
    let mut as_good = 1;
    for shifts in shifts.chunks(BATCH) {
        let Some(alone) = left(rows, None, shifts) else { return 1.0 };
        let none = vec![false; shifts.len()];
        let of = |c: &Candidate| {
            let squares = left(rows, Some(&Basis::of(tried, *c, n)), shifts).unwrap_or_else(|| alone.clone());
            squares.iter().zip(&alone).map(|(s, a)| s / a <= found).collect::<Vec<bool>>()
        };
        let any = |a: Vec<bool>, b: Vec<bool>| a.iter().zip(&b).map(|(a, b)| *a || *b).collect::<Vec<bool>>();
        let hits = candidates.par_iter().map(of).reduce(|| none.clone(), any);
        as_good += hits.iter().filter(|h| **h).count();
        if as_good as f64 > most * (SHIFTS + 1) as f64 {
            break;
        }
    }
    as_good as f64 / (SHIFTS + 1) as f64
}

/// What is left of each shifted residual on the parts in turn, with the best smoothing; nothing where no fit can be made.
fn left(rows: &Rows<'_>, basis: Option<&Basis>, shifts: &[usize]) -> Option<Vec<f64>> {
    let (n, besides) = (rows.searched, rows.besides.len());
    let own = basis.map_or(0, |b| b.size);
    let size = own + besides;
    let fold = |k: usize| k * FOLDS / n;
    let mut grams = vec![DMatrix::<f64>::zeros(size, size); FOLDS];
    let mut rights = vec![vec![DVector::<f64>::zeros(size); FOLDS]; shifts.len()];
    let mut squares = vec![[0.0; FOLDS]; shifts.len()];
    let mut row: Vec<(usize, f64)> = Vec::new();
    for k in 0..n {
        row.clear();
        row.extend(basis.into_iter().flat_map(|b| b.rows[k].iter().copied()));
        row.extend(rows.besides.iter().enumerate().map(|(j, column)| (own + j, column[k])));
        let at = fold(k);
        let gram = &mut grams[at];
        for (a, (i, u)) in row.iter().enumerate() {
            for (j, v) in &row[..=a] {
                gram[(*i, *j)] += u * v;
            }
        }
        for (number, shift) in shifts.iter().enumerate() {
            let e = rows.residual[(k + shift) % n];
            squares[number][at] += e * e;
            let right = &mut rights[number][at];
            for (i, u) in &row {
                right[*i] += u * e;
            }
        }
    }
    for gram in &mut grams {
        // A later function never stands ahead of an earlier one in a row.
        gram.fill_upper_triangle_with_lower_triangle();
    }
    let total: DMatrix<f64> = grams.iter().sum();
    let sums: Vec<DVector<f64>> = rights.iter().map(|parts| parts.iter().sum()).collect();
    let mut lowest = vec![f64::INFINITY; shifts.len()];
    let smoothings = if basis.is_some() { &SMOOTHING[..] } else { &SMOOTHING[..1] };
    for smoothing in smoothings {
        let mut penalty = DMatrix::zeros(size, size);
        if let Some(basis) = basis {
            penalty.view_mut((0, 0), (own, own)).copy_from(&basis.penalty(*smoothing));
        }
        for (j, stiffness) in rows.stiffness.iter().enumerate() {
            penalty[(own + j, own + j)] += stiffness + 1e-9;
        }
        let factors: Option<Vec<Cholesky<f64, Dyn>>> = grams.iter().map(|gram| (&total - gram + &penalty).cholesky()).collect();
        let factors = factors?;
        for (number, best) in lowest.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (at, factor) in factors.iter().enumerate() {
                let right = &rights[number][at];
                let found = factor.solve(&(&sums[number] - right));
                sum += squares[number][at] - 2.0 * found.dot(right) + found.dot(&(&grams[at] * &found));
            }
            *best = f64::min(*best, sum);
        }
    }
    Some(lowest)
}
