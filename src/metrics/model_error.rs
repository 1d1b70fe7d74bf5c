//! How well the valve model explains the measured pressure when it is driven by the same current.

use serde::{Deserialize, Serialize};

use super::{Metric, Needs, NotMeasurable, Segment, enough, rms};
use crate::units::{self, Unit};

/// RMSE of the hyperbolic model: measured pressure minus the pressure that the controller's valve model gives for the
/// commanded current, simulated freely over the whole run.
///
/// # Source
/// Figs. 5 and 7 of the paper.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelRmse {}

/// The same with the average of the two reference curves, Eq. (10), in place of the hyperbola.
///
/// # Source
/// Fig. 7 of the paper.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelRmseAverage {}

fn compute(segment: &Segment<'_>, model_bar: &[f64]) -> Result<f64, NotMeasurable> {
    if model_bar.is_empty() {
        return Err(NotMeasurable::NoModel);
    }
    let errors: Vec<f64> =
        segment.range.clone().map(|k| segment.signals.pressure_bar[k] - model_bar[k]).filter(|e| e.is_finite()).collect();
    enough(errors.len(), segment.range.len())?;
    Ok(rms(errors.into_iter()))
}

impl Metric for ModelRmse {
    fn id(&self) -> &'static str {
        "model_rmse"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::MODEL
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "model_rmse.free_run.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        compute(segment, segment.signals.model_bar)
    }
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

impl Metric for ModelRmseAverage {
    fn id(&self) -> &'static str {
        "model_rmse_average"
    }
    fn unit(&self) -> &'static Unit {
        &units::PRESSURE
    }
    fn needs(&self) -> Needs {
        Needs::MODEL
    }
    fn definition(&self, _: &Segment<'_>) -> String {
        "model_rmse_average.free_run.v1".into()
    }
    fn compute(&self, segment: &Segment<'_>) -> Result<f64, NotMeasurable> {
        compute(segment, segment.signals.average_model_bar)
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
    fn each_is_judged_by_its_own_model() {
        let columns = Columns::new(100, |_| f64::NAN, |_| 0.5, |_| 10.0);
        let (model, average) = (vec![10.2; 100], vec![9.5; 100]);
        let mut segment = columns.segment(0.0);
        assert_eq!(ModelRmse {}.compute(&segment), Err(NotMeasurable::NoModel));
        segment.signals.model_bar = &model;
        segment.signals.average_model_bar = &average;
        assert!((ModelRmse {}.compute(&segment).unwrap() - 0.2).abs() < 1e-12);
        assert!((ModelRmseAverage {}.compute(&segment).unwrap() - 0.5).abs() < 1e-12);
    }
}
