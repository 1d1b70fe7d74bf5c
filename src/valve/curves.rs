//! The ascending and the descending reference curve, Eq. (3), and the range on which they can be trusted.

use super::{Polynomial, ValveError};

/// Steps of the search for the valid range over the limits of the current.
const SEARCH_STEPS: usize = 2000;

/// Pressure [bar] over current [A]: the curve approached by a rising current, and by a falling one.
///
/// On `range_a` both curves rise and the descending one lies above. Beyond it the polynomials say nothing: both
/// continue with the mean of their end slopes, so that the loop keeps its width and stays monotone.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceCurves {
    /// Approached while the current rises; the lower one.
    pub ascending: Polynomial,
    /// Approached while the current falls; the upper one.
    pub descending: Polynomial,
    /// The range of current on which both are valid [A].
    pub range_a: (f64, f64),
    /// The common slope below and above the range [bar/A].
    end_slopes: (f64, f64),
}

impl ReferenceCurves {
    /// Curves with the widest valid range inside `limits_a`, found from slope and crossing, not assumed.
    ///
    /// # Errors
    /// [`ValveError::Value`] where the curves rise together nowhere within the limits.
    pub fn new(ascending: Polynomial, descending: Polynomial, limits_a: (f64, f64)) -> Result<Self, ValveError> {
        let range = valid_range(&ascending, &descending, limits_a).ok_or_else(|| ValveError::Value {
            file: "reference curves".into(),
            key: "curve".into(),
            problem: format!(
                "nowhere between {} A and {} A do both curves rise with the descending one above; check order (highest power first) and units (bar over A)",
                limits_a.0, limits_a.1
            ),
        })?;
        Ok(Self::on_range(ascending, descending, range))
    }

    /// Curves on a range that the caller vouches for, for instance the range that the data covered.
    pub fn on_range(ascending: Polynomial, descending: Polynomial, range_a: (f64, f64)) -> Self {
        let slope = |i: f64| (0.5 * (ascending.slope(i) + descending.slope(i))).max(MIN_SLOPE_BAR_PER_A);
        let end_slopes = (slope(range_a.0), slope(range_a.1));
        Self { ascending, descending, range_a, end_slopes }
    }

    /// The pressure that a rising current approaches [bar].
    #[inline]
    pub fn ascending_at(&self, current_a: f64) -> f64 {
        self.extended(&self.ascending, current_a)
    }

    /// The pressure that a falling current approaches [bar].
    #[inline]
    pub fn descending_at(&self, current_a: f64) -> f64 {
        self.extended(&self.descending, current_a)
    }

    /// What a rising and what a falling current approach at each of these currents [bar]: [`Self::ascending_at`] and
    /// [`Self::descending_at`], to the last bit, for several currents at once.
    pub fn both_at<const COUNT: usize>(&self, current_a: &[f64; COUNT]) -> [[f64; COUNT]; 2] {
        let inside = current_a.map(|i| self.inside(i));
        [&self.ascending, &self.descending].map(|curve| {
            let mut out = [0.0; COUNT];
            for c in &curve.coefficients {
                for k in 0..COUNT {
                    out[k] = out[k] * inside[k] + c;
                }
            }
            for k in 0..COUNT {
                out[k] += self.beyond(current_a[k], inside[k]);
            }
            out
        })
    }

    /// The average model, Eq. (10) [bar].
    #[inline]
    pub fn average_at(&self, current_a: f64) -> f64 {
        0.5 * (self.ascending_at(current_a) + self.descending_at(current_a))
    }

    /// The current at which the ascending curve reaches `pressure_bar` [A].
    pub fn ascending_current(&self, pressure_bar: f64) -> f64 {
        self.inverse(|i| self.ascending_at(i), |i| self.ascending.slope(i), pressure_bar)
    }

    /// The current at which the descending curve reaches `pressure_bar` [A].
    pub fn descending_current(&self, pressure_bar: f64) -> f64 {
        self.inverse(|i| self.descending_at(i), |i| self.descending.slope(i), pressure_bar)
    }

    /// The current at which the average of the curves reaches `pressure_bar` [A].
    pub fn average_current(&self, pressure_bar: f64) -> f64 {
        self.inverse(|i| self.average_at(i), |i| 0.5 * (self.ascending.slope(i) + self.descending.slope(i)), pressure_bar)
    }

    /// The pressures that both curves reach within the valid range [bar].
    pub fn pressure_range_bar(&self) -> (f64, f64) {
        let (low, high) = self.range_a;
        (self.descending_at(low), self.ascending_at(high))
    }

    /// What the average of the curves rises over the valid range, never nothing [bar].
    pub fn span_bar(&self) -> f64 {
        let (low, high) = self.range_a;
        (self.average_at(high) - self.average_at(low)).abs().max(1e-9)
    }

