//! Figures of a step response: rise time, settling time, overshoot.
//!
//! The step is the one jump of the input (target in closed loop, current in open loop). The response goes from the
//! mean pressure before the jump to its final value: the mean over the last tenth of the phase. Of several
//! repetitions the worst counts.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::{Metric, Needs, NotMeasurable, Segment, enough};
use crate::units::{self, Ratio, Unit};

/// Time between the first crossing of 10 % and the first crossing of 90 % of the response, interpolated.
///
/// # Source
/// ISA-51.1, rise time, as in `stepinfo` of MATLAB and python-control.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RiseTime {}

/// Time between the first crossing of 10 % and the first crossing of 90 % of a response to a falling step, interpolated. A
/// phase whose step rises has none.
///
/// # Source
/// ISO 10770-3, step response: fall time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FallTime {}

/// Dead time: from the jump of the input until the response begins, where the line through its 10 % and 30 % points meets the
/// pressure before the jump.
///
/// # Source
/// ISA-51.1, dead time: from the initiation of an input change to the start of the resulting observable response.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeadTime {}

/// Time from the jump of the input until the response stays in a band around its final value: the last exit from the
/// band counts, not the first entry. A response that leaves the band in the last tenth of the phase has not settled.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SettlingTime {
    /// Half-width of the band as a share of the response; 5 % where it is not given.
    #[serde(default = "five_percent")]
    pub band: Ratio,
}

/// How far the response exceeds its final value, as a share of the response.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Overshoot {}

fn five_percent() -> Ratio {
    Ratio::new(0.05)
}

impl Default for SettlingTime {
    fn default() -> Self {
        Self { band: five_percent() }
    }
}

/// A response scaled to run from 0 to 1, from the jump on.
struct Response {
    /// Time since the jump [s] and scaled pressure.
    points: Vec<(f64, f64)>,
    /// Number of the points that the final value was taken from.
    tail: usize,
    /// Whether the pressure falls.
    falls: bool,
}

/// Smallest response that is timed [bar].
const SMALLEST_BAR: f64 = 0.1;

fn response(segment: &Segment<'_>, range: &Range<usize>) -> Result<Response, NotMeasurable> {
    let s = &segment.signals;
    let closed = range.clone().all(|k| s.target_bar[k].is_finite());
    let input = if closed { s.target_bar } else { s.current_a };
    let jumps = |of: Range<usize>| -> Vec<usize> {
        of.filter(|k| input[*k] != input[*k - 1] && !(input[*k].is_nan() || input[*k - 1].is_nan())).collect()
    };
    // The jump may stand at the first sample, against what was commanded before; with one inside, what came before is how the
    // phase was reached.
    let (first, inside) = (range.start.max(1), jumps(range.start + 1..range.end));
    let found = if inside.is_empty() { jumps(first..range.start + 1) } else { inside };
    let [jump] = found[..] else { return Err(NotMeasurable::NotAStep) };
    let tail = (range.len() / 10).max(3).min(range.end - jump);
    let mean = |of: Range<usize>| {
        let values: Vec<f64> = of.clone().map(|k| s.pressure_bar[k]).filter(|p| p.is_finite()).collect();
        enough(values.len(), of.len()).map(|()| values.iter().sum::<f64>() / values.len() as f64)
    };
    let before = mean(jump.saturating_sub(10)..jump)?;
    let last = mean(range.end - tail..range.end)?;
    if (last - before).abs() < SMALLEST_BAR {
        return Err(NotMeasurable::NoResponse { moved_bar: (last - before).abs() });
    }
    let points: Vec<(f64, f64)> = (jump..range.end)
        .filter(|k| s.pressure_bar[*k].is_finite())
        .map(|k| (s.time_s[k] - s.time_s[jump], (s.pressure_bar[k] - before) / (last - before)))
        .collect();
    enough(points.len(), range.end - jump)?;
    Ok(Response { points, tail, falls: last < before })
}

