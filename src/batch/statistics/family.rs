//! Distributions that a metric may follow, each fitted by maximum likelihood.
//!
//! Two or three parameters each. A shifted log-normal stands for every skew on either side, with the normal one as its
//! limit; Student's t for tails heavier than normal, the uniform one for a bounded spread.

use statrs::function::gamma::{digamma, ln_gamma};

use super::distribution::bisect;
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
            // A value that is not positive has no finite logarithm, and such a sample no finite likelihood.
            Self::LogNormal => log_normal(values, 1.0, 0.0),
            Self::Gamma => gamma(values),
            Self::Weibull => weibull(values),
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
    likelihood.is_finite().then_some((Fitted::LogNormal { side, threshold, mean_log, deviation_log }, likelihood))
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
    // Between 1/2 and 1 of the reciprocal of the gap: 1/(2k) < ln k - psi(k) < 1/k (H. Alzer, Math. Comp. 66 (1997) 373-389).
    let shape = bisect(0.5 / gap, 1.0 / gap, |k| k.ln() - digamma(k) > gap);
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
    Some((Fitted::Weibull { shape, scale }, likelihood))
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
        let moved = (next - square).abs();
        square = next;
        if moved < 1e-6 * square {
            break;
        }
    }
    let constant = ln_gamma(0.5 * (freedom + 1.0)) - ln_gamma(0.5 * freedom) - 0.5 * (freedom * std::f64::consts::PI * square).ln();
    let tails: f64 = values.iter().map(|v| ((v - location).powi(2) / (freedom * square)).ln_1p()).sum();
    let likelihood = n * constant - 0.5 * (freedom + 1.0) * tails;
    Some((Fitted::StudentT { location, scale: square.sqrt(), freedom }, likelihood))
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
            Fitted::Uniform { low: 1.0, high: 3.0 },
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

    /// Three values in even ratios exp(d), about 5: their logarithms are d apart.
    fn ratios(d: f64) -> [f64; 3] {
        [5.0 * (-d).exp(), 5.0, 5.0 * d.exp()]
    }

    /// psi(1/4) = -g - pi/2 - 3 ln 2, psi(1/2) = -g - 2 ln 2, psi(1) = -g, psi(2) = 1 - g with Euler's g, psi(10) = 2.2517525890667 (M. Abramowitz, I. Stegun,
    /// 6.3.2 to 6.3.4 and table 6.1): samples whose mean logarithm lies as far below that of their mean as ln k - psi(k).
    #[test]
    fn the_shape_of_a_gamma_is_where_its_digamma_is_known() {
        let euler = 0.577_215_664_901_532_9;
        let quarter = -euler - 0.5 * std::f64::consts::PI - 3.0 * 2f64.ln();
        let psi = [(0.25, quarter), (0.5, -euler - 2.0 * 2f64.ln()), (1.0, -euler), (2.0, 1.0 - euler), (10.0, 2.251_752_589_066_721)];
        for (k, psi) in psi {
            // The mean is (1 + 2 cosh d)/3 of the middle.
            let gap = f64::ln(k) - psi;
            let values = ratios((0.5 * (3.0 * gap.exp() - 1.0)).acosh());
            let Some((Fitted::Gamma { shape, scale }, _)) = Family::Gamma.fit(&values) else { panic!("{k}") };
            assert!((shape / k - 1.0).abs() < 1e-9 && (shape * scale / (5.0 * gap.exp()) - 1.0).abs() < 1e-9, "{shape} is not {k}");
        }
    }

    /// Of three logarithms d apart the shape is u/d with 2 u sinh u = 1 + 2 cosh u: the derivative of the likelihood set to zero by hand.
    #[test]
    fn the_shape_of_a_weibull_of_three_values() {
        let u = 1.394_957_345_035_797_f64;
        for d in [1e-3, 0.1, 1.0, 4.0] {
            let Some((Fitted::Weibull { shape, scale }, _)) = Family::Weibull.fit(&ratios(d)) else { panic!("{d}") };
            let expected = 5.0 * ((1.0 + 2.0 * u.cosh()) / 3.0).powf(d / u);
            assert!((shape * d / u - 1.0).abs() < 1e-9 && (scale / expected - 1.0).abs() < 1e-8, "{d}: {shape} {scale}");
        }
    }

    /// Of -1, 0 and 1 the squared scale is (2 v - 1)/(3 v) for v degrees of freedom, wherever they lie and however wide.
    #[test]
    fn the_scale_of_a_student_of_three_values() {
        for (freedom, width, middle) in [(4, 1.0, 0.0), (20, 3e4, -7.0), (5, 1e-3, 400.0)] {
            let values = [middle - width, middle, middle + width];
            let Some((Fitted::StudentT { location, scale, .. }, _)) = Family::StudentT(freedom).fit(&values) else { panic!() };
            let v = f64::from(freedom);
            let expected = width * ((2.0 * v - 1.0) / (3.0 * v)).sqrt();
            assert!((location - middle).abs() < 1e-6 * width && (scale / expected - 1.0).abs() < 1e-5, "{location} {scale} {expected}");
        }
        // Of a skewed sample neither place nor scale can be moved to what is likelier.
        let values = [0.0, 0.3, 0.5, 0.9, 1.0, 1.8, 2.5, 4.0, 9.0];
        let Some((Fitted::StudentT { location, scale, .. }, best)) = Family::StudentT(5).fit(&values) else { panic!() };
        let at = |location: f64, scale: f64| {
            use statrs::distribution::{Continuous, StudentsT};
            values.iter().map(|v| StudentsT::new(location, scale, 5.0).unwrap().ln_pdf(*v)).sum::<f64>()
        };
        assert!((at(location, scale) - best).abs() < 1e-9);
        for (l, s) in [(0.01, 1.0), (-0.01, 1.0), (0.0, 1.01), (0.0, 0.99)] {
            assert!(at(location + l * scale, s * scale) < best, "{l} {s}");
        }
        // Where most values are one, a narrower scale is always likelier: there is no such distribution.
        assert!(Family::StudentT(4).fit(&[0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0]).is_none());
    }

    /// Of e, e^2 and e^3: mean 2 and deviation 1 of the logarithms. Of 1 to 5: one mean distance beyond either end.
    #[test]
    fn a_log_normal_and_a_uniform_by_hand() {
        let found = Family::LogNormal.fit(&[1f64.exp(), 2f64.exp(), 3f64.exp()]).unwrap().0;
        let Fitted::LogNormal { mean_log, deviation_log, .. } = found else { panic!() };
        assert!((mean_log - 2.0).abs() < 1e-12 && (deviation_log - 1.0).abs() < 1e-12);
        let (found, likelihood) = Family::Uniform.fit(&[1.0, 2.0, 2.5, 4.0, 5.0]).unwrap();
        assert_eq!(found, Fitted::Uniform { low: 0.0, high: 6.0 });
        assert!((likelihood + 5.0 * 4f64.ln()).abs() < 1e-12);
    }

    /// No threshold a hundredth of its distance nearer or farther makes the values likelier; steep ones end at the steepest.
    #[test]
    fn the_threshold_is_the_likeliest() {
        let sample = |side: f64, at: f64, size: f64, deviation_log: f64| {
            let truth = Fitted::LogNormal { side, threshold: at, mean_log: size.ln(), deviation_log };
            let mut values: Vec<f64> = (0..60).map(|k| truth.quantile((f64::from(k) + 0.5) / 60.0)).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        for (side, at, size, deviation_log) in [
            (1.0, 0.0, 1.0, 0.5),
            (-1.0, 5.0, 2.0, 0.4),
            (1.0, 1000.0, 0.01, 0.3),
            (-1.0, -300.0, 50.0, 0.6),
            (1.0, -2.0, 3.0, 0.15),
            (-1.0, 1.0, 1.0, 0.7),
        ] {
            let values = sample(side, at, size, deviation_log);
            let Some((Fitted::LogNormal { side: found, threshold, deviation_log: deviation, .. }, best)) =
                Family::ShiftedLogNormal.fit(&values)
            else {
                panic!()
            };
            assert!(found == side && (deviation / deviation_log - 1.0).abs() < 0.2, "{found} {deviation}");
            let distance = if side > 0.0 { values[0] - threshold } else { values[59] - threshold };
            for share in [0.99, 1.01] {
                let (_, beside) = log_normal(&values, side, threshold + (1.0 - share) * distance).unwrap();
                assert!(beside < best, "{side} {at}: {beside} {best}");
            }
        }
        let Some((Fitted::LogNormal { deviation_log, .. }, _)) = Family::ShiftedLogNormal.fit(&sample(1.0, 3.0, 1.0, 1.2)) else {
            panic!()
        };
        assert!((0.98 * STEEPEST..=STEEPEST).contains(&deviation_log), "{deviation_log}");
        // What leans to neither side has its threshold as far away as it may lie.
        let even: Vec<f64> = (0..=40).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        let Some((Fitted::LogNormal { side, threshold, .. }, _)) = Family::ShiftedLogNormal.fit(&even) else { panic!() };
        assert!(((threshold - 4.0) * side + 2.0 + 120.0).abs() < 1e-6, "{side} {threshold}");
    }

    #[test]
    fn a_family_holds_only_what_it_can() {
        for family in [Family::LogNormal, Family::Gamma, Family::Weibull] {
            assert!([-1.0, 0.0].iter().all(|first| family.fit(&[*first, 1.0, 2.0]).is_none()), "{family:?}");
        }
        for family in FAMILIES {
            assert!(family.fit(&[]).is_none() && family.fit(&[1.0, 2.0]).is_none() && family.fit(&[1.0, 1.0, 1.0]).is_none());
            assert!(family.fit(&[1.0, 2.0, 4.0]).is_some(), "{family:?}");
            assert!(family.fit(&[1.0, 2.0, 4.0, 5.0, 6.0, 6.5, 7.0, 7.5, 8.0, 9.0, 10.0, 12.0, 17.0]).is_some(), "{family:?}");
        }
    }
}
