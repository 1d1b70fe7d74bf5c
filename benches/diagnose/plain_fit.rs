//! A plain least-squares fit by Levenberg and Marquardt with forward differences: the counterpart of
//! `scipy.optimize.least_squares` for the same parameters, data, start and tolerance, with the project's simulation.

use hil::physics::{Effect, Pipeline, Signals};
use hil::recording::Run;
use hil::valve::{Hysteresis, Polynomial, ReferenceCurves, Valve};
use nalgebra::{DMatrix, DVector};

/// Relative fall of the squared error and relative step below which a fit is at its end, as SciPy's default.
const TOLERANCE: f64 = 1e-8;

/// What is fitted: gain and offset [bar] of the curves, a [bar^2], delay [s] and the first parameter of an effect.
pub struct Problem<'a> {
    /// The base model.
    pub valve: &'a Valve,
    /// Id of the effect; its other parameters stay at their defaults.
    pub effect: &'a str,
    /// The recording, on an even grid,
    pub run: &'a Run,
    /// of this step [s].
    pub step_s: f64,
}

/// Where a fit has ended.
pub struct Fitted {
    /// The parameters in the order of [`Problem`].
    pub theta: Vec<f64>,
    /// Root of the mean square error [bar].
    pub rmse_bar: f64,
    /// How many simulations it took.
    pub simulations: usize,
}

impl Problem<'_> {
    fn effect(&self) -> &'static dyn Effect {
        hil::physics::effect(self.effect).expect("the library has the effect")
    }

    /// Where both fits begin. A delay of whole samples would be no place to begin: a straight line between samples has a
    /// kink there, and the slope on one side of it misleads both fits into a wrong minimum.
    pub fn start(&self) -> Vec<f64> {
        vec![0.97, 0.2, 0.5, 0.027, self.effect().parameters()[0].starts[0]]
    }

    /// Measured minus simulated [bar].
    pub fn residual(&self, theta: &[f64]) -> DVector<f64> {
        let moved = |curve: &Polynomial| {
            let mut c: Vec<f64> = curve.coefficients.iter().map(|c| c * theta[0]).collect();
            *c.last_mut().expect("a cubic has coefficients") += theta[1];
            Polynomial::new(c)
        };
        let curves = &self.valve.curves;
        let curves = ReferenceCurves::on_range(moved(&curves.ascending), moved(&curves.descending), curves.range_a);
        let effect = self.effect();
        let values = effect.parameters().iter().map(|p| p.default.unwrap_or(theta[4])).collect();
        let pipeline = Pipeline {
            curves: &curves,
            hysteresis: Hysteresis::Hyperbolic { a_bar2: theta[2] },
            delay_s: theta[3],
            lag_s: 0.0,
            floor_bar: self.valve.floor_bar,
            effects: vec![(effect, values)],
            // As SciPy's fit has it; a command that is held arrives at whole samples, and a delay between two changes nothing then.
            input: hil::valve::Input::Ramp,
            most_inner: hil::physics::MOST_INNER,
        };
        let (mut work, mut pressure) = (Vec::new(), Vec::new());
        pipeline.run(self.run.time_s[0], self.step_s, &Signals::current(&self.run.current_a), &mut work, &mut pressure);
        let measured = self.run.pressure_bar.as_deref().expect("the bench's run has a pressure");
        DVector::from_iterator(pressure.len(), measured.iter().zip(&pressure).map(|(y, p)| y - p))
    }

    /// The fit.
    pub fn fit(&self) -> Fitted {
        let mut theta = self.start();
        let mut residual = self.residual(&theta);
        let mut simulations = 1;
        let mut damping = 1e-3;
        let mut jacobian = DMatrix::zeros(residual.len(), theta.len());
        'descent: for _ in 0..100 {
            for k in 0..theta.len() {
                let mut ahead = theta.clone();
                let step = f64::EPSILON.sqrt() * theta[k].abs();
                ahead[k] += step;
                jacobian.set_column(k, &((self.residual(&ahead) - &residual) / (ahead[k] - theta[k])));
            }
            simulations += theta.len();
            let normal = jacobian.tr_mul(&jacobian);
            let gradient = jacobian.tr_mul(&residual);
            loop {
                let damped = DMatrix::from_fn(theta.len(), theta.len(), |i, j| normal[(i, j)] * if i == j { 1.0 + damping } else { 1.0 });
                let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else { break 'descent };
                // Delay, a and the effect's size stay positive.
                let next: Vec<f64> =
                    theta.iter().zip(&step).enumerate().map(|(k, (t, s))| if k < 2 { t - s } else { (t - s).max(0.1 * t) }).collect();
                let trial = self.residual(&next);
                simulations += 1;
                let (before, after) = (residual.norm_squared(), trial.norm_squared());
                let moved = theta.iter().zip(&next).map(|(t, n)| (n / t - 1.0).abs()).fold(0.0, f64::max);
                if after < before {
                    (theta, residual, damping) = (next, trial, 0.1 * damping);
                    if before - after < TOLERANCE * before {
                        break 'descent;
                    }
                    break;
                }
                if moved < TOLERANCE || damping > 1e12 {
                    break 'descent;
                }
                damping *= 10.0;
            }
        }
        Fitted { rmse_bar: (residual.norm_squared() / residual.len() as f64).sqrt(), theta, simulations }
    }
}
