//! Margins of the continuous loop with the exact delay; no Pade form.
//!
//! The magnitude of L falls with the frequency, so the gain crossover follows in closed form and the unwrapped phase
//! there decides stability (Nyquist).

use std::f64::consts::{FRAC_PI_2, PI};

use super::search::{bisect, logarithmic, maximum};
use super::{FrequencyMargins, LoopPlant};
use crate::control::Gains;

/// The margins of the loop. The gains must not be negative, the plant's gain must be positive.
pub fn margins(plant: &LoopPlant, gains: Gains) -> FrequencyMargins {
    let crossover = gain_crossover(plant, gains);
    let phase_crossover = phase_crossover(plant, gains);
    let at_crossover = match crossover {
        Crossover::At(w) => Some((w, PI + phase(plant, gains, w))),
        Crossover::Never | Crossover::AlwaysAbove => None,
    };
    let stable = match crossover {
        Crossover::Never => true,
        Crossover::At(_) => at_crossover.is_some_and(|(_, margin)| margin > 0.0),
        // Gain above one at every frequency: any delay makes the loop unstable.
        Crossover::AlwaysAbove => plant.delay_s <= 0.0,
    };
    FrequencyMargins {
        gain_margin_db: phase_crossover.map(|w| -20.0 * magnitude(plant, gains, w).log10()),
        phase_margin_deg: at_crossover.map(|(_, margin)| margin.to_degrees()),
        delay_margin_s: at_crossover.filter(|_| stable).map(|(w, margin)| margin / w),
        max_sensitivity: if stable { max_sensitivity(plant, gains, [at_crossover.map(|(w, _)| w), phase_crossover]) } else { None },
        gain_crossover_rad_s: at_crossover.map(|(w, _)| w),
        phase_crossover_rad_s: phase_crossover,
        stable,
    }
}

/// The largest sensitivity |1/(1+L)| over all frequencies, for a loop that crosses a gain of one and -180 deg where it does;
/// `None` when it is not finite.
fn max_sensitivity(plant: &LoopPlant, gains: Gains, crossings: [Option<f64>; 2]) -> Option<f64> {
    // It peaks between the first effect of the integral and a little above what is fastest: a crossing, or the corner of lag and delay.
    // A loop with none of them never turns against its disturbance.
    let slow = plant.lag_s + plant.delay_s;
    let corner = (slow > 0.0).then(|| 1.0 / slow);
    let Some(fast) = crossings.into_iter().chain([corner]).flatten().max_by(f64::total_cmp) else { return Some(1.0) };
    let grid = logarithmic(1e-5 * fast, 20.0 * fast, 1500);
    let sensitivity = |w: f64| {
        let (magnitude, phase) = (magnitude(plant, gains, w), phase(plant, gains, w));
        let (real, imaginary) = (1.0 + magnitude * phase.cos(), magnitude * phase.sin());
        1.0 / real.hypot(imaginary)
    };
    maximum(sensitivity, &grid).filter(|m| m.is_finite()).map(|m| m.max(1.0))
}

/// The boundary curve (K_P, K_I): the gains at which a pair of poles stands on the imaginary axis, from K_P = 0 to K_I = 0.
pub fn boundary(plant: &LoopPlant, count: usize) -> Vec<(f64, f64)> {
    let LoopPlant { gain_bar_per_ma: k, lag_s: tau, delay_s: td } = *plant;
    if td <= 0.0 {
        return Vec::new();
    }
    // 1 + L(jw) = 0  <=>  K_P - j K_I/w = -(1 + j tau w) e^(j T_d w) / k, whose phase is atan(tau w) + T_d w.
    let angle = |w: f64| (tau * w).atan() + td * w;
    let first = bisect(|w| angle(w) - FRAC_PI_2, 0.0, PI / td);
    let last = bisect(|w| angle(w) - PI, first, PI / td);
    let point = |i: usize| {
        let w = first + (last - first) * i as f64 / (count - 1) as f64;
        let magnitude = (tau * w).hypot(1.0) / k;
        ((-magnitude * angle(w).cos()).max(0.0), (magnitude * w * angle(w).sin()).max(0.0))
    };
    (0..count).map(point).collect()
}

enum Crossover {
    At(f64),
    Never,
    AlwaysAbove,
}

