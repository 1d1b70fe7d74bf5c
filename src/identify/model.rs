//! The base model as a vector of parameters: curves, hyperbola, floor, delay, lag.
//!
//! The curves are fitted as mean and half-width in Chebyshev polynomials over the covered range, which keeps the
//! normal equations well conditioned at any order; they are written as powers of the current, as the paper does.

use super::segment::Segment;
use crate::valve::{Polynomial, ReferenceCurves, hyperbola_stretches};

/// Smallest slope of a curve, as a share of the mean slope over the range.
pub(super) const MIN_SLOPE: f64 = 0.02;

/// Which parameters the model has.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    /// Order of the curves.
    pub order: usize,
    /// Whether the curves differ and a hyperbola joins them.
    pub hysteresis: bool,
    /// Whether the pressure has a first-order lag.
    pub lag: bool,
    /// Range of current over which the curves are fitted [A].
    pub range_a: (f64, f64),
    /// Pressure below which the outlet does not fall [bar].
    pub floor_bar: Option<f64>,
    /// Segments whose start between the curves is fitted; the others start where they were measured.
    pub starts: usize,
}

impl Shape {
    /// Number of parameters.
    pub fn len(&self) -> usize {
        let curve = self.order + 1;
        curve + if self.hysteresis { curve + 1 } else { 0 } + 1 + usize::from(self.lag) + self.starts
    }

    /// Position of ln a.
    pub fn ln_a(&self) -> Option<usize> {
        self.hysteresis.then_some(2 * (self.order + 1))
    }

    /// Position of the delay.
    pub fn delay(&self) -> usize {
        self.ln_a().map_or(self.order + 1, |k| k + 1)
    }

    /// Position of the lag.
    pub fn lag_at(&self) -> Option<usize> {
        self.lag.then(|| self.delay() + 1)
    }

    /// Position of the start of segment `k`: its place between the curves, see [`Shape::measured_start`].
    pub fn start_at(&self, k: usize) -> Option<usize> {
        (k < self.starts).then(|| self.delay() + 1 + usize::from(self.lag) + k)
    }

    /// Coefficients of the ascending and of the descending curve, highest power first.
    pub fn polynomials(&self, theta: &[f64]) -> (Polynomial, Polynomial) {
        let curve = self.order + 1;
        let mean = powers(&theta[..curve], self.range_a);
        if !self.hysteresis {
            return (Polynomial::new(mean.clone()), Polynomial::new(mean));
        }
        let half = powers(&theta[curve..2 * curve], self.range_a);
        let combine = |sign: f64| mean.iter().zip(&half).map(|(m, h)| m + sign * h).collect::<Vec<_>>();
        (Polynomial::new(combine(-1.0)), Polynomial::new(combine(1.0)))
    }

    /// The reference curves.
    pub fn curves(&self, theta: &[f64]) -> ReferenceCurves {
        let (ascending, descending) = self.polynomials(theta);
        ReferenceCurves::on_range(ascending, descending, self.range_a)
    }

    /// Parameter a of the hyperbola [bar^2].
    pub fn a_bar2(&self, theta: &[f64]) -> f64 {
        self.ln_a().map_or(0.0, |k| theta[k].exp())
    }

    /// The lag [s].
    pub fn lag_s(&self, theta: &[f64]) -> f64 {
        self.lag_at().map_or(0.0, |k| theta[k])
    }

    /// The same parameters for another shape: a higher order has zeros, a lag that appears takes `lag_s`.
    pub fn convert(&self, theta: &[f64], to: &Shape, lag_s: f64) -> Vec<f64> {
        let resized = |from: &[f64]| {
            let mut out = from.to_vec();
            out.resize(to.order + 1, 0.0);
            out
        };
        let curve = self.order + 1;
        let mut out = resized(&theta[..curve]);
        if to.hysteresis {
            out.extend(if self.hysteresis { resized(&theta[curve..2 * curve]) } else { vec![0.0; to.order + 1] });
            out.push(self.ln_a().map_or(0.0, |k| theta[k]));
        }
        out.push(theta[self.delay()]);
        if to.lag {
            out.push(self.lag_at().map_or(lag_s, |k| theta[k]));
        }
        out.extend((0..to.starts).map(|k| self.start_at(k).map_or(0.0, |at| theta[at])));
        out
    }

