//! The free loop: a stack of plays between copies of the reference curves, scaled about their average.
//!
//! With m the average of the curves and h half their distance, both at the present current, play j holds its pressure
//! z_j while that lies between m - r_j h and m + r_j h, and is carried along by the nearer of the two where it does not:
//! z_j = min(max(z_j, m - r_j h), m + r_j h). The pressure is P = sum_j w_j z_j, with w_j >= 0, sum w_j = 1 and
//! sum w_j r_j = 1, so that the loop which all plays have run through is that of the reference curves. The form is convex
//! and linear in the weights; a weight at r = 0 follows the average without a loop, one at r = 1 alone is backlash, a spread
//! over several r rounds the way from one curve to the other and remembers more than the last reversal.
//!
//! As long as the scaled curves rise, pressure and current move in the same direction, so the inverse exists.
//!
//! Source: generalised play operators in a Prandtl-Ishlinskii stack, M. Brokate and J. Sprekels, *Hysteresis and Phase
//! Transitions* (1996), sections 2.3 to 2.4; M. Al Janaideh, S. Rakheja and C.-Y. Su, IEEE/ASME Trans. Mechatronics 16
//! (2011) 734.

use super::ReferenceCurves;

/// Most plays of a stack.
pub const MOST_PLAYS: usize = 8;
/// Widest play [half-widths of the loop].
pub const WIDEST_PLAY: f64 = 64.0;

/// Currents at which the curves are read at once.
const AT_ONCE: usize = 64;
/// How far the inverse looks at first [A].
const FIRST_STEP_A: f64 = 1e-3;
/// How often it looks farther, before it gives up at 10^16 A.
const FARTHEST: i32 = 40;

/// The stack: how wide each play is, and what it weighs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeLoop {
    half_widths: [f64; MOST_PLAYS],
    weights: [f64; MOST_PLAYS],
    count: usize,
}

impl FreeLoop {
    /// A stack from `(half-width, weight)` of each play: half-widths in those of the loop, at most [`WIDEST_PLAY`]; weights
    /// of 0 or more. Both are scaled so that the weights sum to 1 and the loop is that of the reference curves. `None` for
    /// too many plays, for a value out of range, and where no play with a width has a weight.
    pub fn new(plays: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let mut out = Self { half_widths: [0.0; MOST_PLAYS], weights: [0.0; MOST_PLAYS], count: 0 };
        for (half_width, weight) in plays {
            let allowed = (0.0..=WIDEST_PLAY).contains(&half_width) && weight >= 0.0 && weight.is_finite();
            if out.count == MOST_PLAYS || !allowed {
                return None;
            }
            (out.half_widths[out.count], out.weights[out.count]) = (half_width, weight);
            out.count += 1;
        }
        let sum: f64 = out.weights.iter().sum();
        let width = out.half_widths.iter().zip(&out.weights).map(|(r, w)| r * w).sum::<f64>() / sum;
        if !(sum > 0.0 && width > 0.0) {
            return None;
        }
        // What is scaled already stays as it is, to the last bit: a file reads back as it was written.
        if (sum - 1.0).abs() > 1e-12 {
            out.weights.iter_mut().for_each(|w| *w /= sum);
        }
        if (width - 1.0).abs() > 1e-12 {
            out.half_widths.iter_mut().for_each(|r| *r /= width);
        }
        Some(out)
    }

    /// Half-width [half-widths of the loop] and weight of each play.
    pub fn plays(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.half_widths.iter().copied().zip(self.weights.iter().copied()).take(self.count)
    }

