//! Standard errors, inflated by the correlation time of the residual.
//!
//! Neighbouring residuals are alike wherever the model's form is not quite that of the valve; counting every sample
//! as independent would make the errors too small by the square root of the correlation time.

use nalgebra::DMatrix;

use super::fit::{Fit, Problem};
use super::select::correlation_time;

/// Covariance of the parameters, and the correlation time in samples.
pub(super) fn covariance(problem: &Problem<'_>, fit: &Fit, weights: &[f64], limit: f64) -> (DMatrix<f64>, f64) {
    let n: f64 = weights.iter().filter(|w| **w > 0.0).count() as f64;
    let p = fit.shape.len() as f64;
    let time = correlation_time(problem, &fit.residual_bar, weights, limit);
    let variance = fit.cost / (n - p).max(1.0) * time;
    // Scaled to a unit diagonal before the inversion: amperes, seconds and bar differ by orders of magnitude.
    let scale: Vec<f64> = fit.normal.diagonal().iter().map(|d| if *d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }).collect();
    let scaled = DMatrix::from_fn(scale.len(), scale.len(), |a, b| scale[a] * fit.normal[(a, b)] * scale[b]);
    let eigen = scaled.symmetric_eigen();
    let least = 1e-12 * eigen.eigenvalues.max();
    let mut inverse = DMatrix::zeros(scale.len(), scale.len());
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        let v = eigen.eigenvectors.column(k);
        inverse += v * v.transpose() / value.max(least);
    }
    let covariance = DMatrix::from_fn(scale.len(), scale.len(), |a, b| {
        // A parameter without any influence has no finite error.
        if scale[a] == 0.0 || scale[b] == 0.0 {
            if a == b { f64::INFINITY } else { 0.0 }
        } else {
            variance * scale[a] * inverse[(a, b)] * scale[b]
        }
    });
    (covariance, time)
}

/// Standard error of a linear combination of parameters.
pub(super) fn error_of(covariance: &DMatrix<f64>, direction: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (a, x) in direction.iter().enumerate() {
        for (b, y) in direction.iter().enumerate() {
            if *x != 0.0 && *y != 0.0 {
                sum += x * y * covariance[(a, b)];
            }
        }
    }
    sum.max(0.0).sqrt()
}
