//! How the fit of a free simulation goes down its loss.
//!
//! Nearly all of the time goes into the derivatives, one simulation per parameter. After a step that went well they are
//! corrected by what the step itself has shown (Broyden, Math. Comp. 19 (1965) 577) instead of taken anew, and taken anew
//! as soon as such a step disappoints. First steps from many starts share the derivatives by what no effect changes much.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::base::{AT, BASE};
use super::fit::{Fit, Fitter, clamped, shifted};
use super::loss;
use super::model::{Free, Model};
use super::simulator::Simulator;
use crate::least_squares::{Equations, Landscape, Pace, descend, dot};

/// Steps in a row that corrected derivatives may serve, of a descent of more than so many steps: in a short one each of them counts.
const CORRECTED: [(usize, usize); 2] = [(5, 2), (3, 1)];
/// Simulations side by side: with more of them their signals would leave the level-1 cache.
const ABREAST: usize = 4;
/// Gain of a step below which a fit is at its end [nats].
const TRIFLE_NATS: f64 = 0.02;
/// The same of one that shows who may still win, far below what decides that [nats].
const ROUGH_TRIFLE_NATS: f64 = 1.0;
/// How a descent goes.
const PACE: Pace = Pace { steps: 0, damping: 1e-2, least: 1e-6, raised: 8.0, tries: 4 };

/// How a fit descends.
#[derive(Debug, Clone, Copy, Hash)]
pub struct Descent {
    /// Most steps.
    pub iterations: usize,
    /// The first so many effects stay at their values.
    pub held: usize,
    /// Whether derivatives that are nearly right will do.
    pub rough: bool,
}

/// Which derivatives will do.
#[derive(Clone, Copy)]
pub enum Wanted<'s> {
    /// Each simulated where the fit stands.
    Exact,
    /// Those by gain, offset and delay as where nothing after the curves is dynamic, and of others these where they are among them,
    /// taken at a fit nearby.
    Rough(Option<&'s Slopes>),
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
    /// The derivatives, one column per moving parameter.
    pub fn columns(&self) -> &[Vec<f64>] {
        &self.columns
    }

    /// The derivative by parameter `k`, where it was taken.
    fn column(&self, k: usize) -> Option<&[f64]> {
        self.moving.iter().position(|moving| *moving == k).map(|place| self.columns[place].as_slice())
    }

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

/// Where a descent stands: a fit, and measured minus simulated [bar].
pub struct Place<'a> {
    /// The fit.
    pub fit: Fit<'a>,
    /// What it leaves.
    pub residual: Vec<f64>,
}

/// The loss over the parameters that move.
struct Loss<'l, 'f, 'e, 'a> {
    fitter: &'l Fitter<'f>,
    simulator: &'l mut Simulator<'e>,
    model: &'l Model<'a>,
    free: Vec<Free>,
    moving: Vec<usize>,
    wanted: Wanted<'l>,
    /// Steps in a row that corrected derivatives may serve here.
    corrected: usize,
    /// A step that gains less here is the last [nats].
    trifle_nats: f64,
}

