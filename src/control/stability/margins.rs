//! All margins of a loop in one value, as `hil margins` and every record show them.

use serde::Serialize;

use super::routh::{self, RouthLimits};
use super::sampled::SampledLoop;
use super::{FrequencyMargins, LoopPlant, exact};
use crate::control::Gains;

/// Why margins cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{quantity} is {value}; {allowed}")]
pub struct StabilityError {
    /// What is wrong.
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// What is allowed.
    pub allowed: &'static str,
}

/// The margins of one loop. Keys are part of the contract; a value that does not exist is `null`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Margins {
    /// The loop that the figures are of.
    #[serde(rename = "loop")]
    pub of: LoopRecord,
    /// Limits of the gains with the first-order Pade form of the paper.
    pub routh: RouthLimits,
    /// See [`FrequencyMargins::gain_margin_db`]; exact delay.
    pub gain_margin_db: Option<f64>,
    /// See [`FrequencyMargins::phase_margin_deg`]; exact delay.
    pub phase_margin_deg: Option<f64>,
    /// See [`FrequencyMargins::delay_margin_s`]; exact delay.
    pub delay_margin_s: Option<f64>,
    /// See [`FrequencyMargins::max_sensitivity`]; exact delay.
    pub max_sensitivity: Option<f64>,
    /// See [`FrequencyMargins::gain_crossover_rad_s`]; exact delay.
    pub gain_crossover_rad_s: Option<f64>,
    /// See [`FrequencyMargins::phase_crossover_rad_s`]; exact delay.
    pub phase_crossover_rad_s: Option<f64>,
    /// The same loop at the loop rate.
    pub sampled: SampledMargins,
    /// The worst over the delay range.
    pub worst_over_delay_range: WorstMargins,
    /// Whether the loop is stable: with the exact delay and sampled, over the whole delay range.
    pub stable: bool,
    /// Boundary curves (K_P, K_I) for plots: after Routh with the Pade form, and with the exact delay.
    pub boundary: Boundary,
}

/// Plant and gains of a loop.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoopRecord {
    /// Plant gain k [bar/mA].
    pub gain_bar_per_ma: f64,
    /// Lag tau [s].
    pub lag_s: f64,
    /// Delay T_d [s].
    pub delay_s: f64,
    /// Range of the delay [s].
    pub delay_range_s: (f64, f64),
    /// K_P [mA/bar].
    pub kp_ma_per_bar: f64,
    /// K_I [mA/(bar s)].
    pub ki_ma_per_bar_s: f64,
}

/// Margins at the loop rate with zero-order hold and one period of computation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SampledMargins {
    /// Loop rate [Hz].
    pub rate_hz: f64,
    /// The figures.
    #[serde(flatten)]
    pub margins: FrequencyMargins,
}

/// The worst of each figure over the delay range, with the exact delay and sampled.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorstMargins {
    /// The range [s].
    pub delay_range_s: (f64, f64),
    /// Smallest gain margin [dB].
    pub gain_margin_db: Option<f64>,
    /// Smallest phase margin [deg].
    pub phase_margin_deg: Option<f64>,
    /// Smallest delay margin [s].
    pub delay_margin_s: Option<f64>,
    /// Largest sensitivity; `None` where the loop is unstable somewhere in the range.
    pub max_sensitivity: Option<f64>,
    /// The same of the sampled loop.
    pub sampled: WorstSampled,
    /// Whether the loop is stable over the whole range, exact and sampled.
    pub stable: bool,
}

/// The worst of the sampled loop over the delay range.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorstSampled {
    /// Smallest gain margin [dB].
    pub gain_margin_db: Option<f64>,
    /// Smallest phase margin [deg].
    pub phase_margin_deg: Option<f64>,
    /// Largest sensitivity; `None` where the loop is unstable somewhere in the range.
    pub max_sensitivity: Option<f64>,
}

/// Boundary curves of stability in the plane of the gains, points (K_P [mA/bar], K_I [mA/(bar s)]).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Boundary {
    /// After Routh with the first-order Pade form.
    pub routh: Vec<(f64, f64)>,
    /// With the exact delay.
    pub exact: Vec<(f64, f64)>,
}

/// Number of delays at which a range is examined, both ends included.
pub const DELAYS_EXAMINED: usize = 13;

