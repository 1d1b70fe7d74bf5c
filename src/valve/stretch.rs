//! The hyperbola over a whole recorded current, one monotone stretch at a time.
//!
//! T (the paper's P_t) is constant between reversals, so within a stretch no sample depends on another: the curve
//! and the root are evaluated for a block of samples at once, and the compiler makes vector instructions of it.

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
        let (currents, pressures) = (&current_a[k + 1..=end], &mut pressure_bar[k + 1..=end]);
        if currents.len() < SHORT {
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
    }
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