    /// Slope of the extension below and above the valid range [bar/A].
    pub fn end_slopes_bar_per_a(&self) -> (f64, f64) {
        self.end_slopes
    }

    #[inline]
    fn extended(&self, curve: &Polynomial, current_a: f64) -> f64 {
        let inside = self.inside(current_a);
        curve.eval(inside) + self.beyond(current_a, inside)
    }

    /// The nearest current of the range [A].
    #[inline]
    fn inside(&self, current_a: f64) -> f64 {
        current_a.clamp(self.range_a.0, self.range_a.1)
    }

    /// What the straight line from there adds outside of it [bar].
    #[inline]
    fn beyond(&self, current_a: f64, inside_a: f64) -> f64 {
        let slope = if current_a < inside_a { self.end_slopes.0 } else { self.end_slopes.1 };
        slope * (current_a - inside_a)
    }

    /// Newton's method inside a bracket, falling back to bisection; beyond the range the extension is linear.
    fn inverse(&self, value: impl Fn(f64) -> f64, slope: impl Fn(f64) -> f64, pressure_bar: f64) -> f64 {
        let (mut low, mut high) = self.range_a;
        let (bottom, top) = (value(low), value(high));
        if pressure_bar <= bottom || pressure_bar.is_nan() {
            return low + (pressure_bar - bottom) / self.end_slopes.0;
        }
        if pressure_bar >= top {
            return high + (pressure_bar - top) / self.end_slopes.1;
        }
        let mut current = low + (high - low) * (pressure_bar - bottom) / (top - bottom);
        for _ in 0..64 {
            let excess = value(current) - pressure_bar;
            if excess > 0.0 {
                high = current;
            } else {
                low = current;
            }
            let newton = current - excess / slope(current);
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - current).abs() < 1e-15 {
                return next;
            }
            current = next;
        }
        current
    }
}

/// Slope given to an extension where the end of a curve is flat, so that the inverse exists.
const MIN_SLOPE_BAR_PER_A: f64 = 1e-3;

