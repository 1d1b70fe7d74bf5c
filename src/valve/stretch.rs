//! The hyperbola over a whole recorded current, one monotone stretch at a time.
//!
//! T (the paper's P_t) is constant between reversals, so within a stretch no sample depends on another: the curve
//! and the root are evaluated for a block of samples at once, and the compiler makes vector instructions of it.
//! Where the current turns at every few samples there is nothing to evaluate at once, and what takes the time is the
//! chain of operations from one turn to the next. There the gap to the curve is carried instead of the pressure:
//! both curves then stand beside the chain, and only the root itself is in it.

use super::hyperbola::Branch;
use super::{Polynomial, ReferenceCurves};

/// Samples evaluated together; small enough for the level-1 cache.
const BLOCK: usize = 128;
/// Stretches shorter than this are not worth a block.
const SHORT: usize = 6;

/// Pressure [bar] for each current [A]; the first sample has the pressure `start_bar`. Next to a current that
/// is NaN the pressure holds; a caller with gaps fills them first.
///
/// # Panics
/// Never for slices of equal length; `pressure_bar` is filled up to the shorter one.
pub fn hyperbola_stretches(curves: &ReferenceCurves, a_bar2: f64, start_bar: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[expect(unsafe_code, reason = "the processor was just found to have AVX2, which is all that the function asks for")]
        // SAFETY: guarded by the detection above. No fused multiply-add is enabled, so the bits are those of the plain build.
        unsafe {
            stretches_avx2(curves, a_bar2, start_bar, current_a, pressure_bar);
        }
        return;
    }
    stretches(curves, a_bar2, start_bar, current_a, pressure_bar);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn stretches_avx2(curves: &ReferenceCurves, a_bar2: f64, start_bar: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
    stretches(curves, a_bar2, start_bar, current_a, pressure_bar);
}

#[inline(always)]
fn stretches(curves: &ReferenceCurves, a_bar2: f64, start_bar: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
    let n = current_a.len().min(pressure_bar.len());
    if n == 0 {
        return;
    }
    pressure_bar[0] = start_bar;
    let on_curve = Branch::on_curve_gap(a_bar2);
    let mut k = 0;
    while k + 1 < n {
        let (here, p) = (current_a[k], pressure_bar[k]);
        let change = current_a[k + 1] - here;
        if change == 0.0 || change.is_nan() {
            pressure_bar[k + 1] = p;
            k += 1;
            continue;
        }
        let rising = change > 0.0;
        let mut end = k + 1;
        if rising {
            while end + 1 < n && current_a[end + 1] >= current_a[end] {
                end += 1;
            }
        } else {
            while end + 1 < n && current_a[end + 1] <= current_a[end] {
                end += 1;
            }
        }
        let (direction, curve) = if rising { (1.0, &curves.ascending) } else { (-1.0, &curves.descending) };
        let range = Extension { range_a: curves.range_a, slopes: curves.end_slopes_bar_per_a() };
        let branch = Branch::leaving_with(direction, range.at(curve, here), p, a_bar2, on_curve);
        let short = end - k < SHORT;
        let (currents, pressures) = (&current_a[k + 1..=end], &mut pressure_bar[k + 1..=end]);
        if short {
            for (i, out) in currents.iter().zip(pressures) {
                *out = branch.pressure(range.at(curve, *i));
            }
        } else {
            for (currents, pressures) in currents.chunks(BLOCK).zip(pressures.chunks_mut(BLOCK)) {
                range.block(curve, currents, pressures);
                for out in pressures.iter_mut() {
                    *out = branch.pressure(*out);
                }
            }
        }
        k = end;
        if short && k + 1 < n {
            k = short_stretches(curves, range, -direction, a_bar2, on_curve, k, &current_a[..n], &mut pressure_bar[..n]);
        }
    }
}

