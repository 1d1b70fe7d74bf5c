//! How many samples of a residual count as one.

/// Correlation below which the rest of the sequence is noise of the estimate.
const NOTHING: f64 = 0.05;
/// The lags thin out where the correlation is slow: by this part of themselves.
const THINNING: usize = 8;

/// Integrated correlation time of residuals about their expectation, zero [samples]; at least 1. Each of `stretches` is a stretch of
/// neighbours; a sample that does not count is zero.
///
/// One plus twice the sum of the autocorrelation over the initial sequence of lags at which it is positive, after C. J. Geyer, Statist. Sci.
/// 7 (1992) 473.
pub fn correlation_samples<S: AsRef<[f64]>>(stretches: &[S]) -> f64 {
    let n: usize = stretches.iter().map(|s| s.as_ref().len()).sum();
    let at = |lag: usize| -> f64 {
        let later = |s: &S| s.as_ref().get(lag..).map_or(0.0, |later| s.as_ref().iter().zip(later).map(|(a, b)| a * b).sum());
        stretches.iter().map(later).sum()
    };
    let variance = at(0);
    if variance.is_nan() || variance <= 0.0 {
        return 1.0;
    }
    let (mut samples, mut lag) = (1.0, 1);
    while lag < n / 4 {
        let step = (lag / THINNING).max(1);
        let rho = at(lag) / variance;
        if rho < NOTHING {
            break;
        }
        samples += 2.0 * rho * step as f64;
        lag += step;
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn white(n: usize) -> Vec<f64> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(7);
        (0..n).map(|_| StandardNormal.sample(&mut random)).collect()
    }

    #[test]
    fn white_noise_counts_sample_by_sample_and_a_moving_mean_by_its_length() {
        assert!(correlation_samples(&[white(20_000)]) < 1.5);
        let smooth: Vec<f64> = white(20_000).windows(20).map(|w| w.iter().sum::<f64>() / 20.0).collect();
        let found = correlation_samples(&[smooth]);
        assert!((15.0..25.0).contains(&found), "{found}");
    }

    #[test]
    fn samples_of_different_stretches_are_no_neighbours() {
        // Each stretch goes on where the one before ended, so that joined they would hang together over a hundred samples.
        let slow: Vec<f64> = (0..4000).map(|k| (f64::from(k) * 0.02).sin()).collect();
        let joined = correlation_samples(&[slow.as_slice()]);
        let parts: Vec<&[f64]> = slow.chunks(4).collect();
        assert!(correlation_samples(&parts) < 8.0 && joined > 50.0, "{joined}");
    }

    #[test]
    fn nothing_counts_as_white() {
        assert_eq!(correlation_samples::<&[f64]>(&[]), 1.0);
        assert_eq!(correlation_samples(&[[0.0; 10]]), 1.0);
    }
}