/// The widest interval in which both curves rise and the descending one is not below.
fn valid_range(ascending: &Polynomial, descending: &Polynomial, limits_a: (f64, f64)) -> Option<(f64, f64)> {
    let (low, high) = limits_a;
    let valid = |i: f64| ascending.slope(i) > 0.0 && descending.slope(i) > 0.0 && descending.eval(i) >= ascending.eval(i);
    let at = |k: usize| low + (high - low) * k as f64 / SEARCH_STEPS as f64;
    let mut best: Option<(usize, usize)> = None;
    let mut begin = None;
    for k in 0..=SEARCH_STEPS {
        match (valid(at(k)), begin) {
            (true, None) => begin = Some(k),
            (true, Some(b)) if best.is_none_or(|(p, q)| k - b > q - p) => best = Some((b, k)),
            (false, _) => begin = None,
            _ => {}
        }
    }
    let (begin, end) = best?;
    let edge = |mut inside: f64, mut outside: f64| {
        for _ in 0..60 {
            let middle = 0.5 * (inside + outside);
            if valid(middle) { inside = middle } else { outside = middle }
        }
        inside
    };
    let from = if begin == 0 { low } else { edge(at(begin), at(begin - 1)) };
    let to = if end == SEARCH_STEPS { high } else { edge(at(end), at(end + 1)) };
    Some((from, to))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Eq. (3) of the paper.
    pub fn paper() -> ReferenceCurves {
        ReferenceCurves::new(Polynomial::new([-42.65, 92.5, -8.4, -2.03]), Polynomial::new([-40.01, 83.32, -1.3, -2.41]), (0.0, 1.0))
            .unwrap()
    }

    #[test]
    fn the_papers_range_begins_at_the_crossing_and_not_at_zero() {
        let (low, high) = paper().range_a;
        assert!((low - 0.0580).abs() < 1e-3, "{low}");
        assert_eq!(high, 1.0);
    }

    #[test]
    fn curves_that_never_rise_together_are_refused() {
        let error = ReferenceCurves::new(Polynomial::new([-1.0, 0.0]), Polynomial::new([1.0, 0.0]), (0.0, 1.0)).unwrap_err();
        assert!(error.to_string().contains("nowhere between 0 A and 1 A"), "{error}");
    }

    #[test]
    fn several_currents_at_once_give_what_each_gives_alone() {
        let curves = paper();
        let current_a: [f64; 64] = std::array::from_fn(|k| 0.02 * k as f64 - 0.1);
        let [ascending, descending] = curves.both_at(&current_a);
        assert_eq!((ascending, descending), (current_a.map(|i| curves.ascending_at(i)), current_a.map(|i| curves.descending_at(i))));
        let none = curves.both_at(&[f64::NAN]);
        assert!(none.iter().flatten().all(|p| p.is_nan()), "{none:?}");
    }

    #[test]
    fn the_extension_has_the_mean_of_both_slopes() {
        // Slopes 20 i and 20 i + 5: 4 and 9 at 0.2 A, 16 and 21 at 0.8 A.
        let c = ReferenceCurves::on_range(Polynomial::new([10.0, 0.0, 0.0]), Polynomial::new([10.0, 5.0, 1.0]), (0.2, 0.8));
        let (below, above) = c.end_slopes_bar_per_a();
        assert!((below - 6.5).abs() < 1e-12 && (above - 18.5).abs() < 1e-12);
        assert!((c.ascending_at(0.1) - (0.4 - 0.65)).abs() < 1e-12 && (c.descending_at(0.9) - (11.4 + 1.85)).abs() < 1e-12);
        // What both reach: from where the descending one begins to where the ascending one ends.
        let (low, high) = c.pressure_range_bar();
        assert!((low - 2.4).abs() < 1e-12 && (high - 6.4).abs() < 1e-12);
    }

    /// 20 i, and above it by 4 (i - 0.1) (i - 0.3) (i - 0.6): above from 0.1 to 0.3 A and from 0.6 A on.
    #[test]
    fn the_widest_of_several_ranges_is_taken_to_its_last_digit() {
        let range = |limits| {
            let descending = Polynomial::new([4.0, -4.0, 21.08, -0.072]);
            ReferenceCurves::new(Polynomial::new([20.0, 0.0]), descending, limits).unwrap().range_a
        };
        let near = |found: (f64, f64), low: f64, high: f64| {
            assert!((found.0 - low).abs() < 1e-9 && (found.1 - high).abs() < 1e-9, "{found:?} is not {low} to {high}");
        };
        near(range((0.0, 0.95)), 0.6, 0.95);
        near(range((0.0, 0.7)), 0.1, 0.3);
        near(range((0.15, 0.5)), 0.15, 0.3);
        near(range((0.05, 0.25)), 0.1, 0.25);
        // Of two of one width the lower: above by (i - 0.1) (0.3 - i) (i - 0.7) (i - 0.9), from 0.1 to 0.3 A and from 0.7 to 0.9 A.
        let descending = Polynomial::new([-1.0, 2.0, -1.3, 20.3, -0.0189]);
        near(ReferenceCurves::new(Polynomial::new([20.0, 0.0]), descending, (0.0003, 0.9997)).unwrap().range_a, 0.1, 0.3);
    }

    #[test]
    fn a_flat_curve_has_no_inverse_and_is_refused() {
        let of = |a: [f64; 2], d: [f64; 2]| ReferenceCurves::new(Polynomial::new(a), Polynomial::new(d), (0.0, 1.0));
        assert!(of([0.0, 1.0], [5.0, 2.0]).is_err() && of([5.0, 1.0], [0.0, 9.0]).is_err());
        assert_eq!(of([5.0, 1.0], [5.0, 1.0]).unwrap().range_a, (0.0, 1.0), "curves without hysteresis are curves");
    }

    /// However flat or steep; and where the slope all but vanishes at one end, so that Newton's steps alone would leave the range.
    #[test]
    fn the_inverse_is_exact_for_any_slope() {
        let both = |curve: &[f64]| ReferenceCurves::new(Polynomial::new(curve), Polynomial::new(curve), (0.0, 1.0)).unwrap();
        let (flat, steep, late) =
            (both(&[1e-3, 1e-3, 2.0]), both(&[1e4, 1e4, 2.0]), both(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3, 0.0]));
        for (c, near) in [(flat, 1e-10), (steep, 1e-12), (late, 1e-9)] {
            for current in [1e-3, 0.05, 0.4, 0.7, 0.97, 0.999] {
                let pressure = c.ascending_at(current);
                for found in [c.ascending_current(pressure), c.descending_current(pressure), c.average_current(pressure)] {
                    assert!((found - current).abs() < near, "{found} is not {current}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn the_inverse_of_each_curve_is_exact(current in -0.2f64..1.3) {
            let c = paper();
            prop_assert!((c.ascending_current(c.ascending_at(current)) - current).abs() < 1e-9);
            prop_assert!((c.descending_current(c.descending_at(current)) - current).abs() < 1e-9);
            prop_assert!((c.average_current(c.average_at(current)) - current).abs() < 1e-9);
        }

        #[test]
        fn beyond_the_range_the_curves_rise_and_never_cross(current in -1.0f64..2.0) {
            let c = paper();
            prop_assert!(c.descending_at(current) >= c.ascending_at(current) - 1e-12);
            prop_assert!(c.ascending_at(current + 1e-3) > c.ascending_at(current));
        }
    }
}
