//! # Sensor outliers
//!
//! What it is: readings that are far off, single or a few in a row: a loose contact, a disturbed message.
//!
//! Model: with the probability `share` a reading is off by a normal deviate of the standard deviation `size`; without
//! a seed the mean course.
//!
//! Signature: isolated readings many times the noise away from both neighbours, at times of their own; or a few in a row that
//! leave the course and come back to it from one reading to the next, ragged or stuck at one value, as no pressure is. Judged
//! by likelihood, since no simulation can follow it.
//!
//! What to check on the bench: connector, shield, ground of the sensor.
//!
//! Source: Huber, Robust Statistics, Wiley 1981, section 1.2 (contaminated normal distribution).

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::block::{Block, Pointwise, Through};
use super::effect::{Context, Effect, Kind, Parameter, Scatter, ScatterFinding, Stage, Theta};
use super::signal::Point;
use crate::units::{PRESSURE, RATIO};

/// The effect `sensor_outliers`.
pub struct SensorOutliers;

impl Effect for SensorOutliers {
    fn id(&self) -> &'static str {
        "sensor_outliers"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_outliers.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter {
                name: "share",
                unit: &RATIO,
                range: (0.0, 0.5),
                starts: &[0.01],
                default: None,
                meaning: "share of the readings that are off",
            },
            Parameter {
                name: "size",
                unit: &PRESSURE,
                range: (0.0, 100.0),
                starts: &[1.0],
                default: None,
                meaning: "standard deviation of those readings",
            },
        ];
        &PARAMETERS
    }
    /// Readings far from the median of their neighbours' errors, where the pressure itself hardly moves.
    fn scatter(&self, of: &Scatter<'_>) -> Option<ScatterFinding> {
        let error: Vec<f64> = of.measured_bar.iter().zip(of.simulated_bar).map(|(y, p)| y - p).collect();
        let (mut masked, mut sizes) = (Vec::new(), Vec::new());
        for k in REACH..error.len().saturating_sub(REACH) {
            let mut around: Vec<f64> = (k - REACH..=k + REACH).filter(|j| *j != k).map(|j| error[j]).filter(|e| e.is_finite()).collect();
            if around.len() < 4 || !error[k].is_finite() {
                continue;
            }
            around.sort_by(f64::total_cmp);
            let middle = median(&around);
            // How unsure the neighbourhood itself is: its own spread, and how fast the pressure moves there.
            let unrest = around[around.len() - 2] - around[1];
            let slope = (k - REACH..k + REACH).map(|j| (of.simulated_bar[j + 1] - of.simulated_bar[j]).abs()).fold(0.0, f64::max);
            let away = error[k] - middle;
            if away.abs() > 6.0 * of.noise_bar + 1.5 * unrest + 2.0 * slope {
                masked.push(k);
                sizes.push(away);
            }
        }
        let single = masked.len();
        for (burst, middle) in bursts(of, &error) {
            for k in burst.filter(|k| error[*k].is_finite()) {
                if masked[..single].binary_search(&k).is_err() {
                    masked.push(k);
                    sizes.push(error[k] - middle);
                }
            }
        }
        let n = error.iter().filter(|e| e.is_finite()).count();
        if masked.len() < FEWEST || masked.len() > n / 10 {
            return None;
        }
        let count = masked.len() as f64;
        let size = (sizes.iter().map(|s| s * s).sum::<f64>() / count).sqrt();
        let share = count / n as f64;
        // Each is explained by a normal of its own size in place of that of the noise, at the price of its rarity.
        let nats = |s: &f64| 0.5 * (s / of.noise_bar).powi(2) - (size / of.noise_bar).ln() - 0.5 * (s / size).powi(2) + share.ln();
        let mut spread_bar = vec![0.0; error.len()];
        masked.iter().for_each(|k| spread_bar[*k] = size);
        Some(ScatterFinding {
            is_event: false,
            theta: vec![share, size],
            std_errors: vec![(share * (1.0 - share) / n as f64).sqrt(), size / (2.0 * count).sqrt()],
            gain_nats: sizes.iter().map(nats).sum(),
            evidence: format!(
                "{} readings, single or a few in a row, lie {size:.2} bar (RMS) off their neighbours, more than six times the noise of {:.3} bar",
                masked.len(),
                of.noise_bar
            ),
            masked,
            spread_bar,
            ..ScatterFinding::default()
        })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        match context.seed {
            None => Block::pointwise(Through),
            Some(seed) => Block::pointwise(Spikes { share: theta[0], size: theta[1], random: Pcg64::seed_from_u64(seed ^ 0x6f75_746c) }),
        }
    }
}

struct Spikes {
    share: f64,
    size: f64,
    random: Pcg64,
}