/// The delays at which a range is examined.
pub fn delays(range_s: (f64, f64)) -> Vec<f64> {
    if range_s.0 == range_s.1 {
        return vec![range_s.0];
    }
    (0..DELAYS_EXAMINED).map(|i| range_s.0 + (range_s.1 - range_s.0) * i as f64 / (DELAYS_EXAMINED - 1) as f64).collect()
}

/// The margins of the loop of `plant` and `gains`, sampled at `rate_hz`, and their worst over `delay_range_s`.
pub fn margins(plant: &LoopPlant, delay_range_s: (f64, f64), gains: Gains, rate_hz: f64) -> Result<Margins, StabilityError> {
    check(plant, delay_range_s, gains, rate_hz)?;
    let nominal = exact::margins(plant, gains);
    let sampled = SampledLoop::new(plant, gains, rate_hz).margins();
    let worst = worst(plant, delay_range_s, gains, rate_hz);
    let round_pairs = |curve: Vec<(f64, f64)>| curve.into_iter().map(|(x, y)| (digits(x), digits(y))).collect();
    Ok(Margins {
        of: LoopRecord {
            gain_bar_per_ma: digits(plant.gain_bar_per_ma),
            lag_s: digits(plant.lag_s),
            delay_s: digits(plant.delay_s),
            delay_range_s: (digits(delay_range_s.0), digits(delay_range_s.1)),
            kp_ma_per_bar: digits(gains.kp_ma_per_bar),
            ki_ma_per_bar_s: digits(gains.ki_ma_per_bar_s),
        },
        routh: {
            let limits = routh::limits(plant, gains.kp_ma_per_bar);
            RouthLimits {
                kp_max_ma_per_bar: limits.kp_max_ma_per_bar.map(digits),
                ki_max_ma_per_bar_s: limits.ki_max_ma_per_bar_s.map(digits),
            }
        },
        gain_margin_db: nominal.gain_margin_db.map(digits),
        phase_margin_deg: nominal.phase_margin_deg.map(digits),
        delay_margin_s: nominal.delay_margin_s.map(digits),
        max_sensitivity: nominal.max_sensitivity.map(digits),
        gain_crossover_rad_s: nominal.gain_crossover_rad_s.map(digits),
        phase_crossover_rad_s: nominal.phase_crossover_rad_s.map(digits),
        stable: nominal.stable && sampled.stable && worst.stable,
        sampled: SampledMargins { rate_hz: digits(rate_hz), margins: rounded(sampled) },
        worst_over_delay_range: worst,
        boundary: Boundary { routh: round_pairs(routh::boundary(plant, 41)), exact: round_pairs(exact::boundary(plant, 41)) },
    })
}

fn worst(plant: &LoopPlant, delay_range_s: (f64, f64), gains: Gains, rate_hz: f64) -> WorstMargins {
    let at = |delay_s: f64| {
        let plant = LoopPlant { delay_s, ..*plant };
        (exact::margins(&plant, gains), SampledLoop::new(&plant, gains, rate_hz).margins())
    };
    let (exact, sampled): (Vec<_>, Vec<_>) = delays(delay_range_s).into_iter().map(at).unzip();
    let least =
        |of: &[FrequencyMargins], pick: fn(&FrequencyMargins) -> Option<f64>| of.iter().filter_map(pick).min_by(f64::total_cmp).map(digits);
    let stable = |of: &[FrequencyMargins]| of.iter().all(|m| m.stable);
    let largest = |of: &[FrequencyMargins]| {
        let all: Option<Vec<f64>> = of.iter().map(|m| m.max_sensitivity).collect();
        all.filter(|_| stable(of)).and_then(|all| all.into_iter().max_by(f64::total_cmp)).map(digits)
    };
    WorstMargins {
        delay_range_s: (digits(delay_range_s.0), digits(delay_range_s.1)),
        gain_margin_db: least(&exact, |m| m.gain_margin_db),
        phase_margin_deg: least(&exact, |m| m.phase_margin_deg),
        delay_margin_s: if stable(&exact) { least(&exact, |m| m.delay_margin_s) } else { None },
        max_sensitivity: largest(&exact),
        stable: stable(&exact) && stable(&sampled),
        sampled: WorstSampled {
            gain_margin_db: least(&sampled, |m| m.gain_margin_db),
            phase_margin_deg: least(&sampled, |m| m.phase_margin_deg),
            max_sensitivity: largest(&sampled),
        },
    }
}

