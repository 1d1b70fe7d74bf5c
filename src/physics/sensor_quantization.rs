//! # Sensor quantization
//!
//! What it is: the reading comes in coarse steps.
//!
//! Model: y = step * round(P / step); without a seed the mean course, which the noise of the sensor makes smooth.
//!
//! Signature: only multiples of one step occur, and the difference of neighbouring readings is a comb; against a
//! fine reading the error is uniform within +/- half a step.
//!
//! What to check on the bench: range and bits of the converter, scaling of the message.
//!
//! Source: Widrow and Kollar, Quantization Noise, Cambridge 2008, chapter 1.

use super::block::{Block, Pointwise, Through};
use super::effect::{Context, Effect, Kind, Parameter, Scatter, ScatterFinding, Stage, Theta};
use super::missing_codes::digit;
use super::signal::Point;
use crate::units::PRESSURE;

/// The effect `sensor_quantization`.
pub struct SensorQuantization;

impl Effect for SensorQuantization {
    fn id(&self) -> &'static str {
        "sensor_quantization"
    }
    fn source_text(&self) -> &'static str {
        include_str!("sensor_quantization.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn kind(&self) -> Kind {
        Kind::Scatter
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 1] = [Parameter {
            name: "step",
            unit: &PRESSURE,
            range: (1e-4, 50.0),
            starts: &[0.1],
            default: None,
            meaning: "smallest difference of two readings",
        }];
        &PARAMETERS
    }
    /// The comb of the readings: few values, all multiples of one step that is coarse against the noise.
    fn scatter(&self, of: &Scatter<'_>) -> Option<ScatterFinding> {
        let mut values: Vec<f64> = of.measured_bar.iter().copied().filter(|y| y.is_finite()).collect();
        let n = values.len();
        values.sort_by(f64::total_cmp);
        values.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        if values.len() < 4 || n < 100 {
            return None;
        }
        let mut gaps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
        gaps.sort_by(f64::total_cmp);
        let rough = gaps[gaps.len() / 4];
        // A reading printed with few digits blurs the comb by a digit, and is no comb itself.
        let digit = digit(&values);
        let blur = 0.02 * rough + 1.05 * digit;
        let on_comb =
            gaps.iter().filter(|g| (*g / rough - (*g / rough).round()).abs() * rough <= blur * (*g / rough).round().max(1.0)).count();
        let span = values[values.len() - 1] - values[0];
        let steps: f64 = gaps.iter().map(|g| (g / rough).round()).sum();
        let step = span / steps.max(1.0);
        let coarse = step > 1.2 * of.noise_bar && step > 4.0 * digit;
        if !coarse || (on_comb as f64) < 0.97 * gaps.len() as f64 || n < 8 * values.len() {
            return None;
        }
        Some(ScatterFinding {
            is_event: false,
            theta: vec![step],
            std_errors: vec![blur / steps.max(1.0)],
            // Each reading is one of few instead of any within its noise.
            gain_nats: n as f64 * (step / of.noise_bar.min(0.3 * step)).ln().max(0.1),
            masked: Vec::new(),
            spread_bar: vec![step / 12f64.sqrt(); of.measured_bar.len()],
            evidence: format!("{n} readings take {} values only, all multiples of {step:.4} bar", values.len()),
            ..ScatterFinding::default()
        })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        // The mean of a reading with noise is not rounded.
        match context.seed {
            None => Block::pointwise(Through),
            Some(_) => Block::pointwise(Steps { step: theta[0] }),
        }
    }
}

struct Steps {
    step: f64,
}

impl Pointwise for Steps {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        (input / self.step).round() * self.step
    }
}
