//! Loops whose every figure follows by hand, and laws between the views of a loop.

use super::margins::{delays, margins};
use super::sampled::SampledLoop;
use super::{FrequencyMargins, LoopPlant, exact, routh};
use crate::control::Gains;

const PAPER: LoopPlant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.04 };

fn gains(kp_ma_per_bar: f64, ki_ma_per_bar_s: f64) -> Gains {
    Gains { kp_ma_per_bar, ki_ma_per_bar_s }
}

fn plant(gain_bar_per_ma: f64, lag_s: f64, delay_s: f64) -> LoopPlant {
    LoopPlant { gain_bar_per_ma, lag_s, delay_s }
}

fn near(found: Option<f64>, wanted: f64, relative: f64) {
    let found = found.unwrap_or(f64::NAN);
    assert!((found / wanted - 1.0).abs() < relative, "{found} is not {wanted}");
}

/// L = K z^-2 / (1 - z^-1) with K = k K_I T: |L| = K / (2 sin(w T / 2)) at a phase of -90 deg - 1.5 w T. So -180 deg at w T = pi / 3 with
/// |L| = K, and |L| = 1 at w T = 2 asin(K / 2). |1 + L| is smallest where its derivative by cos(w T) vanishes.
#[test]
fn a_sampled_integrator_has_its_margins_in_closed_form() {
    let of = |k: f64| SampledLoop::new(&plant(0.5, 0.0, 0.0), gains(0.0, 200.0 * k), 100.0).margins();
    let found = of(0.5);
    near(found.gain_margin_db, 6.020_599_913, 1e-8);
    near(found.phase_crossover_rad_s, 104.719_755_1, 1e-8);
    near(found.gain_crossover_rad_s, 50.536_051_03, 1e-8);
    near(found.phase_margin_deg, 90.0 - 1.5 * 28.955_024_37, 1e-8);
    near(found.delay_margin_s, 0.016_082_688_39, 1e-8);
    // |1 + L|^2 = 1 + K^2 / (2 - 2c) - K (1 + 2c) with c = cos(w T), least where 2 (1 - c)^2 = K / 2.
    let cosine = 1.0 - 0.125f64.sqrt();
    let least: f64 = 1.0 + 0.25 / (2.0 - 2.0 * cosine) - 0.5 * (1.0 + 2.0 * cosine);
    near(found.max_sensitivity, 1.0 / least.sqrt(), 1e-9);
    assert!(found.stable);
    // Beyond its limit: both margins are negative, and there is neither a delay margin nor a sensitivity.
    let found = of(1.5);
    near(found.gain_margin_db, -3.521_825_181, 1e-8);
    near(found.phase_margin_deg, 90.0 - 1.5 * 97.180_755_78, 1e-8);
    assert_eq!((found.delay_margin_s, found.max_sensitivity, found.stable), (None, None, false));
    // With 4 s of delay, z^-402, the phase has turned round many times where the gain crosses one: -90 deg - 401.5 w T.
    let late = SampledLoop::new(&plant(0.5, 0.0, 4.0), gains(0.0, 300.0), 100.0).margins();
    near(late.phase_margin_deg, 90.0 - 401.5 * 97.180_755_78, 1e-8);
    near(late.phase_crossover_rad_s, 50.0 * std::f64::consts::PI / 401.5, 1e-8);
}

/// L = K z^-2: the gain is K at every frequency and crosses one nowhere; -180 deg at a quarter of the rate.
#[test]
fn a_sampled_proportional_loop_has_a_gain_margin_only() {
    let of = |k: f64| SampledLoop::new(&plant(1.0, 0.0, 0.0), gains(k, 0.0), 100.0).margins();
    let found = of(0.5);
    near(found.gain_margin_db, 6.020_599_913, 1e-9);
    near(found.phase_crossover_rad_s, 157.079_632_7, 1e-9);
    near(found.max_sensitivity, 2.0, 1e-9);
    assert_eq!((found.phase_margin_deg, found.gain_crossover_rad_s, found.delay_margin_s), (None, None, None));
    near(of(2.0).gain_margin_db, -6.020_599_913, 1e-9);
    // No gains, no loop: nothing crosses, nothing is amplified.
    assert_eq!(of(0.0), FrequencyMargins { max_sensitivity: Some(1.0), stable: true, ..FrequencyMargins::default() });
}

