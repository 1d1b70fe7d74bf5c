//! Least squares of a process value on its own past and that of what drives it, over blocks of the record that can be left out.
//!
//! One pass over the record gives the sums of products of each block. A fit without some of the blocks, and its error on
//! them, are had from these sums alone.
//!
//! Source: Ljung, System Identification, 2nd ed. (1999), section 7.3 and appendix II (sums of products).

use nalgebra::{Cholesky, DMatrix, DVector};

/// Blocks of a record.
pub const BLOCKS: usize = 10;
/// Longest delay that is looked at [samples].
pub const LONGEST_DELAY: usize = 15;
/// Samples before which no equation stands, the same for all models so that they are judged on the same samples.
pub const FIRST: usize = 24;
/// What keeps a matrix of sums from being singular, as a share of its diagonal.
const RIDGE: f64 = 1e-9;

/// A linear equation from what drives to the process value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Orders {
    /// Past values of the process.
    pub own: usize,
    /// Past values of what drives.
    pub input: usize,
    /// Samples from the input to its first trace; one at least, since the output of the same sample follows the process value.
    pub delay: usize,
}

/// Sums of products of regressors and values, one set a block.
#[derive(Debug, Clone)]
pub struct Sums {
    width: usize,
    /// Upper triangles of the products of regressors, then those with the value, its square, and the count.
    blocks: Vec<Vec<f64>>,
}

/// Blocks that take part in a fit.
pub type Used = [bool; BLOCKS];

/// All blocks.
pub const ALL: Used = [true; BLOCKS];

/// A fit.
#[derive(Debug, Clone)]
pub struct Solved {
    /// Coefficients in the order of the regressors.
    pub theta: DVector<f64>,
    /// Mean square of the one-step errors on the blocks used.
    pub variance: f64,
    /// Samples used.
    pub samples: f64,
}

impl Solved {
    /// Bayesian information criterion with so many parameters.
    pub fn bic(&self, parameters: usize) -> f64 {
        self.samples * self.variance.ln() + parameters as f64 * self.samples.ln()
    }
}

impl Sums {
    /// Sums over a record: `regressors` fills the row of a sample.
    pub fn over(value: &[f64], width: usize, mut regressors: impl FnMut(usize, &mut Vec<f64>)) -> Self {
        let triangle = width * (width + 1) / 2;
        let mut blocks = vec![vec![0.0; triangle + width + 2]; BLOCKS];
        let mut row = Vec::with_capacity(width);
        for t in FIRST..value.len() {
            row.clear();
            regressors(t, &mut row);
            let y = value[t];
            if !y.is_finite() || row.iter().any(|v| !v.is_finite()) {
                continue;
            }
            let sums = &mut blocks[block(t, value.len())];
            let mut at = 0;
            for (i, a) in row.iter().enumerate() {
                for (sum, b) in sums[at..=at + i].iter_mut().zip(&row) {
                    *sum += a * b;
                }
                at += i + 1;
            }
            for (sum, a) in sums[triangle..].iter_mut().zip(&row) {
                *sum += a * y;
            }
            sums[triangle + width] += y * y;
            sums[triangle + width + 1] += 1.0;
        }
        Self { width, blocks }
    }

    /// Sums of an equation of these orders from `input` to `value`.
    pub fn of_orders(value: &[f64], input: &[f64], orders: Orders) -> Self {
        Self::over(value, orders.own + orders.input + 1, |t, row| orders.regressors(value, input, t, row))
    }

    fn added(&self, used: &Used) -> Vec<f64> {
        let mut sum = vec![0.0; self.blocks[0].len()];
        for (block, _) in self.blocks.iter().zip(used).filter(|(_, used)| **used) {
            for (s, v) in sum.iter_mut().zip(block) {
                *s += v;
            }
        }
        sum
    }

    fn matrix(&self, sum: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.width;
        let place = |i: usize, j: usize| i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
        let xx = DMatrix::from_fn(n, n, |i, j| sum[place(i, j)]);
        (xx, DVector::from_column_slice(&sum[n * (n + 1) / 2..n * (n + 1) / 2 + n]))
    }

    /// The fit on the blocks used; `None` where they do not carry it.
    pub fn solve(&self, used: &Used) -> Option<Solved> {
        let sum = self.added(used);
        let (mut xx, xy) = self.matrix(&sum);
        let samples = sum[sum.len() - 1];
        if samples < 3.0 * self.width as f64 {
            return None;
        }
        for i in 0..self.width {
            xx[(i, i)] = xx[(i, i)] * (1.0 + RIDGE) + f64::MIN_POSITIVE;
        }
        let theta = Cholesky::new(xx)?.solve(&xy);
        let left = sum[sum.len() - 2] - theta.dot(&xy);
        Some(Solved { theta, variance: (left / samples).max(f64::MIN_POSITIVE), samples })
    }

    /// Sum of squared one-step errors with these coefficients on one block, and its samples.
    pub fn error(&self, theta: &DVector<f64>, block: usize) -> (f64, f64) {
        let sum = &self.blocks[block];
        let (xx, xy) = self.matrix(sum);
        let squares = sum[sum.len() - 2] - 2.0 * theta.dot(&xy) + (xx * theta).dot(theta);
        (squares.max(0.0), sum[sum.len() - 1])
    }
}

impl Orders {
    /// The row of a sample: past values, past inputs, one.
    pub fn regressors(self, value: &[f64], input: &[f64], t: usize, row: &mut Vec<f64>) {
        row.extend((1..=self.own).map(|k| value[t - k]));
        row.extend((0..self.input).map(|k| input[t - self.delay - k]));
        row.push(1.0);
    }
}

/// The block in which a sample of so many lies.
pub fn block(t: usize, samples: usize) -> usize {
    (t * BLOCKS / samples.max(1)).min(BLOCKS - 1)
}