    /// Pressure [bar] for each current [A] from a start at `place` between the curves: -1 on the ascending, 1 on the
    /// descending one. The pressure holds next to a current that is NaN.
    pub fn run(&self, curves: &ReferenceCurves, place: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
        let Some(first) = current_a.first() else { return };
        let mut state = FreeState::start(*self, curves, *first, place);
        let mut at_a = [*first; AT_ONCE];
        for (current_a, pressure_bar) in current_a.chunks(AT_ONCE).zip(pressure_bar.chunks_mut(AT_ONCE)) {
            if current_a.iter().all(|i| *i == state.current_a) {
                pressure_bar.fill(state.pressure_bar);
                continue;
            }
            at_a[..current_a.len()].copy_from_slice(current_a);
            let [low_bar, high_bar] = curves.both_at(&at_a);
            for (k, (i, p)) in current_a.iter().zip(pressure_bar).enumerate() {
                *p = state.advance_between(*i, || (low_bar[k], high_bar[k]));
            }
        }
    }
}

/// The free loop at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeState {
    stack: FreeLoop,
    plays_bar: [f64; MOST_PLAYS],
    current_a: f64,
    pressure_bar: f64,
}

impl FreeState {
    /// Starts at a current, at `place` between the curves: -1 on the ascending, 1 on the descending one.
    pub fn start(stack: FreeLoop, curves: &ReferenceCurves, current_a: f64, place: f64) -> Self {
        let (mean, half) = mean_and_half((curves.ascending_at(current_a), curves.descending_at(current_a)));
        let place = place.clamp(-1.0, 1.0);
        let plays_bar = stack.half_widths.map(|r| mean + place * r * half);
        Self { stack, plays_bar, current_a, pressure_bar: mean + place * half }
    }

    /// The pressure after the current has moved monotonically to `current_a` [bar].
    #[inline]
    pub fn advance(&mut self, curves: &ReferenceCurves, current_a: f64) -> f64 {
        self.advance_between(current_a, || (curves.ascending_at(current_a), curves.descending_at(current_a)))
    }

    /// The same, where the curves give what is asked for there [bar].
    #[inline]
    fn advance_between(&mut self, current_a: f64, curves_bar: impl FnOnce() -> (f64, f64)) -> f64 {
        if current_a == self.current_a || current_a.is_nan() {
            return self.pressure_bar;
        }
        let (mean, half) = mean_and_half(curves_bar());
        // All that a stack may have, side by side: what is not there weighs nothing. A plain comparison is one instruction for several
        // plays, which `max` is not, as it asks for NaN.
        let FreeLoop { half_widths, weights, .. } = &self.stack;
        let weighed_bar: [f64; MOST_PLAYS] = std::array::from_fn(|k| {
            let (reach, z) = (half_widths[k] * half, self.plays_bar[k]);
            let (low, high) = (mean - reach, mean + reach);
            let z = if z > low { z } else { low };
            self.plays_bar[k] = if z < high { z } else { high };
            weights[k] * self.plays_bar[k]
        });
        let sum = weighed_bar.iter().sum();
        (self.current_a, self.pressure_bar) = (current_a, sum);
        sum
    }

