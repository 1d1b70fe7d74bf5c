//! Fits by free simulation: Levenberg-Marquardt on a t likelihood, from several starts.

use nalgebra::{DMatrix, DVector};

use super::evidence::Evidence;
use super::loss;
use super::model::{BASE, Free, Model, Simulator, UNSEEN_LAG_S};

/// A recording of some hundred samples, for instance of a few steps, still counts as this many.
const FEWEST_EFFECTIVE: f64 = 300.0;

/// A fitted model.
#[derive(Clone)]
pub struct Fit<'a> {
    /// The model.
    pub model: Model<'a>,
    /// Its parameters.
    pub theta: Vec<f64>,
    /// Negative log-likelihood [nats per sample], without the calibration's part.
    pub mean_nats: f64,
    /// What the calibration says against the base parameters [nats].
    pub prior_nats: f64,
    /// Scale of the residual [bar].
    pub scale_bar: f64,
    /// Root of the mean square of the residual [bar].
    pub rmse_bar: f64,
}

impl Fit<'_> {
    /// BIC on `effective` samples, the mean of two likelihoods: the t, which rare events move little, and the normal,
    /// which they move most. An effect of events shows in the second, one of the course in both.
    pub fn bic(&self, effective: f64) -> f64 {
        let nats = 0.5 * (self.mean_nats + self.rmse_bar.ln());
        2.0 * (nats * effective + self.prior_nats - self.model.signature_nats()) + self.model.extra_parameters() as f64 * effective.ln()
    }
}

/// What all fits of one diagnosis share.
pub struct Fitter<'e> {
    /// The evidence.
    pub evidence: &'e Evidence,
    /// Measured pressures of all runs; NaN where masked [bar].
    pub measured: Vec<f64>,
    /// Samples that count as one.
    pub tau_samples: f64,
    /// Whether fits minimise the squared error instead of the t loss: in a recording of steps the few samples of a
    /// transient are what matters, and the t loss takes them for its tails.
    pub squared: bool,
}

impl<'e> Fitter<'e> {
    /// For all of the evidence, with the correlation still unknown.
    pub fn new(evidence: &'e Evidence) -> Self {
        Self { evidence, measured: evidence.pressure_bar(), tau_samples: 20.0, squared: evidence.is_of_steps() }
    }

    /// Number of used samples.
    pub fn used(&self) -> usize {
        self.measured.iter().filter(|p| p.is_finite()).count()
    }

    /// Effective number of samples.
    pub fn effective(&self) -> f64 {
        (self.used() as f64 / self.tau_samples).max(FEWEST_EFFECTIVE.min(self.used() as f64))
    }

    /// The loss of a parameter vector.
    pub fn score<'a>(&self, simulator: &mut Simulator<'_>, model: &Model<'a>, theta: &[f64], residual: &mut Vec<f64>) -> Fit<'a> {
        simulator.residual(model, theta, &self.measured, residual);
        let scale_bar = loss::scale(residual, 0.7 * self.evidence.noise_bar, 3.0 * self.evidence.noise_bar);
        let prior_nats = model.free().iter().zip(theta).filter_map(|(f, v)| f.prior.map(|p| p.nats(*v))).sum();
        let (sum, n) = residual.iter().filter(|e| e.is_finite()).fold((0.0, 0usize), |(s, n), e| (s + e * e, n + 1));
        let rmse_bar = (sum / n.max(1) as f64).sqrt().max(1e-9);
        Fit {
            model: model.clone(),
            theta: theta.to_vec(),
            mean_nats: loss::mean_nats(residual, scale_bar),
            prior_nats,
            scale_bar,
            rmse_bar,
        }
    }

    /// What a fit minimises [nats per sample].
    fn objective(&self, fit: &Fit<'_>) -> f64 {
        let nats = if self.squared { fit.rmse_bar.ln() } else { fit.mean_nats };
        nats + fit.prior_nats / self.effective()
    }

