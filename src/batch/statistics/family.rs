//! Distributions that a metric may follow, each fitted by maximum likelihood.
//!
//! Two or three parameters each. A shifted log-normal stands for every skew on either side, with the normal one as its
//! limit; Student's t for tails heavier than normal, the uniform one for a bounded spread.

use statrs::function::gamma::{digamma, ln_gamma};

use super::fitted::Fitted;
use super::sample::mean_deviation;

/// A family of distributions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Mean and standard deviation.
    Normal,
    /// Logarithms are normal; positive values only.
    LogNormal,
    /// Shape and scale; positive values only.
    Gamma,
    /// Shape and scale; positive values only.
    Weibull,
    /// Log-normal from a threshold, upwards or downwards.
    ShiftedLogNormal,
    /// Student's t with these degrees of freedom, location and scale.
    StudentT(u8),
    /// Between two ends.
    Uniform,
}

/// All of them, the simplest first. Each weight of the tails is a family of its own, in even steps of the reciprocal of the
/// degrees of freedom, because a sample of hundreds hardly knows it: the normal one is the end of that row.
pub const FAMILIES: [Family; 11] = [
    Family::Normal,
    Family::LogNormal,
    Family::Gamma,
    Family::Weibull,
    Family::Uniform,
    Family::ShiftedLogNormal,
    Family::StudentT(20),
    Family::StudentT(10),
    Family::StudentT(7),
    Family::StudentT(5),
    Family::StudentT(4),
];

/// Largest deviation of the logarithm of a shifted log-normal: a skewness of 3.3. A threshold that moves into the smallest
/// value has no bound on its likelihood, and means nothing.
const STEEPEST: f64 = 0.75;

impl Family {
    /// Its name as reports print it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::LogNormal => "log-normal",
            Self::Gamma => "gamma",
            Self::Weibull => "Weibull",
            Self::ShiftedLogNormal => "shifted log-normal",
            Self::StudentT(20) => "Student t 20",
            Self::StudentT(10) => "Student t 10",
            Self::StudentT(7) => "Student t 7",
            Self::StudentT(5) => "Student t 5",
            Self::StudentT(4) => "Student t 4",
            Self::StudentT(_) => "Student t",
            Self::Uniform => "uniform",
        }
    }

    /// Number of fitted parameters.
    pub fn parameters(self) -> usize {
        match self {
            Self::ShiftedLogNormal => 3,
            _ => 2,
        }
    }

    /// The distribution of this family that makes the sorted `values` most likely, with the logarithm of that likelihood;
    /// `None` where the family cannot hold them.
    pub fn fit(self, values: &[f64]) -> Option<(Fitted, f64)> {
        let n = values.len() as f64;
        let (first, last) = (*values.first()?, *values.last()?);
        if values.len() < 3 || first == last {
            return None;
        }
        let found = match self {
            Self::Normal => {
                let (mean, deviation) = mean_deviation(values);
                let largest = deviation * ((n - 1.0) / n).sqrt();
                Some((Fitted::Normal { mean, deviation }, -n * largest.ln() - 0.5 * n * (std::f64::consts::TAU.ln() + 1.0)))
            }
            Self::LogNormal if first > 0.0 => log_normal(values, 1.0, 0.0),
            Self::Gamma if first > 0.0 => gamma(values),
            Self::Weibull if first > 0.0 => weibull(values),
            Self::LogNormal | Self::Gamma | Self::Weibull => None,
            Self::Uniform => {
                // The ends lie beyond the extremes by the mean distance between neighbours.
                let beyond = (last - first) / (n - 1.0);
                Some((Fitted::Uniform { low: first - beyond, high: last + beyond }, -n * (last - first).ln()))
            }
            Self::ShiftedLogNormal => [1.0, -1.0].into_iter().filter_map(|side| shifted(values, side)).max_by(|a, b| a.1.total_cmp(&b.1)),
            Self::StudentT(freedom) => student(values, f64::from(freedom)),
        };
        found.filter(|f| f.1.is_finite())
    }
}

fn log_normal(values: &[f64], side: f64, threshold: f64) -> Option<(Fitted, f64)> {
    let n = values.len() as f64;
    let (mut sum, mut squares) = (0.0, 0.0);
    // Around the first logarithm, so that nothing cancels.
    let start = (side * (values[0] - threshold)).ln();
    for v in values {
        let log = (side * (v - threshold)).ln() - start;
        sum += log;
        squares += log * log;
    }
    let variance = (squares - sum * sum / n) / n;
    let mean_log = start + sum / n;
    let likelihood = -0.5 * n * (std::f64::consts::TAU.ln() + variance.ln() + 1.0) - n * mean_log;
    let deviation_log = (variance * n / (n - 1.0)).sqrt();
    (variance > 0.0).then_some((Fitted::LogNormal { side, threshold, mean_log, deviation_log }, likelihood))
}

