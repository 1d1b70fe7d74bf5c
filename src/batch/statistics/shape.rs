//! Which distribution a metric follows, and how well its quantiles are known.
//!
//! Families are weighed by AIC (K. P. Burnham, D. R. Anderson, "Model Selection and Multimodel Inference", 2nd ed., section
//! 2.9: weights exp(-AIC/2)); one that its own Anderson-Darling test refuses is out (parametric bootstrap: W. Stute, W.
//! Gonzales Manteiga, M. Presedo Quindimil, Metrika 40 (1993) 243-256). Intervals come from the same bootstrap, each
//! family with its weight, so that an interval also knows that the family is not known.

use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::family::{FAMILIES, Family};
use super::fitted::Fitted;
use super::{CONFIDENCE, Finding, Interval};

/// Bootstrap samples of all families together.
const SAMPLES: usize = 400;
/// Smallest number of bootstrap samples for a test at [`REFUSED`].
const TEST_SAMPLES: usize = 99;
/// A family with less weight than this changes no interval at the 95 % level.
const NEGLIGIBLE: f64 = 0.005;
/// A family with less weight than this is not tested: it cannot be the chosen one, and moves an interval little.
const LIGHT: f64 = 0.1;
/// Probability below which a family is refused.
const REFUSED: f64 = 0.01;
/// Largest bootstrap sample; the spread of a larger one follows by the square root of its size.
const LARGEST_SAMPLE: usize = 2000;
/// From this number of values on, the values reach the 0.135 % quantiles themselves.
const FEWEST_QUANTILES: usize = 2000;
/// Shares that ISO 22514-2 takes as the ends of the process, and its middle.
const SHARES: [f64; 3] = [0.00135, 0.5, 0.99865];

/// One family that was weighed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Its name.
    pub family: String,
    /// Its Akaike weight among all.
    pub weight: f64,
    /// Probability of so large an Anderson-Darling distance if the values followed it; `None` where its weight is too small to matter.
    pub p_value: Option<f64>,
}

/// The distribution that stands for a metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Name of the family.
    pub family: String,
    /// Its 0.135 %, 50 % and 99.865 % quantiles, in the metric's unit.
    pub quantiles: (f64, f64, f64),
    /// What was weighed, the likeliest first.
    pub candidates: Vec<Candidate>,
}

/// Low end, middle and high end of a process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiles {
    /// 0.135 %.
    pub low: f64,
    /// 50 %.
    pub middle: f64,
    /// 99.865 %.
    pub high: f64,
}

impl Quantiles {
    fn of(fitted: &Fitted) -> Self {
        let [low, middle, high] = SHARES.map(|p| fitted.quantile(p));
        Self { low, middle, high }
    }
}

/// The distribution with its bootstrap.
#[doc(alias("AIC", "bootstrap"))]
pub struct Weighed {
    /// What is reported.
    pub shape: Shape,
    /// The quantiles of the chosen family.
    pub quantiles: Quantiles,
    /// Bootstrap quantiles with the weight of each, and the quantiles that the sample was drawn from.
    replicates: Vec<(Quantiles, f64, Quantiles)>,
    /// By how much a bootstrap sample spreads more than the values do.
    spread: f64,
}

struct Rated {
    family: Family,
    fitted: Fitted,
    weight: f64,
    p_value: Option<f64>,
    replicates: Vec<Quantiles>,
}

