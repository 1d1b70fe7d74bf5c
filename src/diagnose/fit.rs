//! A fit, and what it is judged by.

use super::base::AT;
use super::criteria::Criteria;
use super::evidence::Evidence;
use super::loss;
use super::model::{Free, Model};
use super::simulator::Simulator;
use super::trust::Trust;

/// A recording of some hundred samples, for instance of a few steps, still counts as this many.
const FEWEST_EFFECTIVE: f64 = 300.0;
/// A parameter within this share of its range of an end has ended there.
const EDGE: f64 = 1e-3;

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
    /// Scale of the residual, each reading as much as it weighs [bar].
    pub scale_bar: f64,
    /// Root of the mean square of the residual, each reading as much as it weighs [bar].
    pub rmse_bar: f64,
}

impl Fit<'_> {
    /// It without effect number `k`, and nothing moved in its place; not judged anew.
    pub fn without(&self, k: usize) -> Self {
        let mut theta = self.theta.clone();
        theta.drain(self.model.place(k));
        Self { model: self.model.without(k), theta, ..self.clone() }
    }

    /// The ids of its effects, in their order.
    pub fn ids(&self) -> Vec<&'static str> {
        self.model.effects.iter().map(|e| e.id()).collect()
    }

    /// BIC on `effective` samples, the mean of two likelihoods: the t, which rare events move little, and the normal,
    /// which they move most. An effect of events shows in the second, one of the course in both.
    pub fn bic(&self, effective: f64) -> f64 {
        let nats = 0.5 * (self.mean_nats + self.rmse_bar.ln());
        2.0 * (nats * effective + self.prior_nats - self.model.signature_nats()) + self.model.extra_parameters() as f64 * effective.ln()
    }

    /// What it costs that gain and zero are not as calibrated [nats].
    pub fn recalibration_nats(&self) -> f64 {
        let free = self.model.free();
        [AT.gain, AT.offset].iter().filter_map(|k| free[*k].prior.map(|p| p.nats(self.theta[*k]))).sum()
    }

    /// What it costs that loop, delay and lag are not as calibrated [nats].
    pub fn reshaping_nats(&self) -> f64 {
        let free = self.model.free();
        [AT.width, AT.ln_a, AT.late, AT.lag].iter().filter_map(|k| free[*k].prior.map(|p| p.nats(self.theta[*k]))).sum()
    }

    /// Whether a parameter of the last effect that it cannot do without has ended at the edge of its range.
    pub fn at_edge(&self) -> bool {
        let Some((effect, last)) = self.model.effects.last().zip(self.model.effects.len().checked_sub(1)) else { return false };
        let free = self.model.free();
        let at_edge = |k: usize| self.stands_at(&free, k, free[k].range.0) || self.stands_at(&free, k, free[k].range.1);
        effect.parameters().iter().zip(self.model.place(last)).any(|(p, k)| p.default.is_none() && at_edge(k))
    }

    /// Whether parameter `j` stands at this end of its range.
    fn stands_at(&self, free: &[Free], j: usize, edge: f64) -> bool {
        let (low, high) = free[j].range;
        free[j].distance(self.theta[j], edge).abs() < EDGE * free[j].distance(low, high).abs()
    }

    /// Whether a parameter of effect number `k` has ended where its range does, and neither at the value of its plainest form nor, as a
    /// share of something, at all of it: the effect then explains by what it does not mean to be.
    pub fn at_bound(&self, k: usize) -> bool {
        let free = self.model.free();
        self.model.effects[k].parameters().iter().zip(self.model.place(k)).any(|(p, j)| {
            let (low, high) = free[j].range;
            let is_meant = |edge: f64| p.default == Some(edge) || (low, high) == (0.0, 1.0) && p.default.is_some();
            low < high && [low, high].into_iter().any(|edge| self.stands_at(&free, j, edge) && !is_meant(edge))
        })
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
    /// How far the model is off where nothing is wrong: the sensor noise, and with data of the good valve its form error [bar].
    pub floor_bar: f64,
    /// The thresholds.
    pub criteria: Criteria,
    /// Whether data of the good valve says how the model stood when nothing was wrong.
    pub against_good: bool,
    /// Whether that data also vouches for the model: it follows it.
    pub is_vouched: bool,
    /// Whether this is data of the good valve: what is found in it corrects the model, and is no name.
    pub corrects: bool,
    /// Effects found before by stretches of the recording that no simulation can follow.
    pub found: Vec<&'static str>,
    /// Where the model is to be trusted less, as data of the good valve has it.
    pub trust: Option<Trust>,
    /// What each reading weighs; empty where all weigh the same.
    pub weights: Vec<f64>,
}

