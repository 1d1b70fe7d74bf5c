//! # Reference shift
//!
//! What it is: the curves are not where the identification found them: another temperature, another valve of the
//! batch, a changed spring.
//!
//! Model: P = P0 (1 + gain) + offset + 4 bend z (1 - z), z = P0 / (span of the curves), from the time `from` on. The
//! bend is what a shift of the current (a spring seat that has set) adds where the curves are no straight lines.
//!
//! Signature: the error is nearly a straight line over the pressure and does not depend on rate, direction or time (or
//! only on whether it is before or after one instant).
//!
//! What to check on the bench: oil temperature against that of the identification; repeat the sweep.
//!
//! Source: paper, "error due to oil temperature" of the two clutches.

use super::block::{Block, Point, Pointwise};
use super::effect::{Context, Effect, Hint, Parameter, Stage, Theta};
use crate::units::{PRESSURE, RATIO, TIME};

/// The effect `reference_shift`.
pub struct ReferenceShift;

impl Effect for ReferenceShift {
    fn id(&self) -> &'static str {
        "reference_shift"
    }
    fn source_text(&self) -> &'static str {
        include_str!("reference_shift.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Curve
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter {
                name: "gain",
                unit: &RATIO,
                range: (-0.4, 0.4),
                starts: &[-0.02],
                default: Some(0.0),
                meaning: "relative change of the pressure",
            },
            Parameter {
                name: "offset",
                unit: &PRESSURE,
                range: (-6.0, 6.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "change of the pressure",
            },
            Parameter {
                name: "from",
                unit: &TIME,
                range: (0.0, 1e6),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "time of the change since the start of the recording",
            },
            Parameter {
                name: "bend",
                unit: &PRESSURE,
                range: (-0.5, 0.5),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "change in the middle of the pressures beyond the straight line",
            },
        ];
        &PARAMETERS
    }
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        // What a recalibration would stand in for, and the instant that parts the record best: no step of a fit finds that one,
        // since the error does not change while the instant moves between two samples.
        let mut out = vec![vec![hint.recalibrated.0, hint.recalibrated.1, 0.0, 0.0]];
        out.extend(best_instant(hint).map(|(from_s, gain, offset_bar)| vec![gain, offset_bar, from_s, 0.0]));
        out
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let span_bar = (context.slope_bar_per_a * (context.range_a.1 - context.range_a.0)).abs().max(1e-9);
        Block::pointwise(Shift {
            gain: theta[0],
            offset: theta[1],
            wait: ((theta[2] - context.start_s) / context.dt_s).ceil() as i64,
            bend: 4.0 * theta[3],
            per_span: 1.0 / span_bar,
        })
    }
}

/// Sums for a straight line of the residual over the pressure.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    n: f64,
    p: f64,
    e: f64,
    pp: f64,
    pe: f64,
}

impl Line {
    fn and(self, p: f64, e: f64) -> Self {
        Self { n: self.n + 1.0, p: self.p + p, e: self.e + e, pp: self.pp + p * p, pe: self.pe + p * e }
    }
    fn without(self, of: Self) -> Self {
        Self { n: self.n - of.n, p: self.p - of.p, e: self.e - of.e, pp: self.pp - of.pp, pe: self.pe - of.pe }
    }
    /// Slope, value at no pressure, and how much of the sum of squares the line takes; a level where the pressure stands.
    fn fitted(self) -> (f64, f64, f64) {
        let (spread, along) = (self.pp - self.p * self.p / self.n, self.pe - self.p * self.e / self.n);
        let slope = if spread > 1e-9 * self.pp { along / spread } else { 0.0 };
        let level = (self.e - slope * self.p) / self.n;
        (slope, level, slope * along + self.e * self.e / self.n)
    }
}

/// Share of the readings on either side of an instant that lies next to it.
const NEXT: f64 = 0.01;
/// Part of a change that must have come within the readings next to its instant: a drift or a wander has two sides as well.
const AT_ONCE: f64 = 0.5;
/// By how much it must exceed every other change between neighbouring stretches of that length: a model that errs with the movement
/// has many.
const ALONE: f64 = 2.0;