/// The threshold by a search over its distance from the nearest value.
fn shifted(values: &[f64], side: f64) -> Option<(Fitted, f64)> {
    let (first, last) = (values[0], values[values.len() - 1]);
    let (edge, span) = (if side > 0.0 { first } else { last }, last - first);
    let at = |distance: f64| {
        let found = log_normal(values, side, edge - side * distance * span)?;
        matches!(found.0, Fitted::LogNormal { deviation_log, .. } if deviation_log <= STEEPEST).then_some(found)
    };
    // From a hundredth of the span to thirty spans, where it is as good as normal.
    const POINTS: usize = 24;
    let grid: Vec<f64> = (0..=POINTS).map(|k| 0.01 * 3000f64.powf(k as f64 / POINTS as f64)).collect();
    let value = |k: usize| at(grid[k]).map_or(f64::NEG_INFINITY, |f| f.1);
    let best = (0..=POINTS).max_by(|a, b| value(*a).total_cmp(&value(*b)))?;
    let (mut low, mut high) = (grid[best.saturating_sub(1)], grid[(best + 1).min(POINTS)]);
    for _ in 0..12 {
        let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        let of = |d: f64| at(d).map_or(f64::NEG_INFINITY, |f| f.1);
        if of(left) > of(right) { high = right } else { low = left }
    }
    [at(grid[best]), at(0.5 * (low + high))].into_iter().flatten().max_by(|a, b| a.1.total_cmp(&b.1))
}

fn gamma(values: &[f64]) -> Option<(Fitted, f64)> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let mean_log = values.iter().map(|v| v.ln()).sum::<f64>() / n;
    let gap = mean.ln() - mean_log;
    if gap <= 1e-12 {
        return None;
    }
    // Start and iteration: T. P. Minka, "Estimating a Gamma distribution", 2002.
    let mut shape = (3.0 - gap + ((gap - 3.0).powi(2) + 24.0 * gap).sqrt()) / (12.0 * gap);
    for _ in 0..20 {
        let trigamma = (digamma(shape * (1.0 + 1e-5)) - digamma(shape * (1.0 - 1e-5))) / (2e-5 * shape);
        let next = 1.0 / (1.0 / shape + (shape.ln() - digamma(shape) - gap) / (shape * shape * (1.0 / shape - trigamma)));
        let moved = (next - shape).abs();
        shape = next;
        if moved < 1e-9 * shape {
            break;
        }
    }
    if !(shape.is_finite() && shape > 0.0) {
        return None;
    }
    let scale = mean / shape;
    let likelihood = n * ((shape - 1.0) * mean_log - shape - shape * scale.ln() - ln_gamma(shape));
    Some((Fitted::Gamma { shape, scale }, likelihood))
}

fn weibull(values: &[f64]) -> Option<(Fitted, f64)> {
    let n = values.len() as f64;
    let logs: Vec<f64> = values.iter().map(|v| v.ln()).collect();
    let (mean_log, deviation_log) = mean_deviation(&logs);
    // The deviation of the logarithm is pi / (sqrt(6) shape).
    let mut shape = std::f64::consts::PI / (6f64.sqrt() * deviation_log);
    let mut mean_power = 0.0;
    for _ in 0..50 {
        let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
        for log in &logs {
            let centred = log - mean_log;
            let power = (shape * centred).exp();
            s0 += power;
            s1 += power * centred;
            s2 += power * centred * centred;
        }
        mean_power = s0 / n;
        let value = s1 / s0 - 1.0 / shape;
        let slope = (s2 * s0 - s1 * s1) / (s0 * s0) + 1.0 / (shape * shape);
        let step = value / slope;
        shape = (shape - step).max(0.2 * shape);
        if step.abs() < 1e-9 * shape {
            break;
        }
    }
    let scale = mean_log.exp() * mean_power.powf(1.0 / shape);
    let likelihood = n * (shape.ln() - shape * scale.ln() + (shape - 1.0) * mean_log - 1.0);
    (shape.is_finite() && scale > 0.0).then_some((Fitted::Weibull { shape, scale }, likelihood))
}