/// |L| = 1: tau^2 w^4 + (1 - k^2 K_P^2) w^2 - k^2 K_I^2 = 0.
fn gain_crossover(plant: &LoopPlant, gains: Gains) -> Crossover {
    let proportional = plant.gain_bar_per_ma * gains.kp_ma_per_bar;
    let integral = plant.gain_bar_per_ma * gains.ki_ma_per_bar_s;
    let (a, b, c) = (plant.lag_s * plant.lag_s, 1.0 - proportional * proportional, -integral * integral);
    if a == 0.0 {
        return match (b > 0.0, c < 0.0) {
            (true, true) => Crossover::At((-c / b).sqrt()),
            (true, false) => Crossover::Never,
            (false, _) => Crossover::AlwaysAbove,
        };
    }
    let root = (b * b - 4.0 * a * c).sqrt();
    // The form without cancellation for either sign of b.
    let squared = if b > 0.0 { -2.0 * c / (b + root) } else { (root - b) / (2.0 * a) };
    if squared > 0.0 { Crossover::At(squared.sqrt()) } else { Crossover::Never }
}

/// The first frequency at which the unwrapped phase falls through -180 deg.
fn phase_crossover(plant: &LoopPlant, gains: Gains) -> Option<f64> {
    if plant.delay_s <= 0.0 || (gains.kp_ma_per_bar == 0.0 && gains.ki_ma_per_bar_s == 0.0) {
        return None; // PI and lag together never reach -180 deg.
    }
    // Without the delay the phase stays above -180 deg, with it it is below at 2 pi / T_d at the latest.
    let grid = logarithmic(1e-6 / plant.delay_s, 2.0 * PI / plant.delay_s, 2000);
    let above = |w: f64| phase(plant, gains, w) + PI;
    let bracket = grid.windows(2).find(|w| above(w[0]) > 0.0 && above(w[1]) <= 0.0)?;
    Some(bisect(above, bracket[0], bracket[1]))
}

fn magnitude(plant: &LoopPlant, gains: Gains, w: f64) -> f64 {
    let controller = gains.kp_ma_per_bar.hypot(gains.ki_ma_per_bar_s / w);
    controller * plant.gain_bar_per_ma / (plant.lag_s * w).hypot(1.0)
}