/// The instant [s] on whose sides two straight lines over the pressure leave the least of the residual, and what changes
/// there: gain and offset [bar]. Each side has a twentieth of the readings; `None` where the change does not come at once.
fn best_instant(hint: &Hint<'_>) -> Option<(f64, f64, f64)> {
    let most_bar = 5.0 * hint.scale_bar;
    let readings: Vec<(usize, f64, f64)> = (0..hint.residual_bar.len())
        .map(|k| (k, hint.pressure_bar[k], hint.residual_bar[k].clamp(-most_bar, most_bar)))
        .filter(|(_, p, e)| p.is_finite() && e.is_finite())
        .collect();
    let all = readings.iter().fold(Line::default(), |line, (_, p, e)| line.and(*p, *e));
    let least = (readings.len() / 20).max(2);
    let (mut before, mut best) = (Line::default(), None::<(f64, usize, [(f64, f64, f64); 2])>);
    for (j, (_, p, e)) in readings.iter().enumerate() {
        if j >= least && readings.len() - j >= least {
            let sides = [before.fitted(), all.without(before).fitted()];
            let taken = sides[0].2 + sides[1].2;
            if best.is_none_or(|(most, ..)| taken > most) {
                best = Some((taken, j, sides));
            }
        }
        before = before.and(*p, *e);
    }
    let (_, at, [first, second]) = best?;
    let next = ((NEXT * readings.len() as f64) as usize).max(5).min(least);
    // Against the line before: how far the readings just behind are from those just ahead, and how far both lines say they are.
    let mean =
        |of: &[(usize, f64, f64)], value: &dyn Fn(f64, f64) -> f64| of.iter().map(|(_, p, e)| value(*p, *e)).sum::<f64>() / of.len() as f64;
    let over_first = |p: f64, e: f64| e - first.0 * p - first.1;
    let came = mean(&readings[at..at + next], &over_first) - mean(&readings[at - next..at], &over_first);
    let (gain, offset_bar) = (second.0 - first.0, second.1 - first.1);
    let said = mean(&readings[at..at + next], &|p, _| gain * p + offset_bar);
    let from_s = hint.start_s + (readings[at].0 as f64 - 0.5) * hint.dt_s;
    let levels: Vec<f64> = readings.chunks_exact(next).map(|chunk| mean(chunk, &over_first)).collect();
    let elsewhere = levels.windows(2).enumerate().filter(|(w, _)| ((w + 1) * next).abs_diff(at) > next).map(|(_, l)| (l[1] - l[0]).abs());
    let alone = came.abs() > ALONE * elsewhere.fold(0.0, f64::max);
    (alone && came * said > AT_ONCE * said * said).then_some((from_s, gain, offset_bar))
}

struct Shift {
    gain: f64,
    offset: f64,
    wait: i64,
    bend: f64,
    per_span: f64,
}

impl Pointwise for Shift {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, _: &Point, input: f64) -> f64 {
        if self.wait > 0 {
            self.wait -= 1;
            return input;
        }
        let level = input * self.per_span;
        input + self.gain * input + self.offset + self.bend * level * (1.0 - level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_is_proposed_where_it_is() {
        let n = 4000;
        let pressure: Vec<f64> = (0..n).map(|k| 8.0 + 6.0 * (0.004 * k as f64).sin()).collect();
        for at in [400, 1234, 3300] {
            let mut residual: Vec<f64> = (0..n).map(|k| 0.02 * ((k * 7919 % 101) as f64 / 50.0 - 1.0)).collect();
            for k in at..n {
                residual[k] += 0.2 + 0.01 * pressure[k];
            }
            residual[700] = f64::NAN;
            let hint = Hint {
                start_s: 3.0,
                dt_s: 0.01,
                current_a: &pressure,
                delay_s: 0.02,
                residual_bar: &residual,
                pressure_bar: &pressure,
                scale_bar: 0.1,
                recalibrated: (0.0, 0.0),
            };
            let found = &ReferenceShift.propose(&hint)[1];
            assert!((found[2] - (3.0 + 0.01 * at as f64)).abs() < 0.011, "{found:?}");
            assert!((found[0] - 0.01).abs() < 1e-3 && (found[1] - 0.2).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn what_comes_slowly_has_no_instant() {
        let n = 4000;
        let pressure: Vec<f64> = (0..n).map(|k| 8.0 + 6.0 * (0.004 * k as f64).sin()).collect();
        let noise = |k: usize| 0.02 * ((k * 7919 % 101) as f64 / 50.0 - 1.0);
        let ramp: Vec<f64> = (0..n).map(|k| noise(k) + 0.4 * k as f64 / n as f64).collect();
        let wander: Vec<f64> = (0..n).map(|k| noise(k) + 0.3 * (0.0023 * k as f64).sin()).collect();
        for residual in [ramp, wander] {
            let hint = Hint {
                start_s: 0.0,
                dt_s: 0.01,
                current_a: &pressure,
                delay_s: 0.02,
                residual_bar: &residual,
                pressure_bar: &pressure,
                scale_bar: 0.2,
                recalibrated: (0.0, 0.0),
            };
            assert_eq!(ReferenceShift.propose(&hint).len(), 1);
        }
    }
}
