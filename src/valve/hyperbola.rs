//! The hyperbola between the reference curves, Eqs. (5)-(8), sample by sample, and its inverse, Eq. (11).
//!
//! While the current rises the pressure P keeps a gap `g = P - f(i) > 0` above the ascending curve f; the
//! hyperbola is `g (g + f - T) = a` with T (the paper's P_t) constant along the monotone stretch. A falling
//! current is the same with the signs of P and f turned. T follows at a reversal from the point (i', P'):
//! `T = f(i') + g' - a / g'`.
//!
//! A start on the wrong side of its curve (start-up, a changed curve, a saturation) is the mirrored case: the gap
//! is taken by its absolute value and closes by the same law, so that the pressure neither jumps nor divides by
//! zero, and joins the curve from the other side. A start on the curve stays on it.

use super::ReferenceCurves;

/// Gaps below this share of sqrt(a) count as "on the curve": the hyperbola through them is the curve itself.
const ON_CURVE: f64 = 1e-7;

/// The constants of one monotone stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Branch {
    /// +1 while the current rises, -1 while it falls.
    pub direction: f64,
    /// +1 on the loop's side of the curve, -1 mirrored, 0 on the curve.
    pub side: f64,
    /// The other asymptote, in the turned coordinates of the direction [bar].
    pub asymptote_bar: f64,
    /// 4a [bar^2].
    pub four_a: f64,
}

impl Branch {
    /// The stretch that leaves (i', P') in `direction`; `curve_bar` is f(i') of the curve of that direction.
    #[inline]
    pub fn leaving(direction: f64, curve_bar: f64, pressure_bar: f64, a_bar2: f64) -> Self {
        Self::leaving_with(direction, curve_bar, pressure_bar, a_bar2, Self::on_curve_gap(a_bar2))
    }

    /// The gap up to which a point counts as lying on its curve [bar].
    #[inline]
    pub fn on_curve_gap(a_bar2: f64) -> f64 {
        ON_CURVE * a_bar2.sqrt()
    }

    /// As [`Branch::leaving`], with the gap of [`Branch::on_curve_gap`] computed once for many stretches.
    #[inline]
    pub fn leaving_with(direction: f64, curve_bar: f64, pressure_bar: f64, a_bar2: f64, on_curve_gap: f64) -> Self {
        let gap = direction * (pressure_bar - curve_bar);
        let size = gap.abs();
        let asymptote_bar = direction * curve_bar + size - a_bar2 / size;
        let side = if size <= on_curve_gap || !asymptote_bar.is_finite() { 0.0 } else { gap.signum() };
        Self { direction, side, asymptote_bar: if side == 0.0 { 0.0 } else { asymptote_bar }, four_a: 4.0 * a_bar2 }
    }

    /// Pressure where the curve of this direction has the value `curve_bar`.
    #[inline]
    pub fn pressure(&self, curve_bar: f64) -> f64 {
        let distance = self.asymptote_bar - self.direction * curve_bar;
        let gap = 0.5 * (distance + (distance * distance + self.four_a).sqrt());
        curve_bar + self.direction * self.side * gap
    }

    /// Value of the curve where the pressure on this stretch is `pressure_bar`: the hyperbola solved for f.
    #[inline]
    pub fn curve(&self, pressure_bar: f64) -> f64 {
        let turned = self.direction * pressure_bar;
        let distance = turned - self.asymptote_bar;
        let gap = if self.side > 0.0 {
            // (P - T) g = a
            0.25 * self.four_a / distance
        } else {
            // g (2 g + P - T) = a
            0.25 * (-distance + (distance * distance + 2.0 * self.four_a).sqrt())
        };
        pressure_bar - self.direction * self.side * gap
    }
}

#[inline]
fn curve_at(curves: &ReferenceCurves, direction: f64, current_a: f64) -> f64 {
    if direction > 0.0 { curves.ascending_at(current_a) } else { curves.descending_at(current_a) }
}

/// The hysteresis model at one instant: current in, pressure out.
#[derive(Debug, Clone, PartialEq)]
pub struct HyperbolaState {
    a_bar2: f64,
    current_a: f64,
    pressure_bar: f64,
    branch: Option<Branch>,
}

