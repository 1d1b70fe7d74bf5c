//! Extremes of the measured pressure.

use serde::{Deserialize, Serialize};

use super::{Metric, Needs, NotMeasurable, Segment, enough};
use crate::units::{self, Unit};

/// Largest measured pressure of the phase.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaxPressure {}

/// Smallest measured pressure of the phase.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MinPressure {}

fn usable(segment: &Segment<'_>) -> Result<Vec<f64>, NotMeasurable> {
    let values: Vec<f64> = segment.signals.pressure_bar[segment.range.clone()].iter().copied().filter(|p| p.is_finite()).collect();
    enough(values.len(), segment.range.len()).map(|()| values)
}

impl Metric for MaxPressure {
    fn id(&self) -> &'static str {
        "max_pressure"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "max_pressure.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        Ok(usable(segment)?.into_iter().fold(f64::NEG_INFINITY, f64::max))
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for MinPressure {
    fn id(&self) -> &'static str {
        "min_pressure"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::NOTHING
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "min_pressure.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        Ok(usable(segment)?.into_iter().fold(f64::INFINITY, f64::min))
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Columns;
    use super::*;

    #[test]
    fn extremes_of_what_was_measured() {
        let columns = Columns::new(100, |_| 10.0, |_| 0.5, |t| if t == 0.5 { f64::NAN } else { 10.0 + t });
        let segment = columns.segment(0.0);
        assert_eq!((MaxPressure {}.compute(&segment), MinPressure {}.compute(&segment)), (Ok(10.99), Ok(10.0)));
    }
}
