//! One distribution: its quantiles, its shares, values drawn from it, and how far values are from it.

use rand_distr::Distribution;
use rand_pcg::Pcg64;
use statrs::distribution::{ContinuousCDF, Gamma, StudentsT};
use statrs::function::gamma::ln_gamma;

use super::distribution::{normal_cdf, normal_quantile};

/// One distribution of a family.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fitted {
    /// See [`super::family::Family::Normal`].
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        deviation: f64,
    },
    /// See [`super::family::Family::LogNormal`] and [`super::family::Family::ShiftedLogNormal`].
    LogNormal {
        /// +1 where the long tail is above the threshold, -1 below.
        side: f64,
        /// Threshold; 0 for the plain one.
        threshold: f64,
        /// Mean of the logarithm of the distance from the threshold.
        mean_log: f64,
        /// Its standard deviation.
        deviation_log: f64,
    },
    /// See [`super::family::Family::Gamma`].
    Gamma {
        /// Shape.
        shape: f64,
        /// Scale.
        scale: f64,
    },
    /// See [`super::family::Family::Weibull`].
    Weibull {
        /// Shape.
        shape: f64,
        /// Scale.
        scale: f64,
    },
    /// See [`super::family::Family::StudentT`].
    StudentT {
        /// Location.
        location: f64,
        /// Scale.
        scale: f64,
        /// Degrees of freedom.
        freedom: f64,
    },
    /// See [`super::family::Family::Uniform`].
    Uniform {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
}

impl Fitted {
    /// The value below which a share `p` lies.
    pub fn quantile(&self, p: f64) -> f64 {
        match *self {
            Self::Normal { mean, deviation } => mean + deviation * normal_quantile(p),
            Self::LogNormal { side, threshold, mean_log, deviation_log } => {
                threshold + side * (mean_log + deviation_log * side * normal_quantile(p)).exp()
            }
            Self::Gamma { shape, scale } => scale * gamma_quantile(shape, p),
            Self::Weibull { shape, scale } => scale * (-(-p).ln_1p()).powf(1.0 / shape),
            Self::StudentT { location, scale, freedom } => {
                location + scale * StudentsT::new(0.0, 1.0, freedom).map_or(f64::NAN, |t| t.inverse_cdf(p))
            }
            Self::Uniform { low, high } => low + p * (high - low),
        }
    }

    /// The share below `x`.
    pub fn share_below(&self, x: f64) -> f64 {
        match *self {
            Self::Normal { mean, deviation } => normal_cdf((x - mean) / deviation),
            Self::LogNormal { side, threshold, mean_log, deviation_log } => {
                let distance = side * (x - threshold);
                let z = if distance > 0.0 { (distance.ln() - mean_log) / deviation_log } else { f64::NEG_INFINITY };
                normal_cdf(side * z)
            }
            Self::Gamma { shape, scale } => Gamma::new(shape, 1.0 / scale).map_or(f64::NAN, |g| g.cdf(x)),
            Self::Weibull { shape, scale } => -(-(x.max(0.0) / scale).powf(shape)).exp_m1(),
            Self::StudentT { location, scale, freedom } => StudentsT::new(location, scale, freedom).map_or(f64::NAN, |t| t.cdf(x)),
            Self::Uniform { low, high } => ((x - low) / (high - low)).clamp(0.0, 1.0),
        }
    }

    /// `count` values of this distribution, sorted.
    pub fn draw(&self, count: usize, rng: &mut Pcg64) -> Vec<f64> {
        use rand_distr::{Gamma, StandardNormal, StandardUniform, StudentT, Weibull};
        let mut one: Box<dyn FnMut(&mut Pcg64) -> f64> = match *self {
            Self::Normal { mean, deviation } => Box::new(move |r| {
                let z: f64 = StandardNormal.sample(r);
                mean + deviation * z
            }),
            Self::LogNormal { side, threshold, mean_log, deviation_log } => Box::new(move |r| {
                let z: f64 = StandardNormal.sample(r);
                threshold + side * (mean_log + deviation_log * z).exp()
            }),
            Self::Gamma { shape, scale } => match Gamma::new(shape, scale) {
                Ok(g) => Box::new(move |r| g.sample(r)),
                Err(_) => Box::new(|_| f64::NAN),
            },
            Self::Weibull { shape, scale } => match Weibull::new(scale, shape) {
                Ok(w) => Box::new(move |r| w.sample(r)),
                Err(_) => Box::new(|_| f64::NAN),
            },
            Self::StudentT { location, scale, freedom } => match StudentT::new(freedom) {
                Ok(t) => Box::new(move |r| location + scale * t.sample(r)),
                Err(_) => Box::new(|_| f64::NAN),
            },
            Self::Uniform { low, high } => Box::new(move |r| {
                let u: f64 = StandardUniform.sample(r);
                low + (high - low) * u
            }),
        };
        let mut values: Vec<f64> = (0..count).map(|_| one(rng)).collect();
        values.sort_by(f64::total_cmp);
        values
    }

    /// Anderson-Darling distance of sorted values from this distribution.
    pub fn distance(&self, sorted: &[f64]) -> f64 {
        let n = sorted.len();
        let shares: Vec<f64> = sorted.iter().map(|v| self.share_below(*v)).collect();
        // Far out, a share is 0 or 1: the floor keeps its logarithm finite and the distance huge.
        let log = |p: f64| p.max(1e-300).ln();
        let sum: f64 = (0..n).map(|i| (2 * i + 1) as f64 * (log(shares[i]) + log(1.0 - shares[n - 1 - i]))).sum();
        -(n as f64) - sum / n as f64
    }
}

/// Quantile of the gamma distribution with scale 1: Wilson and Hilferty's start, then Newton.
fn gamma_quantile(shape: f64, p: f64) -> f64 {
    let Ok(distribution) = Gamma::new(shape, 1.0) else { return f64::NAN };
    let cube = 1.0 - 1.0 / (9.0 * shape) + normal_quantile(p) / (3.0 * shape.sqrt());
    let mut x = if cube > 0.0 { shape * cube.powi(3) } else { (p * ln_gamma(shape + 1.0).exp()).powf(1.0 / shape) };
    for _ in 0..30 {
        let density = ((shape - 1.0) * x.ln() - x - ln_gamma(shape)).exp();
        let step = (distribution.cdf(x) - p) / density;
        if !step.is_finite() {
            break;
        }
        x = (x - step).max(0.5 * x);
        if step.abs() < 1e-10 * x {
            break;
        }
    }
    x
}
