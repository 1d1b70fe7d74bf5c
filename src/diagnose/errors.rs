//! Standard errors of a fit: from the curvature of the loss on effective samples, and from what the blocks of the record say one
//! by one. The larger counts, as each misses what the other sees.
//!
//! The first takes the residual for noise that hangs together over its correlation time. Where the model is off, the residual
//! follows the current instead, and hangs together with the derivatives: the blocks then pull a parameter to and fro more than
//! such noise would, which the covariance of their scores shows (Liang and Zeger, Biometrika 73 (1986) 13).

use nalgebra::DMatrix;

use super::descent::{Slopes, Wanted};
use super::fit::{Fit, Fitter};
use super::heldout::blocks;
use super::loss;
use super::model::Free;
use super::simulator::Simulator;
use crate::least_squares::{Equations, dot};

/// A parameter with less information than this is not carried by the record.
const NOTHING: f64 = 1e-200;

/// A fit with its derivatives, and what they say of its parameters, each in the unit in which it moves.
pub struct Curvature<'c, 'a> {
    /// The fit.
    pub fit: &'c Fit<'a>,
    /// Its parameters.
    pub free: Vec<Free>,
    /// The derivatives of the pressure by all of them.
    pub slopes: Slopes,
    /// The normal equations, in nats of effective samples.
    pub normal: DMatrix<f64>,
    /// Their inverse.
    inverse: DMatrix<f64>,
    /// Variances by the scores of the blocks.
    by_blocks: Vec<f64>,
}

impl Curvature<'_, '_> {
    /// Whether the record carries parameter `k`.
    pub fn carries(&self, k: usize) -> bool {
        self.normal[(k, k)] > NOTHING
    }

    /// Variance of parameter `k` as the curvature of the loss has it.
    pub fn by_information(&self, k: usize) -> f64 {
        self.inverse[(k, k)].max(0.0)
    }

    /// Variance of parameter `k`, the larger of the two.
    pub fn variance(&self, k: usize) -> f64 {
        self.by_information(k).max(self.by_blocks[k])
    }

    /// Steps of all parameters, in the units in which they move, whose outer products add up to their covariance. What the record does
    /// not carry is anywhere in its range.
    pub fn spread(&self) -> Vec<Vec<f64>> {
        let n = self.free.len();
        let deviation: Vec<f64> = (0..n)
            .map(|k| {
                let free = &self.free[k];
                let anywhere = free.distance(free.range.0, free.range.1).abs() / 12f64.sqrt();
                if self.carries(k) { self.variance(k).sqrt().min(anywhere) } else { anywhere }
            })
            .collect();
        let covariance = |i: usize, j: usize| {
            let known = |k: usize| self.carries(k) && self.inverse[(k, k)] > 0.0;
            match i == j {
                true => deviation[i] * deviation[i],
                false if known(i) && known(j) => {
                    deviation[i] * deviation[j] * self.inverse[(i, j)] / (self.inverse[(i, i)] * self.inverse[(j, j)]).sqrt()
                }
                false => 0.0,
            }
        };
        let eigen = DMatrix::from_fn(n, n, covariance).symmetric_eigen();
        let step = |k: usize| eigen.eigenvectors.column(k).iter().map(|v| v * eigen.eigenvalues[k].max(0.0).sqrt()).collect();
        (0..n).map(step).collect()
    }

    /// Standard error of parameter `k`, in its own unit; infinite where the record does not carry it.
    pub fn error(&self, k: usize) -> f64 {
        if self.carries(k) { self.variance(k).sqrt() * self.unit(k) } else { f64::INFINITY }
    }

    /// What parameter `k` moves by, in its own unit, where it moves by one [own unit].
    pub fn unit(&self, k: usize) -> f64 {
        if self.free[k].log { self.fit.theta[k].abs() } else { 1.0 }
    }
}

