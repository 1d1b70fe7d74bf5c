//! Friction or none, on what the fits have not seen.

use super::joint::{Fitted, Joint};
use super::regression::{ALL, BLOCKS, Used};
use super::rivals::{Besides, Rivals};

/// Folds: each leaves out this many blocks, spread over the record.
pub const FOLDS: usize = 5;
/// Student's t, two-sided 95 %, nine degrees of freedom (ten blocks).
const STUDENT: f64 = 2.262;

/// What the comparison says.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// The stem and its process, fitted on everything.
    pub friction: Fitted,
    /// RMS one-step error of the best rival and of the friction, fitted on everything.
    pub rms: (f64, f64),
    /// The same on held-out blocks.
    pub heldout_rms: (f64, f64),
    /// 95 % interval over the blocks of the mean gain [nats].
    pub gain: (f64, f64),
    /// BIC of the best rival less that of the friction: positive speaks for friction.
    pub bic: f64,
    /// What stands beside the best rival.
    pub besides: Besides,
    /// Bands that the folds found, smallest and largest.
    pub bands: (f64, f64),
    /// The p value of the gains by flips of the sign of the blocks' differences.
    pub p_value: f64,
}

/// Compares; `None` where the record does not carry the fits.
pub fn compare(joint: &Joint<'_>, rivals: &Rivals) -> Option<Comparison> {
    let best = joint.best(&ALL)?;
    let (bic, friction) = (best.bic, joint.centred(best, &ALL));
    let (rival, solved, rival_bic) = rivals.best(&ALL)?;
    let mut heldout = Heldout::default();
    let mut bands = (f64::INFINITY, 0.0f64);
    for fold in 0..FOLDS {
        let used = Heldout::used(fold);
        let with = joint.centred(joint.best(&used)?, &used);
        let (without, solved, _) = rivals.best(&used)?;
        let band = with.hypothesis.stem.band;
        bands = (bands.0.min(band), bands.1.max(band));
        heldout.fold(&used, |b| without.error(&solved, b), |b| with.error(b));
    }
    let (without, with) = heldout.mean_squares();
    Some(Comparison {
        rms: (solved.variance.sqrt(), friction.solved.variance.sqrt()),
        heldout_rms: (without.sqrt(), with.sqrt()),
        gain: heldout.gain(),
        bic: rival_bic - bic,
        besides: rival.besides,
        bands,
        p_value: heldout.p_value(),
        friction,
    })
}

/// Errors without and with friction on the blocks that the fits left out.
#[derive(Debug, Default)]
pub struct Heldout {
    squares: (f64, f64),
    samples: f64,
    /// Of each block, half the logarithm of the ratio of its squares [nats].
    gains: Vec<f64>,
}

impl Heldout {
    /// What the fits of this fold use.
    pub fn used(fold: usize) -> Used {
        std::array::from_fn(|b| b % FOLDS != fold)
    }

    /// Adds the blocks left out: sum of squares and samples of each, without friction and with it.
    pub fn fold(&mut self, used: &Used, without: impl Fn(usize) -> (f64, f64), with: impl Fn(usize) -> (f64, f64)) {
        for b in (0..BLOCKS).filter(|b| !used[*b]) {
            let ((without, n), (with, _)) = (without(b), with(b));
            if n > 0.0 {
                self.squares = (self.squares.0 + without, self.squares.1 + with);
                self.samples += n;
                self.gains.push(0.5 * (without.max(f64::MIN_POSITIVE) / with.max(f64::MIN_POSITIVE)).ln());
            }
        }
    }

    /// Mean square without and with friction.
    pub fn mean_squares(&self) -> (f64, f64) {
        (self.squares.0 / self.samples, self.squares.1 / self.samples)
    }

    /// 95 % interval of the mean gain over the blocks [nats].
    pub fn gain(&self) -> (f64, f64) {
        interval(&self.gains)
    }

    /// Share of all flips of the gains' signs whose sum is as large.
    pub fn p_value(&self) -> f64 {
        flips(&self.gains)
    }
}

fn flips(gains: &[f64]) -> f64 {
    let sum: f64 = gains.iter().sum();
    let all = 1u32 << gains.len();
    let as_large = (0..all).filter(|bits| {
        let flipped: f64 = gains.iter().enumerate().map(|(k, g)| if bits >> k & 1 == 1 { -g } else { *g }).sum();
        flipped >= sum - 1e-12 * sum.abs()
    });
    as_large.count() as f64 / f64::from(all)
}

/// 95 % interval of the mean.
fn interval(gains: &[f64]) -> (f64, f64) {
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let spread = (gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
    (mean - STUDENT * spread, mean + STUDENT * spread)
}