/// Location and scale for known degrees of freedom, by expectation and maximisation.
fn student(values: &[f64], freedom: f64) -> Option<(Fitted, f64)> {
    let n = values.len() as f64;
    let mut location = values[values.len() / 2];
    let mut square = {
        let quartiles = values[3 * values.len() / 4] - values[values.len() / 4];
        (quartiles / 1.4).powi(2)
    };
    if square <= 0.0 {
        return None;
    }
    for _ in 0..60 {
        let (mut weights, mut first, mut second) = (0.0, 0.0, 0.0);
        for v in values {
            let d = v - location;
            let w = (freedom + 1.0) / (freedom + d * d / square);
            weights += w;
            first += w * d;
            second += w * d * d;
        }
        let shift = first / weights;
        let next = (second - weights * shift * shift) / n;
        location += shift;
        let moved = (next / square - 1.0).abs();
        square = next;
        if moved < 1e-6 {
            break;
        }
    }
    let constant = ln_gamma(0.5 * (freedom + 1.0)) - ln_gamma(0.5 * freedom) - 0.5 * (freedom * std::f64::consts::PI * square).ln();
    let tails: f64 = values.iter().map(|v| ((v - location).powi(2) / (freedom * square)).ln_1p()).sum();
    let likelihood = n * constant - 0.5 * (freedom + 1.0) * tails;
    (square > 0.0).then_some((Fitted::StudentT { location, scale: square.sqrt(), freedom }, likelihood))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    fn truths() -> Vec<(Family, Fitted)> {
        let of = [
            Fitted::Normal { mean: 3.0, deviation: 0.5 },
            Fitted::LogNormal { side: 1.0, threshold: 0.0, mean_log: 0.4, deviation_log: 0.3 },
            Fitted::Gamma { shape: 16.0, scale: 0.1 },
            Fitted::Weibull { shape: 2.0, scale: 1.5 },
            Fitted::Uniform { low: 1.0, high: 2.0 },
            Fitted::LogNormal { side: -1.0, threshold: 5.0, mean_log: 0.4, deviation_log: 0.4 },
            Fitted::StudentT { location: 1.0, scale: 0.2, freedom: 20.0 },
        ];
        FAMILIES.into_iter().zip(of).collect()
    }

    #[test]
    fn quantile_and_share_are_inverse_and_a_large_sample_gives_its_parameters_back() {
        let mut rng = Pcg64::seed_from_u64(1);
        for (family, truth) in truths() {
            for p in [0.00135, 0.2, 0.5, 0.9, 0.99865] {
                assert!((truth.share_below(truth.quantile(p)) - p).abs() < 1e-7, "{truth:?} {p}");
            }
            let values = truth.draw(20_000, &mut rng);
            let (fitted, _) = family.fit(&values).unwrap();
            for p in [0.00135, 0.5, 0.99865] {
                let scale = truth.quantile(0.99865) - truth.quantile(0.00135);
                assert!((fitted.quantile(p) - truth.quantile(p)).abs() < 0.03 * scale, "{fitted:?} is not {truth:?} at {p}");
            }
            assert!(fitted.distance(&values) < 2.5, "{fitted:?}");
        }
    }

    #[test]
    fn the_likelihood_is_that_of_the_density() {
        // By the difference quotient of the distribution function, an independent way to the density.
        let mut rng = Pcg64::seed_from_u64(2);
        for (family, truth) in truths() {
            let values = truth.draw(60, &mut rng);
            let (fitted, likelihood) = family.fit(&values).unwrap();
            if family == Family::Uniform {
                continue;
            }
            let density = |x: f64| (fitted.share_below(x + 1e-5) - fitted.share_below(x - 1e-5)) / 2e-5;
            let sum: f64 = values.iter().map(|v| density(*v).ln()).sum();
            // Spreads with the divisor n - 1 lie a little off the maximum.
            assert!((sum - likelihood).abs() < 0.02, "{fitted:?}: {sum} {likelihood}");
        }
    }

    #[test]
    fn the_gamma_fit_is_the_maximum() {
        let mut rng = Pcg64::seed_from_u64(3);
        let values = Fitted::Gamma { shape: 5.0, scale: 1.0 }.draw(50, &mut rng);
        let Some((Fitted::Gamma { shape, scale }, best)) = Family::Gamma.fit(&values) else { panic!() };
        let at = |k: f64, s: f64| values.iter().map(|v| (k - 1.0) * v.ln() - v / s - k * s.ln() - ln_gamma(k)).sum::<f64>();
        assert!((at(shape, scale) - best).abs() < 1e-9);
        for (k, s) in [(shape * 1.01, scale), (shape * 0.99, scale), (shape, scale * 1.01), (shape, scale * 0.99)] {
            assert!(at(k, s) < best);
        }
    }

    #[test]
    fn negative_values_have_no_gamma() {
        assert!(Family::Gamma.fit(&[-1.0, 1.0, 2.0]).is_none() && Family::Weibull.fit(&[-1.0, 1.0, 2.0]).is_none());
        assert!(Family::Normal.fit(&[1.0, 1.0, 1.0]).is_none());
    }
}