    /// The same curves over another range, and the shape with it.
    pub fn moved(&self, theta: &[f64], range_a: (f64, f64)) -> (Self, Vec<f64>) {
        let to = Self { range_a, ..self.clone() };
        let curve = self.order + 1;
        let mut out = theta.to_vec();
        let mut basis = vec![0.0; curve];
        for part in 0..if self.hysteresis { 2 } else { 1 } {
            let polynomial = Polynomial::new(powers(&theta[part * curve..(part + 1) * curve], self.range_a));
            let series = &mut out[part * curve..(part + 1) * curve];
            series.fill(0.0);
            // Interpolation at the Chebyshev nodes, exact for a polynomial.
            for node in 0..curve {
                let x = (std::f64::consts::PI * (node as f64 + 0.5) / curve as f64).cos();
                let value = polynomial.eval(0.5 * (range_a.0 + range_a.1) + 0.5 * x * (range_a.1 - range_a.0));
                chebyshev(x, &mut basis);
                for (k, (s, b)) in series.iter_mut().zip(&basis).enumerate() {
                    *s += if k == 0 { 1.0 } else { 2.0 } / curve as f64 * value * b;
                }
            }
        }
        (to, out)
    }

    /// The lowest current, not below `limit_a`, down to which both polynomials go on rising, the descending one above,
    /// from `range_a` [A].
    pub fn valid_down_to(&self, theta: &[f64], (low, high): (f64, f64), limit_a: f64) -> f64 {
        const STEPS: u32 = 200;
        let (ascending, descending) = self.polynomials(theta);
        let least = MIN_SLOPE * (ascending.eval(high) - ascending.eval(low)) / (high - low);
        let valid = |i: f64| ascending.slope(i) > least && descending.slope(i) > least && descending.eval(i) >= ascending.eval(i);
        let at = |k: u32| low + (limit_a - low) * f64::from(k) / f64::from(STEPS);
        (1..=STEPS).map(at).take_while(|i| valid(*i)).last().unwrap_or(low)
    }

    /// The loop narrowed as it must be when the pressure answers `later_s` later than before and the current moves
    /// at `rate_a_per_s`: on a ramp, delay and half-width trade places.
    pub fn narrowed(&self, theta: &[f64], rate_a_per_s: f64, later_s: f64) -> Vec<f64> {
        let mut out = theta.to_vec();
        if !self.hysteresis {
            return out;
        }
        let curve = self.order + 1;
        // Derivative of the mean curve as a Chebyshev series.
        let mut slope = vec![0.0; curve + 2];
        for k in (1..curve).rev() {
            slope[k - 1] = slope[k + 1] + 2.0 * k as f64 * theta[k];
        }
        slope[0] *= 0.5;
        let per_a = 2.0 / (self.range_a.1 - self.range_a.0);
        for k in 0..curve {
            out[curve + k] -= slope[k] * per_a * rate_a_per_s * later_s;
        }
        out
    }

    /// Where a segment stood between the curves at its start: -1 on the ascending, 1 on the descending one.
    ///
    /// At the floor the measured pressure says nothing: then the middle, as a simulation starts.
    pub fn measured_start(&self, curves: &ReferenceCurves, segment: &Segment, first_a: f64) -> f64 {
        let (low, high) = (curves.ascending_at(first_a), curves.descending_at(first_a));
        let hidden = self.floor_bar.is_some_and(|f| segment.start_bar < f + 0.01 * (curves.average_at(self.range_a.1) - f));
        let half = 0.5 * (high - low).abs();
        if hidden || half == 0.0 { 0.0 } else { ((segment.start_bar - 0.5 * (low + high)) / half).clamp(-1.0, 1.0) }
    }

    /// Simulates segment number `number` whose delayed current is `delayed_a`; `average` follows the mean of the
    /// curves, Eq. (10).
    pub fn simulate(
        &self,
        theta: &[f64],
        curves: &ReferenceCurves,
        (number, segment): (usize, &Segment),
        delayed_a: &[f64],
        out: &mut [f64],
        average: bool,
    ) {
        if self.hysteresis && !average {
            let first = delayed_a[0];
            let place = self.start_at(number).map_or_else(|| self.measured_start(curves, segment, first), |k| theta[k]);
            let start = curves.average_at(first) + 0.5 * place * (curves.descending_at(first) - curves.ascending_at(first)).abs();
            hyperbola_stretches(curves, self.a_bar2(theta), start, delayed_a, out);
        } else {
            for (o, i) in out.iter_mut().zip(delayed_a) {
                *o = curves.average_at(*i);
            }
        }
        if let Some(floor) = self.floor_bar {
            for o in out.iter_mut() {
                *o = o.max(floor);
            }
        }
        segment.lagged(self.lag_s(theta), out);
        segment.at_readings(out);
    }
}