    /// The inverse: moves to the current nearest to the present one that gives `pressure_bar`, and returns it [A].
    pub fn current_for(&mut self, curves: &ReferenceCurves, pressure_bar: f64) -> f64 {
        let change = pressure_bar - self.pressure_bar;
        if change == 0.0 || change.is_nan() {
            return self.current_a;
        }
        let direction = change.signum();
        let reached = |current_a: f64| direction * (self.clone().advance(curves, current_a) - pressure_bar) >= 0.0;
        // Beyond the range both curves go on rising, so that every pressure is reached; three times as far each time.
        let at = |k: i32| self.current_a + direction * FIRST_STEP_A * 3f64.powi(k);
        let mut far = (0..FARTHEST).map(at).find(|i| reached(*i)).unwrap_or_else(|| at(FARTHEST));
        let mut near = self.current_a;
        // A part in 2^60 of the bracket is less than the last digit of the current.
        for _ in 0..60 {
            let middle = 0.5 * (near + far);
            if reached(middle) { far = middle } else { near = middle }
        }
        self.advance(curves, far);
        far
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

#[inline]
fn mean_and_half((low, high): (f64, f64)) -> (f64, f64) {
    (0.5 * (low + high), (0.5 * (high - low)).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::super::curves::tests::paper;
    use super::*;
    use proptest::prelude::*;

    fn stack() -> FreeLoop {
        FreeLoop::new([(0.0, 0.2), (0.5, 0.3), (1.0, 0.3), (3.0, 0.2)]).unwrap()
    }

    fn run(path: &[f64], place: f64) -> Vec<f64> {
        let mut out = vec![0.0; path.len()];
        stack().run(&paper(), place, path, &mut out);
        out
    }

    proptest! {
        #[test]
        fn pressure_and_current_change_in_the_same_direction(path in prop::collection::vec(0.06f64..1.0, 2..40), place in -1.0f64..1.0) {
            let out = run(&path, place);
            for (p, i) in out.windows(2).zip(path.windows(2)) {
                prop_assert!((p[1] - p[0]) * (i[1] - i[0]) >= -1e-12);
            }
        }

        /// Rests, of which some last long, and currents that are missing among them.
        #[test]
        fn a_whole_current_gives_what_its_samples_give(holds in prop::collection::vec((0usize..12, 1usize..150), 1..20), place in -1.0f64..1.0) {
            let level = |k: usize| if k == 0 { f64::NAN } else { 0.1 * k as f64 };
            let first = (0.4, 1);
            let path: Vec<f64> = std::iter::once(first)
                .chain(holds.into_iter().map(|(k, count)| (level(k), count)))
                .flat_map(|(i, count)| std::iter::repeat_n(i, count))
                .collect();
            let c = paper();
            let mut state = FreeState::start(stack(), &c, path[0], place);
            let each: Vec<f64> = path.iter().map(|i| state.advance(&c, *i)).collect();
            prop_assert_eq!(run(&path, place), each);
        }

        #[test]
        fn the_sampling_of_a_monotone_stretch_does_not_matter(from in 0.06f64..0.5, to in 0.5f64..1.0, n in 2usize..50) {
            let fine: Vec<f64> = (0..=n).map(|k| from + (to - from) * k as f64 / n as f64).collect();
            prop_assert!((run(&fine, 0.0)[n] - run(&[from, to], 0.0)[1]).abs() < 1e-9);
        }

        #[test]
        fn inverse_after_forward_is_the_identity(path in prop::collection::vec(0.06f64..1.0, 2..30)) {
            let c = paper();
            let mut forward = FreeState::start(stack(), &c, path[0], 0.0);
            let mut inverse = forward.clone();
            for i in &path[1..] {
                let p = forward.advance(&c, *i);
                prop_assert!((inverse.current_for(&c, p) - i).abs() < 1e-9);
            }
        }

        #[test]
        fn any_start_and_any_current_is_safe(path in prop::collection::vec(-0.5f64..2.0, 2..30), wanted in -100.0f64..100.0) {
            let c = paper();
            let mut state = FreeState::start(stack(), &c, path[0], 0.3);
            for i in &path {
                prop_assert!(state.advance(&c, *i).is_finite());
                prop_assert!(state.clone().current_for(&c, wanted).is_finite());
            }
        }
    }

    #[test]
    fn the_large_loop_is_that_of_the_reference_curves() {
        let c = paper();
        let up: Vec<f64> = (0..200).map(|k| 0.06 + 0.94 * f64::from(k) / 199.0).collect();
        let there_and_back: Vec<f64> = up.iter().chain(up.iter().rev()).copied().collect();
        let out = run(&there_and_back, 0.0);
        let at = |k: usize| there_and_back[k];
        assert!((out[150] - c.ascending_at(at(150))).abs() < 1e-9, "{} {}", out[150], c.ascending_at(at(150)));
        assert!((out[260] - c.descending_at(at(260))).abs() < 1e-9);
    }

    #[test]
    fn a_minor_loop_closes_and_an_outer_reversal_is_remembered() {
        // Wiping out: what happened between two reversals is forgotten once the later one is passed.
        let direct = run(&[0.1, 0.7, 0.4, 0.8], 0.0);
        let detour = run(&[0.1, 0.7, 0.4, 0.55, 0.45, 0.55, 0.45, 0.8], 0.0);
        assert!((direct[3] - detour[7]).abs() < 1e-12);
        let nested = run(&[0.1, 0.7, 0.4, 0.55, 0.45, 0.55], 0.0);
        assert!((nested[3] - nested[5]).abs() < 1e-12);
    }

    /// On either curve and between them; a play starts as far from the average as it is wide, so that nothing jumps, and a curve is kept.
    #[test]
    fn a_start_lies_where_it_is_said_to() {
        let c = paper();
        for i in [0.2, 0.7] {
            let (low, high) = (c.ascending_at(i), c.descending_at(i));
            for (place, pressure) in
                [(-1.0, low), (-2.0, low), (0.0, 0.5 * (low + high)), (0.5, 0.25 * low + 0.75 * high), (1.0, high), (3.0, high)]
            {
                let state = FreeState::start(stack(), &c, i, place);
                assert!((state.pressure_bar() - pressure).abs() < 1e-12 && state.current_a() == i, "{i} {place}");
                for step in [1e-9, -1e-9] {
                    assert!((state.clone().advance(&c, i + step) - pressure).abs() < 1e-6, "{i} {place}");
                }
            }
            assert!((FreeState::start(stack(), &c, i, -1.0).advance(&c, 0.9) - c.ascending_at(0.9)).abs() < 1e-12);
            assert!((FreeState::start(stack(), &c, i, 1.0).advance(&c, 0.1) - c.descending_at(0.1)).abs() < 1e-12);
        }
    }

    /// Asked for what stands, or for no number, nothing moves; any pressure is reached, however far.
    #[test]
    fn the_inverse_moves_no_more_than_it_must() {
        let c = paper();
        let mut state = FreeState::start(stack(), &c, 0.3, 0.0);
        state.advance(&c, 0.6);
        let (before, current, pressure) = (state.clone(), state.current_a(), state.pressure_bar());
        assert_eq!((state.current_for(&c, pressure), state.current_for(&c, f64::NAN)), (current, current));
        assert_eq!((state.advance(&c, current), state.advance(&c, f64::NAN)), (pressure, pressure));
        assert_eq!(state, before);
        for wanted in [pressure + 1e-9, pressure - 1e-9, 40.0, -40.0, 1e5, -1e5] {
            let mut moved = state.clone();
            let current = moved.current_for(&c, wanted);
            assert!((moved.pressure_bar() - wanted).abs() < 1e-12 * wanted.abs().max(100.0), "{wanted}: {}", moved.pressure_bar());
            assert!(moved.current_a() == current && (current - state.current_a()) * (wanted - pressure) > 0.0, "{wanted}");
        }
    }

    #[test]
    fn the_inverse_begins_without_a_current_too() {
        let c = paper();
        let mut state = FreeState::start(stack(), &c, 0.0, 0.0);
        let current = state.current_for(&c, 5.0);
        assert!((state.pressure_bar() - 5.0).abs() < 1e-12 && (0.1..0.5).contains(&current), "{current}");
    }

    #[test]
    fn what_is_no_stack_is_refused() {
        assert!(FreeLoop::new([(0.0, 1.0)]).is_none());
        assert!(FreeLoop::new([(1.0, -1.0), (2.0, 3.0)]).is_none());
        assert!(FreeLoop::new([(1.0, f64::NAN)]).is_none());
        assert!(FreeLoop::new([(1.0, 1.0); MOST_PLAYS + 1]).is_none());
        let scaled = FreeLoop::new([(1.0, 3.0), (3.0, 1.0)]).unwrap();
        let (weight, width) = scaled.plays().fold((0.0, 0.0), |(a, b), (r, w)| (a + w, b + r * w));
        assert!((weight - 1.0).abs() < 1e-12 && (width - 1.0).abs() < 1e-12);
    }
}