fn worst(segment: &Segment<'_>, of: impl Fn(&Response) -> Result<f64, NotMeasurable>) -> Result<f64, NotMeasurable> {
    let mut worst = f64::NEG_INFINITY;
    for range in &segment.repetitions {
        worst = worst.max(of(&response(segment, range)?)?);
    }
    if worst.is_finite() { Ok(worst) } else { Err(NotMeasurable::NotAStep) }
}

/// Time of the first rise through `level`, interpolated.
fn crossing(points: &[(f64, f64)], level: f64) -> Option<f64> {
    let after = points.iter().position(|p| p.1 >= level)?;
    if after == 0 {
        return Some(points[0].0);
    }
    let (a, b) = (points[after - 1], points[after]);
    Some(a.0 + (level - a.1) / (b.1 - a.1) * (b.0 - a.0))
}

impl Metric for RiseTime {
    fn id(&self) -> &'static str {
        "rise_time"
    }
    fn unit(&self) -> &'static Unit {
        &units::TIME
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "rise_time.10_90.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        worst(segment, |r| match (crossing(&r.points, 0.1), crossing(&r.points, 0.9)) {
            (Some(low), Some(high)) => Ok(high - low),
            _ => Err(NotMeasurable::NotSettled),
        })
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for FallTime {
    fn id(&self) -> &'static str {
        "fall_time"
    }
    fn unit(&self) -> &'static Unit {
        &units::TIME
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "fall_time.10_90.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        worst(segment, |r| match (crossing(&r.points, 0.1), crossing(&r.points, 0.9)) {
            _ if !r.falls => Err(NotMeasurable::NotAStep),
            (Some(first), Some(second)) => Ok(second - first),
            _ => Err(NotMeasurable::NotSettled),
        })
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for DeadTime {
    fn id(&self) -> &'static str {
        "dead_time"
    }
    fn unit(&self) -> &'static Unit {
        &units::TIME
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "dead_time.tangent_10_30.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        worst(segment, |r| match (crossing(&r.points, 0.1), crossing(&r.points, 0.3)) {
            (Some(first), Some(second)) => Ok((first - 0.5 * (second - first)).max(0.0)),
            _ => Err(NotMeasurable::NotSettled),
        })
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for SettlingTime {
    fn id(&self) -> &'static str {
        "settling_time"
    }
    fn unit(&self) -> &'static Unit {
        &units::TIME
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        format!("settling_time.last_exit.v1(band={} %)", self.band.value() * 100.0)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let band = self.band.value();
        worst(segment, |r| {
            let outside = |p: &(f64, f64)| (p.1 - 1.0).abs() > band;
            let Some(last) = r.points.iter().rposition(outside) else { return Ok(0.0) };
            if last + r.tail >= r.points.len() {
                return Err(NotMeasurable::NotSettled);
            }
            let (a, b) = (r.points[last], r.points[last + 1]);
            let edge = 1.0 + band * (a.1 - 1.0).signum();
            Ok(a.0 + (edge - a.1) / (b.1 - a.1) * (b.0 - a.0))
        })
    }
    fn check(&self) -> Result<(), String> {
        super::positive("band", self.band.value(), &self.band)
    }
}