/// K_P 2 and K_I 3 at 100 Hz with no plant behind them: 2.03 mA at the noisy sample, 0.03 mA in the 499 after it. And with L = 0.5 z^-2,
/// which leaves 1, 0, -0.5, 0, 0.25, ...: 0.5 / sqrt(1 - 0.25).
#[test]
fn noise_becomes_current_by_both_gains() {
    let (open, p) = (gains(2.0, 3.0), gains(0.5, 0.0));
    near(Some(SampledLoop::new(&plant(1e-12, 0.01, 0.04), open, 100.0).noise_gain(open)), 4.57f64.sqrt(), 1e-9);
    near(Some(SampledLoop::new(&plant(1.0, 0.0, 0.0), p, 100.0).noise_gain(p)), 0.5 / 0.75f64.sqrt(), 1e-9);
}

/// What is left of a disturbance twice as large is twice as much; a predictor that believes in no delay is none.
#[test]
fn a_loop_is_linear_and_a_predictor_without_delay_is_the_loop_itself() {
    let (prompt, of) = (plant(0.04, 0.02, 0.0), gains(10.0, 200.0));
    let plain = SampledLoop::new(&prompt, of, 100.0);
    let twice = plain.left_of(&[2.0; 50]);
    assert!(plain.left_of(&[1.0; 50]).iter().zip(&twice).all(|(one, two)| (2.0 * one - two).abs() < 1e-12));
    let (own, predicted) = (plain.margins(), SampledLoop::with_predictor(&prompt, &prompt, of, 100.0).margins());
    for (a, b) in [(own.gain_margin_db, predicted.gain_margin_db), (own.gain_crossover_rad_s, predicted.gain_crossover_rad_s)] {
        near(b, a.unwrap(), 1e-6);
    }
}

/// The frequency of a figure is that of the loop: a loop ten times as fast has the same margins ten times as high, and the exact
/// view and the sampled one meet where the rate is high.
#[test]
fn time_has_no_scale() {
    for (kp, ki) in [(1.0, 5.0), (10.0, 300.0), (0.0, 400.0), (20.0, 1.0)] {
        let slow = (exact::margins(&PAPER, gains(kp, ki)), SampledLoop::new(&PAPER, gains(kp, ki), 100.0).margins());
        let quick = plant(0.04, 0.001, 0.004);
        let fast = (exact::margins(&quick, gains(kp, 10.0 * ki)), SampledLoop::new(&quick, gains(kp, 10.0 * ki), 1000.0).margins());
        for (slow, fast) in [(slow.0, fast.0), (slow.1, fast.1)] {
            near(fast.gain_margin_db, slow.gain_margin_db.unwrap(), 1e-7);
            near(fast.phase_crossover_rad_s, 10.0 * slow.phase_crossover_rad_s.unwrap(), 1e-7);
            near(fast.max_sensitivity, slow.max_sensitivity.unwrap(), 1e-7);
            if let Some(delay) = slow.delay_margin_s {
                near(fast.delay_margin_s, 0.1 * delay, 1e-7);
                near(fast.phase_margin_deg, slow.phase_margin_deg.unwrap(), 1e-7);
            }
        }
    }
}

#[test]
fn the_record_of_the_margins_holds_what_the_views_give_to_seven_digits() {
    let of = gains(1.0, 5.0);
    let found = margins(&PAPER, (0.02, 0.08), of, 100.0).unwrap();
    let (exact, sampled) = (exact::margins(&PAPER, of), SampledLoop::new(&PAPER, of, 100.0).margins());
    for (shown, known) in [
        (found.gain_margin_db, exact.gain_margin_db),
        (found.delay_margin_s, exact.delay_margin_s),
        (found.sampled.margins.gain_margin_db, sampled.gain_margin_db),
        (found.sampled.margins.phase_margin_deg, sampled.phase_margin_deg),
        (found.routh.kp_max_ma_per_bar, routh::limits(&PAPER, 1.0).kp_max_ma_per_bar),
    ] {
        near(shown, known.unwrap(), 5e-7);
    }
    // A third of a bar has no end: seven digits of it.
    let third = margins(&plant(1.0 / 3.0, 0.01, 0.04), (0.04, 0.04), of, 100.0).unwrap();
    assert_eq!(third.of.gain_bar_per_ma, 0.333_333_3);
    // The range is examined from end to end.
    let seen = delays((0.02, 0.08));
    assert_eq!((seen.len(), seen[0], seen[12]), (13, 0.02, 0.08));
    assert!(seen.windows(2).all(|w| (w[1] - w[0] - 0.005).abs() < 1e-15), "{seen:?}");
}

