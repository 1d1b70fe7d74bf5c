//! Levenberg-Marquardt on the loss of a free simulation.
//!
//! Nearly all of the time goes into the derivatives, one simulation per parameter. After a step that went well they are
//! corrected by what the step itself has shown (Broyden, Math. Comp. 19 (1965) 577) instead of taken anew, and taken anew
//! as soon as such a step disappoints.

use nalgebra::{DMatrix, DVector};

use super::fit::{Fit, Fitter, clamped, shifted};
use super::loss;
use super::model::{BASE, DELAY, Free, GAIN, Model, OFFSET, Simulator};

/// Steps in a row that corrected derivatives may serve.
const CORRECTED: usize = 1;
/// Gain of a step below which a fit is at its end [nats].
const TRIFLE_NATS: f64 = 0.02;

/// How a fit descends.
#[derive(Debug, Clone, Copy)]
pub struct Descent {
    /// Most steps.
    pub iterations: usize,
    /// The first so many effects stay at their values.
    pub held: usize,
    /// Whether derivatives that are nearly right will do.
    pub rough: bool,
}

impl Descent {
    /// All parameters free.
    pub fn of(iterations: usize) -> Self {
        Self { iterations, held: 0, rough: false }
    }
}

/// Derivatives of the simulated pressure, one column per moving parameter, in the units in which it moves.
pub struct Slopes {
    moving: Vec<usize>,
    columns: Vec<Vec<f64>>,
    /// Steps since they were taken.
    corrected: usize,
}

impl Slopes {
    /// Corrects the columns so that they give the change of pressure that `step` has made; `metric` is the diagonal of
    /// the normal equations, which makes the parameters comparable.
    fn correct(&mut self, step: &[f64], metric: &[f64], before: &[f64], after: &[f64]) {
        let length: f64 = step.iter().zip(metric).map(|(s, m)| s * s * m).sum();
        if length.is_nan() || length <= 0.0 {
            return;
        }
        let mut missed: Vec<f64> =
            before.iter().zip(after).map(|(b, a)| if b.is_finite() && a.is_finite() { b - a } else { 0.0 }).collect();
        for (column, s) in self.columns.iter().zip(step).filter(|(_, s)| **s != 0.0) {
            for (m, d) in missed.iter_mut().zip(column) {
                *m -= d * s;
            }
        }
        for ((column, s), weight) in self.columns.iter_mut().zip(step).zip(metric).filter(|((_, s), _)| **s != 0.0) {
            let share = s * weight / length;
            for (d, m) in column.iter_mut().zip(&missed) {
                *d += share * m;
            }
        }
        self.corrected += 1;
    }
}