fn phase(plant: &LoopPlant, gains: Gains, w: f64) -> f64 {
    -(gains.ki_ma_per_bar_s / w).atan2(gains.kp_ma_per_bar) - (plant.lag_s * w).atan() - plant.delay_s * w
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PAPER: LoopPlant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.04 };
    const GAINS: Gains = Gains { kp_ma_per_bar: 1.0, ki_ma_per_bar_s: 5.0 };

    #[test]
    fn the_gains_of_the_paper() {
        let found = margins(&PAPER, GAINS);
        let close = |a: Option<f64>, b: f64, tolerance: f64| (a.unwrap() - b).abs() < tolerance;
        assert!(close(found.gain_margin_db, 29.366, 5e-4), "{found:?}");
        assert!(close(found.phase_crossover_rad_s, 62.57, 5e-3), "{found:?}");
        assert!(close(found.phase_margin_deg, 91.72, 5e-3), "{found:?}");
        assert!(close(found.gain_crossover_rad_s, 0.20016, 5e-6), "{found:?}");
        assert!(close(found.delay_margin_s, 7.998, 5e-4), "{found:?}");
        assert!(close(found.max_sensitivity, 1.0354, 5e-5), "{found:?}");
        assert!(found.stable);
    }

    #[test]
    fn an_integrator_with_delay_is_stable_up_to_a_quarter_turn() {
        // L = K/s e^(-s T): stable for K T < pi/2, phase margin 90 deg - K T.
        let plant = LoopPlant { gain_bar_per_ma: 1.0, lag_s: 0.0, delay_s: 1.0 };
        let gains = |ki| Gains { kp_ma_per_bar: 0.0, ki_ma_per_bar_s: ki };
        let found = margins(&plant, gains(0.5));
        assert!((found.phase_margin_deg.unwrap() - (90.0 - 0.5f64.to_degrees())).abs() < 1e-9);
        assert!((found.gain_margin_db.unwrap() - 20.0 * (FRAC_PI_2 / 0.5).log10()).abs() < 1e-9);
        assert!(margins(&plant, gains(1.57)).stable);
        // At pi/2 itself it stands on the boundary, and swings for ever.
        assert!(!margins(&plant, gains(FRAC_PI_2)).stable);
        let unstable = margins(&plant, gains(1.58));
        assert!(!unstable.stable);
        assert_eq!((unstable.delay_margin_s, unstable.max_sensitivity), (None, None));
        assert!(unstable.phase_margin_deg.unwrap() < 0.0 && unstable.gain_margin_db.unwrap() < 0.0);
    }

    /// The plant without a lag: K_P alone is the loop gain at every frequency.
    #[test]
    fn without_a_lag_the_gain_crosses_one_only_by_the_integral() {
        let of = |delay_s: f64, kp_ma_per_bar: f64, ki_ma_per_bar_s: f64| {
            margins(&LoopPlant { gain_bar_per_ma: 1.0, lag_s: 0.0, delay_s }, Gains { kp_ma_per_bar, ki_ma_per_bar_s })
        };
        // 0.6^2 + (0.8 / w)^2 = 1 at w = 1, where the phase is -atan(0.8 / 0.6).
        let found = of(0.0, 0.6, 0.8);
        assert!((found.gain_crossover_rad_s.unwrap() - 1.0).abs() < 1e-12 && found.stable, "{found:?}");
        assert!((found.phase_margin_deg.unwrap() - (180.0 - 53.130_102_354)).abs() < 1e-8, "{found:?}");
        assert_eq!((of(0.1, 0.6, 0.0).phase_margin_deg, of(0.1, 0.6, 0.0).stable), (None, true));
        // A gain of one and more at every frequency bears no delay at all.
        for kp in [1.0, 2.0] {
            assert!(of(0.0, kp, 0.5).stable && !of(0.01, kp, 0.5).stable, "{kp}");
            assert_eq!(of(0.01, kp, 0.5).phase_margin_deg, None);
        }
        // 1 + 0.5 e^(-j w T) is smallest where the delay turns by half a turn: 1 / (1 - 0.5).
        assert!((of(0.04, 0.5, 0.0).max_sensitivity.unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(of(0.0, 0.5, 0.0).max_sensitivity, Some(1.0));
    }

    /// w = sqrt((b - 1) / 2) / tau with b of the equation, by hand: nearly no integral on either side of a proportional gain of one.
    #[test]
    fn the_crossover_loses_no_digits_to_cancellation() {
        let of = |kp_ma_per_bar: f64, ki_ma_per_bar_s: f64| {
            let plant = LoopPlant { gain_bar_per_ma: 1.0, lag_s: 0.01, delay_s: 0.0 };
            margins(&plant, Gains { kp_ma_per_bar, ki_ma_per_bar_s }).gain_crossover_rad_s.unwrap()
        };
        // Slow: K_I / w = 1 by itself. Fast: 2 / (0.01 w) with the lag, so w = sqrt(3) / tau.
        assert!((of(0.0, 1e-7) / 1e-7 - 1.0).abs() < 1e-12, "{}", of(0.0, 1e-7));
        assert!((of(2.0, 1e-7) / (100.0 * 3f64.sqrt()) - 1.0).abs() < 1e-12, "{}", of(2.0, 1e-7));
    }

    /// Against 400 000 frequencies in equal ratios, computed apart with complex numbers.
    #[test]
    fn the_sensitivity_peaks_wherever_lag_delay_and_gains_put_it() {
        let of = |gain_bar_per_ma: f64, kp_ma_per_bar: f64, ki_ma_per_bar_s: f64, lag_s: f64, delay_s: f64| {
            margins(&LoopPlant { gain_bar_per_ma, lag_s, delay_s }, Gains { kp_ma_per_bar, ki_ma_per_bar_s }).max_sensitivity.unwrap()
        };
        // Far above the corner of the lag: the delay is a thousandth of it, and the gain makes up for that.
        assert!((of(1.0, 500.0, 0.0, 1.0, 0.001) - 1.589_855_405).abs() < 1e-8);
        // Without a delay and with damping 0.5, |S|^2 = (y + y^2) / (1 - y + y^2) is largest at y = (1 + sqrt 3) / 2, above the crossover.
        assert!((of(1.0, 0.0, 1e3, 1e-3, 0.0) - (1.0 + 2.0 / 3f64.sqrt()).sqrt()).abs() < 1e-9);
        // Far above the crossover where the integral is weak: with c = k K_I tau and y = (tau w)^2, |S|^2 = (y + y^2) / ((c - y)^2 + y) is
        // largest where y^2 - c y - c / 2 = 0.
        for c in [0.1, 1e-4f64] {
            let y = 0.5 * (c + (c * c + 2.0 * c).sqrt());
            let wanted = ((y + y * y) / ((c - y).powi(2) + y)).sqrt();
            for lag in [100.0, 0.003] {
                assert!((of(1.0, 0.0, c / lag, lag, 0.0) - wanted).abs() < 1e-9 && wanted > 1.0 + 0.5 * c, "{lag}");
            }
        }
        // A delay as long as the lag, or a millionth shorter.
        assert!((of(1.0, 1.0, 0.5, 1.0, 1.0) - of(1.0, 1.0, 0.5, 1.0, 0.999_999)).abs() < 1e-4);
        // A resonance at sqrt(K_I k / tau).
        assert!((of(1.0, 0.0, 1e4, 1.0, 0.0) - 100.006_249_7).abs() < 1e-5);
        // Below the corner: hardly any integral, on a quick plant and on a slow one.
        assert!((of(0.04, 0.0, 1.0, 0.01, 0.04) - 1.001_950_879_6).abs() < 1e-9);
        assert!((of(1.0, 0.0, 1e-3, 2.0, 3.0) - 1.004_779_304_1).abs() < 1e-9);
    }

    /// L = K_P + K_I/s with a delay of 1 s: K_P = -cos w and K_I = w sin w, from w = pi/2 to pi in equal steps.
    #[test]
    fn the_boundary_of_a_pure_delay() {
        let found = boundary(&LoopPlant { gain_bar_per_ma: 1.0, lag_s: 0.0, delay_s: 1.0 }, 4);
        let wanted = [(0.0, std::f64::consts::FRAC_PI_2), (0.5, 1.813_799_364), (0.866_025_404, 1.308_996_939), (1.0, 0.0)];
        assert!(found.iter().zip(wanted).all(|(f, w)| (f.0 - w.0).abs() < 1e-8 && (f.1 - w.1).abs() < 1e-8), "{found:?}");
        assert_eq!(found.len(), 4);
        // With a lag: K_P alone, 1 / k at the frequency of which atan(w) + w = pi.
        let lag = boundary(&LoopPlant { gain_bar_per_ma: 1.0, lag_s: 1.0, delay_s: 1.0 }, 2);
        assert!(lag[1].1.abs() < 1e-9 && (lag[1].0 - 1f64.hypot(2.028_757_838)).abs() < 1e-8, "{lag:?}");
        assert!(boundary(&LoopPlant { delay_s: 0.0, ..PAPER }, 4).is_empty());
    }

    #[test]
    fn what_does_not_exist_is_absent() {
        let open = margins(&PAPER, Gains::default());
        assert_eq!((open.gain_margin_db, open.phase_margin_deg, open.delay_margin_s), (None, None, None));
        assert_eq!((open.max_sensitivity, open.stable), (Some(1.0), true));
        let without_delay = margins(&LoopPlant { delay_s: 0.0, ..PAPER }, GAINS);
        assert_eq!(without_delay.gain_margin_db, None);
        assert!(without_delay.phase_margin_deg.is_some() && without_delay.stable);
    }

    proptest! {
        #[test]
        fn margins_lead_to_the_boundary(kp in 0.0..20.0f64, ki in 0.5..400.0f64, td in 0.005..0.08f64) {
            let plant = LoopPlant { delay_s: td, ..PAPER };
            let gains = Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: ki };
            let found = margins(&plant, gains);
            if let (true, Some(gain), Some(delay)) = (found.stable, found.gain_margin_db, found.delay_margin_s) {
                let scaled = |db: f64| { let f = 10f64.powf(db / 20.0); Gains { kp_ma_per_bar: kp * f, ki_ma_per_bar_s: ki * f } };
                prop_assert!(margins(&plant, scaled(gain - 0.01)).stable);
                prop_assert!(!margins(&plant, scaled(gain + 0.01)).stable);
                let delayed = |by: f64| margins(&LoopPlant { delay_s: td + by, ..plant }, gains);
                prop_assert!(delayed(delay * 0.999).stable);
                prop_assert!(!delayed(delay * 1.001).stable);
            }
        }

        #[test]
        fn the_boundary_curve_separates(index in 0usize..40) {
            let (kp, ki) = boundary(&PAPER, 41)[index];
            let gains = |f: f64| Gains { kp_ma_per_bar: kp * f, ki_ma_per_bar_s: ki * f };
            prop_assert!(margins(&PAPER, gains(0.995)).stable);
            prop_assert!(!margins(&PAPER, gains(1.005)).stable);
        }
    }
}