    /// Levenberg-Marquardt from `start`, at most `iterations` steps.
    pub fn polish<'a>(&self, model: &Model<'a>, start: &[f64], iterations: usize) -> Fit<'a> {
        self.polish_in(&mut Simulator::new(self.evidence), model, start, iterations, 0)
    }

    /// As [`Fitter::polish`], with a simulator to go on with, and the first `held` effects held at their values.
    fn polish_in<'a>(&self, simulator: &mut Simulator<'_>, model: &Model<'a>, start: &[f64], iterations: usize, held: usize) -> Fit<'a> {
        let free = model.free();
        let still = if held == 0 { BASE..BASE } else { BASE..model.place(held.min(model.effects.len()) - 1).end };
        let moving: Vec<usize> = (0..free.len()).filter(|k| !still.contains(k)).collect();
        let mut residual = Vec::new();
        let mut best = self.score(simulator, model, &clamped(&free, start), &mut residual);
        let mut damping = 1e-2;
        let mut spare = Vec::new();
        for _ in 0..iterations {
            let Some((normal, gradient)) = self.normal_equations(simulator, model, &free, &moving, &best, &residual) else { break };
            let mut improved = false;
            for _ in 0..4 {
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
                let next = self.score(simulator, model, &moved, &mut spare);
                let gain = self.objective(&best) - self.objective(&next);
                if gain > 0.0 {
                    std::mem::swap(&mut residual, &mut spare);
                    best = next;
                    damping = (damping * 0.2).max(1e-6);
                    improved = gain * self.effective() > 0.02;
                    break;
                }
                damping *= 8.0;
            }
            if !improved {
                break;
            }
        }
        best
    }

    /// Weighted normal equations J'WJ and J'We of the moving parameters at a fit, with the calibration as further rows.
    fn normal_equations(
        &self,
        simulator: &mut Simulator<'_>,
        model: &Model<'_>,
        free: &[Free],
        moving: &[usize],
        at: &Fit<'_>,
        residual: &[f64],
    ) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let p = moving.len();
        let scale_bar = if self.squared { at.rmse_bar } else { at.scale_bar };
        let plain = |e: &f64| if e.is_finite() { 1.0 } else { 0.0 };
        let weights: Vec<f64> = residual.iter().map(|e| if self.squared { plain(e) } else { loss::weight(*e, scale_bar) }).collect();
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); p];
        let mut theta = at.theta.clone();
        // The last stages first: what lies before them is kept from the fit's own simulation.
        for (column, k) in columns.iter_mut().zip(moving).rev() {
            let (free, here) = (&free[*k], theta[*k]);
            let mut ahead = shifted(free, here, free.step);
            if ahead == here {
                ahead = shifted(free, here, -free.step);
            }
            let width = if free.log { (ahead / here).ln() } else { ahead - here };
            theta[*k] = ahead;
            simulator.residual(model, &theta, &self.measured, column);
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
        let mut normal = DMatrix::zeros(p, p);
        let mut gradient = DVector::zeros(p);
        let weighted: Vec<f64> = weights.iter().zip(residual).map(|(w, e)| if *w > 0.0 { w * e } else { 0.0 }).collect();
        let mut product = vec![0.0; weights.len()];
        for i in 0..p {
            for ((out, w), d) in product.iter_mut().zip(&weights).zip(&columns[i]) {
                *out = w * d;
            }
            for j in 0..=i {
                let sum: f64 = dot(&product, &columns[j]);
                normal[(i, j)] = sum;
                normal[(j, i)] = sum;
            }
            gradient[i] = dot(&weighted, &columns[i]);
        }
        // In units of one effective sample's nats.
        let unit = 1.0 / (scale_bar * scale_bar * self.tau_samples);
        normal *= unit;
        gradient *= unit;
        for (row, k) in moving.iter().enumerate() {
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
        let Some((normal, _)) = self.normal_equations(&mut simulator, &fit.model, &free, &all, fit, &residual) else { return infinite };
        // Information of a t distribution is (nu + 1)/(nu + 3) of the weighted normal equations' expectation.
        let scale: Vec<f64> = (0..free.len()).map(|k| 1.0 / normal[(k, k)].max(1e-300).sqrt()).collect();
        let scaled =
            DMatrix::from_fn(free.len(), free.len(), |i, j| normal[(i, j)] * scale[i] * scale[j] + if i == j { 1e-9 } else { 0.0 });
        let Some(inverse) = scaled.try_inverse() else { return infinite };
        let variance = |k: usize| inverse[(k, k)].max(0.0).sqrt() * scale[k] * if free[k].log { fit.theta[k].abs() } else { 1.0 };
        (0..free.len()).map(variance).collect()
    }

    /// Fits `model`, whose last effect is new: from every start of that effect a few steps with the earlier effects
    /// held, the best two to the end with all parameters free.
    pub fn fit_new<'a>(&self, model: &Model<'a>, incumbent: &Fit<'a>, hints: &[Vec<f64>]) -> Fit<'a> {
        let held = model.effects.len() - 1;
        let effect = model.effects[held];
        let mut simulator = Simulator::new(self.evidence);
        let mut residual = Vec::new();
        // From the incumbent's base, and from the calibration: what the base had absorbed must be free to go back.
        let mut calibrated = incumbent.theta.clone();
        calibrated[..BASE].copy_from_slice(&model.calibrated());
        calibrated[BASE - 1] += 0.5 * UNSEEN_LAG_S;
        let mut tried: Vec<Fit<'a>> = Vec::new();
        for values in model.starts(effect).iter().chain(hints) {
            for base in [&incumbent.theta, &calibrated] {
                let theta = [base.as_slice(), values.as_slice()].concat();
                tried.push(self.score(&mut simulator, model, &clamped(&model.free(), &theta), &mut residual));
            }
        }
        let order = |a: &Fit<'_>, b: &Fit<'_>| self.objective(a).total_cmp(&self.objective(b));
        tried.sort_by(order);
        tried.truncate(6);
        // The base makes room for the effect before it is judged: what a wider loop has absorbed must be given back.
        let mut tried: Vec<Fit<'a>> = tried.iter().map(|f| self.polish_in(&mut simulator, model, &f.theta, 2, held + 1)).collect();
        tried.sort_by(order);
        tried.truncate(3);
        let mut rough: Vec<Fit<'a>> = tried.iter().map(|f| self.polish_in(&mut simulator, model, &f.theta, 3, held)).collect();
        rough.sort_by(order);
        // What a few steps bring nowhere near the incumbent is not worth the rest.
        let hopeless =
            (self.objective(&rough[0]) - self.objective(incumbent)) * self.effective() > 30.0 && rough[0].rmse_bar > incumbent.rmse_bar;
        let steps = if hopeless { 4 } else { 12 };
        // A second start goes on only where it may still win.
        let near = |f: &Fit<'_>| (self.objective(f) - self.objective(&rough[0])) * self.effective() < 6.0;
        let keep = if hopeless || rough.len() < 2 || !near(&rough[1]) { 1 } else { 2 };
        rough.truncate(keep);
        let mut fine: Vec<Fit<'a>> = rough.iter().map(|f| self.polish_in(&mut simulator, model, &f.theta, steps, 0)).collect();
        fine.sort_by(order);
        let best = fine.swap_remove(0);
        if hopeless { best } else { self.walk(&mut simulator, best) }
    }

    /// Tries each effect parameter a little up and down: what a gradient of a jumping simulation does not see.
    fn walk<'a>(&self, simulator: &mut Simulator<'_>, mut best: Fit<'a>) -> Fit<'a> {
        let free = best.model.free();
        let mut residual = Vec::new();
        let last = best.model.place(best.model.effects.len() - 1);
        for size in [0.12, 0.03] {
            for k in last.clone() {
                for sign in [1.0, -1.0] {
                    let step = if free[k].log {
                        size
                    } else {
                        size * best.theta[k].abs().max(0.01 * (free[k].range.1 - free[k].range.0).min(10.0))
                    };
                    let mut theta = best.theta.clone();
                    theta[k] = shifted(&free[k], theta[k], sign * step);
                    let next = self.score(simulator, &best.model, &theta, &mut residual);
                    if self.objective(&next) < self.objective(&best) {
                        best = next;
                        break;
                    }
                }
            }
        }
        best
    }

    /// The fit with each optional parameter of its last effect back at its default, where BIC is better for it.
    pub fn simplified<'a>(&self, mut fit: Fit<'a>) -> Fit<'a> {
        let effective = self.effective();
        let count = fit.model.effects.last().map_or(0, |e| e.parameters().len());
        for j in (0..count).rev() {
            let Some(simpler) = fit.model.holding(j) else { continue };
            let less = self.polish(&simpler, &fit.theta, 4);
            if less.bic(effective) < fit.bic(effective) {
                fit = less;
            }
        }
        fit
    }

    /// Refits a model from a vector, for instance after an effect was taken out.
    pub fn refit<'a>(&self, model: &Model<'a>, start: &[f64]) -> Fit<'a> {
        self.polish(model, start, 12)
    }

    /// "Recalibrate only": the base parameters free, from several starts, the same effort as a candidate gets.
    pub fn recalibrate<'a>(&self, model: &Model<'a>, others: &[Vec<f64>]) -> Fit<'a> {
        let start = model.calibrated();
        let mut simulator = Simulator::new(self.evidence);
        let mut starts = vec![start.clone()];
        for (more, lag) in [(0.0, 0.008), (0.008, 0.003), (0.004, 0.014)] {
            let mut s = start.clone();
            s[4] += more;
            s[5] += lag;
            starts.push(s);
        }
        starts.extend(others.iter().map(|t| t[..BASE].to_vec()));
        let fits = starts.iter().map(|s| self.polish_in(&mut simulator, model, s, 10, 0));
        fits.min_by(|a, b| self.objective(a).total_cmp(&self.objective(b))).unwrap_or_else(|| self.polish(model, &start, 10))
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

fn shifted(free: &Free, value: f64, step: f64) -> f64 {
    let moved = if free.log { value * step.clamp(-1.5, 1.5).exp() } else { value + step };
    moved.clamp(free.range.0, free.range.1)
}

fn clamped(free: &[Free], theta: &[f64]) -> Vec<f64> {
    free.iter().zip(theta).map(|(f, v)| v.clamp(f.range.0, f.range.1)).collect()
}
