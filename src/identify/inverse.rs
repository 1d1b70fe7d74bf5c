//! The inverse of normal equations.

use nalgebra::DMatrix;

/// The inverse of normal equations, scaled to a unit diagonal before: amperes, seconds and bar differ by orders of
/// magnitude. A parameter without any influence has an infinite variance.
pub(super) fn inverse(normal: &DMatrix<f64>) -> DMatrix<f64> {
    let scale: Vec<f64> = normal.diagonal().iter().map(|d| if *d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }).collect();
    let scaled = DMatrix::from_fn(scale.len(), scale.len(), |a, b| scale[a] * normal[(a, b)] * scale[b]);
    let eigen = scaled.symmetric_eigen();
    let least = 1e-12 * eigen.eigenvalues.max();
    let mut inverse = DMatrix::zeros(scale.len(), scale.len());
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        let v = eigen.eigenvectors.column(k);
        inverse += v * v.transpose() / value.max(least);
    }
    DMatrix::from_fn(scale.len(), scale.len(), |a, b| {
        if scale[a] == 0.0 || scale[b] == 0.0 { if a == b { f64::INFINITY } else { 0.0 } } else { scale[a] * inverse[(a, b)] * scale[b] }
    })
}
