//! The parameters as they are reported: in the units of the paper, with errors carried over from the fitted ones.

use nalgebra::DMatrix;

use super::fit::Fit;
use super::model::{PLAYS, chebyshev, powers};
use super::uncertainty::error_of;
use crate::least_squares::SIGMAS_95;
use crate::units;

/// Points at which the curves are reported with their errors.
const POINTS: usize = 9;

/// A parameter with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name: `a`, `delay`, `lag`, `late` (delay and lag together), `ascending_c3`, ..
    pub name: String,
    /// Estimate in `unit`.
    pub value: f64,
    /// One standard deviation, in `unit`; infinite where the data do not carry the parameter.
    pub std_error: f64,
    /// Interval of 95 %, in `unit`; that of a parameter that cannot be negative is even in its logarithm.
    pub interval: (f64, f64),
    /// Unit.
    pub unit: String,
}

impl Parameter {
    fn new(name: impl Into<String>, value: f64, std_error: f64, unit: impl Into<String>) -> Self {
        let reach = SIGMAS_95 * std_error;
        Self { name: name.into(), value, std_error, interval: (value - reach, value + reach), unit: unit.into() }
    }

    /// Whether it is a coefficient of a curve.
    pub fn is_coefficient(&self) -> bool {
        self.name.rsplit_once("_c").is_some_and(|(_, power)| power.parse::<usize>().is_ok())
    }

    fn positive(name: &str, value: f64, std_error: f64, unit: &str) -> Self {
        let factor = (SIGMAS_95 * std_error / value).exp();
        Self { interval: (value / factor, value * factor), ..Self::new(name, value, std_error, unit) }
    }
}

/// Both curves at one current, with their standard errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Current [A].
    pub current_a: f64,
    /// Ascending curve [bar].
    pub ascending_bar: f64,
    /// Its standard error [bar].
    pub ascending_std_error_bar: f64,
    /// Descending curve [bar].
    pub descending_bar: f64,
    /// Its standard error [bar].
    pub descending_std_error_bar: f64,
}

/// The parameters of a fit; `late_error_s` is the standard error of delay and lag together where the covariance does not hold it.
pub(super) fn parameters(fit: &Fit, covariance: &DMatrix<f64>, late_error_s: Option<f64>) -> Vec<Parameter> {
    let shape = &fit.shape;
    let curve = shape.order + 1;
    let mut out = Vec::new();
    let (ascending, descending) = shape.polynomials(&fit.theta);
    // The power coefficients of each Chebyshev polynomial: the columns of the linear map.
    let columns: Vec<Vec<f64>> = (0..curve)
        .map(|k| {
            let mut unit = vec![0.0; curve];
            unit[k] = 1.0;
            powers(&unit, shape.range_a)
        })
        .collect();
    let mut add_curve = |name: &str, coefficients: &[f64], sign: f64| {
        for (row, value) in coefficients.iter().enumerate() {
            let power = shape.order - row;
            let mut direction = vec![0.0; shape.len()];
            for k in 0..curve {
                direction[k] = columns[k][row];
                if shape.has_loop() {
                    direction[curve + k] = sign * columns[k][row];
                }
            }
            let unit = match power {
                0 => "bar".to_string(),
                1 => "bar/A".to_string(),
                _ => format!("bar/A^{power}"),
            };
            out.push(Parameter::new(format!("{name}_c{power}"), *value, error_of(covariance, &direction), unit));
        }
    };
    if shape.has_loop() {
        add_curve("ascending", &ascending.coefficients, -1.0);
        add_curve("descending", &descending.coefficients, 1.0);
    } else {
        add_curve("curve", &ascending.coefficients, 0.0);
    }
    if let Some(k) = shape.ln_a() {
        let a = fit.theta[k].exp();
        out.push(Parameter::positive("a", a, a * covariance[(k, k)].sqrt(), units::PRESSURE_SQUARED.symbol));
    }
    let sum: f64 = fit.theta[shape.weights()].iter().sum();
    for (k, half_width) in shape.weights().zip(PLAYS) {
        // The weight is a share: its derivative after the fitted ones leaves their common factor out.
        let share = fit.theta[k] / sum;
        let mut direction = vec![0.0; shape.len()];
        shape.weights().for_each(|l| direction[l] = (f64::from(u8::from(l == k)) - share) / sum);
        out.push(Parameter::new(format!("play_{half_width}"), share, error_of(covariance, &direction), "1"));
    }
    let delay = shape.delay();
    out.push(Parameter::new("delay", fit.theta[delay], covariance[(delay, delay)].sqrt(), "s"));
    if let Some(lag) = shape.lag_at() {
        out.push(Parameter::new("lag", fit.theta[lag], covariance[(lag, lag)].sqrt(), "s"));
        let mut direction = vec![0.0; shape.len()];
        (direction[delay], direction[lag]) = (1.0, 1.0);
        out.push(Parameter::new("late", fit.theta[delay] + fit.theta[lag], error_of(covariance, &direction), "s"));
    } else {
        let error_s = late_error_s.unwrap_or_else(|| covariance[(delay, delay)].sqrt());
        out.push(Parameter::new("late", fit.theta[delay], error_s, "s"));
    }
    out
}

/// The curves at even distances over the range in which they were seen.
pub(super) fn curve_points(fit: &Fit, covariance: &DMatrix<f64>, (low, high): (f64, f64)) -> Vec<CurvePoint> {
    let shape = &fit.shape;
    let curve = shape.order + 1;
    let curves = shape.curves(&fit.theta);
    let mut basis = vec![0.0; curve];
    (0..POINTS)
        .map(|n| {
            let current_a = low + (high - low) * (n as f64 + 0.5) / POINTS as f64;
            let (from, to) = shape.range_a;
            chebyshev((2.0 * current_a - from - to) / (to - from), &mut basis);
            let error = |sign: f64| {
                let mut direction = vec![0.0; shape.len()];
                direction[..curve].copy_from_slice(&basis);
                if shape.has_loop() {
                    direction[curve..2 * curve].iter_mut().zip(&basis).for_each(|(d, b)| *d = sign * b);
                }
                error_of(covariance, &direction)
            };
            CurvePoint {
                current_a,
                ascending_bar: curves.ascending_at(current_a),
                ascending_std_error_bar: error(-1.0),
                descending_bar: curves.descending_at(current_a),
                descending_std_error_bar: error(1.0),
            }
        })
        .collect()
}
