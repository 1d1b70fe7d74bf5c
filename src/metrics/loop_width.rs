//! Figures of the swept characteristic: width of the loop, linearity, repeatability.
//!
//! The current of one dead time earlier belongs to a pressure, so that a fast sweep does not widen the loop by its
//! delay; a lag still does, by about twice its product with the rate of the pressure.

use serde::{Deserialize, Serialize};

use super::passes::{GRID, Passes, mean, passes};
use super::{Metric, NotMeasurable, Segment, milliseconds};
use crate::units::{self, Unit};

/// Output-referred width of the loop: the largest difference in pressure between the mean falling and the mean rising
/// pass at the same current.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HysteresisWidth {}

/// Input-referred width of the loop: the largest difference in current between the mean rising and the mean falling
/// pass at the same pressure.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HysteresisWidthInput {}

/// Largest deviation of the mean of rising and falling passes from the straight line of least squares, as a share of
/// the span of the pressure.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Linearity {}

/// Largest spread of the pressure at one current between passes of the same direction. The first pass starts from
/// an unknown history and is left out where three or more of its direction exist.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Repeatability {}

fn both_ways(segment: &Segment<'_>) -> Result<Passes, NotMeasurable> {
    let found = passes(segment)?;
    if found.rising.is_empty() || found.falling.is_empty() {
        return Err(NotMeasurable::TooFewSweeps {
            rising: found.rising.len(),
            falling: found.falling.len(),
            needed: "one of each is needed",
        });
    }
    Ok(found)
}

/// Definition with the delay and the rate of the sweep that it saw.
fn definition(id: &str, segment: &Segment<'_>) -> String {
    let delay = milliseconds(segment.delay_s);
    match passes(segment) {
        Ok(found) => format!("{id}(delay={delay}, rate={:.4} A/s)", found.rate_a_per_s),
        Err(_) => format!("{id}(delay={delay})"),
    }
}

impl Metric for HysteresisWidth {
    fn id(&self) -> &'static str {
        "hysteresis_width"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("hysteresis_width.max.v1", segment)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let (up, down) = (mean(&found.rising), mean(&found.falling));
        Ok((0..GRID).map(|i| down[i] - up[i]).fold(f64::NEG_INFINITY, f64::max))
    }
}

impl Metric for HysteresisWidthInput {
    fn id(&self) -> &'static str {
        "hysteresis_width_input"
    }
    fn unit(&self) -> &'static Unit {
        &units::CURRENT
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("hysteresis_width_input.max.v1", segment)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let (up, down) = (rising_envelope(mean(&found.rising)), rising_envelope(mean(&found.falling)));
        // Pressures that both curves reach.
        let (low, high) = (up[0].max(down[0]), up[GRID - 1].min(down[GRID - 1]));
        let at = |curve: &[f64], p: f64| {
            let k = curve.partition_point(|c| *c < p).clamp(1, GRID - 1);
            let (a, b) = (curve[k - 1], curve[k]);
            let part = if b > a { (p - a) / (b - a) } else { 0.0 };
            found.current_a[k - 1] + part * (found.current_a[k] - found.current_a[k - 1])
        };
        if low >= high {
            return Err(NotMeasurable::NoResponse { moved_bar: (high - low).max(0.0) });
        }
        let pressures = (0..GRID).map(|i| low + (high - low) * i as f64 / (GRID - 1) as f64);
        Ok(pressures.map(|p| at(&up, p) - at(&down, p)).fold(f64::NEG_INFINITY, f64::max))
    }
}

impl Metric for Linearity {
    fn id(&self) -> &'static str {
        "linearity"
    }
    fn unit(&self) -> &'static Unit {
        &units::RATIO
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("linearity.least_squares.v1", segment)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let (up, down) = (mean(&found.rising), mean(&found.falling));
        let middle: Vec<f64> = up.iter().zip(&down).map(|(a, b)| 0.5 * (a + b)).collect();
        let n = GRID as f64;
        let (mx, my) = (found.current_a.iter().sum::<f64>() / n, middle.iter().sum::<f64>() / n);
        let sxy: f64 = found.current_a.iter().zip(&middle).map(|(x, y)| (x - mx) * (y - my)).sum();
        let sxx: f64 = found.current_a.iter().map(|x| (x - mx).powi(2)).sum();
        let span = middle.iter().copied().fold(f64::NEG_INFINITY, f64::max) - middle.iter().copied().fold(f64::INFINITY, f64::min);
        if span <= 0.0 {
            return Err(NotMeasurable::NoResponse { moved_bar: 0.0 });
        }
        let deviation = found.current_a.iter().zip(&middle).map(|(x, y)| (y - my - sxy / sxx * (x - mx)).abs());
        Ok(deviation.fold(0.0, f64::max) / span)
    }
}

