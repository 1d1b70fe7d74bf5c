//! Slope and start of the characteristic.

use serde::{Deserialize, Serialize};

use super::line::least_squares;
use super::loop_width::{both_ways, definition};
use super::passes::span;
use super::{Metric, Needs, NotMeasurable, Segment};
use crate::units::{self, Unit};

/// Pressure gain: slope of the least-squares line through the mean of the rising and the falling characteristic, between 10 % and
/// 90 % of its span of pressure.
///
/// # Source
/// ISO 10770-3, controlled pressure against input signal.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PressureGain {}

/// Start of the characteristic, the dead band at zero: the current at which the pressure, carried on in a straight line from
/// where the rising characteristic is at 5 % and 10 % of its span, leaves its lowest value.
///
/// # Source
/// ISO 10770-3, dead band: the input below which the pressure does not change.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StartCurrent {}

impl Metric for PressureGain {
    fn id(&self) -> &'static str {
        "pressure_gain"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE_PER_CURRENT
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("pressure_gain.least_squares_10_90.v1", segment, None)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let (up, down) = (found.curve(true), found.curve(false));
        let middle: Vec<f64> = up.iter().zip(&down).map(|(a, b)| 0.5 * (a + b)).collect();
        let (low, moved_bar) = span(&middle)?;
        let share = |p: f64| (p - low) / moved_bar;
        let (x, y): (Vec<f64>, Vec<f64>) = found.current_a.iter().zip(&middle).filter(|(_, p)| (0.1..=0.9).contains(&share(**p))).unzip();
        match x.len() {
            0..3 => Err(NotMeasurable::NoResponse { moved_bar }),
            _ => Ok(least_squares(&x, &y).0),
        }
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for StartCurrent {
    fn id(&self) -> &'static str {
        "start_current"
    }
    fn unit(&self) -> &'static Unit {
        &units::CURRENT
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        definition("start_current.tangent_5_10.v1", segment, None)
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let found = both_ways(segment)?;
        let up = found.curve(true);
        let (low, moved_bar) = span(&up)?;
        let at = |share: f64| {
            let wanted = low + share * moved_bar;
            let k = up.iter().position(|p| *p >= wanted).unwrap_or_default().max(1);
            let (x, y) = (&found.current_a, &up);
            x[k - 1] + (wanted - y[k - 1]) / (y[k] - y[k - 1]) * (x[k] - x[k - 1])
        };
        Ok((2.0 * at(0.05) - at(0.10)).max(found.current_a[0]))
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::loop_width::tests::triangle;
    use super::super::tests::{Columns, scatter};
    use super::super::{HysteresisWidthInput, Linearity};
    use super::*;

    #[test]
    fn a_line_behind_a_dead_band_has_its_slope_and_its_start() {
        let columns = Columns::new(12001, |_| f64::NAN, triangle, |t| (30.0 * (triangle(t) - 0.25)).max(0.0) + 0.02 * scatter(t));
        let segment = columns.segment(0.0);
        let (gain, start) = (PressureGain {}.compute(&segment).unwrap(), StartCurrent {}.compute(&segment).unwrap());
        assert!((gain - 30.0).abs() < 0.02, "{gain}");
        assert!((start - 0.25).abs() < 2e-3, "{start}");
    }

    /// Where the zero of the pressure lies changes neither; nor does it matter that the command never was 0.
    #[test]
    fn slope_and_start_do_not_depend_on_either_zero() {
        let current = |t: f64| 0.1 + triangle(t);
        for zero in [0.0, 5.0] {
            let columns = Columns::new(12001, |_| f64::NAN, current, |t| zero + (30.0 * (current(t) - 0.35)).max(0.0));
            let segment = columns.segment(0.0);
            let (gain, start) = (PressureGain {}.compute(&segment).unwrap(), StartCurrent {}.compute(&segment).unwrap());
            assert!((gain - 30.0).abs() < 1e-9 && (start - 0.35).abs() < 1e-3, "{gain} {start}");
        }
        // 5 + 20 i^2: from 0.02 to 0.98 A it reaches a share s of its span at the root of 0.0004 + 0.96 s.
        let curved = Columns::new(12001, |_| f64::NAN, triangle, |t| 5.0 + 20.0 * triangle(t).powi(2));
        let start = StartCurrent {}.compute(&curved.segment(0.0)).unwrap();
        assert!((start - (2.0 * 0.0484f64.sqrt() - 0.0964f64.sqrt())).abs() < 1e-3, "{start}");
        // A line without a dead band begins where the command does.
        let line = Columns::new(12001, |_| f64::NAN, current, |t| 30.0 * current(t));
        assert!((StartCurrent {}.compute(&line.segment(0.0)).unwrap() - 0.12).abs() < 1e-9);
        // All of the span between two samples: no slope.
        let steep =
            Columns::new(121, |_| f64::NAN, |t| triangle(40.0 * t / 1.2), |t| if triangle(40.0 * t / 1.2) > 0.5 { 9.0 } else { 2.0 });
        let none = PressureGain {}.compute(&steep.segment(0.0));
        assert!(matches!(none, Err(NotMeasurable::NoResponse { moved_bar }) if (moved_bar - 7.0).abs() < 1e-9), "{none:?}");
        let still = Columns::new(12001, |_| f64::NAN, current, |_| 3.0);
        // A pressure that stands still starts nowhere, though the smoothing moves it by its last digit.
        for metric in [&StartCurrent {} as &dyn Metric, &PressureGain {}, &Linearity::default(), &HysteresisWidthInput::default()] {
            let none = metric.compute(&still.segment(0.0));
            assert!(matches!(none, Err(NotMeasurable::NoResponse { moved_bar }) if moved_bar < 1e-9), "{}: {none:?}", metric.id());
        }
    }
}