impl Fitter<'_> {
    /// Standard errors of all parameters; a parameter that the record does not carry has an infinite one.
    pub fn standard_errors(&self, fit: &Fit<'_>) -> Vec<f64> {
        let curvature = self.curvature(fit);
        (0..fit.theta.len()).map(|k| curvature.as_ref().map_or(f64::INFINITY, |curvature| curvature.error(k))).collect()
    }

    /// A fit with its derivatives; nothing where they are not finite.
    pub fn curvature<'c, 'a>(&self, fit: &'c Fit<'a>) -> Option<Curvature<'c, 'a>> {
        let free = fit.model.free();
        let mut simulator = Simulator::new(self.evidence);
        let mut residual = Vec::new();
        self.score(&mut simulator, &fit.model, &fit.theta, &mut residual);
        let all: Vec<usize> = (0..free.len()).collect();
        let slopes = self.slopes(&simulator, &free, &all, fit, &residual, Wanted::Exact);
        // Information of a t distribution is (nu + 1)/(nu + 3) of the weighted normal equations' expectation.
        let Equations { normal, .. } = self.normal_equations(&slopes, &free, fit, &residual)?;
        let inverse = inverse(&normal)?;
        let by_blocks = self.by_blocks(&slopes, &free, fit, &residual, &inverse);
        Some(Curvature { fit, free, slopes, normal, inverse, by_blocks })
    }

    /// Variances of the parameters by the scores of the blocks, in the units in which they move. `inverse`: that of the normal
    /// equations; both are in nats of effective samples.
    fn by_blocks(&self, slopes: &Slopes, free: &[Free], fit: &Fit<'_>, residual: &[f64], inverse: &DMatrix<f64>) -> Vec<f64> {
        let block = blocks(self);
        let count = block.last().map_or(0, |b| b + 1);
        let columns = slopes.columns();
        let scale_bar = if self.squared { fit.rmse_bar } else { fit.scale_bar };
        let pull = |e: f64| if self.squared { e } else { loss::weight(e, scale_bar) * e };
        let pulls: Vec<f64> = residual.iter().map(|e| if e.is_finite() { pull(*e) } else { 0.0 }).collect();
        let unit = 1.0 / (scale_bar * scale_bar * self.tau_samples);
        let mut scores = DMatrix::zeros(count, free.len());
        let mut begin = 0;
        for b in 0..count {
            let end = begin + block[begin..].iter().take_while(|of| **of == b).count();
            for (k, column) in columns.iter().enumerate() {
                scores[(b, k)] = unit * dot(&pulls[begin..end], &column[begin..end]);
            }
            begin = end;
        }
        // Few blocks that the parameters were fitted to pull less than they would have.
        let used = (count as f64 - free.len() as f64).max(1.0);
        let meat = scores.transpose() * &scores * (count as f64 / used);
        let covariance = inverse * meat * inverse;
        (0..free.len()).map(|k| covariance[(k, k)]).collect()
    }
}

/// Inverse of the normal equations, scaled to a unit diagonal on the way.
fn inverse(normal: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = normal.nrows();
    let scale: Vec<f64> = (0..n).map(|k| 1.0 / normal[(k, k)].max(1e-300).sqrt()).collect();
    let scaled = DMatrix::from_fn(n, n, |i, j| normal[(i, j)] * scale[i] * scale[j] + if i == j { 1e-9 } else { 0.0 });
    Some(DMatrix::from_fn(n, n, |i, j| scale[i] * scale[j]).component_mul(&scaled.try_inverse()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::base::AT;
    use crate::diagnose::evidence::tests::{held, straight, straight_run, waves};
    use crate::diagnose::model::Model;

    /// Standard error of the gain of a straight line whose readings are off by `error_bar`, at a sample and its time.
    fn of_gain(error_bar: impl Fn(usize, f64) -> f64) -> f64 {
        let valve = straight();
        let evidence = held(vec![straight_run(waves(12_000), error_bar)]);
        let base = Model::base(&valve).unwrap().on(&evidence);
        let fitter = Fitter { tau_samples: 1.0, squared: true, ..Fitter::new(&evidence) };
        let fit = fitter.refit(&base, &base.calibrated());
        fitter.standard_errors(&fit)[AT.gain]
    }

    #[test]
    fn a_gain_that_wanders_from_block_to_block_is_known_less_well_than_noise_of_that_size_would_have_it() {
        let mut state = 1u64;
        let chance: Vec<f64> = (0..12_000)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
            })
            .collect();
        let noise = of_gain(|k, _| 0.2 * chance[k]);
        // The gain is one per cent higher in every other stretch of 10 s: as large an error, in RMS 0.06 bar.
        let wandering = of_gain(|k, i| if (k / 1000).is_multiple_of(2) { 0.2 * (i - 0.5) } else { -0.2 * (i - 0.5) });
        assert!(wandering > 5.0 * noise, "{wandering} {noise}");
        // White noise of 0.058 bar on 12,000 samples of a sine of 6 bar, whose mean square is 18 bar^2.
        assert!((0.5..2.0).contains(&(noise / (0.2 / 12.0f64.sqrt() / (12_000.0f64 * 18.0).sqrt()))), "{noise}");
    }
}