impl<'a> Landscape for Loss<'_, '_, '_, 'a> {
    type Point = Place<'a>;
    type Slopes = Slopes;

    fn slopes(&mut self, at: &Place<'a>) -> Slopes {
        self.fitter.slopes(self.simulator, &self.free, &self.moving, &at.fit, &at.residual, self.wanted)
    }

    fn equations(&self, slopes: &Slopes, at: &Place<'a>) -> Option<Equations> {
        self.fitter.normal_equations(slopes, &self.free, &at.fit, &at.residual)
    }

    fn moved(&mut self, at: &Place<'a>, step: &DVector<f64>) -> Place<'a> {
        let mut theta = at.fit.theta.clone();
        for (k, s) in self.moving.iter().zip(step.iter()) {
            theta[*k] = shifted(&self.free[*k], theta[*k], *s);
        }
        let mut residual = Vec::new();
        let fit = self.fitter.score_near(self.simulator, self.model, &theta, at.fit.scale_bar, &mut residual);
        Place { fit, residual }
    }

    fn objective(&self, at: &Place<'a>) -> f64 {
        self.fitter.objective(&at.fit)
    }

    fn is_held(&self, k: usize) -> bool {
        self.free[self.moving[k]].is_still()
    }

    fn is_blocked(&self, at: &Place<'a>, k: usize, step: f64) -> bool {
        self.free[self.moving[k]].is_blocked(at.fit.theta[self.moving[k]], step)
    }

    fn is_worth_more(&self, _before: f64, gain: f64) -> bool {
        gain * self.fitter.effective() > self.trifle_nats
    }

    fn corrected(&self, mut slopes: Slopes, metric: &Equations, from: &Place<'a>, to: &Place<'a>) -> Option<Slopes> {
        let made: Vec<f64> = self.moving.iter().map(|k| self.free[*k].distance(from.fit.theta[*k], to.fit.theta[*k])).collect();
        slopes.correct(&made, metric.normal.diagonal().as_slice(), &from.residual, &to.residual);
        (slopes.corrected <= self.corrected).then_some(slopes)
    }
}

