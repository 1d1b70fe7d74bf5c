//! # Reference shift
//!
//! What it is: the curves are not where the identification found them: another temperature, another valve of the
//! batch, a changed spring.
//!
//! Model: P = P0 (1 + gain) + offset + c(i + current) - c(i), c the average of the curves, from the time `from` on: as if it took so much
//! less current, as where a spring seat has set.
//!
//! Signature: the error is a straight line over the pressure, or as steep as the curves are over the current, and does not depend on rate,
//! direction or time (or only on whether it is before or after one instant).
//!
//! What to check on the bench: oil temperature against that of the identification; repeat the sweep.
//!
//! Source: paper, "error due to oil temperature" of the two clutches.

use nalgebra::{Matrix4, Vector4};

use super::block::{Block, Pointwise};
use super::effect::{Context, Effect, Hint, Parameter, Sampling, Stage, Theta};
use super::signal::Point;
use crate::units::{CURRENT, PRESSURE, RATIO, TIME};
use crate::valve::ReferenceCurves;

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
    fn is_shift_of_calibration(&self) -> bool {
        true
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
                range: (-MOST_BAR, MOST_BAR),
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
                name: "current",
                unit: &CURRENT,
                range: (-0.05, 0.05),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "current that it takes less for the same pressure",
            },
        ];
        &PARAMETERS
    }
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        // What a recalibration would stand in for, and the instant that parts the record best: no step of a fit finds that one,
        // since the error does not change while the instant moves between two samples.
        let mut out = vec![vec![hint.recalibrated.0, hint.recalibrated.1, 0.0, 0.0]];
        out.extend(best_instant(hint).map(|(from_s, gain, offset_bar)| vec![gain, offset_bar, from_s, 0.0]));
        out.extend(best_gap(hint).map(|(from_s, offset_bar)| vec![0.0, offset_bar, from_s, 0.0]));
        out
    }
    fn resolved(&self, k: usize, of: Sampling) -> Option<f64> {
        (k == 2).then_some(of.step_s)
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::pointwise(Shift {
            gain: theta[0],
            offset: theta[1],
            wait: ((theta[2] - context.start_s) / context.dt_s).ceil() as i64,
            seat: (theta[3] != 0.0).then(|| (theta[3], context.curves.clone())),
        })
    }
}

/// Sums of a stretch of residuals over offset, pressure, its direction and its rate.
#[derive(Debug, Clone, Copy, Default)]
struct Lines {
    normal: Matrix4<f64>,
    right: Vector4<f64>,
}

impl Lines {
    fn and(&mut self, row: Vector4<f64>, e: f64) {
        self.normal += row * row.transpose();
        self.right += e * row;
    }
    fn without(&self, of: &Self) -> Self {
        Self { normal: self.normal - of.normal, right: self.right - of.right }
    }
    /// Values of the four, and how much of the sum of squares they take. What the pressures do not show stays nothing.
    fn fitted(&self) -> Option<(Vector4<f64>, f64)> {
        let ridge = Matrix4::from_diagonal(&self.normal.diagonal().map(|d| RIDGE * d + 1e-9));
        let values = (self.normal + ridge).cholesky()?.solve(&self.right);
        Some((values, values.dot(&self.right)))
    }
}

/// Share of each diagonal element that keeps values in bounds.
const RIDGE: f64 = 1e-6;
/// Instants that are looked at first lie so many readings apart.
const COARSE: usize = 10;
/// Share of the readings on either side of an instant that lies next to it.
const NEXT: f64 = 0.01;
/// Part of a change that must have come within the readings next to its instant: a drift or a wander has two sides as well.
const AT_ONCE: f64 = 0.5;
/// By how much it must exceed every other change between neighbouring stretches of that length: a model that errs with the movement
/// has many.
const ALONE: f64 = 1.5;
/// Up to this share of the span above the lowest pressure a valve may stand at tank pressure, where no change of its zero shows.
const TANK: f64 = 0.01;

/// No change of the zero is larger [bar].
const MOST_BAR: f64 = 6.0;

/// A reading: its sample, what its residual may be made of, and the residual [bar].
struct Reading {
    sample: usize,
    row: Vector4<f64>,
    residual_bar: f64,
}

