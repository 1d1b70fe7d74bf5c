//! The loss of a fit: a Student t likelihood with its scale profiled out.
//!
//! A squared error lets a few events of several bar decide everything, a saturating one would not see them; the
//! logarithm of the t distribution does neither. Losses are in nats per effective sample: neighbouring samples of a
//! residual are alike, so N samples count as N / tau_int.

use crate::least_squares;

/// Degrees of freedom: heavy enough for events and outliers.
pub const DEGREES: f64 = 4.0;

/// The scale of a t distribution that fits the residual [bar], not below `least_bar`; NaN entries are skipped.
pub fn scale(residual: &[f64], least_bar: f64, guess_bar: f64) -> f64 {
    let mut square = guess_bar.max(least_bar).powi(2);
    for _ in 0..6 {
        let (mut sum, mut n) = (0.0, 0usize);
        for e in residual {
            let e2 = e * e;
            if e2.is_finite() {
                sum += (DEGREES + 1.0) * e2 / (DEGREES + e2 / square);
                n += 1;
            }
        }
        let next = (sum / n.max(1) as f64).max(least_bar * least_bar);
        let done = (next / square - 1.0).abs() < 2e-3;
        square = next;
        if done {
            break;
        }
    }
    square.sqrt()
}

/// Mean negative log-likelihood of the residual at its own scale [nats per sample].
pub fn mean_nats(residual: &[f64], scale_bar: f64) -> f64 {
    let inverse = 1.0 / (DEGREES * scale_bar * scale_bar);
    let (mut logs, mut n) = (0.0, 0usize);
    // One logarithm for eight samples: each factor is below 1e30, so the product stays finite.
    for chunk in residual.chunks(8) {
        let mut product = 1.0;
        for e in chunk {
            let factor = 1.0 + e * e * inverse;
            if factor.is_finite() {
                product *= factor.min(1e30);
                n += 1;
            }
        }
        logs += product.ln();
    }
    scale_bar.ln() + 0.5 * (DEGREES + 1.0) * logs / n.max(1) as f64
}

/// Weight of each sample in the next least-squares step; 0 where the residual is NaN.
pub fn weight(residual_bar: f64, scale_bar: f64) -> f64 {
    let z2 = (residual_bar / scale_bar).powi(2);
    if z2.is_finite() { (DEGREES + 1.0) / (DEGREES + z2) } else { 0.0 }
}

/// Integrated correlation time of a residual about its mean [samples], its tails clipped; at least 1.
pub fn correlation_samples(residual: &[f64], scale_bar: f64) -> f64 {
    let clipped: Vec<f64> = residual.iter().map(|e| if e.is_finite() { e.clamp(-3.0 * scale_bar, 3.0 * scale_bar) } else { 0.0 }).collect();
    let mean = clipped.iter().sum::<f64>() / clipped.len().max(1) as f64;
    least_squares::correlation_samples(&[clipped.iter().map(|e| e - mean).collect::<Vec<f64>>()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    fn noise(n: usize, sigma: f64) -> Vec<f64> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(7);
        let normal = Normal::new(0.0, sigma).unwrap();
        (0..n).map(|_| normal.sample(&mut random)).collect()
    }

    #[test]
    fn a_few_events_move_the_scale_little_and_the_loss_by_a_logarithm() {
        let mut residual = noise(10_000, 0.05);
        let clean = scale(&residual, 0.01, 1.0);
        // The scale of a t(4) that fits a normal is some 15 % below its standard deviation.
        assert!((0.04..0.05).contains(&clean), "{clean}");
        let before = mean_nats(&residual, clean);
        for k in 0..20 {
            residual[k * 400] = 5.0;
        }
        let after = scale(&residual, 0.01, 1.0);
        assert!(after < 1.02 * clean);
        let gain = (mean_nats(&residual, after) - before) * 10_000.0;
        assert!((200.0..600.0).contains(&gain), "{gain}");
    }

    #[test]
    fn correlation_of_white_and_of_smoothed_noise() {
        let white = noise(20_000, 1.0);
        assert!(correlation_samples(&white, 1.0) < 1.5);
        let smooth: Vec<f64> = white.windows(20).map(|w| w.iter().sum::<f64>() / 20.0).collect();
        let tau = correlation_samples(&smooth, 1.0);
        assert!((15.0..25.0).contains(&tau), "{tau}");
    }
}