impl Fitter<'_> {
    /// Levenberg-Marquardt from `start`, at most `iterations` steps.
    pub fn polish<'a>(&self, model: &Model<'a>, start: &[f64], iterations: usize) -> Fit<'a> {
        self.polish_in(&mut Simulator::new(self.evidence), model, start, Descent::of(iterations))
    }

    /// As [`Fitter::polish`], with a simulator to go on with.
    pub fn polish_in<'a>(&self, simulator: &mut Simulator<'_>, model: &Model<'a>, start: &[f64], descent: Descent) -> Fit<'a> {
        let Descent { iterations, held, rough } = descent;
        let free = model.free();
        let still = if held == 0 { BASE..BASE } else { BASE..model.place(held.min(model.effects.len()) - 1).end };
        let moving: Vec<usize> = (0..free.len()).filter(|k| !still.contains(k)).collect();
        let mut residual = Vec::new();
        let mut best = self.score(simulator, model, &clamped(&free, start), &mut residual);
        let mut damping = 1e-2;
        let mut spare = Vec::new();
        let mut kept: Option<Slopes> = None;
        let corrected = if iterations > 5 && !self.squared { CORRECTED } else { 0 };
        for _ in 0..iterations {
            let mut slopes = match kept.take().filter(|s| s.corrected <= corrected) {
                Some(slopes) => slopes,
                None => self.slopes(simulator, &free, &moving, &best, &residual, rough && !self.squared),
            };
            let Some((normal, gradient)) = self.normal_equations(&slopes, &free, &best, &residual) else { break };
            let fresh = slopes.corrected == 0;
            let mut gain = 0.0;
            for _ in 0..if fresh { 4 } else { 1 } {
                let mut damped = normal.clone();
                for k in 0..moving.len() {
                    damped[(k, k)] = normal[(k, k)] * (1.0 + damping) + 1e-12;
                }
                let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                    damping *= 10.0;
                    continue;
                };
                let mut moved = best.theta.clone();
                for (k, s) in moving.iter().zip(step.iter()) {
                    moved[*k] = shifted(&free[*k], moved[*k], *s);
                }
                let next = self.score_near(simulator, model, &moved, best.scale_bar, &mut spare);
                gain = self.objective(&best) - self.objective(&next);
                if gain > 0.0 {
                    let made: Vec<f64> = moving.iter().map(|k| free[*k].distance(best.theta[*k], next.theta[*k])).collect();
                    slopes.correct(&made, normal.diagonal().as_slice(), &residual, &spare);
                    std::mem::swap(&mut residual, &mut spare);
                    best = next;
                    damping = (damping * 0.2).max(1e-6);
                    break;
                }
                if fresh {
                    damping *= 8.0;
                }
            }
            let improved = gain * self.effective() > TRIFLE_NATS;
            if improved {
                kept = Some(slopes);
            } else if fresh {
                break;
            }
        }
        best
    }

    /// The derivatives at a fit.
    pub fn slopes(
        &self,
        simulator: &mut Simulator<'_>,
        free: &[Free],
        moving: &[usize],
        at: &Fit<'_>,
        residual: &[f64],
        rough: bool,
    ) -> Slopes {
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); moving.len()];
        let mut theta = at.theta.clone();
        // The last stages first: what lies before them is kept from the fit's own simulation.
        for (column, k) in columns.iter_mut().zip(moving).rev() {
            if rough && self.slope_at_rest(*k, at, residual, column) {
                continue;
            }
            let (free, here) = (&free[*k], theta[*k]);
            if free.range.0 == free.range.1 {
                column.resize(residual.len(), 0.0);
                continue;
            }
            let mut ahead = shifted(free, here, free.step);
            if ahead == here {
                ahead = shifted(free, here, -free.step);
            }
            let width = free.distance(here, ahead);
            theta[*k] = ahead;
            simulator.residual(&at.model, &theta, &self.measured, column);
            theta[*k] = here;
            if width == 0.0 {
                column.fill(0.0);
                continue;
            }
            for (d, e) in column.iter_mut().zip(residual) {
                // Derivative of the simulated pressure.
                let slope = (e - *d) / width;
                *d = if slope.is_finite() { slope } else { 0.0 };
            }
        }
        Slopes { moving: moving.to_vec(), columns, corrected: 0 }
    }

    /// The derivative of base parameter `k` without a simulation, as it is where nothing after the curves is dynamic: of
    /// the gain and the offset, and of the delay. Nothing for the others.
    fn slope_at_rest(&self, k: usize, at: &Fit<'_>, residual: &[f64], column: &mut Vec<f64>) -> bool {
        let pressure = || self.measured.iter().zip(residual).map(|(y, e)| y - e);
        let known = |slope: f64| if slope.is_finite() { slope } else { 0.0 };
        column.clear();
        match k {
            GAIN => column.extend(pressure().map(|p| known((p - at.theta[OFFSET]) / (1.0 + at.theta[GAIN])))),
            OFFSET => column.resize(residual.len(), 1.0),
            DELAY => {
                let per_step = 1.0 / self.evidence.step_s();
                column.push(0.0);
                column.extend(pressure().zip(pressure().skip(1)).map(|(before, p)| known((before - p) * per_step)));
            }
            _ => return false,
        }
        true
    }

    /// Weighted normal equations J'WJ and J'We of the moving parameters at a fit, with the calibration as further rows.
    pub fn normal_equations(&self, slopes: &Slopes, free: &[Free], at: &Fit<'_>, residual: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let p = slopes.moving.len();
        let scale_bar = if self.squared { at.rmse_bar } else { at.scale_bar };
        let plain = |e: &f64| if e.is_finite() { 1.0 } else { 0.0 };
        let weights: Vec<f64> = residual.iter().map(|e| if self.squared { plain(e) } else { loss::weight(*e, scale_bar) }).collect();
        let mut normal = DMatrix::zeros(p, p);
        let mut gradient = DVector::zeros(p);
        let weighted: Vec<f64> = weights.iter().zip(residual).map(|(w, e)| if *w > 0.0 { w * e } else { 0.0 }).collect();
        let mut product = vec![0.0; weights.len()];
        for i in 0..p {
            for ((out, w), d) in product.iter_mut().zip(&weights).zip(&slopes.columns[i]) {
                *out = w * d;
            }
            for j in 0..=i {
                let sum: f64 = dot(&product, &slopes.columns[j]);
                normal[(i, j)] = sum;
                normal[(j, i)] = sum;
            }
            gradient[i] = dot(&weighted, &slopes.columns[i]);
        }
        // In units of one effective sample's nats.
        let unit = 1.0 / (scale_bar * scale_bar * self.tau_samples);
        normal *= unit;
        gradient *= unit;
        for (row, k) in slopes.moving.iter().enumerate() {
            if let Some(prior) = free[*k].prior {
                let stiffness = prior.stiffness(at.theta[*k]);
                normal[(row, row)] += stiffness;
                gradient[row] += stiffness * (prior.mean - at.theta[*k]);
            }
        }
        normal.iter().all(|v| v.is_finite()).then_some((normal, gradient))
    }

    /// Standard errors of all parameters, from the normal equations on effective samples, so that they are inflated
    /// by the correlation of the residual; a parameter that the record does not carry has an infinite one.
    pub fn standard_errors(&self, fit: &Fit<'_>) -> Vec<f64> {
        let free = fit.model.free();
        let mut simulator = Simulator::new(self.evidence);
        let mut residual = Vec::new();
        self.score(&mut simulator, &fit.model, &fit.theta, &mut residual);
        let infinite = vec![f64::INFINITY; free.len()];
        let all: Vec<usize> = (0..free.len()).collect();
        let slopes = self.slopes(&mut simulator, &free, &all, fit, &residual, false);
        let Some((normal, _)) = self.normal_equations(&slopes, &free, fit, &residual) else { return infinite };
        // Information of a t distribution is (nu + 1)/(nu + 3) of the weighted normal equations' expectation.
        let scale: Vec<f64> = (0..free.len()).map(|k| 1.0 / normal[(k, k)].max(1e-300).sqrt()).collect();
        let scaled =
            DMatrix::from_fn(free.len(), free.len(), |i, j| normal[(i, j)] * scale[i] * scale[j] + if i == j { 1e-9 } else { 0.0 });
        let Some(inverse) = scaled.try_inverse() else { return infinite };
        let error = |k: usize| inverse[(k, k)].max(0.0).sqrt() * scale[k] * if free[k].log { fit.theta[k].abs() } else { 1.0 };
        let carried = |k: usize| normal[(k, k)] > 1e-200;
        (0..free.len()).map(|k| if carried(k) { error(k) } else { f64::INFINITY }).collect()
    }
}

/// Sum of products in four lanes, which the compiler makes vector instructions of.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a4.zip(b4) {
        for l in 0..4 {
            lanes[l] += x[l] * y[l];
        }
    }
    lanes.iter().sum::<f64>() + rest
}