/// Continues from the turn at sample `k` with stretches shorter than `SHORT`, `direction` that of the first one, as
/// long as the pressure is on the loop's side of the curve. Returns the sample up to which the pressures are filled.
///
/// With g' the gap at the turn and d the way that the curve goes from there, the hyperbola is g^2 - 2 h g = a with
/// 2 h = g' - d - a / g'. At the next turn the gap to the other curve is the width of the loop less g.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "the state of one loop, split for the reader")]
fn short_stretches(
    curves: &ReferenceCurves,
    range: Extension,
    mut direction: f64,
    a_bar2: f64,
    on_curve: f64,
    mut k: usize,
    current_a: &[f64],
    pressure_bar: &mut [f64],
) -> usize {
    let half_a = 0.5 * a_bar2;
    let both = |i: f64| (range.at(&curves.ascending, i), range.at(&curves.descending, i));
    let (ascending, descending) = both(current_a[k]);
    let mut from = if direction > 0.0 { ascending } else { descending };
    let mut turn_gap = direction * (pressure_bar[k] - from);
    while turn_gap > on_curve {
        let behind = half_a / turn_gap;
        let mut end = k;
        let (gap, ascending, descending) = loop {
            if end + 1 == current_a.len() || end - k == SHORT || current_a[end + 1].is_nan() || current_a[end].is_nan() {
                // A long stretch, or a gap: neither is for here, and both are taken from the turn on.
                return k;
            }
            end += 1;
            let (ascending, descending) = both(current_a[end]);
            let curve = if direction > 0.0 { ascending } else { descending };
            let half = 0.5 * (turn_gap - direction * (curve - from)) - behind;
            let gap = half + (half * half + a_bar2).sqrt();
            pressure_bar[end] = curve + direction * gap;
            if end + 1 == current_a.len() || (current_a[end + 1] - current_a[end]) * direction < 0.0 {
                break (gap, ascending, descending);
            }
        };
        k = end;
        direction = -direction;
        from = if direction > 0.0 { ascending } else { descending };
        turn_gap = (descending - ascending) - gap;
    }
    k
}

/// A curve with its linear continuation beyond the valid range.
#[derive(Clone, Copy)]
struct Extension {
    range_a: (f64, f64),
    slopes: (f64, f64),
}

impl Extension {
    #[inline(always)]
    fn at(self, curve: &Polynomial, current_a: f64) -> f64 {
        let inside = current_a.max(self.range_a.0).min(self.range_a.1);
        curve.eval(inside) + self.beyond(current_a)
    }

    #[inline(always)]
    fn beyond(self, current_a: f64) -> f64 {
        self.slopes.0 * (current_a - self.range_a.0).min(0.0) + self.slopes.1 * (current_a - self.range_a.1).max(0.0)
    }

    #[inline(always)]
    fn block(self, curve: &Polynomial, currents: &[f64], out: &mut [f64]) {
        if let [c3, c2, c1, c0] = curve.coefficients[..] {
            for (i, out) in currents.iter().zip(out) {
                let x = i.max(self.range_a.0).min(self.range_a.1);
                *out = (((c3 * x + c2) * x + c1) * x + c0) + self.beyond(*i);
            }
            return;
        }
        out.fill(0.0);
        for c in &curve.coefficients {
            for (i, out) in currents.iter().zip(out.iter_mut()) {
                *out = *out * i.max(self.range_a.0).min(self.range_a.1) + c;
            }
        }
        for (i, out) in currents.iter().zip(out) {
            *out += self.beyond(*i);
        }
    }
}

/// The plain recursion as the paper writes it: P_t anew from the previous point at every sample. The yardstick of
/// the bench and of the tests.
pub fn hyperbola_per_sample(curves: &ReferenceCurves, a_bar2: f64, start_bar: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
    let (mut current, mut pressure) = (f64::NAN, start_bar);
    for (i, out) in current_a.iter().zip(pressure_bar) {
        if *i > current {
            let p_t = pressure + a_bar2 / (curves.ascending_at(current) - pressure);
            let f = curves.ascending_at(*i);
            pressure = 0.5 * (p_t + f + ((p_t - f) * (p_t - f) + 4.0 * a_bar2).sqrt());
        } else if *i < current {
            let p_t = pressure + a_bar2 / (curves.descending_at(current) - pressure);
            let f = curves.descending_at(*i);
            pressure = 0.5 * (p_t + f - ((p_t - f) * (p_t - f) + 4.0 * a_bar2).sqrt());
        }
        current = *i;
        *out = pressure;
    }
}

#[cfg(test)]
mod tests {
    use super::super::HyperbolaState;
    use super::super::curves::tests::paper;
    use super::*;
    use proptest::prelude::*;

