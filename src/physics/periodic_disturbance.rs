//! # Periodic disturbance
//!
//! What it is: a tone in the pressure that the current does not make: pump ripple, the alias of a PWM or of dither.
//!
//! Model: P = P0 + sine sin(2 pi f t) + cosine cos(2 pi f t), t the time of the recording.
//!
//! Signature: one narrow line in the spectrum of the error, the same in holds and in ramps.
//!
//! What to check on the bench: change the pump speed, the PWM frequency or the log rate and see whether the line moves.
//!
//! Source: Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., section 4.2 (aliasing).

use super::block::{Block, Point, Pointwise};
use super::effect::{Context, Effect, Hint, Parameter, Sampling, Stage, Theta};
use crate::units::{FREQUENCY, PRESSURE};

/// The effect `periodic_disturbance`.
pub struct PeriodicDisturbance;

impl Effect for PeriodicDisturbance {
    fn id(&self) -> &'static str {
        "periodic_disturbance"
    }
    fn source_text(&self) -> &'static str {
        include_str!("periodic_disturbance.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Sensor
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter {
                name: "frequency",
                unit: &FREQUENCY,
                range: (0.05, 500.0),
                starts: &[5.0],
                default: None,
                meaning: "frequency of the tone",
            },
            Parameter {
                name: "sine",
                unit: &PRESSURE,
                range: (-10.0, 10.0),
                starts: &[0.05],
                default: Some(0.0),
                meaning: "amplitude of its sine",
            },
            Parameter {
                name: "cosine",
                unit: &PRESSURE,
                range: (-10.0, 10.0),
                starts: &[0.05],
                default: Some(0.0),
                meaning: "amplitude of its cosine",
            },
        ];
        &PARAMETERS
    }
    /// The strongest line of the spectrum of the residual, with its amplitudes.
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        strongest_line(hint).into_iter().map(|(f, s, c)| vec![f, s, c]).collect()
    }
    fn resolved(&self, k: usize, of: Sampling) -> Option<f64> {
        (k == 0).then(|| SHARE_OF_LINE / of.length_s)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let w = std::f64::consts::TAU * theta[0];
        let turn = w * context.dt_s;
        let phase = w * context.start_s;
        Block::pointwise(Tone { sine: theta[1], cosine: theta[2], turn: (turn.sin(), turn.cos()), now: (phase.sin(), phase.cos()) })
    }
}

/// Share of the width of a line by which its frequency may be moved without the tone getting out of step.
const SHARE_OF_LINE: f64 = 0.03;

struct Tone {
    sine: f64,
    cosine: f64,
    turn: (f64, f64),
    now: (f64, f64),
}

impl Pointwise for Tone {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        let (s, c) = self.now;
        self.now = (s * self.turn.1 + c * self.turn.0, c * self.turn.1 - s * self.turn.0);
        input + self.sine * s + self.cosine * c
    }
}

/// Frequency [Hz], sine and cosine amplitude [bar] of the line that stands highest above its neighbourhood.
pub(super) fn strongest_line(hint: &Hint<'_>) -> Option<(f64, f64, f64)> {
    let n = hint.residual_bar.len();
    if n < 256 {
        return None;
    }
    let clip = 4.0 * hint.scale_bar;
    let clipped: Vec<f64> = hint.residual_bar.iter().map(|e| if e.is_finite() { e.clamp(-clip, clip) } else { 0.0 }).collect();
    let mut planner = realfft::RealFftPlanner::<f64>::new();
    let forward = planner.plan_fft_forward(n);
    let (mut input, mut spectrum) = (clipped.clone(), forward.make_output_vec());
    forward.process(&mut input, &mut spectrum).ok()?;
    let power: Vec<f64> = spectrum.iter().map(realfft::num_complex::Complex::norm_sqr).collect();
    const HALF: usize = 20;
    let lowest = ((0.3 * n as f64 * hint.dt_s) as usize).max(HALF);
    let peak =
        (lowest..power.len().saturating_sub(HALF)).max_by(|a, b| prominence(&power, *a, HALF).total_cmp(&prominence(&power, *b, HALF)))?;
    // Between the bins: the frequency at which the projection is largest.
    let project = |f: f64| {
        let w = std::f64::consts::TAU * f;
        let (mut s, mut c) = (0.0, 0.0);
        for (k, e) in clipped.iter().enumerate() {
            let (sin, cos) = (w * (hint.start_s + k as f64 * hint.dt_s)).sin_cos();
            s += e * sin;
            c += e * cos;
        }
        (2.0 * s / n as f64, 2.0 * c / n as f64)
    };
    let bin = 1.0 / (n as f64 * hint.dt_s);
    let size = |f: &f64| {
        let (s, c) = project(*f);
        s * s + c * c
    };
    let nearest = |about: f64, step: f64| (-4..=4).map(|j| about + f64::from(j) * step).max_by(|a, b| size(a).total_cmp(&size(b)));
    let best = nearest(nearest(peak as f64 * bin, 0.2 * bin)?, 0.03 * bin)?;
    let (s, c) = project(best);
    Some((best, s, c))
}

/// Power of a bin over the mean of its neighbourhood.
fn prominence(power: &[f64], at: usize, half: usize) -> f64 {
    let around: f64 = power[at - half..at - 2].iter().chain(&power[at + 3..at + half]).sum();
    power[at] / (around + 1e-300)
}
