//! # Sensor outliers
//!
//! What it is: single readings that are far off: a loose contact, a disturbed message.
//!
//! Model: with the probability `share` a reading is off by a normal deviate of the standard deviation `size`; without
//! a seed the mean course.
//!
//! Signature: isolated readings many times the noise away from both neighbours, at times of their own. Judged by
//! likelihood, since no simulation can follow it.
//!
//! What to check on the bench: connector, shield, ground of the sensor.
//!
//! Source: Huber, Robust Statistics, Wiley 1981, section 1.2 (contaminated normal distribution).

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::block::{Block, Point, Pointwise, Through};
use super::effect::{Context, Effect, Kind, Parameter, Scatter, ScatterFinding, Stage, Theta};
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
            let middle = 0.5 * (around[around.len() / 2] + around[(around.len() - 1) / 2]);
            // How unsure the neighbourhood itself is: its own spread, and how fast the pressure moves there.
            let unrest = around[around.len() - 2] - around[1];
            let slope = (k - REACH..k + REACH).map(|j| (of.simulated_bar[j + 1] - of.simulated_bar[j]).abs()).fold(0.0, f64::max);
            let away = error[k] - middle;
            if away.abs() > 6.0 * of.noise_bar + 1.5 * unrest + 2.0 * slope {
                masked.push(k);
                sizes.push(away);
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
            theta: vec![share, size],
            std_errors: vec![(share * (1.0 - share) / n as f64).sqrt(), size / (2.0 * count).sqrt()],
            gain_nats: sizes.iter().map(nats).sum(),
            evidence: format!(
                "{} single readings lie {size:.2} bar (RMS) off both neighbours, more than six times the noise of {:.3} bar",
                masked.len(),
                of.noise_bar
            ),
            masked,
            spread_bar,
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

/// Neighbours looked at on each side.
const REACH: usize = 4;
/// Fewest outliers that make a finding.
const FEWEST: usize = 4;