impl Metric for Repeatability {
    fn id(&self) -> &'static str {
        "repeatability"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("repeatability.spread.v1", segment)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = passes(segment)?;
        if found.rising.len() < 2 && found.falling.len() < 2 {
            return Err(NotMeasurable::TooFewSweeps {
                rising: found.rising.len(),
                falling: found.falling.len(),
                needed: "two of one kind are needed",
            });
        }
        let spread = |of: &[Vec<f64>]| {
            let counted = if of.len() >= 3 { &of[1..] } else { of };
            let range = |i: usize| {
                let values = || counted.iter().map(move |p| p[i]);
                values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
            };
            (0..GRID).map(range).fold(0.0, f64::max)
        };
        Ok([&found.rising, &found.falling].into_iter().filter(|p| p.len() >= 2).map(|p| spread(p)).fold(0.0, f64::max))
    }
}

/// The running maximum: noise must not make a curve fall.
fn rising_envelope(mut curve: Vec<f64>) -> Vec<f64> {
    for i in 1..curve.len() {
        curve[i] = curve[i].max(curve[i - 1]);
    }
    curve
}

#[cfg(test)]
mod tests {
    use super::super::tests::Columns;
    use super::*;

    /// Triangle 0..1 A with period 10 s.
    fn triangle(t: f64) -> f64 {
        let phase = (t / 10.0).fract();
        if phase < 0.5 { 2.0 * phase } else { 2.0 - 2.0 * phase }
    }

    fn rising(t: f64) -> bool {
        (t / 10.0).fract() < 0.5
    }

    #[test]
    fn a_parallel_loop_has_its_width_in_both_directions() {
        // p = 20 i, 0.6 bar above when falling: 0.6 bar, or 0.6/20 A.
        let columns = Columns::new(3001, |_| f64::NAN, triangle, |t| 20.0 * triangle(t) + if rising(t) { 0.0 } else { 0.6 });
        let segment = columns.segment(0.0);
        assert!((HysteresisWidth {}.compute(&segment).unwrap() - 0.6).abs() < 1e-9);
        assert!((HysteresisWidthInput {}.compute(&segment).unwrap() - 0.03).abs() < 1e-6);
        assert!(Linearity {}.compute(&segment).unwrap() < 1e-9);
        assert!(Repeatability {}.compute(&segment).unwrap() < 1e-9);
    }

    #[test]
    fn the_delay_does_not_widen_the_loop() {
        let columns = Columns::new(3001, |_| f64::NAN, triangle, |t| 20.0 * triangle((t - 0.03).max(0.0)));
        assert!(HysteresisWidth {}.compute(&columns.segment(0.03)).unwrap().abs() < 1e-9);
        assert!(HysteresisWidth {}.compute(&columns.segment(0.0)).unwrap() > 0.2);
    }

    #[test]
    fn a_parabola_has_its_known_linearity_and_a_drift_its_spread() {
        // y = x^2 on [0, 1] against its best line: the end deviates by 1/6, of which the grid sees 0.96^2/6 of its span.
        let columns = Columns::new(3001, |_| f64::NAN, triangle, |t| triangle(t).powi(2) + 0.001 * (t / 10.0).floor());
        let linearity = Linearity {}.compute(&columns.segment(0.0)).unwrap();
        assert!((linearity - 0.96f64.powi(2) / 6.0 / (0.98f64.powi(2) - 0.02f64.powi(2))).abs() < 2e-3, "{linearity}");
        assert!((Repeatability {}.compute(&columns.segment(0.0)).unwrap() - 0.001).abs() < 1e-6);
    }

    #[test]
    fn a_hold_has_no_loop() {
        let columns = Columns::new(300, |_| f64::NAN, |_| 0.5, |_| 10.0);
        let none = |rising, falling, needed| NotMeasurable::TooFewSweeps { rising, falling, needed };
        assert_eq!(HysteresisWidth {}.compute(&columns.segment(0.0)), Err(none(0, 0, "one of each is needed")));
        assert_eq!(Repeatability {}.compute(&columns.segment(0.0)), Err(none(0, 0, "two of one kind are needed")));
    }
}
