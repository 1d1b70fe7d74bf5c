//! Statistics of a batch: yield, process behaviour, capability, outliers, drift, Pareto of the failures.
//!
//! Every figure is a [`Finding`]: a value, or the reason why the data cannot carry one. Sources stand beside
//! the formulas; each is checked in its tests against a published worked example.

mod capability;
mod chart;
#[cfg(test)]
mod coverage;
mod distribution;
mod drift;
mod family;
mod fitted;
mod histogram;
mod normality;
mod outliers;
mod pareto;
mod proportion;
mod rules;
mod sample;
mod shape;

pub use capability::{Capability, Index, Tolerance, capability};
pub use chart::{ControlChart, Signal, WITHIN_D2, control_chart};
pub(in crate::batch) use distribution::{f_upper, t_quantile, t_two_sided};
pub use drift::{Drift, drift};
pub use histogram::{Histogram, histogram};
pub use normality::{Normality, normality};
pub use outliers::{Outlier, outliers};
pub use pareto::{ParetoBar, pareto};
pub use proportion::{Proportion, clopper_pearson, proportion, wilson};
pub use rules::{FALSE_ALARMS, Rule};
pub(in crate::batch) use sample::mean_deviation;
pub use sample::{Sample, sample};
pub use shape::{Candidate, Shape};

use serde::{Deserialize, Serialize};

/// Confidence level of every interval.
pub const CONFIDENCE: f64 = 0.95;

/// A figure, or the reason why there is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding<T> {
    /// The figure; `None` where the data cannot carry it.
    pub value: Option<T>,
    /// Why there is no figure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absent: Option<String>,
}

impl<T> Finding<T> {
    /// A figure.
    pub fn of(value: T) -> Self {
        Self { value: Some(value), absent: None }
    }
    /// No figure, and why.
    pub fn absent(reason: impl Into<String>) -> Self {
        Self { value: None, absent: Some(reason.into()) }
    }
}

/// An interval at the [`CONFIDENCE`] level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Everything that is said of one metric of a batch, in the order of the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MetricStatistics {
    /// Phase and metric, as the records name them: `hold_24/rmse`.
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// The limits that the values were judged by.
    pub tolerance: Tolerance,
    /// Number of valves without a value.
    pub missing: usize,
    /// Location and spread.
    pub sample: Finding<Sample>,
    /// Counts per class, for a plot.
    pub histogram: Finding<Histogram>,
    /// Individuals and moving-range chart.
    pub chart: Finding<ControlChart>,
    /// Anderson-Darling test.
    pub normality: Finding<Normality>,
    /// Cp, Cpk, Pp, Ppk.
    pub capability: Capability,
    /// Valves that do not belong to the rest.
    pub outliers: Finding<Vec<Outlier>>,
    /// Change over the batch.
    pub drift: Finding<Drift>,
}

/// The statistics of one metric. `values` are in the order of the test; NaN marks a valve without a value.
pub fn metric(name: &str, unit: &str, tolerance: Tolerance, values: &[f64]) -> MetricStatistics {
    let present: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let positions: Vec<usize> = (0..values.len()).filter(|&i| values[i].is_finite()).collect();
    let chart = control_chart(&present, &positions);
    let normality = normality(&present);
    MetricStatistics {
        name: name.into(),
        unit: unit.into(),
        tolerance,
        missing: values.len() - present.len(),
        sample: sample(&present),
        histogram: histogram(&present),
        capability: capability(&present, tolerance, &chart),
        chart,
        normality,
        outliers: outliers(&present, &positions),
        drift: drift(&present, &positions),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_valve_without_a_value_is_counted_and_left_out() {
        let values: Vec<f64> = (0..40).map(|k| if k % 10 == 3 { f64::NAN } else { f64::from(k % 7) }).collect();
        let found = metric("hold_24/rmse", "bar", Tolerance { min: None, max: Some(9.0) }, &values);
        assert_eq!((found.missing, found.sample.value.unwrap().count), (4, 36));
        // The places are those of the batch: a line over 0 to 39.
        let present: Vec<usize> = (0..40).filter(|k| k % 10 != 3).collect();
        let kept: Vec<f64> = present.iter().map(|&k| values[k]).collect();
        assert_eq!(found.drift, drift(&kept, &present));
    }

    #[test]
    fn a_figure_is_read_back_as_it_was_written() {
        for finding in [Finding::of(1.5), Finding::absent("no limit")] {
            let text = serde_json::to_string(&finding).unwrap();
            assert_eq!(serde_json::from_str::<Finding<f64>>(&text).unwrap(), finding, "{text}");
        }
    }
}