/// Weighs the families on `values`.
pub fn weigh(values: &[f64]) -> Finding<Weighed> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let fits: Vec<(Family, Fitted, f64)> = FAMILIES
        .into_iter()
        .filter_map(|family| family.fit(&sorted).map(|(fitted, likelihood)| (family, fitted, criterion(family, likelihood, sorted.len()))))
        .collect();
    let Some(best) = fits.iter().map(|f| f.2).min_by(f64::total_cmp) else {
        return Finding::absent("no distribution can hold the values");
    };
    let relative = |aic: f64| (-0.5 * (aic - best)).exp();
    let sum: f64 = fits.iter().map(|f| relative(f.2)).sum();
    let mut rated: Vec<Rated> = fits
        .into_iter()
        .map(|(family, fitted, aic)| Rated { family, fitted, weight: relative(aic) / sum, p_value: None, replicates: Vec::new() })
        .collect();
    rated.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let size = sorted.len().min(LARGEST_SAMPLE);
    // The same values give the same interval on every machine.
    let mut rng = Pcg64::seed_from_u64(22_514);
    for candidate in rated.iter_mut().filter(|c| c.weight >= NEGLIGIBLE) {
        candidate.bootstrap(&sorted, size, &mut rng);
    }
    let candidates: Vec<Candidate> =
        rated.iter().map(|c| Candidate { family: c.family.name().into(), weight: c.weight, p_value: c.p_value }).collect();
    let kept: Vec<&Rated> = rated.iter().filter(|c| c.p_value.is_none_or(|p| p >= REFUSED) && !c.replicates.is_empty()).collect();
    let Some(chosen) = kept.iter().find(|c| c.p_value.is_some()) else {
        if sorted.len() >= FEWEST_QUANTILES {
            return Finding::of(of_the_values(&sorted, candidates, &mut rng));
        }
        let first = &candidates[0];
        return Finding::absent(format!("no distribution fits the values (the nearest, {}, has p < {REFUSED})", first.family));
    };
    let quantiles = Quantiles::of(&chosen.fitted);
    let shape = Shape { family: chosen.family.name().into(), quantiles: (quantiles.low, quantiles.middle, quantiles.high), candidates };
    let replicates = kept.iter().flat_map(|c| {
        let (each, truth) = (c.weight / c.replicates.len() as f64, Quantiles::of(&c.fitted));
        c.replicates.iter().map(move |q| (*q, each, truth))
    });
    let spread = (size as f64 / sorted.len() as f64).sqrt();
    Finding::of(Weighed { shape, quantiles, replicates: replicates.collect(), spread })
}

/// Without any family: the quantiles of the values, and those of samples drawn from the values.
fn of_the_values(sorted: &[f64], candidates: Vec<Candidate>, rng: &mut Pcg64) -> Weighed {
    use rand::RngExt;
    let at = |values: &[f64], p: f64| {
        let place = p * (values.len() - 1) as f64;
        let below = place.floor() as usize;
        values[below] + (place - place.floor()) * (values[below + 1] - values[below])
    };
    let of = |values: &[f64]| Quantiles { low: at(values, SHARES[0]), middle: at(values, SHARES[1]), high: at(values, SHARES[2]) };
    let quantiles = of(sorted);
    let replicates = (0..SAMPLES).map(|_| {
        let mut sample: Vec<f64> = (0..sorted.len()).map(|_| sorted[rng.random_range(0..sorted.len())]).collect();
        sample.sort_by(f64::total_cmp);
        (of(&sample), 1.0, quantiles)
    });
    let shape =
        Shape { family: "quantiles of the values".into(), quantiles: (quantiles.low, quantiles.middle, quantiles.high), candidates };
    Weighed { shape, quantiles, replicates: replicates.collect(), spread: 1.0 }
}

/// Akaike's criterion with the correction for few values (C. M. Hurvich, C.-L. Tsai, Biometrika 76 (1989) 297-307).
fn criterion(family: Family, likelihood: f64, count: usize) -> f64 {
    let (k, n) = (family.parameters() as f64, count as f64);
    2.0 * k - 2.0 * likelihood + 2.0 * k * (k + 1.0) / (n - k - 1.0).max(1.0)
}