impl HyperbolaState {
    /// Starts at a point that may lie on, inside or outside the loop.
    pub fn start(a_bar2: f64, current_a: f64, pressure_bar: f64) -> Self {
        Self { a_bar2, current_a, pressure_bar, branch: None }
    }

    /// The pressure after the current has moved monotonically to `current_a` [bar].
    #[inline]
    pub fn advance(&mut self, curves: &ReferenceCurves, current_a: f64) -> f64 {
        let change = current_a - self.current_a;
        if change == 0.0 || change.is_nan() {
            return self.pressure_bar;
        }
        let direction = change.signum();
        let branch = match self.branch {
            Some(b) if b.direction == direction => b,
            _ => {
                let curve_bar = curve_at(curves, direction, self.current_a);
                *self.branch.insert(Branch::leaving(direction, curve_bar, self.pressure_bar, self.a_bar2))
            }
        };
        self.pressure_bar = branch.pressure(curve_at(curves, direction, current_a));
        self.current_a = current_a;
        self.pressure_bar
    }

    /// The present pressure [bar].
    pub fn pressure_bar(&self) -> f64 {
        self.pressure_bar
    }

    /// The present current [A].
    pub fn current_a(&self) -> f64 {
        self.current_a
    }
}

/// The inverse model: pressure wanted in, current out.
#[derive(Debug, Clone, PartialEq)]
pub struct InverseState {
    state: HyperbolaState,
}

impl InverseState {
    /// Starts where the valve is: at a current and the pressure that it gave.
    pub fn start(a_bar2: f64, current_a: f64, pressure_bar: f64) -> Self {
        Self { state: HyperbolaState::start(a_bar2, current_a, pressure_bar) }
    }

    /// The current that moves the model's pressure to `pressure_bar`, Eq. (11) [A].
    pub fn current_for(&mut self, curves: &ReferenceCurves, pressure_bar: f64) -> f64 {
        let state = &mut self.state;
        let change = pressure_bar - state.pressure_bar;
        if change == 0.0 || change.is_nan() {
            return state.current_a;
        }
        let direction = change.signum();
        let branch = match state.branch {
            Some(b) if b.direction == direction => b,
            _ => {
                let curve_bar = curve_at(curves, direction, state.current_a);
                *state.branch.insert(Branch::leaving(direction, curve_bar, state.pressure_bar, state.a_bar2))
            }
        };
        let curve_bar = branch.curve(pressure_bar);
        let current_a = if direction > 0.0 { curves.ascending_current(curve_bar) } else { curves.descending_current(curve_bar) };
        // Pressure and current move together; a start on the wrong side may not turn the current round.
        state.current_a = if direction > 0.0 { current_a.max(state.current_a) } else { current_a.min(state.current_a) };
        state.pressure_bar = pressure_bar;
        state.current_a
    }

    /// Takes over what the valve really did, after a limit cut the command: the model moves on from there.
    pub fn follow(&mut self, curves: &ReferenceCurves, current_a: f64) {
        self.state.advance(curves, current_a);
    }

    /// The model's present pressure [bar].
    pub fn pressure_bar(&self) -> f64 {
        self.state.pressure_bar
    }

    /// The model's present current [A].
    pub fn current_a(&self) -> f64 {
        self.state.current_a
    }
}

#[cfg(test)]
mod tests {
    use super::super::curves::tests::paper;
    use super::*;
    use proptest::prelude::*;

