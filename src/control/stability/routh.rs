//! Routh criterion with the delay in the first-order Pade form, Eqs. (16)-(18) of the paper.
//!
//! Characteristic polynomial a0 s^3 + a1 s^2 + a2 s + a3 with a0 = tau T_d, a1 = 2 tau + T_d - k T_d K_P,
//! a2 = 2 + 2 k K_P - k T_d K_I, a3 = 2 k K_I. (The paper prints a2 with a factor too many.)

use super::LoopPlant;
use crate::control::Gains;

/// Limits of the gains after Routh with the Pade form.
#[doc(alias("Routh", "Pade"))]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct RouthLimits {
    /// Largest K_P [mA/bar]; `None` without a delay, where the form sets no limit.
    #[doc(alias = "K_P limit")]
    pub kp_max_ma_per_bar: Option<f64>,
    /// Largest K_I [mA/(bar s)] at the K_P that was asked for; `None` where K_P alone is too large or no limit exists.
    #[doc(alias = "K_I limit")]
    pub ki_max_ma_per_bar_s: Option<f64>,
}

/// The limits of K_P, and of K_I at the given K_P, Eq. (18).
pub fn limits(plant: &LoopPlant, kp_ma_per_bar: f64) -> RouthLimits {
    RouthLimits { kp_max_ma_per_bar: kp_max(plant), ki_max_ma_per_bar_s: ki_max(plant, kp_ma_per_bar) }
}

fn kp_max(plant: &LoopPlant) -> Option<f64> {
    let LoopPlant { gain_bar_per_ma: k, lag_s: tau, delay_s: td } = *plant;
    (k > 0.0 && td > 0.0).then(|| (2.0 * tau + td) / (k * td))
}

fn ki_max(plant: &LoopPlant, kp: f64) -> Option<f64> {
    let LoopPlant { gain_bar_per_ma: k, lag_s: tau, delay_s: td } = *plant;
    let (a0, a1) = (tau * td, 2.0 * tau + td - k * td * kp);
    // a1 a2 > a0 a3 solved for K_I; with a0 = 0 it is a2 > 0.
    let slope = k * (a1 * td + 2.0 * a0);
    (a1 > 0.0 && slope > 0.0).then(|| a1 * (2.0 + 2.0 * k * kp) / slope)
}

/// Whether the loop with the Pade form is stable.
pub fn stable(plant: &LoopPlant, gains: Gains) -> bool {
    let LoopPlant { gain_bar_per_ma: k, lag_s: tau, delay_s: td } = *plant;
    let (kp, ki) = (gains.kp_ma_per_bar, gains.ki_ma_per_bar_s);
    let (a0, a1) = (tau * td, 2.0 * tau + td - k * td * kp);
    let (a2, a3) = (2.0 + 2.0 * k * kp - k * td * ki, 2.0 * k * ki);
    a1 > 0.0 && a2 > 0.0 && a3 >= 0.0 && a1 * a2 > a0 * a3
}

/// The boundary curve K_I over K_P, `count` points from K_P = 0 to its limit.
pub fn boundary(plant: &LoopPlant, count: usize) -> Vec<(f64, f64)> {
    let Some(last) = kp_max(plant) else { return Vec::new() };
    let point = |i: usize| {
        let kp = last * i as f64 / (count - 1) as f64;
        // At the very limit a1 = 0, and with it K_I.
        (kp, ki_max(plant, kp).unwrap_or(0.0))
    };
    (0..count).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PAPER: LoopPlant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.04 };

    #[test]
    fn the_limits_of_the_paper() {
        // The paper rounds them to 35, 900 and 500.
        let close = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 1e-9;
        assert!(close(limits(&PAPER, 0.0).kp_max_ma_per_bar, 37.5));
        assert!(close(limits(&PAPER, 0.0).ki_max_ma_per_bar_s, 937.5));
        assert!(close(limits(&PAPER, 35.0).ki_max_ma_per_bar_s, 500.0));
        assert_eq!(limits(&PAPER, 40.0).ki_max_ma_per_bar_s, None);
    }

    #[test]
    fn each_condition_of_routh_alone_makes_it_unstable() {
        let gains = |kp_ma_per_bar: f64, ki_ma_per_bar_s: f64| Gains { kp_ma_per_bar, ki_ma_per_bar_s };
        assert!(stable(&PAPER, gains(1.0, 5.0)) && stable(&PAPER, gains(1.0, 0.0)));
        // K_P beyond its limit; an integral that turns the wrong way; K_I beyond its limit.
        assert!(!stable(&PAPER, gains(40.0, 0.0)) && !stable(&PAPER, gains(1.0, -1.0)) && !stable(&PAPER, gains(0.0, 940.0)));
        // Without a lag a0 = 0: a1 and a2 both negative have a positive product.
        assert!(!stable(&LoopPlant { lag_s: 0.0, ..PAPER }, gains(30.0, 1e4)));
    }

    #[test]
    fn the_boundary_runs_from_the_limit_of_the_integral_to_that_of_the_proportional_gain() {
        let found = boundary(&PAPER, 4);
        let kp: Vec<f64> = found.iter().map(|p| p.0).collect();
        assert_eq!(kp, [0.0, 12.5, 25.0, 37.5]);
        assert!((found[0].1 - 937.5).abs() < 1e-9 && found[3].1.abs() < 1e-9, "{found:?}");
        // K_P 12.5: a1 = 0.04, slope = 0.04 (0.0016 + 0.0008) = 9.6e-5, K_I = 0.04 * 3 / 9.6e-5.
        assert!((found[1].1 - 1250.0).abs() < 1e-6, "{found:?}");
        assert!(boundary(&LoopPlant { delay_s: 0.0, ..PAPER }, 4).is_empty());
        assert_eq!(
            limits(&LoopPlant { gain_bar_per_ma: 0.0, ..PAPER }, 1.0),
            RouthLimits { kp_max_ma_per_bar: None, ki_max_ma_per_bar_s: None }
        );
    }

    #[test]
    fn without_a_delay_there_is_no_limit() {
        let limits = limits(&LoopPlant { delay_s: 0.0, ..PAPER }, 1.0);
        assert_eq!((limits.kp_max_ma_per_bar, limits.ki_max_ma_per_bar_s), (None, None));
    }

    proptest! {
        #[test]
        fn the_limit_separates_stable_from_unstable(kp in 0.0..37.0f64, k in 0.01..0.1f64, tau in 0.0..0.1f64, td in 0.005..0.1f64) {
            let plant = LoopPlant { gain_bar_per_ma: k, lag_s: tau, delay_s: td };
            if let Some(ki) = limits(&plant, kp).ki_max_ma_per_bar_s {
                let gains = |factor: f64| Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: ki * factor };
                prop_assert!(stable(&plant, gains(0.999)));
                prop_assert!(!stable(&plant, gains(1.001)));
            }
        }
    }
}
