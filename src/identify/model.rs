//! The base model as a vector of parameters: curves, hyperbola, floor, delay, lag.
//!
//! The curves are fitted as mean and half-width in Chebyshev polynomials over the covered range, which keeps the
//! normal equations well conditioned at any order; they are written as powers of the current, as the paper does.

use super::segment::Segment;
use crate::valve::{FreeLoop, Hysteresis, Input, Polynomial, ReferenceCurves};

/// Smallest slope of a curve, as a share of the mean slope over the range.
pub(super) const MIN_SLOPE: f64 = 0.02;

/// Half-widths of the plays of a free loop, in half-widths of the loop, before they are scaled together.
pub(super) const PLAYS: [f64; 7] = [0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Weights from which a free loop begins: a soft loop, no play of which is out of reach.
const FIRST_WEIGHTS: [f64; PLAYS.len()] = [0.2, 0.15, 0.15, 0.2, 0.15, 0.1, 0.05];

/// The path between the curves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// One curve.
    None,
    /// The hyperbola.
    Hyperbolic,
    /// A stack of plays.
    Free,
}

/// Which parameters the model has.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    /// Order of the curves.
    pub order: usize,
    /// The path between the curves.
    pub form: Form,
    /// What the command does between its samples.
    pub input: Input,
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
    /// Whether the curves differ.
    pub fn has_loop(&self) -> bool {
        self.form != Form::None
    }

    /// Whether the delay shows by whole steps only: a held command and no lag that would show when it arrives.
    pub fn is_staircase(&self) -> bool {
        self.input == Input::Held && !self.lag
    }

    /// Number of parameters of both curves.
    pub fn curve_parameters(&self) -> usize {
        (self.order + 1) * if self.has_loop() { 2 } else { 1 }
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.delay() + 1 + usize::from(self.lag) + self.starts * self.per_start()
    }

    /// Parameters of each fitted start: its place between the curves, and how far a lag is behind.
    fn per_start(&self) -> usize {
        1 + usize::from(self.lag)
    }

    /// Position of ln a.
    pub fn ln_a(&self) -> Option<usize> {
        (self.form == Form::Hyperbolic).then_some(self.curve_parameters())
    }

    /// Positions of the weights of the plays.
    pub fn weights(&self) -> std::ops::Range<usize> {
        let from = self.curve_parameters();
        from..from + if self.form == Form::Free { PLAYS.len() } else { 0 }
    }

    /// Position of the delay.
    pub fn delay(&self) -> usize {
        self.curve_parameters()
            + match self.form {
                Form::None => 0,
                Form::Hyperbolic => 1,
                Form::Free => PLAYS.len(),
            }
    }

    /// Position of the lag.
    pub fn lag_at(&self) -> Option<usize> {
        self.lag.then(|| self.delay() + 1)
    }

    /// Position of the start of segment `k`: its place between the curves, see [`Shape::measured_start`].
    pub fn start_at(&self, k: usize) -> Option<usize> {
        (k < self.starts).then(|| self.delay() + 1 + usize::from(self.lag) + k)
    }

    /// Position of the pressure by which the lag of segment `k` stands above its input at the start [bar].
    pub fn before_at(&self, k: usize) -> Option<usize> {
        (self.lag && k < self.starts).then(|| self.delay() + 2 + self.starts + k)
    }

    /// Coefficients of the ascending and of the descending curve, highest power first.
    pub fn polynomials(&self, theta: &[f64]) -> (Polynomial, Polynomial) {
        let curve = self.order + 1;
        let mean = powers(&theta[..curve], self.range_a);
        if !self.has_loop() {
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

    /// The path between the curves.
    pub fn hysteresis(&self, theta: &[f64]) -> Hysteresis {
        match self.form {
            Form::None => Hysteresis::None,
            Form::Hyperbolic => Hysteresis::Hyperbolic { a_bar2: self.ln_a().map_or(0.0, |k| theta[k].exp()) },
            Form::Free => {
                let plays = PLAYS.into_iter().zip(theta[self.weights()].iter().copied());
                // Without a play that has a width there is no loop; one of the loop's own width is backlash.
                FreeLoop::new(plays).or_else(|| FreeLoop::new([(1.0, 1.0)])).map_or(Hysteresis::None, Hysteresis::Free)
            }
        }
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
        if to.has_loop() {
            out.extend(if self.has_loop() { resized(&theta[curve..2 * curve]) } else { vec![0.0; to.order + 1] });
        }
        match to.form {
            Form::None => {}
            Form::Hyperbolic => out.push(self.ln_a().map_or(0.0, |k| theta[k])),
            Form::Free if self.form == Form::Free => out.extend(&theta[self.weights()]),
            Form::Free => out.extend(FIRST_WEIGHTS),
        }
        out.push(theta[self.delay()]);
        if to.lag {
            out.push(self.lag_at().map_or(lag_s, |k| theta[k]));
        }
        out.extend((0..to.starts).map(|k| self.start_at(k).map_or(0.0, |at| theta[at])));
        if to.lag {
            out.extend((0..to.starts).map(|k| self.before_at(k).map_or(0.0, |at| theta[at])));
        }
        out
    }

    /// The same curves over another range, and the shape with it.
    pub fn moved(&self, theta: &[f64], range_a: (f64, f64)) -> (Self, Vec<f64>) {
        let to = Self { range_a, ..self.clone() };
        let curve = self.order + 1;
        let mut out = theta.to_vec();
        let mut basis = vec![0.0; curve];
        for part in 0..if self.has_loop() { 2 } else { 1 } {
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
        if !self.has_loop() {
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
        if self.has_loop() && !average {
            let place = self.start_at(number).map_or_else(|| self.measured_start(curves, segment, delayed_a[0]), |k| theta[k]);
            self.hysteresis(theta).run(curves, 0.5 + 0.5 * place, delayed_a, out);
        } else {
            for (o, i) in out.iter_mut().zip(delayed_a) {
                *o = curves.average_at(*i);
            }
        }
        let arrival = segment.arrival(theta[self.delay()], self.input);
        arrival.read_between(out);
        if let Some(floor) = self.floor_bar {
            for o in out.iter_mut() {
                *o = o.max(floor);
            }
        }
        let before_bar = self.before_at(number).map_or(0.0, |k| theta[k]);
        segment.lagged(self.lag_s(theta), before_bar, arrival, out);
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
        let shape =
            Shape { order: 3, form: Form::Hyperbolic, input: Input::Ramp, lag: false, range_a: (0.2, 0.8), floor_bar: None, starts: 0 };
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
        let flat = Shape {
            order: 3,
            form: Form::Hyperbolic,
            input: Input::Ramp,
            lag: false,
            range_a: (-1.0, 1.0),
            floor_bar: Some(0.0),
            starts: 0,
        };
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
        let low =
            Shape { order: 1, form: Form::Hyperbolic, input: Input::Ramp, lag: false, range_a: (0.2, 0.8), floor_bar: None, starts: 1 };
        let high = Shape { order: 4, lag: true, ..low.clone() };
        let theta = [10.0, 8.0, 0.4, 0.1, -1.0, 0.02, 0.3];
        let converted = low.convert(&theta, &high, 0.005);
        assert_eq!(converted.len(), high.len());
        assert!((high.curves(&converted).ascending_at(0.3) - low.curves(&theta).ascending_at(0.3)).abs() < 1e-12);
        assert_eq!((high.hysteresis(&converted), high.lag_s(&converted)), (low.hysteresis(&theta), 0.005));
        assert_eq!(converted[high.start_at(0).unwrap()], 0.3);
    }
}
