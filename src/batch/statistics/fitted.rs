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
                // Beyond the threshold the logarithm is that of 0.
                let log = (side * (x - threshold)).max(0.0).ln();
                normal_cdf(side * (log - mean_log) / deviation_log)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Exponential, half a squared normal deviate, an Erlang of 3 (1 - exp(-x) (1 + x + x^2/2)), and wide ones through their shares.
    #[test]
    fn quantiles_of_the_gamma_distribution() {
        for p in [0.00135, 0.025, 0.3, 0.5, 0.9, 0.99865] {
            let near = |found: f64, wanted: f64| assert!((found / wanted - 1.0).abs() < 1e-8, "{p}: {found} is not {wanted}");
            near(gamma_quantile(1.0, p), -(-p).ln_1p());
            near(gamma_quantile(0.5, p), 0.5 * normal_quantile(0.5 + 0.5 * p).powi(2));
            let x = gamma_quantile(3.0, p);
            near(1.0 - (-x).exp() * (1.0 + x + 0.5 * x * x), p);
            for shape in [0.1, 0.7, 1.1, 20.0, 1e4] {
                near(Gamma::new(shape, 1.0).unwrap().cdf(gamma_quantile(shape, p)), p);
            }
        }
    }

    /// Values at 1/4 and 3/4: -2 - (2 ln 1/4 + 6 ln 3/4)/2.
    #[test]
    fn the_anderson_darling_distance_of_two_values() {
        let distance = Fitted::Uniform { low: 0.0, high: 1.0 }.distance(&[0.25, 0.75]);
        assert!((distance - (-2.0 - 0.25f64.ln() - 3.0 * 0.75f64.ln())).abs() < 1e-12, "{distance}");
    }

    /// Beyond a threshold, or below a positive family's zero, there is nothing.
    #[test]
    fn a_distribution_ends_at_its_threshold() {
        let of = |side: f64| Fitted::LogNormal { side, threshold: 2.0, mean_log: 0.0, deviation_log: 0.5 };
        assert_eq!(
            [of(1.0).share_below(2.0), of(1.0).share_below(1.0), of(-1.0).share_below(2.0), of(-1.0).share_below(3.0)],
            [0.0, 0.0, 1.0, 1.0]
        );
        assert_eq!(Fitted::Weibull { shape: 2.0, scale: 1.0 }.share_below(-1.0), 0.0);
        assert!((of(-1.0).share_below(1.0) - 0.5).abs() < 1e-12 && (of(-1.0).quantile(0.5) - 1.0).abs() < 1e-12);
    }
}
