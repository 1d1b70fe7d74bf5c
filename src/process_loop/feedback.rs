//! Is there a controller: does the process value say what the output does, beyond what the output's own past says?
//!
//! A sweep of a valve knows its current in advance, whatever the pressure does. A controller answers: to what the process value was
//! before, or in the same sample against the direction in which the output moves the process. (A valve that follows a sweep within
//! the sample moves with it.)
//!
//! Source: Granger, Econometrica 37 (1969) 424; Caines and Chan, IEEE Trans. Automatic Control 20 (1975) 498 (feedback between
//! stationary series).

use super::regression::{ALL, BLOCKS, Solved, Sums};

/// Past values of the output and of the process value.
const PAST: (usize, usize) = (4, 2);
/// Differences of the criterion that count as positive and as very strong evidence (Kass and Raftery 1995).
const POSITIVE: f64 = 2.0;
const VERY_STRONG: f64 = 10.0;
/// Bend of a straight line, as a share of the range, and the share of such samples that makes a program.
const STRAIGHT: (f64, f64) = (1e-5, 0.5);
/// What is left of a signal, as a share of its variance, is rounding below this.
const ROUNDING: f64 = 1e-9;

/// Whether the output goes on straight lines and in steps for most of the time: a program, which no controller writes.
pub fn is_program(output: &[f64], range: f64) -> bool {
    let straight = output.windows(3).filter(|w| (w[2] - 2.0 * w[1] + w[0]).abs() < STRAIGHT.0 * range).count();
    straight as f64 > STRAIGHT.1 * output.len() as f64
}

/// Whether the output answers what the process value was before; held out, too, since few turns of a sweep are few events.
pub fn follows(value: &[f64], output: &[f64]) -> bool {
    let (without, with) = (told_by(value, output, 1..1), told_by(value, output, 1..PAST.1 + 1));
    let told = without.answer().zip(with.answer()).is_some_and(|((without, _), (with, _))| without - with > POSITIVE);
    told && without.heldout().zip(with.heldout()).is_some_and(|(without, with)| with < without)
}

/// Whether the output answers the process value of the same sample, against the direction of a process of this gain.
pub fn opposes(value: &[f64], output: &[f64], gain: f64) -> bool {
    let past = told_by(value, output, 1..PAST.1 + 1).answer();
    let now = told_by(value, output, 0..PAST.1 + 1).answer();
    past.zip(now).is_some_and(|((past, _), (now, answer))| past - now > VERY_STRONG && answer * gain < 0.0)
}

/// The output told by its own past and by the process value at these lags.
fn told_by(value: &[f64], output: &[f64], lags: std::ops::Range<usize>) -> Told {
    let width = PAST.0 + 1 + lags.len();
    let sums = Sums::over(output, width, |t, row| {
        row.push(1.0);
        row.extend((1..=PAST.0).map(|k| output[t - k]));
        row.extend(lags.clone().map(|k| value[t - k]));
    });
    Told { sums, width }
}

struct Told {
    sums: Sums,
    width: usize,
}

impl Told {
    /// The criterion, and the coefficient of the first lag of the process value.
    fn answer(&self) -> Option<(f64, f64)> {
        let solved = self.sums.solve(&ALL)?;
        let answer = solved.theta.get(PAST.0 + 1).copied().unwrap_or(0.0);
        Some((Solved { variance: solved.variance.max(ROUNDING), ..solved }.bic(self.width + 1), answer))
    }

    /// Squared error on blocks that the fit has not seen.
    fn heldout(&self) -> Option<f64> {
        let of_block = |b: usize| Some(self.sums.error(&self.sums.solve(&std::array::from_fn(|k| k != b))?.theta, b).0);
        (0..BLOCKS).map(of_block).sum()
    }
}