    fn currents() -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(0.06f64..1.0, 2..40)
    }

    /// A start inside the loop.
    fn start(a: f64, current: f64) -> HyperbolaState {
        HyperbolaState::start(a, current, paper().average_at(current))
    }

    proptest! {
        #[test]
        fn the_pressure_is_continuous_where_the_current_turns(path in currents(), a in 0.01f64..5.0) {
            // C1: a small step in either direction changes the pressure a little.
            let c = paper();
            let mut state = start(a, path[0]);
            for i in &path[1..] {
                let before = state.advance(&c, *i);
                for step in [1e-7, -1e-7] {
                    prop_assert!((state.clone().advance(&c, i + step) - before).abs() < 1e-4);
                }
            }
        }

        #[test]
        fn the_same_current_after_a_different_past_gives_a_different_pressure(i in 0.3f64..0.8, a in 0.01f64..2.0) {
            // C2: memory.
            let c = paper();
            let mut up = start(a, 0.1);
            let mut down = start(a, 0.95);
            prop_assert!(up.advance(&c, i) < down.advance(&c, i));
        }

        #[test]
        fn pressure_and_current_change_in_the_same_direction(path in currents(), a in 0.0f64..5.0, p0 in -5.0f64..40.0) {
            // C3: dP/di >= 0, from any start.
            let c = paper();
            let mut state = HyperbolaState::start(a, path[0], p0);
            for pair in path.windows(2) {
                let before = state.pressure_bar();
                let after = state.advance(&c, pair[1]);
                prop_assert!((after - before) * (pair[1] - pair[0]) >= -1e-9, "{before} -> {after}");
            }
        }

        #[test]
        fn inverse_after_forward_is_the_identity(path in currents(), a in 0.01f64..5.0) {
            let c = paper();
            let mut forward = start(a, path[0]);
            let mut inverse = InverseState::start(a, path[0], forward.pressure_bar());
            for i in &path[1..] {
                let p = forward.advance(&c, *i);
                prop_assert!((inverse.current_for(&c, p) - i).abs() < 1e-9);
            }
        }

        #[test]
        fn the_inverse_moves_its_current_as_the_pressure_is_asked_to_move(wanted in prop::collection::vec(-2.0f64..40.0, 2..30), i0 in 0.06f64..1.0, p0 in -5.0f64..45.0) {
            // From any start, also on the wrong side of a curve, where the formula alone would turn the current round.
            let c = paper();
            let mut inverse = InverseState::start(1.0, i0, p0);
            for p in wanted {
                let (i_before, p_before) = (inverse.current_a(), inverse.pressure_bar());
                let i = inverse.current_for(&c, p);
                prop_assert!((i - i_before) * (p - p_before) >= 0.0, "{p_before} bar -> {p} bar: {i_before} A -> {i} A");
                prop_assert_eq!((inverse.current_a(), inverse.pressure_bar()), (i, p));
            }
        }

        #[test]
        fn the_curve_of_the_direction_bounds_the_pressure(path in currents(), a in 0.0f64..5.0) {
            let c = paper();
            let mut state = start(a, path[0]);
            for i in &path[1..] {
                let (before, rising) = (state.clone(), *i > state.current_a());
                let p = state.advance(&c, *i);
                // The curve of the direction bounds the pressure, and the gap to it never grows.
                let gap = |state: &HyperbolaState| if rising {
                    state.pressure_bar() - c.ascending_at(state.current_a())
                } else {
                    c.descending_at(state.current_a()) - state.pressure_bar()
                };
                prop_assert!(gap(&state).abs() <= gap(&before).abs() + 1e-9);
                if gap(&before) >= 0.0 {
                    prop_assert!(gap(&state) >= -1e-9, "{p}");
                }
            }
        }

        #[test]
        fn the_sampling_of_a_monotone_stretch_does_not_matter(a in 0.01f64..5.0, from in 0.06f64..0.5, to in 0.5f64..1.0, n in 1usize..50) {
            let c = paper();
            for (from, to) in [(from, to), (to, from)] {
                let mut coarse = start(a, from);
                let mut fine = coarse.clone();
                let direct = coarse.advance(&c, to);
                let asymptote = { fine.advance(&c, from + (to - from) / n as f64); fine.branch.unwrap().asymptote_bar };
                let mut last = fine.pressure_bar();
                for k in 2..=n {
                    last = fine.advance(&c, from + (to - from) * k as f64 / n as f64);
                    prop_assert_eq!(fine.branch.unwrap().asymptote_bar, asymptote);
                }
                prop_assert!((last - direct).abs() < 1e-9);
            }
        }

        #[test]
        fn any_start_and_any_current_is_safe(path in prop::collection::vec(-0.5f64..2.0, 2..30), a in 0.0f64..5.0, p0 in -100.0f64..100.0) {
            let c = paper();
            let mut state = HyperbolaState::start(a, path[0], p0);
            let mut inverse = InverseState::start(a, path[0], p0);
            for i in &path[1..] {
                prop_assert!(state.advance(&c, *i).is_finite());
                prop_assert!(inverse.current_for(&c, i * 30.0).is_finite());
            }
        }
    }

    #[test]
    fn a_start_on_a_curve_stays_on_it_and_at_the_crossing_nothing_divides_by_zero() {
        let c = paper();
        let crossing = c.range_a.0;
        let mut state = HyperbolaState::start(1.0, crossing, c.ascending_at(crossing));
        assert_eq!(state.advance(&c, 0.5), c.ascending_at(0.5));
        let mut state = HyperbolaState::start(0.0, 0.5, c.descending_at(0.5));
        assert_eq!(state.advance(&c, 0.4), c.descending_at(0.4));
    }

    /// A point off its curve by the rounding of a double follows it to the last digit, where the formula would lose half of them.
    #[test]
    fn what_lies_on_a_curve_but_for_rounding_follows_it() {
        assert_eq!(Branch::on_curve_gap(0.25), 0.5 * ON_CURVE);
        for direction in [1.0, -1.0] {
            let branch = Branch::leaving(direction, 7.0, 7.0 + 1e-13, 0.5);
            assert_eq!((branch.pressure(9.0), branch.curve(9.0)), (9.0, 9.0));
            // At zero pressure too, where nothing may be divided by the distance.
            assert_eq!(Branch::leaving(direction, 0.0, 0.0, 0.5).curve(0.0), 0.0);
        }
    }

    /// From inside the loop and from beyond its curve, either way.
    #[test]
    fn a_stretch_solved_for_its_curve_gives_it_back() {
        for (direction, gap) in [(1.0, 2.0), (1.0, -2.0), (-1.0, 2.0), (-1.0, -2.0), (1.0, 0.3), (-1.0, 0.3)] {
            let branch = Branch::leaving(direction, 10.0, 10.0 + gap, 0.7);
            assert!((branch.pressure(10.0) - (10.0 + gap)).abs() < 1e-9);
            for step in [0.1, 1.0, 6.0] {
                let curve = 10.0 + direction * step;
                assert!((branch.curve(branch.pressure(curve)) - curve).abs() < 1e-9, "{direction} {gap} {step}");
            }
        }
    }

    /// Asking for the pressure that stands, or for none, moves nothing and forgets nothing; a command that was cut is followed.
    #[test]
    fn the_inverse_keeps_its_memory() {
        let c = paper();
        let mut forward = start(1.0, 0.9);
        let mut inverse = InverseState::start(1.0, 0.9, forward.pressure_bar());
        let branches = [0.7, 0.6].map(|i| {
            let p = forward.advance(&c, i);
            inverse.current_for(&c, p);
            inverse.state.branch
        });
        assert!(branches[0].is_some() && branches[0] == branches[1], "one stretch: {branches:?}");
        let before = inverse.clone();
        let (current, pressure) = (before.current_a(), before.pressure_bar());
        assert_eq!((inverse.current_for(&c, pressure), inverse.current_for(&c, f64::NAN)), (current, current));
        assert_eq!(inverse, before);
        inverse.follow(&c, 0.8);
        forward.advance(&c, 0.8);
        assert!((inverse.pressure_bar() - forward.pressure_bar()).abs() < 1e-9 && inverse.current_a() == 0.8);
    }

    #[test]
    fn the_hyperbola_satisfies_its_own_equation() {
        // (P - P_t)(P - f) = a, Eq. (5), with P_t from Eq. (7).
        let c = paper();
        let (a, i0, p0) = (0.8, 0.3, c.average_at(0.3));
        let p_t = p0 + a / (c.ascending_at(i0) - p0);
        let mut state = HyperbolaState::start(a, i0, p0);
        for i in [0.35, 0.5, 0.9] {
            let p = state.advance(&c, i);
            assert!(((p - p_t) * (p - c.ascending_at(i)) - a).abs() < 1e-9);
        }
    }
}