/// The sampled loop bears less than the exact one: between both limits it is the sampled view that calls it unstable, in the nominal
/// delay as in the range.
#[test]
fn a_loop_is_stable_only_where_both_views_say_so() {
    let exact_limit = 10f64.powf(exact::margins(&PAPER, gains(1.0, 5.0)).gain_margin_db.unwrap() / 20.0);
    let between = gains(0.97 * exact_limit, 0.97 * 5.0 * exact_limit);
    let found = margins(&PAPER, (0.04, 0.04), between, 100.0).unwrap();
    assert!(found.gain_margin_db.unwrap() > 0.0 && !found.sampled.margins.stable);
    assert!(!found.stable && !found.worst_over_delay_range.stable);
    // The nominal delay may lie outside the range: a range that bears it does not save the loop.
    let outside = margins(&PAPER, (0.0, 0.0), between, 100.0).unwrap();
    assert!(outside.worst_over_delay_range.stable && !outside.stable);
    let long = margins(&plant(0.04, 0.01, 0.2), (0.0, 0.0), between, 100.0).unwrap();
    assert!(long.worst_over_delay_range.stable && !long.stable);
}

#[test]
fn the_ends_of_what_is_allowed_are_allowed() {
    let of = gains(1.0, 5.0);
    assert!(margins(&plant(0.04, 100.0, 10.0), (10.0, 10.0), of, 100.0).is_ok());
    let refused = |lag, delay, range: (f64, f64), rate| margins(&plant(0.04, lag, delay), range, of, rate).unwrap_err().quantity;
    assert_eq!(refused(100.1, 0.0, (0.0, 0.0), 100.0), "the lag in s");
    assert_eq!(refused(f64::INFINITY, 0.0, (0.0, 0.0), 100.0), "the lag in s");
    assert_eq!(refused(-0.1, 0.0, (0.0, 0.0), 100.0), "the lag in s");
    assert_eq!(refused(0.01, 10.1, (0.0, 0.0), 100.0), "the delay in s");
    assert_eq!(refused(0.01, 0.0, (0.0, 10.1), 100.0), "the delay in s");
    assert_eq!(refused(0.01, 0.0, (0.05, 0.04), 100.0), "the low end of the delay range in s");
    // 10 000 periods of delay are too many, by the plant and by the range.
    assert_eq!(refused(0.01, 10.0, (0.0, 0.0), 1000.0), "the loop rate in Hz");
    assert_eq!(refused(0.01, 0.0, (0.0, 10.0), 1000.0), "the loop rate in Hz");
    assert!(margins(&plant(0.04, 0.01, 0.0), (0.0, 0.0), of, 20_000.0).is_ok());
}

/// Without a lag and at K_P = 1 / k the product a1 a2 is what decides; on each boundary itself the loop is not stable.
#[test]
fn on_the_boundary_of_routh_the_loop_is_not_stable() {
    // Powers of two, so that the limits come out exactly: K_P 3, and K_I 8 (2 + 2 K_P) / 8 = 4 at K_P 1.
    let half = plant(1.0, 0.5, 0.5);
    let limits = routh::limits(&half, 1.0);
    assert_eq!((limits.kp_max_ma_per_bar, limits.ki_max_ma_per_bar_s), (Some(3.0), Some(4.0)));
    assert!(routh::stable(&half, gains(1.0, 3.9)) && !routh::stable(&half, gains(1.0, 4.0)));
    assert!(routh::stable(&half, gains(2.9, 0.0)) && !routh::stable(&half, gains(3.0, 0.0)));
    assert_eq!(routh::limits(&half, 3.0).ki_max_ma_per_bar_s, None);
}
