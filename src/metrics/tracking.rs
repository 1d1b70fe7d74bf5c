//! How well the pressure follows the reference, delayed by the valve's dead time.

use serde::{Deserialize, Serialize};

use super::{Metric, Needs, NotMeasurable, Segment, milliseconds, rms};
use crate::units::{self, Pressure, Time, Unit};

/// Root mean square of the tracking error P(t) - P_d(t - T_d) over the samples of the phase.
///
/// # Source
/// The paper judges all its figures so, because the pressure cannot follow before the dead time has passed.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rmse {
    /// Delay of the reference; the dead time of the controller's valve model where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<Time>,
}

/// [`Rmse`] over the samples whose delayed reference lies in a pressure band.
///
/// # Source
/// Table 1 of the paper reports the band of 20 to 26 bar on its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RmseBand {
    /// Lower end of the band, included.
    pub from: Pressure,
    /// Upper end of the band, included.
    pub to: Pressure,
    /// Delay of the reference; the dead time of the controller's valve model where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<Time>,
}

/// Largest absolute tracking error |P(t) - P_d(t - T_d)| over the samples of the phase.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaxError {
    /// Delay of the reference; the dead time of the controller's valve model where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<Time>,
}

fn delay_s(given: Option<Time>, segment: &Segment<'_>) -> f64 {
    given.map_or(segment.delay_s, Time::value)
}

/// A reference that is judged before it was set would be another figure.
fn check_delay(given: Option<Time>) -> Result<(), String> {
    match given {
        Some(delay) if delay.value() < 0.0 => Err(format!("`delay` is {delay}; it must not be negative")),
        _ => Ok(()),
    }
}

impl Metric for Rmse {
    fn id(&self) -> &'static str {
        "rmse"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::TARGET
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        format!("rmse.delayed.v1(delay={})", milliseconds(delay_s(self.delay, segment)))
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let errors = segment.errors(delay_s(self.delay, segment))?;
        Ok(rms(errors.into_iter().map(|e| e.1)))
    }
    fn check(&self) -> Result<(), String> {
        check_delay(self.delay)
    }
}

impl Metric for RmseBand {
    fn id(&self) -> &'static str {
        "rmse_band"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::TARGET
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        format!("rmse_band.delayed.v1(from={}, to={}, delay={})", self.from, self.to, milliseconds(delay_s(self.delay, segment)))
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let (low_bar, high_bar) = (self.from.value(), self.to.value());
        let errors = segment.errors(delay_s(self.delay, segment))?;
        let inside: Vec<f64> = errors.into_iter().filter(|(r, _)| (low_bar..=high_bar).contains(r)).map(|e| e.1).collect();
        if inside.is_empty() {
            return Err(NotMeasurable::OutsideBand { low_bar, high_bar });
        }
        Ok(rms(inside.into_iter()))
    }
    fn check(&self) -> Result<(), String> {
        check_delay(self.delay)?;
        if self.from < self.to { Ok(()) } else { Err(format!("`from` ({}) must lie below `to` ({})", self.from, self.to)) }
    }
}

impl Metric for MaxError {
    fn id(&self) -> &'static str {
        "max_error"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::TARGET
    }
    fn definition(&self, segment: &Segment<'_>) -> String {
        format!("max_error.delayed.v1(delay={})", milliseconds(delay_s(self.delay, segment)))
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        let errors = segment.errors(delay_s(self.delay, segment))?;
        Ok(errors.into_iter().map(|e| e.1.abs()).fold(0.0, f64::max))
    }
    fn check(&self) -> Result<(), String> {
        check_delay(self.delay)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Columns;
    use super::*;

    #[test]
    fn a_band_has_a_lower_and_an_upper_end() {
        let check = |from, to| RmseBand { from: Pressure::new(from), to: Pressure::new(to), delay: None }.check();
        assert!(check(20.0, 26.0).is_ok() && check(26.0, 20.0).is_err() && check(20.0, 20.0).is_err());
    }

    #[test]
    fn a_perfect_but_late_pressure_has_no_error() {
        let columns = Columns::new(400, |t| 10.0 + (3.0 * t).sin(), |_| 0.0, |t| 10.0 + (3.0 * (t - 0.02)).sin());
        let mut segment = columns.segment(0.02);
        segment.range = 100..400;
        assert!(Rmse::default().compute(&segment).unwrap() < 1e-12);
        assert!(Rmse { delay: Some(Time::new(0.0)) }.compute(&segment).unwrap() > 0.03);
        assert_eq!(Rmse::default().definition(&segment), "rmse.delayed.v1(delay=20 ms)");
    }

    #[test]
    fn a_reference_is_not_judged_before_it_was_set() {
        for delay in [None, Some(Time::new(0.0)), Some(Time::new(0.03))] {
            assert_eq!(Rmse { delay }.check(), Ok(()));
        }
        let early = Some(Time::new(-0.01));
        let band = RmseBand { from: Pressure::new(1.0), to: Pressure::new(2.0), delay: early };
        for refused in [Rmse { delay: early }.check(), MaxError { delay: early }.check(), band.check()] {
            assert_eq!(refused, Err("`delay` is -0.01 s; it must not be negative".into()));
        }
    }

    #[test]
    fn a_sine_error_has_the_known_rms_and_maximum() {
        let columns = Columns::new(1000, |_| 10.0, |_| 0.0, |t| 10.0 + (2.0 * std::f64::consts::PI * t).sin());
        let segment = columns.segment(0.02);
        assert!((Rmse::default().compute(&segment).unwrap() - 0.5f64.sqrt()).abs() < 1e-12);
        assert!((MaxError::default().compute(&segment).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_band_counts_by_the_delayed_reference() {
        let columns = Columns::new(1000, |t| if t < 5.0 { 10.0 } else { 22.0 }, |_| 0.0, |t| if t < 5.0 { 13.0 } else { 23.0 });
        let segment = columns.segment(0.0);
        let band = |from: f64, to: f64| RmseBand { from: Pressure::new(from), to: Pressure::new(to), delay: None };
        assert_eq!(band(20.0, 26.0).compute(&segment), Ok(1.0));
        assert_eq!(band(30.0, 40.0).compute(&segment), Err(NotMeasurable::OutsideBand { low_bar: 30.0, high_bar: 40.0 }));
    }

    #[test]
    fn lost_samples_and_open_loop_have_no_figure() {
        let columns = Columns::new(100, |_| 10.0, |_| 0.0, |t| if t < 0.2 { f64::NAN } else { 10.0 });
        assert_eq!(
            Rmse::default().compute(&columns.segment(0.0)),
            Err(NotMeasurable::TooFewSamples { usable: 80, samples: 100, needed: 90 })
        );
        let open = Columns::new(100, |_| f64::NAN, |_| 0.0, |_| 10.0);
        assert_eq!(MaxError::default().compute(&open.segment(0.0)), Err(NotMeasurable::NoTarget));
    }
}
