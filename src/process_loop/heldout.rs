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
    /// Blocks on which friction predicts better.
    pub blocks_won: usize,
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
    let mut gains = Vec::new();
    let (mut squares, mut samples) = ((0.0, 0.0), 0.0);
    let mut bands = (f64::INFINITY, 0.0f64);
    for fold in 0..FOLDS {
        let mut used: Used = ALL;
        let left: Vec<usize> = (0..BLOCKS).filter(|b| b % FOLDS == fold).collect();
        left.iter().for_each(|b| used[*b] = false);
        let with = joint.centred(joint.best(&used)?, &used);
        let (without, solved, _) = rivals.best(&used)?;
        let band = with.hypothesis.stem.band;
        bands = (bands.0.min(band), bands.1.max(band));
        for b in left {
            let ((r, n), (f, _)) = (without.error(&solved, b), with.error(b));
            if n < 1.0 {
                continue;
            }
            squares = (squares.0 + r, squares.1 + f);
            samples += n;
            gains.push(0.5 * (r.max(1e-300) / f.max(1e-300)).ln());
        }
    }
    Some(Comparison {
        rms: (solved.variance.sqrt(), friction.solved.variance.sqrt()),
        heldout_rms: ((squares.0 / samples).sqrt(), (squares.1 / samples).sqrt()),
        gain: interval(&gains),
        blocks_won: gains.iter().filter(|g| **g > 0.0).count(),
        bic: rival_bic - bic,
        besides: rival.besides,
        bands,
        p_value: flips(&gains),
        friction,
    })
}

/// Share of all flips of the signs whose sum is as large.
pub fn flips(gains: &[f64]) -> f64 {
    let sum: f64 = gains.iter().sum();
    let all = 1u32 << gains.len();
    let as_large = (0..all).filter(|bits| {
        let flipped: f64 = gains.iter().enumerate().map(|(k, g)| if bits >> k & 1 == 1 { -g } else { *g }).sum();
        flipped >= sum - 1e-12 * sum.abs()
    });
    as_large.count() as f64 / f64::from(all)
}

/// 95 % interval of the mean.
pub fn interval(gains: &[f64]) -> (f64, f64) {
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let spread = (gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
    (mean - STUDENT * spread, mean + STUDENT * spread)
}