/// The instant [s] on whose sides two straight lines over the pressure leave the least of the residual, beside what a loop width and a
/// delay that have made room for the change add; and what changes there: gain and offset [bar]. Each side has a twentieth of the
/// readings; `None` where the change does not come at once.
fn best_instant(hint: &Hint<'_>) -> Option<(f64, f64, f64)> {
    let readings = readings(hint);
    let (mut all, mut until) = (Lines::default(), Vec::with_capacity(readings.len()));
    for r in &readings {
        until.push(all);
        all.and(r.row, r.residual_bar);
    }
    let least = (readings.len() / 20).max(5);
    let parted = |j: usize| Some((until[j].fitted()?.0, all.without(&until[j]).fitted()?.0));
    let taken = |j: usize| Some(until[j].fitted()?.1 + all.without(&until[j]).fitted()?.1);
    let best = |from: usize, to: usize, step: usize| {
        let inside = from.max(least)..to.min(readings.len().saturating_sub(least) + 1);
        inside.step_by(step).filter_map(|j| Some((taken(j)?, j))).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, j)| j)
    };
    let about = best(0, readings.len(), COARSE)?;
    let at = best(about.saturating_sub(COARSE), about + COARSE, 1)?;
    let (first, second) = parted(at)?;
    let change = second - first;
    // Against the line before: how far the readings just behind are from those just ahead, and how far both lines say they are.
    let next = ((NEXT * readings.len() as f64) as usize).clamp(5, least);
    // A transient of a few readings is no level.
    let level = |of: &[Reading], value: &dyn Fn(&Reading) -> f64| {
        let mut values: Vec<f64> = of.iter().map(value).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let over_first = |r: &Reading| r.residual_bar - first.dot(&r.row);
    let came = level(&readings[at..at + next], &over_first) - level(&readings[at - next..at], &over_first);
    let said = level(&readings[at..at + next], &|r| change[0] + change[1] * r.row[1]);
    // Elsewhere each side has its own line.
    let over_own = |r: &Reading| r.residual_bar - if r.sample < readings[at].sample { first } else { second }.dot(&r.row);
    let chunks: Vec<&[Reading]> = readings.chunks_exact(next).collect();
    // Neighbours in time, apart from the instant.
    let side_by_side = |w: &&[&[Reading]]| w[1][next - 1].sample - w[0][0].sample < 3 * next;
    let apart = |w: &&[&[Reading]]| w[1][0].sample.abs_diff(readings[at].sample) > next;
    let change_of = |w: &[&[Reading]]| (level(w[1], &over_own) - level(w[0], &over_own)).abs();
    let elsewhere = chunks.windows(2).filter(side_by_side).filter(apart).map(change_of).fold(0.0, f64::max);
    let alone = came.abs() > ALONE * elsewhere;
    let from_s = hint.start_s + (readings[at].sample as f64 - 0.5) * hint.dt_s;
    (alone && came * said > AT_ONCE * said * said).then_some((from_s, change[1], change[0]))
}

/// The gap between two runs on whose sides two levels leave the least of the residual: where it ends [s], and by how much the zero has
/// changed [bar]. `None` of one run.
fn best_gap(hint: &Hint<'_>) -> Option<(f64, f64)> {
    let sums = |(_, residual): &(f64, &[f64])| {
        let finite = residual.iter().filter(|e| e.is_finite());
        finite.fold((0.0, 0.0), |(sum, count), e| (sum + e.clamp(-MOST_BAR, MOST_BAR), count + 1.0))
    };
    let of: Vec<(f64, f64)> = hint.parts.iter().map(sums).collect();
    let together = |of: &[(f64, f64)]| of.iter().fold((0.0, 0.0), |all, one| (all.0 + one.0, all.1 + one.1));
    let change = |k: usize| {
        let (before, behind) = (together(&of[..k]), together(&of[k..]));
        let offset_bar = behind.0 / behind.1 - before.0 / before.1;
        let taken = offset_bar * offset_bar * before.1 * behind.1 / (before.1 + behind.1);
        taken.is_finite().then_some((taken, hint.parts[k].0 - 0.5 * hint.dt_s, offset_bar))
    };
    let best = (1..of.len()).filter_map(change).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, from_s, offset_bar)| (from_s, offset_bar))
}

fn readings(hint: &Hint<'_>) -> Vec<Reading> {
    let most_bar = 5.0 * hint.scale_bar;
    let (lowest, highest) = hint.pressure_bar.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
    let tank_bar = lowest + TANK * (highest - lowest);
    let before = hint.pressure_bar.iter().take(1).chain(hint.pressure_bar);
    let samples = hint.pressure_bar.iter().zip(before).zip(hint.residual_bar).enumerate();
    let reading = |(sample, ((p, before), e)): (usize, ((&f64, &f64), &f64))| {
        let change = p - before;
        let direction = if change == 0.0 { 0.0 } else { change.signum() };
        let row = Vector4::new(1.0, *p, direction, change / hint.dt_s);
        (*p >= tank_bar && e.is_finite() && row.iter().all(|v| v.is_finite())).then(|| Reading {
            sample,
            row,
            residual_bar: e.clamp(-most_bar, most_bar),
        })
    };
    samples.filter_map(reading).collect()
}

struct Shift {
    gain: f64,
    offset: f64,
    wait: i64,
    /// How much less current it takes [A], on which curves.
    seat: Option<(f64, ReferenceCurves)>,
}

impl Pointwise for Shift {
    fn start(&mut self, _: &Point, _: f64) {}
    #[inline]
    fn step(&mut self, at: &Point, input: f64) -> f64 {
        if self.wait > 0 {
            self.wait -= 1;
            return input;
        }
        let seat = |(less_a, curves): &(f64, ReferenceCurves)| curves.average_at(at.current_a + less_a) - curves.average_at(at.current_a);
        input + self.gain * input + self.offset + self.seat.as_ref().map_or(0.0, seat)
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
                parts: &[],
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
                parts: &[],
                pressure_bar: &pressure,
                scale_bar: 0.2,
                recalibrated: (0.0, 0.0),
            };
            assert_eq!(ReferenceShift.propose(&hint).len(), 1);
        }
    }
}