impl Pointwise for Spikes {
    fn start(&mut self, _: &Point, _: f64) {}
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        let off: f64 = StandardNormal.sample(&mut self.random);
        if self.random.random::<f64>() < self.share { input + self.size * off } else { input }
    }
}

/// Stretches of two readings or more that leave the course of the error by a jump and come back by one, each with the error about
/// it [bar]. What a valve does in so few readings it does smoothly; these are ragged, or stand at one value.
fn bursts(of: &Scatter<'_>, error: &[f64]) -> Vec<(std::ops::Range<usize>, f64)> {
    let mut found = Vec::new();
    let mut k = REACH;
    while k + REACH + 2 <= error.len() {
        let before = &error[k - REACH..k];
        let Some((middle, unrest)) = course(before) else {
            k += 1;
            continue;
        };
        let slope = |from: usize, to: usize| {
            (from..to.min(error.len() - 1)).map(|j| (of.simulated_bar[j + 1] - of.simulated_bar[j]).abs()).fold(0.0, f64::max)
        };
        let far = 6.0 * of.noise_bar + 1.5 * unrest + 2.0 * slope(k - REACH, k + LONGEST + REACH);
        let is_far = |e: f64| (e - middle).abs() > far;
        if !is_far(error[k]) {
            k += 1;
            continue;
        }
        // Back where the readings stay with the course for as long as was looked at before.
        let back = (k + 2..=k + LONGEST)
            .find(|end| error.get(*end..end + REACH).and_then(course).is_some_and(|(after, unrest)| !is_far(after) && unrest < far));
        let wrong = |end: usize| {
            let jumps = error[k..end].windows(2).filter(|w| (w[1] - w[0]).abs() > far).count();
            let all = jumps + 1 == end - k;
            is_stuck(&of.measured_bar[k..end]) || all || jumps > 0 && (end - k - 1) as f64 * of.dt_s <= SHORT_S
        };
        match back.filter(|end| is_far(error[end - 1]) && wrong(*end)) {
            Some(end) => {
                found.push((k..end, middle));
                k = end + REACH;
            }
            None => k += 1,
        }
    }
    found
}

/// Median and range of a few errors; nothing where one is missing [bar].
fn course(errors: &[f64]) -> Option<(f64, f64)> {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted[0], sorted[sorted.len() - 1]);
    (high - low).is_finite().then(|| (median(&sorted), high - low))
}

/// The median of sorted values.
fn median(sorted: &[f64]) -> f64 {
    0.5 * (sorted[sorted.len() / 2] + sorted[(sorted.len() - 1) / 2])
}

/// Whether readings are all the same, to the last digit.
fn is_stuck(measured: &[f64]) -> bool {
    measured.windows(2).all(|w| w[0] == w[1])
}

/// A burst of this length may be smooth in a part of it [s]: no valve goes and comes back in less. In a longer one every reading
/// must jump.
const SHORT_S: f64 = 0.05;
/// Most readings in a row of a burst.
const LONGEST: usize = 8;
/// Neighbours looked at on each side.
const REACH: usize = 4;
/// Fewest outliers that make a finding.
const FEWEST: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    /// A slow course with noise of 0.03 bar, off by `off` at a sample.
    fn found(off: impl Fn(usize) -> Option<f64>) -> Option<ScatterFinding> {
        let mut random = Pcg64::seed_from_u64(3);
        let simulated: Vec<f64> = (0..6000).map(|k| 12.0 + 4.0 * (0.005 * k as f64).sin()).collect();
        let noise = |random: &mut Pcg64| {
            let z: f64 = StandardNormal.sample(random);
            0.03 * z
        };
        let measured: Vec<f64> = simulated.iter().enumerate().map(|(k, p)| p + noise(&mut random) + off(k).unwrap_or(0.0)).collect();
        SensorOutliers.scatter(&Scatter::between(&measured, &simulated, 0.03))
    }

    #[test]
    fn bursts_of_wrong_readings_are_found_whole() {
        let wrong = [1.9, -0.8, 2.6, 1.1];
        let burst = |k: usize| (k % 500 >= 250 && k % 500 < 254).then(|| wrong[k % 500 - 250]);
        let finding = found(burst).unwrap();
        assert_eq!(finding.masked.len(), 48, "{:?}", finding.masked);
        assert!(finding.masked.iter().all(|k| burst(*k).is_some()));
    }

    #[test]
    fn what_a_valve_may_do_in_a_few_readings_is_no_burst() {
        // A smooth dip of eight readings, and a step that stays.
        let dip = |k: usize| (k % 500 >= 250 && k % 500 < 258).then(|| -1.2 * (std::f64::consts::PI * (k % 500 - 249) as f64 / 9.0).sin());
        assert!(found(dip).is_none());
        assert!(found(|k| (k % 1000 >= 500).then_some(1.5)).is_none());
    }
}