impl Rated {
    fn bootstrap(&mut self, sorted: &[f64], size: usize, rng: &mut Pcg64) {
        let tested = self.weight >= LIGHT;
        let count = ((self.weight * SAMPLES as f64).ceil() as usize).max(if tested { TEST_SAMPLES } else { 2 });
        // A distance does not grow with the size of the sample where the family is right.
        let observed = if tested { self.fitted.distance(sorted) } else { 0.0 };
        let mut farther = 0;
        for _ in 0..count {
            let sample = self.fitted.draw(size, rng);
            let Some((refitted, _)) = self.family.fit(&sample) else { continue };
            farther += usize::from(tested && refitted.distance(&sample) >= observed);
            self.replicates.push(Quantiles::of(&refitted));
        }
        self.p_value = tested.then(|| (1 + farther) as f64 / (count + 1) as f64);
    }
}

impl Weighed {
    /// The interval of a figure of the quantiles.
    ///
    /// Each bootstrap figure is turned round its family's own (the basic bootstrap; A. C. Davison, D. V. Hinkley, "Bootstrap
    /// Methods and their Application", section 5.2), on a scale on which a ratio spreads evenly: asinh is a logarithm for
    /// figures far from 0 and a line near it.
    pub fn interval(&self, figure: impl Fn(&Quantiles) -> f64) -> Interval {
        let turned = |(q, weight, truth): &(Quantiles, f64, Quantiles)| {
            let (at, base) = (figure(q).asinh(), figure(truth).asinh());
            ((base - self.spread * (at - base)).sinh(), *weight)
        };
        let mut figures: Vec<(f64, f64)> = self.replicates.iter().map(turned).filter(|f| f.0.is_finite()).collect();
        figures.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: f64 = figures.iter().map(|f| f.1).sum();
        let at = |share: f64| {
            let mut sum = 0.0;
            figures.iter().find(|f| {
                sum += f.1;
                sum >= share * all
            })
        };
        let tail = 0.5 * (1.0 - CONFIDENCE);
        let end = |share: f64| at(share).or(figures.last()).map_or(f64::NAN, |f| f.0);
        Interval { low: end(tail), high: end(1.0 - tail) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::distribution::normal_quantile;
    use super::*;

    fn normal_values(count: u32) -> Vec<f64> {
        (0..count).map(|k| 10.0 + normal_quantile((f64::from(k) + 0.5) / f64::from(count))).collect()
    }

    /// 2 k - 2 ln L + 2 k (k + 1) / (n - k - 1), with two parameters and with three.
    #[test]
    fn akaikes_criterion_corrected_for_few_values() {
        assert!((criterion(Family::Normal, -10.0, 10) - (4.0 + 20.0 + 12.0 / 7.0)).abs() < 1e-12);
        assert!((criterion(Family::ShiftedLogNormal, -10.0, 10) - (6.0 + 20.0 + 24.0 / 6.0)).abs() < 1e-12);
    }

    #[test]
    fn weights_add_up_and_each_family_has_its_own_in_the_bootstrap() {
        let weighed = weigh(&normal_values(100)).value.unwrap();
        let of = |kept: fn(&Candidate) -> bool| weighed.shape.candidates.iter().filter(|c| kept(c)).map(|c| c.weight).sum::<f64>();
        assert!((of(|_| true) - 1.0).abs() < 1e-12);
        assert!((SAMPLES..2 * SAMPLES).contains(&weighed.replicates.len()), "{}", weighed.replicates.len());
        let drawn: f64 = weighed.replicates.iter().map(|r| r.1).sum();
        assert!((drawn - of(|c| c.weight >= NEGLIGIBLE && c.p_value.is_none_or(|p| p >= REFUSED))).abs() < 1e-9, "{drawn}");
        // Only what can be chosen is tested, and it is tested with 99 samples at least.
        for c in &weighed.shape.candidates {
            assert_eq!(c.p_value.is_some(), c.weight >= LIGHT, "{c:?}");
            assert!(c.p_value.is_none_or(|p| (0.0025..=1.0).contains(&p)), "{c:?}");
        }
    }

    fn weighed(spread: f64, truth: f64, replicates: impl Iterator<Item = (f64, f64)>) -> Weighed {
        let at = |middle: f64| Quantiles { low: 0.0, middle, high: 0.0 };
        let shape = Shape { family: "normal".into(), quantiles: (0.0, truth, 0.0), candidates: Vec::new() };
        Weighed { shape, quantiles: at(truth), replicates: replicates.map(|(m, weight)| (at(m), weight, at(truth))).collect(), spread }
    }

    /// The basic bootstrap turns what was drawn round the truth: what lies above it by a part in a thousand, lies below by as much.
    #[test]
    fn an_interval_is_turned_round_the_truth_and_knows_weights() {
        let of = |spread, truth: f64, replicates: Vec<(f64, f64)>| {
            let found = weighed(spread, truth, replicates.into_iter()).interval(|q| q.middle);
            (found.low, found.high)
        };
        let near = |found: (f64, f64), low: f64, high: f64| {
            assert!((found.0 / low - 1.0).abs() < 1e-3 && (found.1 / high - 1.0).abs() < 1e-3, "{found:?}");
        };
        // Near zero in even steps; of half the spread, half as far.
        let steps = |weight: fn(u32) -> f64| (1..=1010).map(|k| (1e-6 * f64::from(k), weight(k))).collect::<Vec<_>>();
        near(of(1.0, 0.0, steps(|_| 1.0)), -985e-6, -26e-6);
        near(of(0.5, 0.0, steps(|_| 1.0)), -492.5e-6, -13e-6);
        // The upper half counts threefold: 50.5 of 2020 reach to the 17th of it from above, 1969.5 to the 51st of the lower half.
        near(of(1.0, 0.0, steps(|k| if k > 505 { 3.0 } else { 1.0 })), -994e-6, -51e-6);
        // Far from zero in even ratios.
        let ratios: Vec<_> = (1..=1010).map(|k| (100.0 * (1e-3 * f64::from(k)).exp(), 1.0)).collect();
        near(of(1.0, 100.0, ratios), 100.0 * (-0.985f64).exp(), 100.0 * (-0.026f64).exp());
    }

    /// Of the N samples and the one that was measured, the share that lies at least as far.
    #[test]
    fn the_probability_of_a_bootstrap_is_neither_zero_nor_above_one() {
        let tested = |values: Vec<f64>| {
            let fitted = Fitted::Normal { mean: 10.0, deviation: 1.0 };
            let mut rated = Rated { family: Family::Normal, fitted, weight: 1.0, p_value: None, replicates: Vec::new() };
            rated.bootstrap(&values, 50, &mut Pcg64::seed_from_u64(2));
            (rated.p_value.unwrap(), rated.replicates.len())
        };
        assert_eq!(tested(normal_values(50)), (1.0, SAMPLES));
        assert_eq!(tested(normal_values(50).iter().map(|v| v + 5.0).collect()), (1.0 / 401.0, SAMPLES));
    }

    /// The bootstrap of many values draws fewer: it spreads more, by the square root.
    #[test]
    fn a_smaller_bootstrap_sample_is_drawn_in() {
        let spread = |count| weigh(&normal_values(count)).value.unwrap().spread;
        assert_eq!((spread(500), spread(8000)), (1.0, 0.5));
    }

    /// 0, 3, 6, ..., 6000: each quantile lies on a line between two values. The median of so many is known to +-1.96 / (2 sqrt n) of the range.
    #[test]
    fn quantiles_of_the_values_themselves() {
        let values: Vec<f64> = (0..=2000).map(|k| 3.0 * f64::from(k)).collect();
        let found = of_the_values(&values, Vec::new(), &mut Pcg64::seed_from_u64(1));
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(close(found.quantiles.low, 8.1) && close(found.quantiles.middle, 3000.0) && close(found.quantiles.high, 5991.9));
        let interval = found.interval(|q| q.middle);
        let half = 6000.0 * 0.98 / 2001f64.sqrt();
        assert!(((interval.high - interval.low) / (2.0 * half) - 1.0).abs() < 0.2, "{interval:?} {half}");
    }
}
