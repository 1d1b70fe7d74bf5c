//! # Supply saturation
//!
//! What it is: the supply cannot deliver the pressure that the current asks for.
//!
//! Model: P = min(P0, limit), rounded over `softness`: P = limit - s ln(1 + exp((limit - P0)/s)); the limit holds
//! from `from` to `until`.
//!
//! Signature: one-sided clipping at high current; a sag only while the pressure is high; a shared supply that sags at
//! times of its own leaves one level at which the pressure then stands.
//!
//! What to check on the bench: supply pressure during the run, pump speed, relief valve.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, chapter 7 (hydraulic power elements).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Hint, Parameter, Scatter, ScatterFinding, Stage, Theta};
use super::sag::{densest, sags};
use super::signal::Point;
use crate::units::{PRESSURE, TIME};

/// A reading is too low by this many times the scale of what the model leaves: one in a thousand by chance.
const TOO_LOW: f64 = 3.0;

/// The effect `supply_saturation`.
pub struct SupplySaturation;

impl Effect for SupplySaturation {
    fn id(&self) -> &'static str {
        "supply_saturation"
    }
    fn source_text(&self) -> &'static str {
        include_str!("supply_saturation.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Supply
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter {
                name: "limit",
                unit: &PRESSURE,
                range: (1.0, 400.0),
                starts: &[12.0, 16.0, 20.0, 24.0, 28.0],
                default: None,
                meaning: "pressure that the supply can deliver",
            },
            Parameter {
                name: "softness",
                unit: &PRESSURE,
                range: (0.005, 3.0),
                starts: &[0.05],
                default: Some(0.005),
                meaning: "pressure over which the clipping sets in",
            },
            Parameter {
                name: "from",
                unit: &TIME,
                range: (0.0, 1e6),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "begin of the limit since the start of the recording",
            },
            Parameter { name: "until", unit: &TIME, range: (0.0, 1e6), starts: &[1e6], default: Some(1e6), meaning: "end of the limit" },
        ];
        &PARAMETERS
    }
    /// The level at which the pressure stands where it is too low.
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        let low = |k: &usize| hint.residual_bar[*k] < -TOO_LOW * hint.scale_bar;
        let mut levels: Vec<f64> = (0..hint.residual_bar.len()).filter(low).map(|k| hint.pressure_bar[k] + hint.residual_bar[k]).collect();
        densest(&mut levels, 2.0 * TOO_LOW * hint.scale_bar).map(|limit| vec![limit, 0.05, 0.0, 1e6]).into_iter().collect()
    }
    /// A supply that sags at times of its own.
    fn scatter(&self, of: &Scatter<'_>) -> Option<ScatterFinding> {
        let sags = sags(of)?;
        let masked = sags.samples(of.dt_s, of.measured_bar.len());
        let (from, to) = sags.longest();
        let seconds = |k: usize| k as f64 * of.dt_s;
        let list: Vec<String> = sags.stretches.iter().map(|(a, b)| format!("{:.1} to {:.1} s", seconds(*a), seconds(*b))).collect();
        let excess = |k: &usize| (of.simulated_bar[*k] - of.measured_bar[*k]) / of.noise_bar;
        Some(ScatterFinding {
            theta: vec![sags.level_bar, 0.005, seconds(from), seconds(to)],
            std_errors: vec![of.noise_bar, f64::NAN, of.dt_s, of.dt_s],
            gain_nats: masked.iter().map(excess).filter(|z| z.is_finite()).map(|z| (0.25 * z * z).ln_1p()).sum(),
            spread_bar: vec![0.0; of.measured_bar.len()],
            is_event: true,
            evidence: format!(
                "the pressure stands at {:.2} bar whatever is asked beyond it, but passes it at other times: {} (longest from the begin to the end given; the augmented model is without it: when the supply sags in another drive, the current does not tell)",
                sags.level_bar,
                list.join(", ")
            ),
            masked,
            ..ScatterFinding::default()
        })
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::pointwise(Supply {
            limit: theta[0],
            softness: theta[1],
            from_s: theta[2],
            until_s: theta[3],
            time_s: context.start_s,
            dt_s: context.dt_s,
        })
    }
}

struct Supply {
    limit: f64,
    softness: f64,
    from_s: f64,
    until_s: f64,
    time_s: f64,
    dt_s: f64,
}

impl Pointwise for Supply {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        let now = self.time_s;
        self.time_s += self.dt_s;
        let room = (self.limit - input) / self.softness;
        if room > 36.0 || now < self.from_s || now >= self.until_s {
            return input;
        }
        let rounded = if room < -36.0 { 0.0 } else { room.exp().ln_1p() };
        self.limit - self.softness * rounded
    }
}
