//! Fits by free simulation, from several starts.

use nalgebra::DMatrix;

use super::descent::Descent;
use super::evidence::Evidence;
use super::loss;
use super::model::{BASE, Free, Model, Simulator, UNSEEN_LAG_S};

/// A recording of some hundred samples, for instance of a few steps, still counts as this many.
const FEWEST_EFFECTIVE: f64 = 300.0;

/// What a few steps bring no nearer to the incumbent than this is not worth the rest [nats].
const HOPELESS_NATS: f64 = -30.0;

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

    /// Whether a parameter of the last effect that it cannot do without has ended at the edge of its range.
    pub fn at_edge(&self) -> bool {
        let Some((effect, last)) = self.model.effects.last().zip(self.model.effects.len().checked_sub(1)) else { return false };
        let free = self.model.free();
        let at_edge = |k: usize| {
            let near =
                |edge: f64| free[k].distance(self.theta[k], edge).abs() < 1e-3 * free[k].distance(free[k].range.0, free[k].range.1).abs();
            near(free[k].range.0) || near(free[k].range.1)
        };
        effect.parameters().iter().zip(self.model.place(last)).any(|(p, k)| p.default.is_none() && at_edge(k))
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
    /// Effects found before by stretches of the recording that no simulation can follow.
    pub found: Vec<&'static str>,
}

impl<'e> Fitter<'e> {
    /// For all of the evidence, with the correlation still unknown.
    pub fn new(evidence: &'e Evidence) -> Self {
        Self { evidence, measured: evidence.pressure_bar(), tau_samples: 20.0, squared: evidence.is_of_steps(), found: Vec::new() }
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
        self.score_near(simulator, model, theta, 3.0 * self.evidence.noise_bar, residual)
    }

    /// As [`Fitter::score`], where the scale of the residual is likely near `guess_bar`.
    pub fn score_near<'a>(
        &self,
        simulator: &mut Simulator<'_>,
        model: &Model<'a>,
        theta: &[f64],
        guess_bar: f64,
        residual: &mut Vec<f64>,
    ) -> Fit<'a> {
        simulator.residual(model, theta, &self.measured, residual);
        let scale_bar = loss::scale(residual, 0.7 * self.evidence.noise_bar, guess_bar);
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
    pub fn objective(&self, fit: &Fit<'_>) -> f64 {
        let nats = if self.squared { fit.rmse_bar.ln() } else { fit.mean_nats };
        nats + fit.prior_nats / self.effective()
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

    /// Fits `model`, whose last effect is new.
    pub fn fit_new<'a>(&self, model: &Model<'a>, incumbent: &Fit<'a>, hints: &[Vec<f64>]) -> Fit<'a> {
        let starts = [model.starts(model.effects[model.effects.len() - 1]).as_slice(), hints].concat();
        let screened = self.screen(model, incumbent, &starts);
        let hopeless = self.gain(incumbent, &screened[0]) < HOPELESS_NATS && screened[0].rmse_bar > incumbent.rmse_bar;
        self.finish(screened, hopeless)
    }

    /// What `next` gains over `fit` in what a fit minimises [nats].
    pub fn gain(&self, fit: &Fit<'_>, next: &Fit<'_>) -> f64 {
        (self.objective(fit) - self.objective(next)) * self.effective()
    }

    /// The best fits, best first and at least one, of `model`, whose last effect is new: a few steps from every one of
    /// `starts` of that effect, with the earlier effects held at first.
    pub fn screen<'a>(&self, model: &Model<'a>, incumbent: &Fit<'a>, starts: &[Vec<f64>]) -> Vec<Fit<'a>> {
        let held = model.effects.len() - 1;
        let mut simulator = Simulator::new(self.evidence);
        let mut residual = Vec::new();
        // From the incumbent's base, and from the calibration: what the base had absorbed must be free to go back.
        let mut calibrated = incumbent.theta.clone();
        calibrated[..BASE].copy_from_slice(&model.calibrated());
        calibrated[BASE - 1] += 0.5 * UNSEEN_LAG_S;
        let mut tried: Vec<Fit<'a>> = Vec::new();
        for values in starts {
            for base in [&incumbent.theta, &calibrated] {
                let theta = [base.as_slice(), values.as_slice()].concat();
                tried.push(self.score(&mut simulator, model, &clamped(&model.free(), &theta), &mut residual));
            }
        }
        let order = |a: &Fit<'_>, b: &Fit<'_>| self.objective(a).total_cmp(&self.objective(b));
        tried.sort_by(order);
        tried.truncate(6);
        // The base makes room for the effect before it is judged: what a wider loop has absorbed must be given back.
        let mut tried: Vec<Fit<'a>> = tried
            .iter()
            .map(|f| self.polish_in(&mut simulator, model, &f.theta, Descent { iterations: 2, held: held + 1, rough: true }))
            .collect();
        tried.sort_by(order);
        tried.truncate(3);
        let mut rough: Vec<Fit<'a>> =
            tried.iter().map(|f| self.polish_in(&mut simulator, model, &f.theta, Descent { iterations: 4, held, rough: true })).collect();
        rough.sort_by(order);
        rough
    }

    /// The best of what [`Fitter::screen`] has found, brought to the end with all parameters free; only a few steps where
    /// it is hopeless.
    pub fn finish<'a>(&self, mut rough: Vec<Fit<'a>>, hopeless: bool) -> Fit<'a> {
        let mut simulator = Simulator::new(self.evidence);
        // A second start goes on only where it may still win.
        let both = !hopeless && rough.len() > 1 && self.gain(&rough[1], &rough[0]) < 6.0;
        rough.truncate(if both { 2 } else { 1 });
        let steps = if hopeless { 5 } else { 18 };
        let fine = rough.iter().map(|f| self.polish_in(&mut simulator, &f.model, &f.theta, Descent::of(steps)));
        let best = fine.min_by(|a, b| self.objective(a).total_cmp(&self.objective(b))).unwrap_or_else(|| rough[0].clone());
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
                    let next = self.score_near(simulator, &best.model, &theta, best.scale_bar, &mut residual);
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
        self.polish(model, start, 18)
    }

    /// "Recalibrate only": the base parameters free, from several starts, the same effort as a candidate gets.
    pub fn recalibrate<'a>(&self, model: &Model<'a>, others: &[Vec<f64>]) -> Fit<'a> {
        let start = model.calibrated();
        let mut simulator = Simulator::new(self.evidence);
        let mut starts = vec![start.clone()];
        for (more, lag) in [(0.0, 0.008), (0.008, 0.003), (0.004, 0.014)] {
            let mut s = start.clone();
            s[4] += more * model.slowness;
            s[5] += lag * model.slowness;
            starts.push(s);
        }
        starts.extend(others.iter().map(|t| t[..BASE].to_vec()));
        let fits = starts.iter().map(|s| self.polish_in(&mut simulator, model, s, Descent::of(10)));
        fits.min_by(|a, b| self.objective(a).total_cmp(&self.objective(b))).unwrap_or_else(|| self.polish(model, &start, 10))
    }
}

pub fn shifted(free: &Free, value: f64, step: f64) -> f64 {
    let moved = if free.log { value * step.clamp(-1.5, 1.5).exp() } else { value + step };
    moved.clamp(free.range.0, free.range.1)
}

pub fn clamped(free: &[Free], theta: &[f64]) -> Vec<f64> {
    free.iter().zip(theta).map(|(f, v)| v.clamp(f.range.0, f.range.1)).collect()
}