/// A Chebyshev series over `range_a` as powers of the current, highest first (Clenshaw's recurrence on polynomials).
pub(super) fn powers(series: &[f64], range_a: (f64, f64)) -> Vec<f64> {
    let scale = 2.0 / (range_a.1 - range_a.0);
    let shift = -(range_a.0 + range_a.1) / (range_a.1 - range_a.0);
    let n = series.len();
    let times_x = |p: &[f64], factor: f64| {
        let mut out = vec![0.0; n + 1];
        for (k, c) in p.iter().enumerate().take(n) {
            out[k] += factor * shift * c;
            out[k + 1] += factor * scale * c;
        }
        out
    };
    let (mut b1, mut b2) = (vec![0.0; n + 1], vec![0.0; n + 1]);
    for k in (1..n).rev() {
        let mut b = times_x(&b1, 2.0);
        for (j, v) in b.iter_mut().enumerate() {
            *v -= b2[j];
        }
        b[0] += series[k];
        b2 = std::mem::replace(&mut b1, b);
    }
    let mut out = times_x(&b1, 1.0);
    for (j, v) in out.iter_mut().enumerate() {
        *v -= b2[j];
    }
    if n > 0 {
        out[0] += series[0];
    }
    out.truncate(n);
    out.reverse();
    out
}

/// Values of the Chebyshev polynomials of order 0 to `out.len() - 1` at `x` in [-1, 1].
pub(super) fn chebyshev(x: f64, out: &mut [f64]) {
    for k in 0..out.len() {
        out[k] = match k {
            0 => 1.0,
            1 => x,
            _ => 2.0 * x * out[k - 1] - out[k - 2],
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn powers_and_series_have_the_same_values(series in prop::collection::vec(-5.0f64..5.0, 1..8), i in 0.1f64..0.9) {
            let range = (0.1, 0.9);
            let x = (2.0 * i - range.0 - range.1) / (range.1 - range.0);
            let mut basis = vec![0.0; series.len()];
            chebyshev(x, &mut basis);
            let direct: f64 = basis.iter().zip(&series).map(|(b, c)| b * c).sum();
            prop_assert!((Polynomial::new(powers(&series, range)).eval(i) - direct).abs() < 1e-8);
        }
    }

    #[test]
    fn curves_over_another_range_are_the_same_curves() {
        let shape = Shape { order: 3, hysteresis: true, lag: false, range_a: (0.2, 0.8), floor_bar: None, starts: 0 };
        let theta = [10.0, 8.0, 0.4, 0.1, 0.5, 0.2, -0.1, 0.05, -1.0, 0.02];
        let (moved, there) = shape.moved(&theta, (0.1, 0.9));
        for i in [0.25, 0.5, 0.75] {
            assert!((shape.curves(&theta).ascending_at(i) - moved.curves(&there).ascending_at(i)).abs() < 1e-9);
            assert!((shape.curves(&theta).descending_at(i) - moved.curves(&there).descending_at(i)).abs() < 1e-9);
        }
    }

    #[test]
    fn the_papers_curves_hold_down_to_their_crossing() {
        // Eq. (3), as Chebyshev series over the range that stands above a floor at zero.
        let flat = Shape { order: 3, hysteresis: true, lag: false, range_a: (-1.0, 1.0), floor_bar: Some(0.0), starts: 0 };
        // c3 x^3 + c2 x^2 + c1 x + c0 in Chebyshev polynomials.
        let series = |c: [f64; 4]| [c[3] + 0.5 * c[1], c[2] + 0.75 * c[0], 0.5 * c[1], 0.25 * c[0]];
        let (up, down) = (series([-42.65, 92.5, -8.4, -2.03]), series([-40.01, 83.32, -1.3, -2.41]));
        let mut theta: Vec<f64> = (0..4).map(|k| 0.5 * (up[k] + down[k])).collect();
        theta.extend((0..4).map(|k| 0.5 * (down[k] - up[k])));
        theta.extend([0.0, 0.02]);
        let (shape, theta) = flat.moved(&theta, (0.2, 0.98));
        let low = shape.valid_down_to(&theta, (0.2, 0.98), 0.0);
        assert!((low - 0.058).abs() < 0.002, "{low}");
        assert_eq!(shape.valid_down_to(&theta, (0.2, 0.98), 0.1), 0.1);
    }

    #[test]
    fn a_higher_order_keeps_the_values() {
        let low = Shape { order: 1, hysteresis: true, lag: false, range_a: (0.2, 0.8), floor_bar: None, starts: 1 };
        let high = Shape { order: 4, lag: true, ..low.clone() };
        let theta = [10.0, 8.0, 0.4, 0.1, -1.0, 0.02, 0.3];
        let converted = low.convert(&theta, &high, 0.005);
        assert_eq!(converted.len(), high.len());
        assert!((high.curves(&converted).ascending_at(0.3) - low.curves(&theta).ascending_at(0.3)).abs() < 1e-12);
        assert_eq!((high.a_bar2(&converted), high.lag_s(&converted)), (low.a_bar2(&theta), 0.005));
        assert_eq!(converted[high.start_at(0).unwrap()], 0.3);
    }
}