    fn both(current_a: &[f64], a: f64, start: f64, curves: &ReferenceCurves) -> (Vec<f64>, Vec<f64>) {
        let mut fast = vec![0.0; current_a.len()];
        hyperbola_stretches(curves, a, start, current_a, &mut fast);
        let mut state = HyperbolaState::start(a, current_a[0], start);
        let slow = current_a.iter().map(|i| state.advance(curves, *i)).collect();
        (fast, slow)
    }

    proptest! {
        #[test]
        fn stretches_agree_with_the_state_sample_by_sample(
            turns in prop::collection::vec((0.0f64..1.1, 1usize..300), 1..8), a in 0.0f64..4.0, start in -2.0f64..40.0, quartic in any::<bool>(),
        ) {
            let mut curves = paper();
            if quartic {
                let mut up = vec![0.5];
                up.extend(&curves.ascending.coefficients);
                curves = ReferenceCurves::on_range(Polynomial::new(up), curves.descending.clone(), curves.range_a);
            }
            let mut path = vec![0.3];
            for (to, n) in turns {
                let from = *path.last().unwrap();
                path.extend((1..=n).map(|k| from + (to - from) * k as f64 / n as f64));
            }
            let (fast, slow) = both(&path, a, start, &curves);
            for (f, s) in fast.iter().zip(&slow) {
                prop_assert!((f - s).abs() < 1e-7 * (1.0 + s.abs()), "{f} {s}");
            }
        }
    }

    /// Steps of a current that turns often: small whole steps, so that samples repeat, and now and then a gap.
    fn dense() -> impl Strategy<Value = Vec<f64>> {
        let step =
            prop_oneof![8 => (-9i32..10).prop_map(|k| Some(f64::from(k) * 0.02)), 8 => (-0.2f64..0.2).prop_map(Some), 1 => Just(None)];
        (prop::collection::vec(step, 1..400), any::<bool>()).prop_map(|(steps, alternating)| {
            let mut current = 0.5;
            let mut path = vec![current];
            for (k, step) in steps.into_iter().enumerate() {
                let Some(step) = step else {
                    path.push(f64::NAN);
                    continue;
                };
                let step = if alternating { step.abs() * if k % 2 == 0 { 1.0 } else { -1.0 } } else { step };
                current = (current + step).clamp(-0.1, 1.1);
                path.push(current);
            }
            path
        })
    }

    proptest! {
        #[test]
        fn dense_reversals_agree_with_the_state(path in dense(), a in prop_oneof![Just(0.0), 1e-6f64..4.0], start in -40.0f64..80.0) {
            let curves = paper();
            let mut fast = vec![0.0; path.len()];
            hyperbola_stretches(&curves, a, start, &path, &mut fast);
            // The state forgets a gap; the stretches begin anew after it.
            let mut state = HyperbolaState::start(a, path[0], start);
            let mut before = path[0];
            for (i, f) in path.iter().zip(&fast) {
                if i.is_nan() || before.is_nan() {
                    state = HyperbolaState::start(a, *i, state.pressure_bar());
                }
                let s = state.advance(&curves, *i);
                prop_assert!((f - s).abs() < 1e-7 * (1.0 + s.abs()), "{f} {s}");
                before = *i;
            }
        }

        #[test]
        fn the_bits_do_not_depend_on_the_processor(path in dense(), a in 0.0f64..4.0, start in -40.0f64..80.0) {
            let curves = paper();
            let (mut detected, mut plain) = (vec![0.0; path.len()], vec![0.0; path.len()]);
            hyperbola_stretches(&curves, a, start, &path, &mut detected);
            stretches(&curves, a, start, &path, &mut plain);
            let bits = |p: &[f64]| p.iter().map(|p| p.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&detected), bits(&plain));
        }
    }

    #[test]
    fn the_papers_recursion_gives_the_same_pressures() {
        let curves = paper();
        let path: Vec<f64> = (0..2000).map(|k| 0.5 + 0.4 * (k as f64 * 0.01).sin()).collect();
        let start = curves.average_at(path[0]);
        let mut recursion = vec![0.0; path.len()];
        hyperbola_per_sample(&curves, 0.7, start, &path, &mut recursion);
        let (fast, _) = both(&path, 0.7, start, &curves);
        for (f, s) in fast.iter().zip(&recursion) {
            assert!((f - s).abs() < 1e-6, "{f} {s}");
        }
    }
}