impl<'e> Fitter<'e> {
    /// For all of the evidence, with the correlation still unknown.
    pub fn new(evidence: &'e Evidence) -> Self {
        Self {
            evidence,
            measured: evidence.pressure_bar(),
            tau_samples: 20.0,
            squared: evidence.rests_mostly(),
            floor_bar: evidence.noise_bar,
            criteria: evidence.criteria,
            against_good: false,
            is_vouched: false,
            corrects: false,
            found: Vec::new(),
            trust: None,
            weights: Vec::new(),
        }
    }

    /// For the evidence without these samples.
    pub fn without(evidence: &'e Evidence, left_out: &[usize]) -> Self {
        let mut fitter = Self::new(evidence);
        for k in left_out {
            fitter.measured[*k] = f64::NAN;
        }
        fitter
    }

    /// The same on a part of the evidence.
    pub fn looking_at<'s>(&self, part: &'s Evidence) -> Fitter<'s> {
        let Self { tau_samples, squared, floor_bar, criteria, against_good, is_vouched, corrects, .. } = *self;
        let found = self.found.clone();
        Fitter { tau_samples, squared, floor_bar, criteria, against_good, is_vouched, corrects, found, ..Fitter::new(part) }
            .trusting(self.trust.clone())
    }

    /// The same with other readings, or with some of them masked.
    pub fn seeing(&self, measured: Vec<f64>) -> Self {
        let Self { tau_samples, squared, .. } = *self;
        Self { measured, tau_samples, squared, trust: self.trust.clone(), weights: self.weights.clone(), ..Fitter::new(self.evidence) }
    }

    /// From now on readings weigh as the model is to be trusted there.
    pub fn trusting(mut self, trust: Option<Trust>) -> Self {
        self.weights = trust.as_ref().map(|trust| trust.weights(self.evidence)).unwrap_or_default();
        self.trust = trust;
        self
    }

    /// Measured minus simulated, each as much as it weighs; NaN where masked [bar].
    pub fn residual(&self, simulator: &mut Simulator<'_>, model: &Model<'_>, theta: &[f64], out: &mut Vec<f64>) {
        self.residuals(simulator, model, &[theta], std::slice::from_mut(out));
    }

    /// The same for each of several vectors.
    pub fn residuals(&self, simulator: &mut Simulator<'_>, model: &Model<'_>, thetas: &[&[f64]], outs: &mut [Vec<f64>]) {
        simulator.residuals(model, thetas, &self.measured, outs);
        outs.iter_mut().for_each(|out| self.weigh(out));
    }

    /// Takes each value of a pressure for as much as a reading there weighs.
    pub fn weigh(&self, values: &mut [f64]) {
        for (value, weight) in values.iter_mut().zip(&self.weights) {
            *value *= weight;
        }
    }

    /// What a reading weighs.
    pub fn weight(&self, k: usize) -> f64 {
        self.weights.get(k).copied().unwrap_or(1.0)
    }

    /// A fit of other evidence as it stands on this one.
    pub fn as_it_stands<'a>(&self, fit: &Fit<'a>) -> Fit<'a> {
        self.score(&mut Simulator::new(self.evidence), &fit.model, &fit.theta, &mut Vec::new())
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
        self.score_near(simulator, model, theta, self.guessed_scale_bar(), residual)
    }

    /// Near what the scale of a residual is likely, before a fit is known [bar].
    pub fn guessed_scale_bar(&self) -> f64 {
        3.0 * self.evidence.noise_bar
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
        self.residual(simulator, model, theta, residual);
        self.judged(model, theta, guess_bar, residual)
    }

    /// The fit that leaves this residual, whose scale is likely near `guess_bar`.
    pub fn judged<'a>(&self, model: &Model<'a>, theta: &[f64], guess_bar: f64, residual: &[f64]) -> Fit<'a> {
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

    /// The better one of two fits, the first of equals.
    pub fn better<'a>(&self, first: Fit<'a>, second: Fit<'a>) -> Fit<'a> {
        if self.objective(&second).total_cmp(&self.objective(&first)).is_lt() { second } else { first }
    }

    /// The best of these fits, the first of equals; nothing of none.
    pub fn best<'a>(&self, fits: impl IntoIterator<Item = Fit<'a>>) -> Option<Fit<'a>> {
        fits.into_iter().reduce(|best, next| self.better(best, next))
    }

    /// What `next` gains over `fit` in what a fit minimises [nats].
    pub fn gain(&self, fit: &Fit<'_>, next: &Fit<'_>) -> f64 {
        (self.objective(fit) - self.objective(next)) * self.effective()
    }
}

pub fn shifted(free: &Free, value: f64, step: f64) -> f64 {
    let moved = if free.log { value * step.clamp(-1.5, 1.5).exp() } else { value + step };
    moved.clamp(free.range.0, free.range.1)
}

pub fn clamped(free: &[Free], theta: &[f64]) -> Vec<f64> {
    free.iter().zip(theta).map(|(f, v)| v.clamp(f.range.0, f.range.1)).collect()
}