fn check(plant: &LoopPlant, range: (f64, f64), gains: Gains, rate_hz: f64) -> Result<(), StabilityError> {
    let wrong = |quantity, value, allowed| Err(StabilityError { quantity, value, allowed });
    let finite = |value: f64| value.is_finite() && value >= 0.0;
    if !(plant.gain_bar_per_ma.is_finite() && plant.gain_bar_per_ma > 0.0) {
        return wrong("the plant gain in bar/mA", plant.gain_bar_per_ma, "it must be positive");
    }
    // Beyond these the figures would be of no pressure loop, and the delay line of the sampled loop without bound.
    if !(finite(plant.lag_s) && plant.lag_s <= 100.0) {
        return wrong("the lag in s", plant.lag_s, "it must lie between 0 and 100 s");
    }
    for delay in [plant.delay_s, range.0, range.1] {
        if !(finite(delay) && delay <= 10.0) {
            return wrong("the delay in s", delay, "it must lie between 0 and 10 s");
        }
    }
    if range.0 > range.1 {
        return wrong("the low end of the delay range in s", range.0, "it must not exceed the high end");
    }
    if !finite(gains.kp_ma_per_bar) {
        return wrong("K_P in mA/bar", gains.kp_ma_per_bar, "it must not be negative");
    }
    if !finite(gains.ki_ma_per_bar_s) {
        return wrong("K_I in mA/(bar s)", gains.ki_ma_per_bar_s, "it must not be negative");
    }
    if !(rate_hz.is_finite() && rate_hz > 0.0 && rate_hz * (plant.delay_s.max(range.1)) < 1e4) {
        return wrong("the loop rate in Hz", rate_hz, "it must be positive, and the delay at most 10000 periods long");
    }
    Ok(())
}

fn rounded(m: FrequencyMargins) -> FrequencyMargins {
    FrequencyMargins {
        gain_margin_db: m.gain_margin_db.map(digits),
        phase_margin_deg: m.phase_margin_deg.map(digits),
        delay_margin_s: m.delay_margin_s.map(digits),
        max_sensitivity: m.max_sensitivity.map(digits),
        gain_crossover_rad_s: m.gain_crossover_rad_s.map(digits),
        phase_crossover_rad_s: m.phase_crossover_rad_s.map(digits),
        stable: m.stable,
    }
}

/// Seven significant digits: more than any figure here is worth, and the same on every machine.
fn digits(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: LoopPlant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.04 };
    const GAINS: Gains = Gains { kp_ma_per_bar: 1.0, ki_ma_per_bar_s: 5.0 };

    #[test]
    fn the_worst_is_at_the_long_end_of_the_delay() {
        let found = margins(&PAPER, (0.01, 0.08), GAINS, 100.0).unwrap();
        let long = exact::margins(&LoopPlant { delay_s: 0.08, ..PAPER }, GAINS);
        assert_eq!(found.worst_over_delay_range.gain_margin_db, long.gain_margin_db.map(digits));
        assert_eq!(found.worst_over_delay_range.max_sensitivity, long.max_sensitivity.map(digits));
        assert!(found.stable);
    }

    #[test]
    fn an_unstable_corner_of_the_range_makes_the_loop_unstable() {
        let found = margins(&PAPER, (0.04, 0.5), Gains { kp_ma_per_bar: 5.0, ki_ma_per_bar_s: 150.0 }, 100.0).unwrap();
        assert!(!found.stable && !found.worst_over_delay_range.stable);
        assert_eq!(found.worst_over_delay_range.max_sensitivity, None);
        assert!(found.max_sensitivity.is_some());
    }

    #[test]
    fn values_outside_their_range_are_refused() {
        let message = |plant, gains, rate| margins(&plant, (0.0, 0.1), gains, rate).unwrap_err().to_string();
        insta::assert_snapshot!(message(LoopPlant { gain_bar_per_ma: 0.0, ..PAPER }, GAINS, 100.0), @"the plant gain in bar/mA is 0; it must be positive");
        insta::assert_snapshot!(message(PAPER, Gains { kp_ma_per_bar: -1.0, ..GAINS }, 100.0), @"K_P in mA/bar is -1; it must not be negative");
        insta::assert_snapshot!(message(PAPER, GAINS, 0.0), @"the loop rate in Hz is 0; it must be positive, and the delay at most 10000 periods long");
        insta::assert_snapshot!(message(LoopPlant { delay_s: f64::NAN, ..PAPER }, GAINS, 100.0), @"the delay in s is NaN; it must lie between 0 and 10 s");
    }
}
