//! # Periodic disturbance
//!
//! What it is: a tone in the pressure that the current does not make: pump ripple, the alias of a PWM or of dither.
//!
//! Model: P = P0 + sine sin(2 pi f t) + cosine cos(2 pi f t), t the time of the recording.
//!
//! Signature: one narrow line in the spectrum of the error, the same in holds and in ramps.
//!
//! Where the pace wanders, as a pump's does, no sine stays in step: the band of the spectrum tells it, its middle and its size are
//! said, and the augmented model is without it.
//!
//! What to check on the bench: change the pump speed, the PWM frequency or the log rate and see whether the line moves.
//!
//! Source: Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., section 4.2 (aliasing).

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Hint, Parameter, Sampling, Scatter, ScatterFinding, Stage, Theta};
use super::signal::Point;
use super::wandering_tone::wandering_tone;
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
    fn is_apart_from_form(&self) -> bool {
        true
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
    /// A tone whose pace wanders.
    fn scatter(&self, of: &Scatter<'_>) -> Option<ScatterFinding> {
        wandering_tone(of)
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

/// Frequency [Hz], sine and cosine amplitude [bar] of the line that stands highest above its neighbourhood, in all parts together.
pub(super) fn strongest_line(hint: &Hint<'_>) -> Option<(f64, f64, f64)> {
    let clip = 4.0 * hint.scale_bar;
    let clipped =
        |residual: &[f64]| -> Vec<f64> { residual.iter().map(|e| if e.is_finite() { e.clamp(-clip, clip) } else { 0.0 }).collect() };
    let longest = hint.parts.iter().map(|(_, residual)| residual.len()).max()?;
    let enough = |(_, residual): &&(f64, &[f64])| residual.len() >= longest / SHORTEST;
    let parts: Vec<(f64, Vec<f64>)> = hint.parts.iter().filter(enough).map(|(start_s, residual)| (*start_s, clipped(residual))).collect();
    let readings: usize = parts.iter().map(|p| p.1.len()).sum();
    if longest < FEWEST_OF_PART || readings < FEWEST {
        return None;
    }
    // Where each part begins in the turn of a tone is another matter than how strong it is.
    let forward = realfft::RealFftPlanner::<f64>::new().plan_fft_forward(longest);
    let mut power = vec![0.0; longest / 2 + 1];
    for (_, part) in &parts {
        let (mut input, mut spectrum) = (part.clone(), forward.make_output_vec());
        input.resize(longest, 0.0);
        forward.process(&mut input, &mut spectrum).ok()?;
        for (sum, line) in power.iter_mut().zip(&spectrum) {
            *sum += line.norm_sqr();
        }
    }
    let half = (power.len() / 16).clamp(6, 20);
    let lowest = ((0.3 * longest as f64 * hint.dt_s) as usize).max(half);
    let peak =
        (lowest..power.len().saturating_sub(half)).max_by(|a, b| prominence(&power, *a, half).total_cmp(&prominence(&power, *b, half)))?;
    // Between the bins: the frequency at which the projection is largest.
    let project = |f: f64| {
        let w = std::f64::consts::TAU * f;
        let (turn_sin, turn_cos) = (w * hint.dt_s).sin_cos();
        let (mut s, mut c) = (0.0, 0.0);
        for (start_s, part) in &parts {
            // Turned on from reading to reading, and set anew before the rounding counts.
            for (n, block) in part.chunks(TURNED).enumerate() {
                let (mut sin, mut cos) = (w * (start_s + (n * TURNED) as f64 * hint.dt_s)).sin_cos();
                for e in block {
                    s += e * sin;
                    c += e * cos;
                    (sin, cos) = (sin * turn_cos + cos * turn_sin, cos * turn_cos - sin * turn_sin);
                }
            }
        }
        (2.0 * s / readings as f64, 2.0 * c / readings as f64)
    };
    let size = |f: f64| {
        let (s, c) = project(f);
        s * s + c * c
    };
    let nearest = |about: f64, steps: i32, step: f64| {
        let sizes = (-steps..=steps).map(|j| about + f64::from(j) * step).map(|f| (f, size(f)));
        sizes.max_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0)
    };
    let bin = 1.0 / (longest as f64 * hint.dt_s);
    let (from, to) = parts.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), (start_s, part)| {
        (from.min(*start_s), to.max(start_s + part.len() as f64 * hint.dt_s))
    });
    // Parts that lie apart tell a tone in step with all of them from one beside it.
    let width = (1.0 / (to - from)).clamp(bin / FINEST, bin);
    let steps = (bin / width).ceil() * 4.0;
    let best = nearest(nearest(peak as f64 * bin, steps as i32, 0.2 * width)?, 4, 0.03 * width)?;
    let (s, c) = project(best);
    Some((best, s, c))
}

/// Fewest readings in which a line is looked for, in all and in the longest part.
const FEWEST: usize = 256;
const FEWEST_OF_PART: usize = 128;
/// A part shorter than the longest by this factor tells little of a line.
const SHORTEST: usize = 8;
/// The width of the line of parts that lie apart is at most by this factor below that of the longest part alone.
const FINEST: f64 = 50.0;

/// Readings over which a tone is turned on without its sine and cosine being worked out anew.
const TURNED: usize = 256;

/// Power of a bin over the mean of its neighbourhood.
fn prominence(power: &[f64], at: usize, half: usize) -> f64 {
    let around: f64 = power[at - half..at - 2].iter().chain(&power[at + 3..at + half]).sum();
    power[at] / (around + 1e-300)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_in_short_parts_that_lie_apart() {
        let (frequency, dt_s) = (7.3, 0.01);
        // Two seconds after each start, and the end of each run, on the clock of the run.
        let begins = [(0.0, 220), (5.59, 70), (0.0, 220), (29.5, 70), (0.0, 220), (7.36, 70)];
        let mut state = 3u64;
        let parts: Vec<(f64, Vec<f64>)> = begins
            .iter()
            .map(|&(start_s, samples)| {
                let values = (0..samples).map(|k| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    let noise = (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
                    let t = start_s + dt_s * f64::from(k);
                    0.3 * (std::f64::consts::TAU * frequency * t + 1.0).sin() + noise
                });
                (start_s, values.collect())
            })
            .collect();
        let parts: Vec<(f64, &[f64])> = parts.iter().map(|p| (p.0, p.1.as_slice())).collect();
        let longest = parts[0].1;
        let hint = Hint {
            start_s: 0.0,
            dt_s,
            current_a: longest,
            delay_s: 0.0,
            residual_bar: longest,
            parts: &parts,
            pressure_bar: longest,
            scale_bar: 0.3,
            recalibrated: (0.0, 0.0),
        };
        let (found, sine, cosine) = strongest_line(&hint).unwrap();
        assert!((found - frequency).abs() < 0.2 / 29.5, "{found}");
        assert!((sine.hypot(cosine) - 0.3).abs() < 0.06, "{sine} {cosine}");
        // A part alone is too short to tell.
        assert!(strongest_line(&Hint { parts: &parts[..1], ..hint }).is_none());
    }
}