impl Fitter<'_> {
    /// The fit that is reached from `start` in at most `iterations` steps.
    pub fn polish<'a>(&self, model: &Model<'a>, start: &[f64], iterations: usize) -> Fit<'a> {
        self.polish_in(&mut Simulator::new(self.evidence), model, start, Descent::of(iterations))
    }

    /// As [`Fitter::polish`], with a simulator to go on with.
    pub fn polish_in<'a>(&self, simulator: &mut Simulator<'_>, model: &Model<'a>, start: &[f64], descent: Descent) -> Fit<'a> {
        let from = simulator.start_share.unwrap_or(-1.0);
        let fit = || vec![self.descended(simulator, model, start, descent)];
        self.remembering((model, &[start, &[from]]), descent, fit).swap_remove(0)
    }

    fn descended<'a>(&self, simulator: &mut Simulator<'_>, model: &Model<'a>, start: &[f64], descent: Descent) -> Fit<'a> {
        let place = self.placed(simulator, model, &clamped(&model.free(), start));
        self.descended_from(simulator, place, descent, None).fit
    }

    /// Where `model` stands with this vector.
    pub fn placed<'a>(&self, simulator: &mut Simulator<'_>, model: &Model<'a>, theta: &[f64]) -> Place<'a> {
        let mut residual = Vec::new();
        let fit = self.score(simulator, model, theta, &mut residual);
        Place { fit, residual }
    }

    /// The same where its pressure there is known [bar].
    pub fn placed_by<'a>(&self, model: &Model<'a>, theta: &[f64], pressure_bar: Vec<f64>) -> Place<'a> {
        let mut residual = pressure_bar;
        residual.iter_mut().zip(&self.measured).for_each(|(e, y)| *e = y - *e);
        self.weigh(&mut residual);
        Place { fit: self.judged(model, theta, self.guessed_scale_bar(), &residual), residual }
    }

    /// Where a descent from `place` ends; `near`: derivatives that will do where they need be right only nearly.
    pub fn descended_from<'a>(
        &self,
        simulator: &mut Simulator<'_>,
        place: Place<'a>,
        descent: Descent,
        near: Option<&Slopes>,
    ) -> Place<'a> {
        let Descent { iterations, held, rough } = descent;
        let model = &place.fit.model.clone();
        let free = model.free();
        let still = if held == 0 { BASE..BASE } else { BASE..model.place(held.min(model.effects.len()) - 1).end };
        let moving: Vec<usize> = (0..free.len()).filter(|k| !still.contains(k)).collect();
        let corrected = CORRECTED.iter().find(|(steps, _)| iterations > *steps && !self.squared).map_or(0, |(_, corrected)| *corrected);
        let wanted = if rough && !self.squared { Wanted::Rough(near) } else { Wanted::Exact };
        let trifle_nats = if rough { ROUGH_TRIFLE_NATS } else { TRIFLE_NATS };
        let mut loss = Loss { fitter: self, simulator, model, free, moving, wanted, corrected, trifle_nats };
        descend(&mut loss, place, &Pace { steps: iterations, ..PACE }).at
    }

    /// The derivatives at a fit.
    pub fn slopes(
        &self,
        simulator: &Simulator<'_>,
        free: &[Free],
        moving: &[usize],
        at: &Fit<'_>,
        residual: &[f64],
        wanted: Wanted<'_>,
    ) -> Slopes {
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); moving.len()];
        // The last stages first: what lies before them is kept from the fit's own simulation.
        let mut simulated: Vec<(usize, f64, Vec<f64>)> = Vec::new();
        for (place, k) in moving.iter().enumerate().rev() {
            if let Wanted::Rough(near) = wanted {
                if self.slope_at_rest(*k, at, residual, &mut columns[place]) {
                    continue;
                }
                if let Some(column) = near.and_then(|near| near.column(*k)) {
                    columns[place].extend_from_slice(column);
                    continue;
                }
            }
            let (free, here) = (&free[*k], at.theta[*k]);
            let mut ahead = shifted(free, here, free.step);
            if ahead == here {
                ahead = shifted(free, here, -free.step);
            }
            let width = free.distance(here, ahead);
            if free.is_still() || width == 0.0 {
                columns[place].resize(residual.len(), 0.0);
                continue;
            }
            let mut theta = at.theta.clone();
            theta[*k] = ahead;
            simulated.push((place, width, theta));
        }
        // Each group from what the fit's own simulation has left.
        let taken: Vec<Vec<Vec<f64>>> = simulated
            .par_chunks(ABREAST)
            .map(|abreast| {
                let thetas: Vec<&[f64]> = abreast.iter().map(|(.., theta)| theta.as_slice()).collect();
                let mut ahead: Vec<Vec<f64>> = abreast.iter().map(|_| Vec::new()).collect();
                self.residuals(&mut simulator.clone(), &at.model, &thetas, &mut ahead);
                for ((_, width, _), column) in abreast.iter().zip(&mut ahead) {
                    for (d, e) in column.iter_mut().zip(residual) {
                        // Derivative of the simulated pressure.
                        let slope = (e - *d) / width;
                        *d = if slope.is_finite() { slope } else { 0.0 };
                    }
                }
                ahead
            })
            .collect();
        for ((place, ..), column) in simulated.iter().zip(taken.into_iter().flatten()) {
            columns[*place] = column;
        }
        Slopes { moving: moving.to_vec(), columns, corrected: 0 }
    }

    /// The derivative of base parameter `k` without a simulation, as it is where nothing after the curves is dynamic: of
    /// the gain and the offset, and of the delay. Nothing for the others.
    fn slope_at_rest(&self, k: usize, at: &Fit<'_>, residual: &[f64], column: &mut Vec<f64>) -> bool {
        let pressure = || self.measured.iter().zip(residual).enumerate().map(|(k, (y, e))| y - e / self.weight(k));
        let known = |slope: f64| if slope.is_finite() { slope } else { 0.0 };
        column.clear();
        match k {
            k if k == AT.gain => column.extend(pressure().map(|p| known((p - at.theta[AT.offset]) / (1.0 + at.theta[AT.gain])))),
            k if k == AT.offset => column.resize(residual.len(), 1.0),
            k if k == AT.late => {
                let per_step = 1.0 / self.evidence.step_s();
                column.push(0.0);
                column.extend(pressure().zip(pressure().skip(1)).map(|(before, p)| known((before - p) * per_step)));
            }
            _ => return false,
        }
        self.weigh(column);
        true
    }

    /// Weighted normal equations J'WJ and J'We of the moving parameters at a fit, with the calibration as further rows.
    pub fn normal_equations(&self, slopes: &Slopes, free: &[Free], at: &Fit<'_>, residual: &[f64]) -> Option<Equations> {
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
        normal.iter().all(|v| v.is_finite()).then_some(Equations { normal, gradient })
    }
}