impl Metric for Overshoot {
    fn id(&self) -> &'static str {
        "overshoot"
    }
    fn unit(&self) -> &'static Unit {
        &units::RATIO
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "overshoot.over_final.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        worst(segment, |r| Ok(r.points.iter().map(|p| p.1 - 1.0).fold(0.0, f64::max)))
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Columns;
    use super::*;

    /// Step from 2 to 10 at 1 s; `g` is the scaled response over the time since then.
    fn step(g: impl Fn(f64) -> f64) -> Columns {
        let target = |t: f64| if t < 0.9999 { 2.0 } else { 10.0 };
        Columns::new(1000, target, |_| 0.5, move |t| if t < 1.0 { 2.0 } else { 2.0 + 8.0 * g(t - 1.0) })
    }

    #[test]
    fn a_first_order_lag_has_its_textbook_figures() {
        let columns = step(|t| 1.0 - (-t / 0.2).exp());
        let segment = columns.segment(0.0);
        assert!((RiseTime {}.compute(&segment).unwrap() - 0.2 * 9f64.ln()).abs() < 1e-4);
        assert!((SettlingTime::default().compute(&segment).unwrap() - 0.2 * 20f64.ln()).abs() < 2e-4);
        assert!(Overshoot {}.compute(&segment).unwrap() < 1e-9);
    }

    #[test]
    fn dead_time_and_fall_time_of_a_late_lag() {
        let late = |t: f64| if t < 0.05 { 0.0 } else { 1.0 - (-(t - 0.05) / 0.2).exp() };
        let columns = step(late);
        // The tangent of a lag begins 0.02 tau early.
        let dead = DeadTime {}.compute(&columns.segment(0.0)).unwrap();
        assert!((dead - (0.05 - 0.0203 * 0.2)).abs() < 1e-3, "{dead}");
        assert_eq!(FallTime {}.compute(&columns.segment(0.0)), Err(NotMeasurable::NotAStep));
        let falling = Columns::new(
            1000,
            |t| if t < 0.9999 { 10.0 } else { 2.0 },
            |_| 0.5,
            move |t| 10.0 - 8.0 * if t < 1.0 { 0.0 } else { late(t - 1.0) },
        );
        let fall = FallTime {}.compute(&falling.segment(0.0)).unwrap();
        assert!((fall - 0.2 * 9f64.ln()).abs() < 1e-3, "{fall}");
    }

    #[test]
    fn a_resonance_has_its_textbook_overshoot() {
        let (zeta, wn) = (0.3f64, 10.0f64);
        let wd = wn * (1.0 - zeta * zeta).sqrt();
        let columns = step(|t| 1.0 - (-zeta * wn * t).exp() * ((wd * t).cos() + zeta * wn / wd * (wd * t).sin()));
        let expected = (-std::f64::consts::PI * zeta / (1.0 - zeta * zeta).sqrt()).exp();
        assert!((Overshoot {}.compute(&columns.segment(0.0)).unwrap() - expected).abs() < 1e-3);
    }

    #[test]
    fn the_last_exit_counts_not_the_first_entry() {
        let columns = step(|t| {
            if t < 0.1 {
                0.0
            } else if (3.0..3.2).contains(&t) {
                1.2
            } else {
                1.0
            }
        });
        let settled = SettlingTime::default().compute(&columns.segment(0.0)).unwrap();
        assert!((3.18..=3.2).contains(&settled), "{settled}");
    }

    /// Of a response by its points: what lies between two of them lies on a line.
    #[test]
    fn a_level_is_crossed_between_two_samples() {
        let points = [(0.0, 0.0), (1.0, 0.2), (3.0, 0.6), (4.0, 0.5), (5.0, 1.0)];
        for (level, wanted) in [(0.1, 0.5), (0.3, 1.5), (0.55, 2.75), (0.8, 4.6)] {
            assert!((crossing(&points, level).unwrap() - wanted).abs() < 1e-12, "{level}");
        }
        assert_eq!((crossing(&points, 0.0), crossing(&points, 1.1)), (Some(0.0), None));
    }

    /// Each level until its time, and the last from then on.
    fn levels<const N: usize, const M: usize>(values: [f64; N], until_s: [f64; M]) -> impl Fn(f64) -> f64 {
        move |t| values[until_s.partition_point(|until| *until <= t)]
    }

    /// The jump may be the first sample of the phase, as where a phase begins with a new target; one inside goes before it.
    #[test]
    fn the_jump_is_found_where_the_phase_begins_and_inside() {
        let columns = Columns::new(1000, levels([2.0, 10.0, 6.0], [0.995, 4.995]), |_| 0.5, levels([2.0, 10.0, 6.0], [1.2, 5.3]));
        let dead = |range: Range<usize>| {
            let mut segment = columns.segment(0.0);
            segment.repetitions = vec![range];
            DeadTime {}.compute(&segment).map(|t| (t * 100.0).round() as i32)
        };
        // The first answer comes 20 samples after its jump, the second 30.
        assert_eq!(
            [dead(0..400), dead(60..400), dead(100..400), dead(400..1000), dead(500..1000), dead(100..1000)],
            [Ok(19), Ok(19), Ok(19), Ok(29), Ok(29), Ok(29)]
        );
        assert_eq!([dead(0..1000), dead(101..500)], [Err(NotMeasurable::NotAStep), Err(NotMeasurable::NotAStep)]);
        // Of several repetitions the slowest counts.
        let mut segment = columns.segment(0.0);
        segment.repetitions = vec![400..1000, 0..400];
        assert_eq!(DeadTime {}.compute(&segment).map(|t| (t * 100.0).round() as i32), Ok(29));
        segment.repetitions.clear();
        assert_eq!(DeadTime {}.compute(&segment), Err(NotMeasurable::NotAStep));
    }

    /// In open loop the current is the input; a command that is lost is no jump.
    #[test]
    fn a_lost_command_is_no_jump() {
        let mut columns = Columns::new(1000, |_| f64::NAN, |t| if t < 0.995 { 0.3 } else { 0.5 }, |t| if t < 1.2 { 2.0 } else { 10.0 });
        columns.current[600] = f64::NAN;
        assert!(RiseTime {}.compute(&columns.segment(0.0)).is_ok());
    }

    /// What came just before the jump is where the response begins; what comes last, the tenth of the phase, where it ends.
    #[test]
    fn a_response_runs_from_before_the_jump_to_the_end_of_the_phase() {
        // A phase that began elsewhere: only the ten samples before the jump count. 12 in the last tenth but one, 10 in the last.
        let answer = levels([50.0, 2.0, 12.0, 10.0], [1.895, 2.0, 8.995]);
        let columns = Columns::new(1000, |t| if t < 1.995 { 2.0 } else { 10.0 }, |_| 0.5, answer);
        let segment = columns.segment(0.0);
        assert!((Overshoot {}.compute(&segment).unwrap() - 0.25).abs() < 1e-12);
        // The last sample of 12 bar lies at 6.99 s, and 0.05 of the response from its end a part of a sample later.
        let settled = SettlingTime::default().compute(&segment).unwrap();
        assert!((settled - (6.99 + 0.01 * 0.2 / 0.25)).abs() < 1e-9, "{settled}");
        // On the edge of its band it is in it.
        assert_eq!(SettlingTime { band: Ratio::new(0.25) }.compute(&segment), Ok(0.0));
        // A jump half a second before the end: the last tenth would reach beyond it.
        let late = Columns::new(1000, |t| if t < 9.495 { 2.0 } else { 10.0 }, |_| 0.5, |t| if t < 9.495 { 2.0 } else { 10.0 });
        assert_eq!(Overshoot {}.compute(&late.segment(0.0)), Ok(0.0));
    }

    /// Nine samples in ten must be there, of those before the jump, of those after it, and of the last tenth.
    #[test]
    fn a_response_with_too_many_lost_samples_has_no_figure() {
        let overshoot = |lost: Range<usize>| {
            let mut columns = step(|_| 1.0);
            columns.pressure[lost].fill(f64::NAN);
            Overshoot {}.compute(&columns.segment(0.0))
        };
        let few = |usable, samples, needed| Err(NotMeasurable::TooFewSamples { usable, samples, needed });
        assert_eq!([overshoot(90..91), overshoot(90..92)], [Ok(0.0), few(8, 10, 9)]);
        assert_eq!([overshoot(110..200), overshoot(110..201)], [Ok(0.0), few(809, 900, 810)]);
        assert_eq!([overshoot(990..1000), overshoot(989..1000)], [Ok(0.0), few(89, 100, 90)]);
    }

    #[test]
    fn no_number_where_there_is_none() {
        let drifting = step(|t| t / 9.0);
        assert_eq!(SettlingTime::default().compute(&drifting.segment(0.0)), Err(NotMeasurable::NotSettled));
        let ramp = Columns::new(300, |t| t, |_| 0.0, |t| t);
        assert_eq!(RiseTime {}.compute(&ramp.segment(0.0)), Err(NotMeasurable::NotAStep));
        let dead = step(|_| 0.0);
        assert_eq!(RiseTime {}.compute(&dead.segment(0.0)), Err(NotMeasurable::NoResponse { moved_bar: 0.0 }));
    }
}
