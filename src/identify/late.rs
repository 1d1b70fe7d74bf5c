//! Delay and lag together, where the recording does not say whether there is a lag.
//!
//! On a slow current on straight lines a lag is nearly a further delay, and no strong evidence for it is found: the model then has
//! none. With a lag the answer would come a little later. That nobody saw it is no reason to be surer: the error of delay and lag
//! together is that of the model with a lag, about the value of the model that is written.

use nalgebra::DMatrix;

use super::dynamics;
use super::fit::{Fit, Problem};
use super::inverse::inverse;
use super::survey::Survey;
use super::uncertainty::{error_of, variance};

/// Standard error of delay and lag together [s], where the model could have a lag and has none; otherwise nothing, and the covariance
/// says it.
pub(super) fn late_error_s(
    problem: &Problem<'_>,
    survey: &Survey,
    fit: &Fit,
    (weights, limit): (&[f64], f64),
    covariance: &DMatrix<f64>,
) -> Option<f64> {
    if fit.shape.lag || fit.shape.is_staircase() || survey.steps > 0 {
        return None;
    }
    let lagged = dynamics::with_lag(problem, fit, survey, weights, limit)?;
    let (shape, delay) = (&lagged.shape, fit.shape.delay());
    let direction: Vec<f64> = (0..shape.len()).map(|k| f64::from(u8::from(k == shape.delay() || Some(k) == shape.lag_at()))).collect();
    let (unit, _) = variance(problem, &lagged, weights, limit);
    let lagged_s = error_of(&(inverse(&lagged.normal) * unit), &direction);
    let away_s = lagged.theta[shape.delay()] + shape.lag_s(&lagged.theta) - fit.theta[delay];
    let error_s = lagged_s.hypot(away_s).max(covariance[(delay, delay)].sqrt());
    error_s.is_finite().then_some(error_s)
}
